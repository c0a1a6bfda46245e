"""Floor half of the preview: the room from above with scans, loads, hypotheses, tracks and truth."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from math import cos, hypot, isnan, sin
from types import MappingProxyType

import cv2
import numpy as np
from numpy.typing import NDArray

from trackers.observations import FloorFrame, LaserScan, Observation, Odometry
from trackers.rig import FloorSensor
from trackers.tracks import Hypotheses, ScoreMap, Track
from twin.report.assumed_poses import assumed_poses, draw_assumed_pose
from twin.report.birdseye import (
    SHIFT,
    FloorColours,
    FloorView,
    ScannerOnFloor,
    Site,
    fixed_point,
    floor_extent,
    paint_room,
)
from twin.report.palette import RGB, IdentityColours, Tag, layer_colours, write, write_tags

BACKDROP: RGB = (17, 20, 26)
INK: RGB = (232, 236, 242)
QUIET: RGB = (140, 148, 160)
DARK_INK: RGB = (10, 12, 16)
_HIDDEN_FLOOR = FloorColours(
    (24, 28, 36), (33, 38, 48), (58, 64, 76), (104, 112, 126), (112, 122, 138), (240, 240, 240), (42, 110, 136)
)
_VISIBLE_FLOOR = FloorColours(
    (38, 45, 57), (48, 56, 69), (64, 71, 84), (112, 120, 134), (132, 142, 158), (240, 240, 240), (59, 159, 196)
)
SILENT_FILL: RGB = (96, 34, 34)
"""Background of a silent sensor's label."""
_PERSON_RADIUS_M = 0.22
_DOT_M = 0.012
_FAN_LIGHT = 0.08
"""Share of its colour that a scanner adds to the floor it sees."""

# A scan return as a soft 3 × 3 px dot, the opaque middle last.
_DOT_X = np.array([-1, 1, -1, 1, 0, -1, 1, 0, 0])
_DOT_Y = np.array([-1, -1, 1, 1, -1, 0, 0, 1, 0])
_DOT_OPACITY = np.array([0.35, 0.35, 0.35, 0.35, 0.75, 0.75, 0.75, 0.75, 1.0], dtype=np.float32)


@dataclass(frozen=True, eq=False)
class TruePoses:
    """True poses of people in one frame, in the room frame: xy [m], yaw of the trunk [rad] (NaN: unknown)."""

    ids: NDArray[np.int64]  # (n,)
    xy_m: NDArray[np.float64]  # (n, 2)
    yaw_rad: NDArray[np.float64]  # (n,)


@dataclass(frozen=True, eq=False)
class PreviewFrame:
    """Content of one frame: the newest observation of each reporting sensor, and of a tracker tracks and maps.

    truth: None if unknown; silent: sensors that stopped reporting, which are labelled.
    """

    newest: Mapping[str, Observation]
    tracks: Sequence[Track] = ()
    truth: TruePoses | None = None
    silent: Collection[str] = ()
    maps: Sequence[ScoreMap | Hypotheses] = ()


