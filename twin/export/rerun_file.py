"""rerun: one `.rrd` per recording, with room, sensors, scans, pictures, depth, floor, truth and tracks on one timeline `t`.

Needs `rerun-sdk` (`pip install -e '.[rerun]'` in the checkout). `rerun FILE.rrd` opens it, in a browser with `--web-viewer`.
Entities: /room is the room's frame [m], /room/sensors/NAME a sensor's; depth pictures stand under their lens, so that the viewer
makes points of them. Pictures of lenses that rerun cannot project (fisheye) stand alone under /pictures.
"""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull

from trackers.arrays import Array
from trackers.errors import InputError
from trackers.observations import NS_PER_S, FloorFrame, LaserScan
from trackers.rig import CameraSensor, FloorSensor, PinholeSensor, Rig, StereoSensor
from twin.export.labels import boxes_in, upright_heights
from twin.export.pictures import ExportedPicture, Recorded, pictures
from twin.geometry.geom_hull import hull_points
from twin.recording.tables import TrackTable
from twin.truth.truth_types import TruthFrame
from twin.world.world import World

_TALL_M = 1.9
"""Height above which objects, which would hide the people, are drawn by their edges only [m]."""
_TRUTH_RADIUS_M, _TRACK_RADIUS_M = 0.22, 0.15
_COLOURS = ((31, 119, 180), (255, 127, 14), (44, 160, 44), (214, 39, 40), (148, 103, 189))
_SCAN_COLOURS = ((230, 90, 60), (240, 180, 40), (60, 180, 220), (160, 110, 220))


def export_rerun(recordings: Sequence[Recorded], out: Path) -> None:
    """Write `SEQUENCE.rrd` per recording. Raises InputError where rerun-sdk is not installed."""
    try:
        rerun = importlib.import_module("rerun")
    except ImportError as error:
        raise InputError(
            f"--format rerun: rerun-sdk is not installed ({error}); pip install -e '.[rerun]' in the checkout installs it"
        ) from error
    for recorded in recordings:
        _RerunFile(rerun, recorded).write(out / f"{recorded.name}.rrd")


