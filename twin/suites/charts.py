"""Small multiples: one metric of one scenario, with every tracker's mean over seeds, its interval, and each seed's value."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape

from twin.report.metrics_table import format_number
from twin.report.palette import IDENTITY_COLOURS
from twin.suites.metrics import METRICS, format_metric
from twin.suites.results import Group, mean_over_seeds

_SHAPES = (
    "M-4.4 0a4.4 4.4 0 1 0 8.8 0a4.4 4.4 0 1 0 -8.8 0Z",
    "M-4 -4H4V4H-4Z",
    "M0 -5.6L5.6 0L0 5.6L-5.6 0Z",
    "M0 -5.2L5 4H-5Z",
)
"""Disc, square, diamond, triangle: marks that distinguish trackers of equal colour."""

_WIDTH, _LEFT, _RIGHT, _TOP, _ROW, _BOTTOM = 178.0, 8.0, 50.0, 8.0, 20.0, 18.0


@dataclass(frozen=True)
class Scale:
    """Range of values of a metric's axis, the same in every scenario."""

    low: float
    high: float

    def x(self, value: float) -> float:
        """Convert a value to its position on the axis [px]."""
        return _LEFT + (value - self.low) / (self.high - self.low) * (_WIDTH - _LEFT - _RIGHT)


def scale_of(metric: str, groups: Iterable[Group]) -> Scale:
    """Choose a scale that fits every seed of every group; counts start at 0, shares end at 1."""
    values = [value for group in groups for value in group.values(metric)]
    if not values:
        return Scale(0.0, 1.0)
    low, high = min(values), max(values)
    figure = METRICS[metric]
    if figure.better == "less":
        low = min(0.0, low)
    else:
        high = max(1.0, high)
    margin = 0.04 * (high - low) or 0.5
    return Scale(low - margin if figure.better == "more" else low - 0.02 * margin, high + margin)


def colour_of(slot: int) -> int:
    """Return the colour number of the tracker in this slot."""
    return slot % len(IDENTITY_COLOURS)


def marker(slot: int, x: float, y: float, said: str = "") -> str:
    """Draw the marker of the tracker in this slot, as SVG."""
    shape = _SHAPES[slot // len(IDENTITY_COLOURS) % len(_SHAPES)]
    title = f"<title>{said}</title>" if said else ""
    return f'<path class="mean f{colour_of(slot)}" transform="translate({x:.1f} {y:g})" d="{shape}">{title}</path>'


def small_multiple(
    metric: str,
    scale: Scale,
    trackers: Sequence[tuple[str, Group]],
    slots: Mapping[str, int],
    before: Mapping[str, Group],
) -> str:
    """Draw the chart as SVG, one row per tracker (name and group).

    slots: a tracker's index, which determines colour and mark; before: the same group of the baseline.
    """
    height = _TOP + _ROW * len(trackers) + _BOTTOM
    right = _WIDTH - _RIGHT
    parts = [f'<svg viewBox="0 0 {_WIDTH:g} {height:g}" role="img" aria-label="{escape(METRICS[metric].name)}">']
    bottom = height - _BOTTOM
    parts.append(f'<path class="frame" d="M{_LEFT:g} {bottom:g}H{right:g}"/>')
    for value, anchor in ((scale.low, "start"), (scale.high, "end")):
        text = _tick(metric, max(0.0, value) if METRICS[metric].better == "less" else min(1.0, value))
        x = _LEFT if anchor == "start" else right
        parts.append(f'<text class="axis" x="{x:g}" y="{height - 5:g}" text-anchor="{anchor}">{text}</text>')
    for row, (name, group) in enumerate(trackers):
        y = _TOP + _ROW * (row + 0.5)
        parts += _row(metric, scale, y, group, slots[name], before.get(name))
    return "".join(parts) + "</svg>"


def _row(metric: str, scale: Scale, y: float, group: Group, slot: int, before: Group | None) -> list[str]:
    mean = mean_over_seeds(group.values(metric))
    if mean is None:
        return [f'<text class="axis" x="{_WIDTH - 2:g}" y="{y + 4:g}" text-anchor="end">–</text>']
    parts = [
        f'<circle class="seed f{colour_of(slot)}" cx="{scale.x(value):.1f}" cy="{y:g}" r="2.2"><title>seed {seed}: '
        f"{format_metric(metric, value)}</title></circle>"
        for seed, figures in group.seeds.items()
        if (value := figures.get(metric)) is not None
    ]
    old = mean_over_seeds(before.values(metric)) if before is not None else None
    if old is not None:
        x = min(max(scale.x(old.mean), _LEFT), _WIDTH - _RIGHT)
        parts.append(
            f'<path class="before" d="M{x:.1f} {y - 7:g}V{y + 7:g}">'
            f"<title>before: {format_metric(metric, old.mean)}</title></path>"
        )
    if mean.low is not None and mean.high is not None:
        parts.append(
            f'<path class="interval s{colour_of(slot)}" d="M{scale.x(mean.low):.1f} {y:g}H{scale.x(mean.high):.1f}"/>'
        )
        centre, low, high = (format_metric(metric, value) for value in (mean.mean, mean.low, mean.high))
        said = f"{centre}, 95 %: {low} to {high}"
    else:
        said = format_metric(metric, mean.mean)
    parts.append(marker(slot, scale.x(mean.mean), y, said))
    parts.append(f'<text x="{_WIDTH - 2:g}" y="{y + 4:g}" text-anchor="end">{_tick(metric, mean.mean)}</text>')
    return parts


def _tick(metric: str, value: float) -> str:
    return format_number(value, METRICS[metric].decimals or 1)
