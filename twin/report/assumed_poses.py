"""Assumed poses of sensors in trackers, drawn dashed beside the true ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape

import cv2
import numpy as np
from numpy.typing import NDArray

from trackers.rig import CameraSensor, FloorSensor, Rig, RigSensor
from twin.report.birdseye import SHIFT, FloorView, dashes, fixed_point, svg_path
from twin.report.palette import BOLD, RGB, TAG_PX, Tag, text_width

Piece = tuple[NDArray[np.float64], NDArray[np.float64]]
"""The two ends (2,) of a line [px]."""

_POINTER_PX = 32.0
_RING_PX = 11.0
_DASH_PX, _GAP_PX = 5.0, 5.0
_TURN = np.linspace(0, 2 * np.pi, 17)
_RING = _RING_PX * np.stack([np.cos(_TURN), np.sin(_TURN)], axis=-1)  # every second piece is drawn
_LEVEL = 0.2
"""Least level share of a sensor's axis for drawing its direction."""


@dataclass(frozen=True)
class AssumedPose:
    """Sensor at its true and assumed pose; `off` names the distance and angle between them."""

    name: str
    true: RigSensor
    assumed: RigSensor
    off: str

    @property
    def text(self) -> str:
        """Label on drawings."""
        return f"{self.name} assumed {self.off} off"


def assumed_poses(rig: Rig, true: Rig | None) -> list[AssumedPose]:
    """Find the sensors whose poses differ in the two rigs; none if the true rig is unknown."""
    found = []
    for name, sensor in (true.sensors if true is not None else {}).items():
        assumed = rig.sensors[name]
        here, there = sensor.room_from_sensor, assumed.room_from_sensor
        if here == there:
            continue
        from scipy.spatial.transform import Rotation  # takes a while to load

        apart_m = float(np.linalg.norm(there.translation - here.translation))
        turned_deg = float(np.rad2deg(Rotation.from_matrix(here.rotation.T @ there.rotation).magnitude()))
        off = [f"{_short(apart_m)} m"] * (apart_m > 1e-6) + [f"{_short(turned_deg)}°"] * (turned_deg > 1e-4)
        if off:
            found.append(AssumedPose(name, sensor, assumed, ", ".join(off)))
    return found


def draw_assumed_pose(
    panel: NDArray[np.uint8], view: FloorView, pose: AssumedPose, colours: Mapping[str, RGB], ink: RGB, fill: RGB
) -> Tag:
    """Draw both poses on an RGB panel, in place; return the tag to write last.

    colours: of the sensors that have their own; ink: of the others and of the true pose; fill: of the tag.
    """
    colour = colours.get(pose.name, ink)
    at, there = (view.pixels(each.room_from_sensor.translation[:2]) for each in (pose.true, pose.assumed))
    _lines(panel, [(at, there)], colour, 1)
    if isinstance(pose.assumed, FloorSensor):
        _lines(panel, dashes(view.pixels(pose.assumed.corners), _DASH_PX, _GAP_PX), colour, 1)
    else:
        _lines(panel, list(zip(there + _RING, there + _RING[1:], strict=False))[::2], colour, 1)
    if (along := _ahead(pose.true)) is not None:
        _lines(panel, [(at, at + _POINTER_PX * along)], ink, 2)
    if (along := _ahead(pose.assumed)) is not None:
        starts = np.arange(_RING_PX, _POINTER_PX, _DASH_PX + _GAP_PX)
        _lines(panel, [(there + start * along, there + (start + _DASH_PX) * along) for start in starts], colour, 2)
    cv2.circle(panel, fixed_point(at).tolist(), 5 << SHIFT, ink, -1, cv2.LINE_AA, SHIFT)
    text = pose.text
    return Tag(text, _tag_x(text, float(there[0]), float(at[0]), view.width_px), float(there[1]), fill, colour)


def assumed_poses_svg(view: FloorView, rig: Rig, true: Rig | None) -> str:
    """Draw the assumed poses alone as SVG elements (classes `assumed assumed-name halo`, coloured by the page)."""
    parts = []
    for row, pose in enumerate(assumed_poses(rig, true)):
        x, y = view.pixels(pose.assumed.room_from_sensor.translation[:2])
        outlines = [f'<circle class="assumed" cx="{x:.1f}" cy="{y:.1f}" r="{_RING_PX:g}"/>']
        if isinstance(pose.assumed, FloorSensor):
            outlines = [f'<path class="assumed" d="{svg_path(view.pixels(pose.assumed.corners), closed=True)}"/>']
        elif (along := _ahead(pose.assumed)) is not None:
            ends = np.stack([[x, y] + _RING_PX * along, [x, y] + _POINTER_PX * along])
            outlines.append(f'<path class="assumed" d="{svg_path(ends)}"/>')
        right = _to_the_right(x, view.pixels(pose.true.room_from_sensor.translation[:2])[0], view.width_px)
        parts += outlines
        parts.append(
            f'<text class="assumed-name halo" x="{x + (16 if right else -16):.1f}" y="{y + 4 + 13 * row:.1f}" '
            f'text-anchor="{"start" if right else "end"}">{escape(pose.text)}</text>'
        )
    return "".join(parts)


def _tag_x(text: str, there: float, at: float, width_px: int) -> float:
    """Find the x of a tag's middle that covers neither mark, if it has room there."""
    half = text_width(text, TAG_PX, BOLD) / 2 + 5
    shift = _RING_PX + 5 + half
    right = _to_the_right(there, at, width_px)
    fits = there + shift + half <= width_px if right else there - shift - half >= 0
    return there + (shift if right == fits else -shift)


def _to_the_right(there: float, at: float, width_px: int) -> bool:
    """Choose the side of a label: away from the true pose, or else the one with more room."""
    return there > at if abs(there - at) > 2 else there < width_px / 2


def _short(value: float) -> str:
    return f"{value:.2g}" if value < 10 else f"{value:.0f}"


def _ahead(sensor: RigSensor) -> NDArray[np.float64] | None:
    """Compute a sensor's direction on the drawing, (2,) of length 1; None for a floor and a steep direction."""
    if isinstance(sensor, FloorSensor):
        return None
    axis = 2 if isinstance(sensor, CameraSensor) else 0
    along = sensor.room_from_sensor.rotation[:2, axis] * np.array([1.0, -1.0])
    length = float(np.hypot(*along))
    return along / length if length > _LEVEL else None


def _lines(panel: NDArray[np.uint8], pieces: Sequence[Piece], colour: RGB, width_px: int) -> None:
    ends = [fixed_point(np.stack(piece)) for piece in pieces]
    cv2.polylines(panel, ends, False, colour, width_px, cv2.LINE_AA, SHIFT)
