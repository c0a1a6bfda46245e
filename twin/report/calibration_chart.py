"""Calibration curve of stated radii: stated probability against the share found, one line per tracker."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from twin.report.palette import IDENTITY_COLOURS

_SIDE, _LEFT, _TOP, _BOTTOM, _RIGHT = 220.0, 44.0, 10.0, 40.0, 190.0
_TICKS = (0.0, 0.25, 0.5, 0.75, 1.0)

Curve = Sequence[tuple[float, float]]
"""Stated and found shares, by probability."""


def calibration_chart(curves: Sequence[tuple[str, int, Curve]]) -> str:
    """Draw curves as SVG: the name of a tracker, its index among all (for its colour), and its curve.

    On the diagonal a tracker is calibrated; below it is overconfident.
    """
    width, height = _LEFT + _SIDE + _RIGHT, _TOP + _SIDE + _BOTTOM
    parts = [
        f'<svg viewBox="0 0 {width:g} {height:g}" style="max-width:{width:g}px;min-width:0" role="img" '
        'aria-label="Calibration of the stated radii">',
        f'<path class="frame" fill="none" d="M{_x(0):g} {_y(0):g}V{_y(1):g}H{_x(1):g}V{_y(0):g}Z"/>',
        f'<path class="frame" stroke-dasharray="3 3" d="M{_x(0):g} {_y(0):g}L{_x(1):g} {_y(1):g}"/>',
    ]
    for share in _TICKS:
        parts.append(
            f'<text class="axis" x="{_x(share):g}" y="{_y(0) + 15:g}" text-anchor="middle">{100 * share:g}</text>'
            f'<text class="axis" x="{_LEFT - 6:g}" y="{_y(share) + 4:g}" text-anchor="end">{100 * share:g}</text>'
        )
    parts.append(
        f'<text class="axis" x="{_x(0.5):g}" y="{height - 6:g}" text-anchor="middle">claimed [%]</text>'
        f'<text class="axis" transform="translate(11 {_y(0.5):g}) rotate(-90)" text-anchor="middle">found [%]</text>'
    )
    for row, (name, slot, curve) in enumerate(curves):
        colour, y = slot % len(IDENTITY_COLOURS), _TOP + 14 + 18 * row
        points = "L".join(f"{_x(claimed):.1f} {_y(found):.1f}" for claimed, found in curve)
        parts.append(f'<path class="s{colour}" fill="none" stroke-width="2" d="M{points}"/>')
        parts += [
            f'<circle class="f{colour}" cx="{_x(claimed):.1f}" cy="{_y(found):.1f}" r="2.6">'
            f"<title>{escape(name)}: {found:.1%} within what it claims for {claimed:.0%}</title></circle>"
            for claimed, found in curve
        ]
        x = _LEFT + _SIDE + 14
        parts.append(
            f'<path class="s{colour}" stroke-width="3" d="M{x:g} {y - 4:g}h14"/>'
            f'<text x="{x + 20:g}" y="{y:g}">{escape(name)}</text>'
        )
    return "".join(parts) + "</svg>"


def _x(share: float) -> float:
    return _LEFT + share * _SIDE


def _y(share: float) -> float:
    return _TOP + (1 - share) * _SIDE
