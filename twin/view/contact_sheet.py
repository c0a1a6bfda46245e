"""Contact sheets: the room and every sensor's output at one time, or one scenario under many seeds, with the truth drawn in."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from math import isfinite
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from trackers.errors import InputError
from trackers.observations import NS_PER_S, DepthImage, Image, Observation, Odometry
from trackers.rig import CameraSensor, OdometrySensor, RigSensor
from twin.instant.snapshot import Snapshot
from twin.messages import OnProgress, no_progress
from twin.report.assumed_poses import assumed_poses
from twin.report.birdseye import Site
from twin.report.floor_panel import BACKDROP, INK, FloorPanel, PreviewFrame, TruePoses
from twin.report.palette import (
    BOLD,
    IDENTITY_COLOURS,
    RGB,
    IdentityColours,
    Tag,
    text_width,
    write,
    write_tags,
)
from twin.report.scene_pictures import DARK_NOTE, check_picture_name, render_picture, tile_pictures, write_png
from twin.room.building import room_outline
from twin.room.mjcf import ENOUGH_LIGHT, light_of
from twin.run.feed import true_poses
from twin.scenario import Scenario, load_scenario
from twin.sensors.render import OffscreenRenderer
from twin.truth.truth_types import Box
from twin.view.free_camera import CameraSpace, name_tags, overview
from twin.world.simulation import Simulation

_TILE_PX = (520, 390)
_COLUMNS, _COLUMNS_OF_FOUR, _COLUMNS_WITH_DEPTH = (3,), (2,), (4, 3)
"""With depth the one that leaves fewer tiles empty, of equal ones the first: four keep depth next to its colours."""

_LABEL_PX, _EDGE_PX = 30, 5
_LETTERS_PX = (16, 15, 14, 13, 12, 11)
"""Heights of a label's letters; the largest that fits is used."""
_WHAT = {"fisheye": "fisheye camera", "camera": "pinhole camera", "stereo": "stereo camera", "floor": "pressure floor"}

_FINER = 2
_NO_DEPTH: RGB = (0, 0, 0)
_NO_PICTURE = np.zeros((3, 4, 3), dtype=np.uint8)
_NEAREST_SHARE, _FARTHEST_SHARE = 0.02, 0.98


def write_view(scenario: Scenario, t: float, path: Path) -> tuple[str, ...]:
    """Write a PNG of the scenario at time t [s]: the room, the plan with all scans and floors, and each sensor's output.

    Returns warnings about probably unintended content, one sentence each.

    The truth is drawn in: names over heads, boxes around the visible part of each person in images, positions and headings
    on plans. Depth is coloured, near red, far blue, black without a value. Raises InputError for a time outside the scenario
    and a file that cannot be written.
    """
    check_picture_name(path)
    shown, warnings = drawn_view(scenario, t)
    write_png(path, shown)
    return warnings


def drawn_view(
    scenario: Scenario, t: float, tile_px: tuple[int, int] = _TILE_PX
) -> tuple[NDArray[np.uint8], tuple[str, ...]]:
    """Return the image of `write_view`, RGB (height, width, 3), and its warnings.

    `tile_px`: width and height of each tile. Raises InputError for a time outside the scenario.
    """
    if not (isfinite(t) and 0 <= t < scenario.duration_s):
        raise InputError(f"--at {t:g}: is not in the scenario; 0 up to {scenario.duration_s:g} s is expected")
    with Simulation(scenario, drawn=True) as simulation:
        looks = simulation.look(round(t * NS_PER_S))
        sheet, warnings = Sheet(simulation, t, tile_px), simulation.warnings
        tiles = [
            (f"{scenario.name}, {t:g} s{sheet.light()}", sheet.room()),
            (sheet.plan_label(), sheet.plan(looks, simulation.rig.sensors.keys() - looks.keys())),
        ]
        boxes = simulation.boxes(t)
        on_plan = [name for name, look in looks.items() if not isinstance(look, Image | DepthImage)]
        for name, sensor in simulation.rig.sensors.items():
            if isinstance(sensor, OdometrySensor):
                continue  # shown as the place of the scanners on its base
            what, look = f"{name}: {_what(sensor)}", looks.get(name)
            match look:
                case None if isinstance(sensor, CameraSensor):
                    tiles.append((f"{what}, silent", sheet.camera(_NO_PICTURE, ())))
                case None:
                    tiles.append((f"{what}, silent", sheet.plan({}, [name])))
                case Image():
                    tiles.append((what, sheet.camera(look.rgb, boxes.get(name, ()))))
                case DepthImage():
                    tiles.append((f"{what}, left picture", sheet.camera(look.rgb, boxes.get(name, ()))))
                    said, rgb = _coloured(look.depth_m)
                    tiles.append((f"{name}: depth, {said}", sheet.camera(rgb, boxes.get(name, ()))))
                case _ if len(on_plan) > 1:  # of one alone the plan is the one above
                    tiles.append((what, sheet.plan({name: look})))
    with_depth = any(isinstance(look, DepthImage) for look in looks.values())
    choice = _COLUMNS_WITH_DEPTH if with_depth else _COLUMNS_OF_FOUR if len(tiles) == 4 else _COLUMNS
    columns = min(choice, key=lambda each: -len(tiles) % each)
    return tile_pictures([framed(label, tile) for label, tile in tiles], min(columns, len(tiles)), BACKDROP), warnings


