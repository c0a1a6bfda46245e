"""The time axis that the charts of a run share, so that a moment stands at the same place in all of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trackers.observations import NS_PER_S
from twin.report.clock import minutes_text, time_text, time_ticks

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
        """Where stamps stand, same shape."""
        share = (np.asarray(stamps_ns) - self.start_ns) / max(1, self.end_ns - self.start_ns)
        return LEFT + (WIDTH - LEFT - RIGHT) * share

    def seconds(self, stamp_ns: int) -> float:
        """A stamp as it reads [s]."""
        return (stamp_ns - self.zero_ns) / NS_PER_S

    def text(self, stamp_ns: int) -> str:
        """A stamp in words, to a tenth of a second."""
        return time_text(self.seconds(stamp_ns), decimals=1)

    def grid(self, height: float) -> str:
        """SVG: a line at each round time and the times below, for a chart `height` high without them."""
        end = self.seconds(self.end_ns)
        ticks = time_ticks(self.seconds(self.start_ns), end, 14)
        places = self.x((ticks * NS_PER_S).astype(np.int64) + self.zero_ns)
        lines = "".join(f"M{x:.1f} 0V{height:.0f}" for x in places)
        texts = "".join(
            f'<text class="axis" x="{x:.1f}" y="{height + 15:.0f}" text-anchor="middle">'
            f"{minutes_text(t) if end >= 120 else time_text(t, 0 if float(t).is_integer() else 1)}</text>"
            for x, t in zip(places, ticks, strict=True)
        )
        return f'<path class="grid" d="{lines}"/>{texts}'

    def chart(self, height: float, body: str, label: str) -> str:
        """A whole chart `height` high plus the axis; `label` is what a screen reader says."""
        span = f'data-start="{self.seconds(self.start_ns):.3f}" data-end="{self.seconds(self.end_ns):.3f}"'
        return (
            f'<svg class="timed" viewBox="0 0 {WIDTH} {height + 22:.0f}" role="img" aria-label="{label}" {span}>'
            f"{self.grid(height)}{body}"
            f'<g class="cursor" visibility="hidden"><path d="M0 0V{height:.0f}"/>'
            f'<text y="{height + 15:.0f}"></text></g></svg>'
        )
