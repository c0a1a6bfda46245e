"""Video of a scenario's people by a free camera, with the loads on pressure floors drawn in."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from math import isfinite
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from trackers.errors import InputError, valid_names
from trackers.observations import NS_PER_S, FloorFrame, Observation
from trackers.rig import FloorSensor, Rig
from twin.instant.snapshot import Snapshot
from twin.messages import OnProgress, no_progress
from twin.people.population import randomized
from twin.report.birdseye import Site
from twin.report.floor_panel import PRESSED, FloorPanel, PreviewFrame
from twin.report.palette import IdentityColours, write, write_tags
from twin.report.preview import TIME_BASE, VideoFile
from twin.report.scene_pictures import DARK_NOTE, Standpoint, axes_towards, render_picture
from twin.report.sensor_stills import SilenceMonitor
from twin.room.building import room_outline
from twin.room.mjcf import ENOUGH_LIGHT, light_of
from twin.run.feed import true_poses
from twin.scenario import Scenario
from twin.sensors.render import RendererOnDemand
from twin.sensors.render_scene import Mark
from twin.view.activities import verb
from twin.view.free_camera import CameraSpace, FollowCamera, name_tags, overview
from twin.world.scene import Scene, populate
from twin.world.simulation import Simulation
from twin.world.world import World

FPS = 25
_SIZE_PX = (1280, 720)
_PLAN_PX = (300, 240)
_STRIP_PX = 30
_EDGE_PX = 12
_THICK_M = 0.002
_SHOWN_SHARE = 0.92
"""Side of a drawn element over its pitch, so that the floor's joints stay visible."""
_SAMPLE_S = 0.5
_FEET, _HEAD = np.array([0, 0, 0.1]), np.array([0, 0, 0.65])  # the head over the hips [m]
_INK, _STRIP = (232, 236, 242), (17, 20, 26)


def write_video(
    scenario: Scenario,
    path: Path,
    *,
    start_s: float = 0.0,
    end_s: float | None = None,
    follow: str | None = None,
    on_progress: OnProgress = no_progress,
) -> None:
    """Write an MP4 of the people from `start_s` to `end_s` [s] (None: the scenario's end), 25 images per second.

    From a free camera over the tracked area, or one that follows the person `follow`. A corner shows a plan with the output
    of scanners and floors. Raises InputError for times outside the scenario, an unknown or absent person, a name not of a
    video, and a file that cannot be written.
    """
    end_s = scenario.duration_s if end_s is None else end_s
    _check(scenario, path, start_s, end_s, follow)
    with ExitStack() as stack:
        reports = _Reports(scenario, stack)
        world = reports.world
        elements = sum(floor.rows * floor.columns for floor in reports.rig.floors().values()) if reports.rig else 0
        renderer = stack.enter_context(RendererOnDemand(lambda: world.scene.model, most_marks=elements))
        video = stack.enter_context(VideoFile(path, _SIZE_PX, FPS))
        film = _Film(scenario, reports, renderer, _whereabouts(scenario, world.scene, start_s, end_s), follow)
        times = np.arange(round(start_s * FPS), round(end_s * FPS)) / FPS
        for done, t in enumerate(times.tolist()):
            video.encode(film.picture(t), round(done / FPS / TIME_BASE))
            on_progress("pictures", done + 1, len(times))
        if follow is not None and not film.followed:
            raise InputError(
                f"--follow {follow}: is not in the room from {start_s:g} to {end_s:g} s; another time is expected"
            )


def _check(scenario: Scenario, path: Path, start_s: float, end_s: float, follow: str | None) -> None:
    if path.suffix.lower() != ".mp4":
        raise InputError(f"--video {path}: is not the name of a video; a name ending in .mp4 is expected")
    if not (isfinite(start_s) and 0 <= start_s < scenario.duration_s):
        raise InputError(f"--from {start_s:g}: is not in the scenario; 0 up to {scenario.duration_s:g} s is expected")
    if not (isfinite(end_s) and start_s + 1 / FPS <= end_s <= scenario.duration_s):
        raise InputError(
            f"--to {end_s:g}: is not after --from and in the scenario; more than {start_s:g} and at most "
            f"{scenario.duration_s:g} s is expected"
        )
    if follow is not None and follow not in scenario.people:
        raise InputError(f"--follow {follow}: is not in people; {valid_names(follow, scenario.people)}")