class FloorPanel:
    """The room from above with scans, tracks and truth.

    Scans and floors are drawn at the rig's assumed poses, as a tracker uses them. The sensors of the true rig are drawn, if
    known, and those assumed elsewhere once more, dashed and labelled (`about`: of these alone). `layers`: colour of each
    scanner.
    """

    def __init__(self, site: Site, width_px: int, height_px: int, about: Collection[str] | None = None) -> None:
        rig = site.rig
        self.width_px, self.height_px = width_px, height_px
        self.layers = layer_colours(rig.lasers())
        self._rig, self._outline, self._glass, self._names = rig, site.outline, site.glass, site.person_names
        self._true, self._shown = site.true_rig or rig, site.shown
        poses = assumed_poses(rig, site.true_rig)
        self._assumed_poses = [each for each in poses if about is None or each.name in about]
        self._scanners = ScannerOnFloor.of(rig)
        self._view: FloorView | None = None
        self._has_extent = bool(site.outline) or rig.area is not None or site.shown is not None
        self._hidden_floor = self._visible_floor = np.zeros((height_px, width_px, 3), dtype=np.uint8)
        self._mask = np.zeros((height_px, width_px), dtype=np.uint8)
        self._light = np.zeros_like(self._visible_floor)

    def _paint(self, scans: Mapping[str, LaserScan]) -> FloorView:
        """Paint the static parts. A robot's bag has no room: its first scans with a return set the extent."""
        reach = [self._scanners[name].reach(scan) for name, scan in scans.items()]
        self._has_extent |= any(len(points) for points in reach)
        extent = floor_extent(self._true, self._outline, *reach) if self._shown is None else self._shown
        view = FloorView.fit(extent, self.width_px, self.height_px)
        self._hidden_floor, self._visible_floor = self._hidden_floor.copy(), self._visible_floor.copy()
        paint_room(self._hidden_floor, view, self._true, self._outline, _HIDDEN_FLOOR, self._glass)
        paint_room(self._visible_floor, view, self._true, self._outline, _VISIBLE_FLOOR, self._glass)
        for floor in self._true.floors().values():
            draw_grid(self._hidden_floor, view, floor, _HIDDEN_FLOOR.grid)
            draw_grid(self._visible_floor, view, floor, _VISIBLE_FLOOR.grid)
        return view

    def draw(
        self,
        panel: NDArray[np.uint8],
        frame: PreviewFrame,
        colours: IdentityColours,
        tails: Mapping[int, Sequence[tuple[int, float, float]]] = MappingProxyType({}),
    ) -> None:
        """Draw one frame on `panel`: scans from where their base is, loads, truth, tracks; its hypotheses are dots.

        tails: earlier stamps [ns] and positions x, y [m] of tracks.
        """
        scans = {name: each for name, each in frame.newest.items() if isinstance(each, LaserScan)}
        for each in frame.newest.values():
            if isinstance(each, Odometry):
                self._scanners |= ScannerOnFloor.of(self._rig, each)
        if self._view is None or not self._has_extent:
            self._view = self._paint(scans)
        view = self._view
        panel[:] = self._hidden_floor
        self._draw_free_space(panel, view, scans)
        for name, each in frame.newest.items():
            if isinstance(each, FloorFrame):
                draw_pressure(panel, view, self._rig.floors()[name], each)
        if frame.truth is not None:
            _draw_truth(panel, view, frame.truth, self._names)
        for name, scan in scans.items():
            _draw_points(panel, view.pixels(self._scanners[name].points(scan)), self.layers[name])
        for name in self._rig.mounted().keys() & self._scanners.keys():
            centre = fixed_point(view.pixels(self._scanners[name].place)).tolist()
            cv2.circle(panel, centre, 5 << SHIFT, _VISIBLE_FLOOR.sensor, -1, cv2.LINE_AA, SHIFT)
        for track in frame.tracks:
            if track.id in tails:
                _draw_tail(panel, view.pixels(np.array(tails[track.id])[:, 1:]), colours[track.id])
        tags = [
            draw_assumed_pose(panel, view, pose, self.layers, _VISIBLE_FLOOR.sensor, DARK_INK)
            for pose in self._assumed_poses
        ]
        tags += [self._silent_tag(view, name) for name in sorted(frame.silent)]
        tags += [_draw_track(panel, view, track, colours[track.id]) for track in frame.tracks]
        for found in frame.maps:
            if isinstance(found, Hypotheses):
                _draw_places(panel, view, np.asarray(found.places, float), _mix(colours[found.id], INK, 0.6))
        write_tags(panel, tags)

    def _silent_tag(self, view: FloorView, name: str) -> Tag:
        x, y = view.pixels(self._true.pose_at(name).translation[:2])
        return Tag(f"{name} silent", float(x), float(y) + 18, SILENT_FILL, INK)

    def _draw_free_space(self, panel: NDArray[np.uint8], view: FloorView, scans: Mapping[str, LaserScan]) -> None:
        """Lighten the floor that any scanner sees through, tinted by each scanner's colour."""
        fans = {
            name: fixed_point(view.pixels(self._scanners[name].free_space(scan, view.drawable_m)))
            for name, scan in scans.items()
        }
        self._mask[:] = 0
        for fan in fans.values():
            cv2.fillPoly(self._mask, [fan], 255, cv2.LINE_8, SHIFT)
        cv2.copyTo(self._visible_floor, self._mask, panel)
        for name, fan in fans.items():
            self._light[:] = 0
            cv2.fillPoly(
                self._light, [fan], tuple(_FAN_LIGHT * value for value in self.layers[name]), cv2.LINE_8, SHIFT
            )
            cv2.add(panel, self._light, panel)


