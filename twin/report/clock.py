"""Times as a person reads them: seconds since the start, and round ticks along an axis."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trackers.observations import NS_PER_S

_LONGEST_CLOCK_NS = 1_000_000 * NS_PER_S
_STEPS_S = (0.1, 0.2, 0.5, 1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 14400, 43200, 86400)


def origin_ns(first_stamp_ns: int) -> int:
    """The stamp that reads as 0 s: 0 for a clock that starts with the run, the first stamp for one since 1970."""
    return first_stamp_ns if abs(first_stamp_ns) > _LONGEST_CLOCK_NS else 0


def time_ticks(start_s: float, end_s: float, most: int) -> NDArray[np.float64]:
    """Round times from start to end [s], `most` of them at most."""
    step = next((s for s in _STEPS_S if (end_s - start_s) / s <= most), _STEPS_S[-1])
    first = np.ceil(start_s / step - 1e-9)
    return step * np.arange(first, np.floor(end_s / step + 1e-9) + 1) + 0.0  # −0 would be written as such


def time_text(t: float, decimals: int = 0) -> str:
    """`12 s`, or `2:05` from two minutes on."""
    t = round(t, decimals) + 0.0  # no −0
    return f"{t:.{decimals}f} s" if abs(t) < 120 else minutes_text(t, decimals)


def minutes_text(t: float, decimals: int = 0) -> str:
    """Minutes and seconds: `2:05`."""
    minutes, seconds = divmod(round(abs(t), decimals), 60)
    return f"{'−' if t < 0 else ''}{minutes:.0f}:{seconds:0{3 + decimals if decimals else 2}.{decimals}f}"