def _whereabouts(scenario: Scenario, scene: Scene, start_s: float, end_s: float) -> NDArray[np.float64]:
    """Return feet, hips and heads of all people during a time span, (k, 3) [m]; without people the area's corners."""
    population = populate(randomized(scenario), scene)
    places = []
    for t in np.arange(start_s, end_s, _SAMPLE_S).tolist():
        population.advance(t)
        truth = population.truth(t)
        hips = np.stack([truth.x, truth.y, truth.z], axis=-1)[truth.present]
        places += [hips * [1, 1, 0] + _FEET, hips, hips + _HEAD]
    found = np.concatenate(places)
    return found if len(found) else np.concatenate([scene.area, np.full((len(scene.area), 1), 1.0)], axis=1)


class _Reports:
    """The world, with the newest report of each scanner and floor."""

    def __init__(self, scenario: Scenario, stack: ExitStack) -> None:
        self.newest: dict[str, Observation] = {}
        self.silent: frozenset[str] = frozenset()
        self.rig: Rig | None = None
        self.true_rig: Rig | None = None
        self._to_come: Iterator[Observation] = iter(())
        if any(description.kind in ("laser", "floor") for description in scenario.sensors.values()):
            simulation = stack.enter_context(Simulation(scenario, images=False, drawn=True))
            self.world, self.rig, self.true_rig = simulation.world, simulation.rig, simulation.true_rig
            self._to_come = iter(simulation)
        else:
            self.world = World(scenario)
        self._next = next(self._to_come, None)
        self._silence_monitor = SilenceMonitor(self.rig.sensors if self.rig is not None else ())

    def until(self, t: float) -> None:
        """Add the reports up to time t [s]."""
        while self._next is not None and self._next.stamp_ns <= t * NS_PER_S:
            self._silence_monitor.add(self._next)
            self.newest[self._next.sensor] = self._next
            self._next = next(self._to_come, None)
        self.silent = self._silence_monitor.silent(round(t * NS_PER_S))

    def floors(self) -> dict[str, FloorFrame]:
        """Return the newest frame of each floor that is not silent."""
        return {name: each for name, each in self.heard().items() if isinstance(each, FloorFrame)}

    def heard(self) -> dict[str, Observation]:
        """Return the newest report of each sensor that is not silent."""
        return {name: each for name, each in self.newest.items() if name not in self.silent}

    def floor(self, name: str) -> FloorSensor:
        """Return the grid of a floor at its true pose."""
        assert self.true_rig is not None, "a floor has reported"
        return self.true_rig.floors()[name]