class _RerunFile:
    """Writer of one recording as it is read."""

    def __init__(self, rerun: Any, recorded: Recorded) -> None:
        self._rerun, self._recorded = rerun, recorded
        self._rig: Rig = recorded.recording.rig
        self._stream = rerun.RecordingStream("roomtwin", recording_id=recorded.name, send_properties=False)
        self._boxes = boxes_in(recorded)
        self._scan_colour = dict(zip(self._rig.lasers(), _SCAN_COLOURS * 25, strict=False))

    def write(self, path: Path) -> None:
        """Write the file."""
        self._stream.set_log_time_enabled(False)
        self._stream.set_log_tick_enabled(False)
        self._stream.save(path, default_blueprint=self._blueprint())
        self._stream.log("room", self._rerun.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        self._room()
        for name in self._rig.sensors:
            self._sensor(name)
        recording = self._recorded.recording
        cameras = self._rig.cameras()
        for picture in pictures(self._recorded, cameras, depth=True):
            self._picture(picture, cameras[picture.camera])
        topic_types = set(self._rig.sensors) - set(cameras)
        if topic_types:
            for observation in recording.observations(only=topic_types):
                self._at(observation.stamp_ns)
                if isinstance(observation, LaserScan):
                    self._scan(observation)
                elif isinstance(observation, FloorFrame):
                    self._floor(observation)
        for frame in self._recorded.truth():
            self._truth(frame)
        for name, table in self._recorded.tracks.items():
            self._tracks(name, table)
        self._stream.flush()
        self._stream.disconnect()

    def _at(self, stamp_ns: int) -> None:
        self._stream.set_time("t", duration=stamp_ns / NS_PER_S)

    def _blueprint(self) -> Any:
        blueprint = importlib.import_module("rerun.blueprint")
        flat = [
            blueprint.Spatial2DView(origin=_picture_path(name, camera), name=name)
            for name, camera in self._rig.cameras().items()
        ]
        room = blueprint.Spatial3DView(origin="room", name=self._recorded.name)
        whole = blueprint.Horizontal(room, blueprint.Vertical(*flat), column_shares=[2, 1]) if flat else room
        return blueprint.Blueprint(whole, collapse_panels=True)

    def _room(self) -> None:
        """Log the room's objects: low ones as solids, tall ones and the tracked area by their edges."""
        if self._rig.area is not None:
            corners = np.column_stack(
                [np.array([*self._rig.area, self._rig.area[0]]), np.full(len(self._rig.area) + 1, 0.01)]
            )
            self._stream.log(
                "room/area", self._rerun.LineStrips3D([corners], colors=[(90, 200, 90)], radii=0.01), static=True
            )
        if self._recorded.scenario is None:
            return
        try:
            world = World(self._recorded.scenario.model_copy(update={"people": {}}))
        except InputError as error:
            self._recorded.on_warning(f"the room is left out: {error}")
            return
        model, data = world.scene.model, world.empty_snapshot(0.0).data
        edges = []
        for geom in range(model.ngeom):
            corners = hull_points(model, data, geom) if model.geom_rgba[geom, 3] > 0 else None
            if corners is None or np.ptp(corners, axis=0).min() < 1e-6 or corners[:, 2].max() < 0.02:
                continue
            hull = ConvexHull(corners)
            if corners[:, 2].max() >= _TALL_M:
                flat = corners[:, :2][ConvexHull(corners[:, :2]).vertices]
                for z in (corners[:, 2].min(), corners[:, 2].max()):
                    edges.append(np.column_stack([flat, np.full(len(flat), z)])[[*range(len(flat)), 0]])
                continue
            colour = (255 * model.geom_rgba[geom, :3]).astype(np.uint8)
            mesh = self._rerun.Mesh3D(
                vertex_positions=corners,
                triangle_indices=hull.simplices,
                vertex_colors=np.tile(colour, (len(corners), 1)),
            )
            self._stream.log(f"room/things/{geom}", mesh, static=True)
        self._stream.log(
            "room/walls", self._rerun.LineStrips3D(edges, colors=[(150, 150, 150)], radii=0.008), static=True
        )

    def _sensor(self, name: str) -> None:
        rerun, sensor = self._rerun, self._rig.sensors[name]
        pose = sensor.room_from_sensor
        self._stream.log(
            f"room/sensors/{name}", rerun.Transform3D(translation=pose.translation, mat3x3=pose.rotation), static=True
        )
        if isinstance(sensor, PinholeSensor | StereoSensor):
            lens = sensor.intrinsics
            pinhole = rerun.Pinhole(
                image_from_camera=lens.matrix, resolution=[lens.width, lens.height], image_plane_distance=0.3
            )
            self._stream.log(f"room/sensors/{name}/lens", pinhole, static=True)

    def _picture(self, picture: ExportedPicture, camera: CameraSensor) -> None:
        self._at(picture.stamp_ns)
        path = _picture_path(picture.camera, camera)
        if picture.is_depth:
            depth = self._rerun.EncodedDepthImage(blob=picture.data, media_type="image/png", meter=1000.0)
            self._stream.log(f"room/sensors/{picture.camera}/lens/depth", depth)
            return
        media = "image/jpeg" if picture.suffix == ".jpg" else "image/png"
        self._stream.log(path, self._rerun.EncodedImage(contents=picture.data, media_type=media))
        boxes = self._boxes.get((picture.camera, picture.stamp_ns))
        if boxes is not None:
            found = self._rerun.Boxes2D(
                mins=np.array([(each.left, each.top) for each in boxes]).reshape(-1, 2),
                sizes=np.array([(each.width, each.height) for each in boxes]).reshape(-1, 2),
                labels=[self._recorded.person_names.get(each.id, str(each.id)) for each in boxes],
                colors=[_COLOURS[each.id % len(_COLOURS)] for each in boxes],
            )
            self._stream.log(f"{path}/boxes", found)

    def _scan(self, scan: LaserScan) -> None:
        colour = self._scan_colour[scan.sensor]
        self._stream.log(
            f"room/sensors/{scan.sensor}/scan", self._rerun.Points3D(scan.points, colors=[colour], radii=0.015)
        )

    def _floor(self, frame: FloorFrame) -> None:
        sensor = self._rig.sensors[frame.sensor]
        assert isinstance(sensor, FloorSensor)
        pressed = frame.values > 0
        centres = np.column_stack([sensor.centres[pressed], np.full(int(pressed.sum()), 0.005)])
        shades = frame.values[pressed].astype(int)
        colours = np.column_stack([np.full_like(shades, 255), 220 - shades * 200 // 255, np.full_like(shades, 40)])
        half = np.tile([sensor.pitch_m / 2, sensor.pitch_m / 2, 0.005], (len(centres), 1))
        path = f"room/floors/{frame.sensor}"
        self._stream.log(path, self._rerun.Boxes3D(centers=centres, half_sizes=half, colors=colours, fill_mode="solid"))

    def _truth(self, frame: TruthFrame) -> None:
        self._at(frame.stamp_ns)
        rows = np.array([(each.x, each.y, each.head_z) for each in frame.people]).reshape(-1, 3)
        labels = [self._recorded.person_names.get(each.id, str(each.id)) for each in frame.people]
        colours = [_COLOURS[each.id % len(_COLOURS)] for each in frame.people]
        self._upright("room/truth", rows, _TRUTH_RADIUS_M, labels, colours, "majorwireframe")

    def _tracks(self, tracker: str, table: TrackTable) -> None:
        for stamp_ns, rows in table.frames():
            self._at(stamp_ns)
            places = np.column_stack([table.x[rows], table.y[rows], table.head_z[rows]])
            ids = table.id[rows].tolist()
            colours = [_COLOURS[each % len(_COLOURS)] for each in ids]
            self._upright(
                f"room/tracks/{tracker}", places, _TRACK_RADIUS_M, [f"#{each}" for each in ids], colours, "solid"
            )

    def _upright(
        self, path: str, rows: Array, radius_m: float, labels: list[str], colours: list[tuple[int, ...]], fill: str
    ) -> None:
        """Log cylinders from the floor to the crown; rows: x, y, height of the head (NaN: unknown)."""
        height = upright_heights(rows[:, 2])
        cylinders = self._rerun.Cylinders3D(
            lengths=height, radii=np.full(len(rows), radius_m), centers=np.column_stack([rows[:, :2], height / 2]),
            labels=labels, colors=colours, fill_mode=fill,
        )  # fmt: skip
        self._stream.log(path, cylinders)


def _picture_path(name: str, camera: CameraSensor) -> str:
    """Return the entity of a camera's pictures: under its lens if rerun can project it."""
    return (
        f"room/sensors/{name}/lens/picture" if isinstance(camera, PinholeSensor | StereoSensor) else f"pictures/{name}"
    )
