"""Time in reports: the axis shared by a run's charts, time spans, and their texts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trackers.observations import NS_PER_S

_LONGEST_CLOCK_NS = 1_000_000 * NS_PER_S
_STEPS_S = (0.1, 0.2, 0.5, 1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 14400, 43200, 86400)
_MOST_TICKS = 14


def time_origin_ns(first_stamp_ns: int) -> int:
    """Return the stamp of 0 s: 0 for a clock that starts with the run, the first stamp for one since 1970."""
    return first_stamp_ns if abs(first_stamp_ns) > _LONGEST_CLOCK_NS else 0


def round_ticks(start_s: float, end_s: float) -> NDArray[np.float64]:
    """Choose round times from start to end [s], at most `_MOST_TICKS` of them."""
    step = next((s for s in _STEPS_S if (end_s - start_s) / s <= _MOST_TICKS), _STEPS_S[-1])
    first = np.ceil(start_s / step - 1e-9)
    return step * np.arange(first, np.floor(end_s / step + 1e-9) + 1) + 0.0  # without −0


def format_time(t: float, decimals: int = 0) -> str:
    """Format a time [s]: `12 s`, or `2:05` from two minutes on."""
    t = round(t, decimals) + 0.0  # no −0
    return f"{t:.{decimals}f} s" if abs(t) < 120 else format_minutes(t, decimals)


def format_minutes(t: float, decimals: int = 0) -> str:
    """Format minutes and seconds: `2:05`."""
    minutes, seconds = divmod(round(abs(t), decimals), 60)
    return f"{'−' if t < 0 else ''}{minutes:.0f}:{seconds:0{3 + decimals if decimals else 2}.{decimals}f}"


WIDTH = 1000
LEFT, RIGHT = 104, 14
"""Width of every chart and of its margins [SVG units]."""


@dataclass(frozen=True)
class TimeAxis:
    """From `start_ns` to `end_ns` along the charts' width; `zero_ns` is the stamp that reads as 0 s."""

    start_ns: int
    end_ns: int
    zero_ns: int

    def x(self, stamps_ns: NDArray[np.int64] | int) -> NDArray[np.float64]:
        """Convert stamps to positions along the axis, same shape."""
        share = (np.asarray(stamps_ns) - self.start_ns) / max(1, self.end_ns - self.start_ns)
        return LEFT + (WIDTH - LEFT - RIGHT) * share

    def seconds(self, stamp_ns: int) -> float:
        """Convert a stamp to seconds since the origin [s]."""
        return (stamp_ns - self.zero_ns) / NS_PER_S

    def format(self, stamp_ns: int) -> str:
        """Format a stamp, to a tenth of a second."""
        return format_time(self.seconds(stamp_ns), decimals=1)

    def grid(self, height: float) -> str:
        """Draw as SVG a line at each round time and the times below, for a chart `height` high without them."""
        end = self.seconds(self.end_ns)
        ticks = round_ticks(self.seconds(self.start_ns), end)
        places = self.x((ticks * NS_PER_S).astype(np.int64) + self.zero_ns)
        lines = "".join(f"M{x:.1f} 0V{height:.0f}" for x in places)
        texts = "".join(
            f'<text class="axis" x="{x:.1f}" y="{height + 15:.0f}" text-anchor="middle">'
            f"{format_minutes(t) if end >= 120 else format_time(t, 0 if float(t).is_integer() else 1)}</text>"
            for x, t in zip(places, ticks, strict=True)
        )
        return f'<path class="grid" d="{lines}"/>{texts}'

    def chart(self, height: float, body: str, label: str) -> str:
        """Wrap `body` as a whole chart `height` high plus the axis; `label` is read by screen readers."""
        span = f'data-start="{self.seconds(self.start_ns):.3f}" data-end="{self.seconds(self.end_ns):.3f}"'
        return (
            f'<svg class="timed" viewBox="0 0 {WIDTH} {height + 22:.0f}" role="img" aria-label="{label}" {span}>'
            f"{self.grid(height)}{body}"
            f'<g class="cursor" visibility="hidden"><path d="M0 0V{height:.0f}"/>'
            f'<text y="{height + 15:.0f}"></text></g></svg>'
        )


_GAP_FACTOR = 1.5


@dataclass(frozen=True)
class Span:
    """Span from `start_ns` to `end_ns`; `label`: a track id or a level, 0 if unlabelled."""

    start_ns: int
    end_ns: int
    label: int = 0


def median_period_ns(*frame_stamps_ns: NDArray[np.int64]) -> int:
    """Compute the median period of frames [ns], of the slowest of several tables; 0.1 s if unknown.

    The slowest, because truth is written at the stamps of every sensor, denser and less even than a tracker's frames.
    """
    return max((int(np.median(np.diff(stamps))) for stamps in frame_stamps_ns if stamps.size > 1), default=100_000_000)


def split_at_gaps(
    stamps_ns: NDArray[np.int64], period_ns: int, labels: NDArray[np.int64] | None = None
) -> list[NDArray[np.intp]]:
    """Split the indices of samples (ascending stamps) into pieces of one label without a gap above 1.5 periods."""
    if stamps_ns.size == 0:
        return []
    breaks = np.diff(stamps_ns) > _GAP_FACTOR * period_ns
    if labels is not None:
        breaks |= np.diff(labels) != 0
    return np.split(np.arange(stamps_ns.size), np.flatnonzero(breaks) + 1)


def spans_of(stamps_ns: NDArray[np.int64], period_ns: int, labels: NDArray[np.int64] | None = None) -> list[Span]:
    """Convert samples to spans, half a period on either side; a gap above 1.5 periods or another label ends one."""
    half = period_ns // 2
    return [
        Span(
            int(stamps_ns[piece[0]]) - half,
            int(stamps_ns[piece[-1]]) + half,
            0 if labels is None else int(labels[piece[0]]),
        )
        for piece in split_at_gaps(stamps_ns, period_ns, labels)
    ]


def subtract_spans(whole: Sequence[Span], parts: Sequence[Span], shortest_ns: int) -> list[Span]:
    """Subtract `parts` from `whole` (each in order, without overlap); keep pieces above `shortest_ns`."""
    left = []
    for span in whole:
        start = span.start_ns
        for part in parts:
            if part.end_ns <= start or part.start_ns >= span.end_ns:
                continue
            if part.start_ns - start > shortest_ns:
                left.append(Span(start, part.start_ns, span.label))
            start = max(start, part.end_ns)
        if span.end_ns - start > shortest_ns:
            left.append(Span(start, span.end_ns, span.label))
    return left