class _Film:
    """Renderer of the video's pictures."""

    def __init__(
        self,
        scenario: Scenario,
        reports: _Reports,
        renderer: RendererOnDemand,
        whereabouts: NDArray[np.float64],
        follow: str | None,
    ) -> None:
        self._reports, self._renderer, self._world = reports, renderer, reports.world
        scene = self._world.scene
        self._title = scenario.name
        snapshot = self._world.empty_snapshot(0.0)
        aspect = _SIZE_PX[0] / (_SIZE_PX[1] - _STRIP_PX)
        room = CameraSpace(snapshot, scene.floor)
        self._stand = overview(snapshot, room, whereabouts, aspect)
        self._follow = follow
        self._follow_camera = None if follow is None else FollowCamera(room, scene.ids[follow], aspect)
        self.followed = False
        self._plan: FloorPanel | None = None
        self._plan_left = follow is None and self._is_fuller_on_the_right(whereabouts)
        if reports.rig is not None:
            outline, glass = (room_outline(snapshot.model, snapshot.data, glass_only=only) for only in (False, True))
            names = {number: name for name, number in scene.ids.items()}
            self._plan = FloorPanel(Site(reports.rig, outline, names, reports.true_rig, glass), *_PLAN_PX)

    def picture(self, t: float) -> NDArray[np.uint8]:
        """Draw the image at time t [s]; times must rise."""
        self._reports.until(t)
        snapshot = self._world.snapshot(t)
        stand = self._stand_at(snapshot)
        size = _SIZE_PX[0], _SIZE_PX[1] - _STRIP_PX
        marks = self._marks()
        shown = render_picture(self._renderer(), snapshot.data, stand, size, marks=marks)
        write_tags(shown, name_tags(self._world, snapshot, stand, size))
        self._lay_plan(shown, t)
        return np.vstack([shown, self._strip(t, light_of(snapshot.model) < ENOUGH_LIGHT)])

    def _stand_at(self, snapshot: Snapshot) -> Standpoint:
        if self._follow_camera is None or self._follow is None:
            return self._stand
        place = self._world.population.names.index(self._follow)
        truth = self._world.population.truth(snapshot.t)
        if truth.present[place]:
            self.followed = True
            self._stand = self._follow_camera.at(snapshot, float(truth.yaw[place]))
        return self._stand

    def _marks(self) -> list[Mark]:
        """Return marks of the loaded elements of the newest floor frames."""
        marks = []
        red, green, blue = (each / 255 for each in PRESSED)
        for name, frame in self._reports.floors().items():
            floor = self._reports.floor(name)
            opacity, centres = np.sqrt(frame.values / 255), floor.centres  # a root, to show small loads too
            pose = floor.room_from_sensor
            yaw = float(np.arctan2(pose.rotation[1, 0], pose.rotation[0, 0]))
            half = 0.5 * _SHOWN_SHARE * floor.pitch_m
            for row, column in np.argwhere(opacity > 0).tolist():
                x, y = centres[row, column].tolist()
                z = float(pose.translation[2]) + 2 * _THICK_M
                alpha = float(opacity[row, column])
                marks.append(Mark((x, y, z), (half, half, _THICK_M), (red, green, blue, alpha), yaw))
        return marks

    def _lay_plan(self, shown: NDArray[np.uint8], t: float) -> None:
        """Draw the plan into an upper corner."""
        if self._plan is None or self._reports.rig is None:
            return
        width, height = _PLAN_PX
        panel = np.zeros((height, width, 3), dtype=np.uint8)
        poses = true_poses(self._world.truth(round(t * NS_PER_S), {}))
        frame = PreviewFrame(self._reports.heard(), truth=poses, silent=self._reports.silent)
        self._plan.draw(panel, frame, IdentityColours())
        left = _EDGE_PX if self._plan_left else _SIZE_PX[0] - _EDGE_PX - width
        shown[_EDGE_PX : _EDGE_PX + height, left : left + width] = panel

    def _is_fuller_on_the_right(self, whereabouts: NDArray[np.float64]) -> bool:
        """Return True where the upper right corner of the fixed camera's image shows more people than the upper left."""
        right, up, forward = axes_towards(self._stand.eye, self._stand.target)
        local = whereabouts - self._stand.eye
        depth = np.maximum(local @ forward, 1e-6)
        side, above = (local @ right) / depth, (local @ up) / depth
        high = above > self._stand.half_height * (1 - 2 * _PLAN_PX[1] / _SIZE_PX[1])
        corner = self._stand.half_height * (_SIZE_PX[0] - 2 * _PLAN_PX[0]) / _SIZE_PX[1]
        return bool((high & (side > corner)).sum() > (high & (side < -corner)).sum())

    def _strip(self, t: float, is_dark: bool) -> NDArray[np.uint8]:
        """Draw the time, a note on a dark room, and the activities."""
        strip = np.full((_STRIP_PX, _SIZE_PX[0], 3), _STRIP, dtype=np.uint8)
        population = self._world.population
        present = population.present(t)
        said = [
            f"{name} {verb(kind, bool(goes))}"
            for name, kind, goes, there in zip(
                population.names, population.doing, population.under_way, present, strict=True
            )
            if there
        ]
        write(strip, f"{self._title}, {t:.1f} s{DARK_NOTE if is_dark else ''}", _EDGE_PX, _STRIP_PX - 10, _INK, 15)
        write(strip, "   ".join(said[:8]), _SIZE_PX[0] - _EDGE_PX, _STRIP_PX - 10, _INK, 15, align="right")
        return strip