def _what(sensor: RigSensor) -> str:
    """Name the kind of a sensor in words."""
    if sensor.kind == "laser":
        return f"scanner, {sensor.room_from_sensor.translation[2]:.2f} m high"
    return _WHAT[sensor.kind]


def framed(label: str, tile: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Add a label above a tile, and an edge around both."""
    strip = np.full((_LABEL_PX, tile.shape[1], 3), BACKDROP, dtype=np.uint8)
    fitting = (size for size in _LETTERS_PX if text_width(label, size, BOLD) <= tile.shape[1] - 4)
    write(strip, label, 2, _LABEL_PX - 10, INK, next(fitting, _LETTERS_PX[-1]), BOLD)
    edges = [(_EDGE_PX, _EDGE_PX), (_EDGE_PX, _EDGE_PX), (0, 0)]
    framed = np.pad(np.vstack([strip, tile]), edges)
    framed[:_EDGE_PX] = framed[-_EDGE_PX:] = framed[:, :_EDGE_PX] = framed[:, -_EDGE_PX:] = BACKDROP
    return framed


class Sheet:
    """Tiles of one time, all of the same size."""

    def __init__(self, simulation: Simulation, t: float, tile_px: tuple[int, int]) -> None:
        self._simulation, self._tile_px = simulation, tile_px
        self._world = simulation.world
        self._snapshot: Snapshot = self._world.snapshot(t)
        self._names = {number: name for name, number in self._world.scene.ids.items()}
        self._poses: TruePoses | None = true_poses(self._world.truth(round(t * NS_PER_S), {}))
        self._outline = room_outline(self._snapshot.model, self._snapshot.data)
        self._glass = room_outline(self._snapshot.model, self._snapshot.data, glass_only=True)

    def room(self) -> NDArray[np.uint8]:
        """Draw the room from a free place high up that shows most of the people."""
        scene = self._world.scene
        aspect = self._tile_px[0] / self._tile_px[1]
        points = [np.concatenate([scene.area, np.full((len(scene.area), 1), height)], axis=1) for height in (0.1, 1.0)]
        if self._poses is not None and len(self._poses.xy_m):
            here = self._poses.xy_m
            points += [
                np.concatenate([here, np.full((len(here), 1), height)], axis=1) for height in (0.2, 1.0, 1.7)
            ] * 3
        stand = overview(self._snapshot, CameraSpace(self._snapshot, scene.floor), np.concatenate(points), aspect)
        with OffscreenRenderer(self._snapshot.model) as renderer:
            shown = render_picture(renderer, self._snapshot.data, stand, self._tile_px, finer=_FINER)
        write_tags(shown, name_tags(self._world, self._snapshot, stand, self._tile_px))
        return shown

    def light(self) -> str:
        """Return a note if the room is dark, and its image is lit for the eye."""
        return DARK_NOTE if light_of(self._snapshot.model) < ENOUGH_LIGHT else ""

    def plan_label(self) -> str:
        """Return the plan's label."""
        what = "from above: truth, scans, floors"
        return (
            f"{what} as calibrated (dashed)" if assumed_poses(self._simulation.rig, self._simulation.true_rig) else what
        )

    def plan(self, looks: Mapping[str, Observation], silent: Collection[str] = ()) -> NDArray[np.uint8]:
        """Draw the plan with the true people, these scans and floor frames, by the trackers' rig.

        `silent`: sensors without reports, which are labelled.
        """
        rig = self._simulation.rig
        panel = np.zeros((self._tile_px[1], self._tile_px[0], 3), dtype=np.uint8)
        site = Site(rig, self._outline, self._names, self._simulation.true_rig, self._glass)
        bases = {
            name: Odometry(name, 0, np.linalg.inv(rig.sensors[name].room_from_sensor.matrix) @ pose)
            for name, pose in self._snapshot.bases.items()
        }
        frame = PreviewFrame({**looks, **bases}, truth=self._poses, silent=silent)
        FloorPanel(site, *self._tile_px, about=[*looks, *silent]).draw(panel, frame, IdentityColours())
        return panel

    def camera(self, rgb: NDArray[np.uint8], boxes: Sequence[Box]) -> NDArray[np.uint8]:
        """Draw a camera's image, with the box of each visible person."""
        shown, scale, offset = _fitted(rgb, self._tile_px)
        tags = []
        for box in boxes:
            colour = IDENTITY_COLOURS[(box.id - 1) % len(IDENTITY_COLOURS)]
            left, top = offset + scale * np.array([box.left, box.top])
            right, bottom = offset + scale * np.array([box.left + box.width, box.top + box.height])
            cv2.rectangle(shown, (round(left), round(top)), (round(right), round(bottom)), colour, 2)
            tags.append(Tag(self._names[box.id], 0.5 * (left + right), top - 9, colour, INK))
        write_tags(shown, tags, size_px=13)
        return shown


def _coloured(depth_m: NDArray[np.float32]) -> tuple[str, NDArray[np.uint8]]:
    """Colour a depth image, and return the legend."""
    there = depth_m > 0
    if not there.any():
        return "nothing matched", np.zeros((*depth_m.shape, 3), dtype=np.uint8)
    near, far = np.quantile(depth_m[there], [_NEAREST_SHARE, _FARTHEST_SHARE]).tolist()
    share = np.clip((far - depth_m) / max(far - near, 1e-6), 0, 1)
    rgb = np.asarray(cv2.applyColorMap((255 * share).astype(np.uint8), cv2.COLORMAP_TURBO), dtype=np.uint8)[
        ..., ::-1
    ].copy()
    rgb[~there] = _NO_DEPTH
    return f"{near:.1f} m red to {far:.1f} m blue, on {100 * there.mean():.0f} %", rgb


def _fitted(rgb: NDArray[np.uint8], tile_px: tuple[int, int]) -> tuple[NDArray[np.uint8], float, NDArray[np.float64]]:
    """Scale an image into a tile, on black; return its scale and the position of its corner [px]."""
    width, height = tile_px
    scale = min(width / rgb.shape[1], height / rgb.shape[0])
    size = round(rgb.shape[1] * scale), round(rgb.shape[0] * scale)
    finer = cv2.INTER_AREA if scale < 1 else cv2.INTER_NEAREST
    tile = np.full((height, width, 3), BACKDROP, dtype=np.uint8)
    left, top = (width - size[0]) // 2, (height - size[1]) // 2
    tile[top : top + size[1], left : left + size[0]] = cv2.resize(rgb, size, interpolation=finer)
    return tile, scale, np.array([left, top], dtype=float)


_SMALL_TILE_PX = (320, 240)
_SEED_COLUMNS = 3


def write_drawn(
    scenario: str,
    changes: Sequence[str],
    seeds: Sequence[int],
    t: float,
    path: Path,
    *,
    on_progress: OnProgress = no_progress,
) -> tuple[str, ...]:
    """Write a PNG of a scenario at time t [s] under each seed: the room with its people, and the plan with all scans.

    Returns warnings about probably unintended content, one sentence each. Raises InputError for a bad scenario, a time
    outside of it, and a file that cannot be written.
    """
    check_picture_name(path)
    tiles, warnings = [], []
    for number, seed in enumerate(seeds, start=1):
        loaded = load_scenario(scenario, [*changes, f"seed={seed}"])
        with Simulation(loaded, images=False, drawn=True) as simulation:
            looks = simulation.look(round(t * NS_PER_S))
            sheet = Sheet(simulation, t, _SMALL_TILE_PX)
            label = f"seed {seed}: {len(loaded.people)} people, {', '.join(loaded.sensors)}"
            tiles.append(framed(label, np.hstack([sheet.room(), sheet.plan(looks)])))
            warnings += [f"seed {seed}: {warning}" for warning in simulation.warnings]
        on_progress("drawing", number, len(seeds))
    write_png(path, tile_pictures(tiles, min(_SEED_COLUMNS, len(tiles)), BACKDROP))
    return tuple(warnings)
