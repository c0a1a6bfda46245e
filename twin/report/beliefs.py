"""Sensors that trackers believe elsewhere than they are: the true pose in full, the believed one dashed and labelled."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from trackers.rig import CameraSensor, FloorSensor, Rig, RigSensor
from twin.report.birdseye import SHIFT, FloorView, dashes, fixed_point, svg_path
from twin.report.lettering import BOLD, TAG_PX, Tag, text_width
from twin.report.palette import RGB

Piece = tuple[NDArray[np.float64], NDArray[np.float64]]
"""The two ends (2,) of a line [px]."""

_POINTER_PX = 32.0
_RING_PX = 11.0
_DASH_PX, _GAP_PX = 5.0, 5.0
_TURN = np.linspace(0, 2 * np.pi, 17)
_RING = _RING_PX * np.stack([np.cos(_TURN), np.sin(_TURN)], axis=-1)  # every second piece is drawn
_LEVEL = 0.2
"""A sensor that looks up or down more steeply than this share of its axis that is level has no pointer."""


@dataclass(frozen=True)
class Belief:
    """One sensor as it is and as it is believed; `off` says how far apart the two are."""

    name: str
    true: RigSensor
    believed: RigSensor
    off: str

    @property
    def text(self) -> str:
        """What to write beside it."""
        return f"{self.name} believed {self.off} off"


def beliefs(rig: Rig, true: Rig | None) -> list[Belief]:
    """The sensors whose poses in the two rigs differ; none where the truth is not known."""
    found = []
    for name, sensor in (true.sensors if true is not None else {}).items():
        told = rig.sensors[name]
        here, there = sensor.room_from_sensor, told.room_from_sensor
        apart_m = float(np.linalg.norm(there.translation - here.translation))
        turned_deg = float(np.rad2deg(Rotation.from_matrix(here.rotation.T @ there.rotation).magnitude()))
        off = [f"{_short(apart_m)} m"] * (apart_m > 1e-6) + [f"{_short(turned_deg)}°"] * (turned_deg > 1e-4)
        if off:
            found.append(Belief(name, sensor, told, ", ".join(off)))
    return found


def draw_belief(
    panel: NDArray[np.uint8], view: FloorView, belief: Belief, colours: Mapping[str, RGB], ink: RGB, fill: RGB
) -> Tag:
    """Draw both poses on an RGB panel, in place; gives the tag to write when all is drawn.

    colours: of the sensors that have one of their own; ink: of the others and of what is true; fill: of the tag.
    """
    colour = colours.get(belief.name, ink)
    at, there = (view.pixels(each.room_from_sensor.translation[:2]) for each in (belief.true, belief.believed))
    _lines(panel, [(at, there)], colour, 1)
    if isinstance(belief.believed, FloorSensor):
        _lines(panel, dashes(view.pixels(belief.believed.corners), _DASH_PX, _GAP_PX), colour, 1)
    else:
        _lines(panel, list(zip(there + _RING, there + _RING[1:], strict=False))[::2], colour, 1)
    if (along := _ahead(belief.true)) is not None:
        _lines(panel, [(at, at + _POINTER_PX * along)], ink, 2)
    if (along := _ahead(belief.believed)) is not None:
        starts = np.arange(_RING_PX, _POINTER_PX, _DASH_PX + _GAP_PX)
        _lines(panel, [(there + start * along, there + (start + _DASH_PX) * along) for start in starts], colour, 2)
    cv2.circle(panel, fixed_point(at).tolist(), 5 << SHIFT, ink, -1, cv2.LINE_AA, SHIFT)
    text = belief.text
    return Tag(text, _beside(text, float(there[0]), float(at[0]), view.width_px), float(there[1]), fill, colour)


def beliefs_svg(view: FloorView, rig: Rig, true: Rig | None) -> str:
    """The believed poses alone as SVG elements (classes `believed belief halo`, coloured by the page)."""
    parts = []
    for row, belief in enumerate(beliefs(rig, true)):
        x, y = view.pixels(belief.believed.room_from_sensor.translation[:2])
        outlines = [f'<circle class="believed" cx="{x:.1f}" cy="{y:.1f}" r="{_RING_PX:g}"/>']
        if isinstance(belief.believed, FloorSensor):
            outlines = [f'<path class="believed" d="{svg_path(view.pixels(belief.believed.corners), closed=True)}"/>']
        elif (along := _ahead(belief.believed)) is not None:
            ends = np.stack([[x, y] + _RING_PX * along, [x, y] + _POINTER_PX * along])
            outlines.append(f'<path class="believed" d="{svg_path(ends)}"/>')
        right = _to_the_right(x, view.pixels(belief.true.room_from_sensor.translation[:2])[0], view.width_px)
        parts += outlines
        parts.append(
            f'<text class="belief halo" x="{x + (16 if right else -16):.1f}" y="{y + 4 + 13 * row:.1f}" '
            f'text-anchor="{"start" if right else "end"}">{escape(belief.text)}</text>'
        )
    return "".join(parts)


def _beside(text: str, there: float, at: float, width_px: int) -> float:
    """Where the middle of a tag is that covers neither mark, if it has room there."""
    half = text_width(text, TAG_PX, BOLD) / 2 + 5
    aside = _RING_PX + 5 + half
    right = _to_the_right(there, at, width_px)
    fits = there + aside + half <= width_px if right else there - aside - half >= 0
    return there + (aside if right == fits else -aside)


def _to_the_right(there: float, at: float, width_px: int) -> bool:
    """Whether to write on the right of a believed place: away from the true one, or else where more room is."""
    return there > at if abs(there - at) > 2 else there < width_px / 2


def _short(value: float) -> str:
    return f"{value:.2g}" if value < 10 else f"{value:.0f}"


def _ahead(sensor: RigSensor) -> NDArray[np.float64] | None:
    """Where a sensor looks on the drawing, (2,) of length 1; None for one that looks steeply up or down, and a floor."""
    if isinstance(sensor, FloorSensor):
        return None
    axis = 2 if isinstance(sensor, CameraSensor) else 0
    along = sensor.room_from_sensor.rotation[:2, axis] * np.array([1.0, -1.0])
    length = float(np.hypot(*along))
    return along / length if length > _LEVEL else None


def _lines(panel: NDArray[np.uint8], pieces: Sequence[Piece], colour: RGB, width_px: int) -> None:
    ends = [fixed_point(np.stack(piece)) for piece in pieces]
    cv2.polylines(panel, ends, False, colour, width_px, cv2.LINE_AA, SHIFT)