def _draw_truth(panel: NDArray[np.uint8], view: FloorView, truth: TruePoses, names: Mapping[int, str]) -> None:
    radius = _PERSON_RADIUS_M * view.scale
    centres = view.pixels(truth.xy_m)
    for person, centre, yaw in zip(truth.ids.tolist(), centres, truth.yaw_rad.tolist(), strict=True):
        cv2.circle(panel, fixed_point(centre).tolist(), round(radius * (1 << SHIFT)), INK, 1, cv2.LINE_AA, SHIFT)
        if not isnan(yaw):
            facing = np.array([cos(yaw), -sin(yaw)])
            ends = fixed_point(np.stack([centre + 0.75 * radius * facing, centre + 1.35 * radius * facing]))
            cv2.line(panel, ends[0].tolist(), ends[1].tolist(), INK, 2, cv2.LINE_AA, SHIFT)
        write(panel, names.get(person, str(person)), centre[0], centre[1] + radius + 15, QUIET, 13, align="centre")


def _draw_points(panel: NDArray[np.uint8], pixels: NDArray[np.float64], colour: RGB) -> None:
    x, y = np.floor(pixels).astype(np.intp).T
    height, width = panel.shape[:2]
    inside = (x >= 1) & (x < width - 1) & (y >= 1) & (y < height - 1)
    x, y = (x[inside] + _DOT_X[:, None]).ravel(), (y[inside] + _DOT_Y[:, None]).ravel()
    below = panel[y, x]
    opacity = np.repeat(_DOT_OPACITY, np.count_nonzero(inside))[:, None]
    # Where dots overlap, the more opaque one, written last, stays.
    panel[y, x] = (below + opacity * (np.array(colour, dtype=np.float32) - below)).astype(np.uint8)


def _draw_places(panel: NDArray[np.uint8], view: FloorView, places: NDArray[np.float64], colour: RGB) -> None:
    radius = max(1, round(_DOT_M * view.scale))
    for at in np.rint(view.pixels(places[:, :2])).astype(int).tolist():
        cv2.circle(panel, at, radius, colour, -1)


def _draw_tail(panel: NDArray[np.uint8], tail: NDArray[np.float64], colour: RGB) -> None:
    half = len(tail) // 2
    faint = _mix(colour, _VISIBLE_FLOOR.floor, 0.6)
    cv2.polylines(panel, [fixed_point(tail[: half + 1])], False, faint, 1, cv2.LINE_AA, SHIFT)
    cv2.polylines(
        panel, [fixed_point(tail[half:])], False, _mix(colour, _VISIBLE_FLOOR.floor, 0.25), 2, cv2.LINE_AA, SHIFT
    )


def _draw_track(panel: NDArray[np.uint8], view: FloorView, track: Track, colour: RGB) -> Tag:
    """Draw a track; return the tag to write when all are drawn."""
    centre = view.pixels(np.array([track.x, track.y]))
    radius = max(7.0, 0.55 * _PERSON_RADIUS_M * view.scale)
    at, size = fixed_point(centre).tolist(), round(radius * (1 << SHIFT))
    if np.isfinite(track.vx) and np.isfinite(track.vy) and hypot(track.vx, track.vy) > 0.1:
        # The arrow ends at the position in 0.4 s.
        tip = view.pixels(np.array([track.x + 0.4 * track.vx, track.y + 0.4 * track.vy]))
        along = (tip - centre) / max(hypot(*(tip - centre)), 1e-6)
        tip = tip + radius * along
        wing = np.array([-along[1], along[0]])
        head = np.stack([tip, tip - 8 * along + 5 * wing, tip - 8 * along - 5 * wing])
        stem = fixed_point(np.stack([centre, tip - 6 * along]))
        cv2.line(panel, stem[0].tolist(), stem[1].tolist(), colour, 2, cv2.LINE_AA, SHIFT)
        cv2.fillPoly(panel, [fixed_point(head)], colour, cv2.LINE_AA, SHIFT)
    if track.status == "confirmed":
        cv2.circle(panel, at, size, colour, -1, cv2.LINE_AA, SHIFT)
    else:
        cv2.circle(panel, at, size, _mix(colour, _VISIBLE_FLOOR.floor, 0.7), -1, cv2.LINE_AA, SHIFT)
        dashed_loop(panel, centre + radius * _CIRCLE, colour)
    cv2.circle(panel, at, size, DARK_INK, 1, cv2.LINE_AA, SHIFT)
    situation = track.situation if track.situation != "apart" else ""  # the usual case
    return track_tag(track, float(centre[0]), float(centre[1]) - radius - 14, colour, situation)


_CIRCLE = np.stack([np.cos(np.linspace(0, 2 * np.pi, 24)), np.sin(np.linspace(0, 2 * np.pi, 24))], axis=-1)


def dashed_loop(panel: NDArray[np.uint8], loop: NDArray[np.float64], colour: RGB) -> None:
    """Draw every second piece of a closed line (k, 2) [px]."""
    corners = fixed_point(loop)
    pieces = [np.stack([corners[i], corners[(i + 1) % len(corners)]]) for i in range(0, len(corners), 2)]
    cv2.polylines(panel, pieces, False, colour, 2, cv2.LINE_AA, SHIFT)


def track_tag(track: Track, x: float, y: float, colour: RGB, situation: str = "") -> Tag:
    """Make the tag of a track: its id and situation, in its colour, paler while it coasts."""
    fill = _mix(colour, DARK_INK, 0.3 if track.status == "confirmed" else 0.7)
    return Tag(f"#{track.id} {situation}".strip(), x, y, fill, INK)


def _mix(colour: RGB, other: RGB, share: float) -> RGB:
    red, green, blue = (round(a + share * (b - a)) for a, b in zip(colour, other, strict=True))
    return red, green, blue


PRESSED: RGB = (255, 120, 70)
_STRONGEST = 0.95
_FULL_SCALE = 255.0


def draw_pressure(panel: NDArray[np.uint8], view: FloorView, floor: FloorSensor, frame: FloorFrame) -> None:
    """Draw the loaded elements of a pressure floor over the room, in place, brighter for more load."""
    values = frame.values.astype(np.float32) / _FULL_SCALE
    opacity = _STRONGEST * np.sqrt(values)
    # the grid is an image of one pixel per element, mapped affinely to the drawing
    origin, along_x, along_y = view.pixels(floor.corners[[0, 1, 3]])
    matrix = np.stack([(along_x - origin) / floor.columns, (along_y - origin) / floor.rows, origin], axis=1)
    matrix[:, 2] += matrix[:, :2] @ [0.5, 0.5] - 0.5  # pixel coordinates are those of their centres
    height, width = panel.shape[:2]
    laid = cv2.warpAffine(opacity, matrix, (width, height), flags=cv2.INTER_NEAREST)[..., None]
    panel[:] = (panel + laid * (np.array(PRESSED, dtype=np.float32) - panel)).astype(np.uint8)


def draw_grid(panel: NDArray[np.uint8], view: FloorView, floor: FloorSensor, colour: RGB) -> None:
    """Draw the lines between a floor's elements, in place."""
    corner, along_x, _, along_y = view.pixels(floor.corners)
    for count, across, along in ((floor.columns, along_x, along_y), (floor.rows, along_y, along_x)):
        for place in np.linspace(0, 1, count + 1):
            start = corner + place * (across - corner)
            end = start + (along - corner)
            cv2.line(panel, np.rint(start).astype(int).tolist(), np.rint(end).astype(int).tolist(), colour, 1)
