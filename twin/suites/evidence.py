"""How likely chance alone would make so large a change somewhere: an exact test over all figures of a suite at once.

If a change does not matter, before and now could be swapped in any recording: that turns the signs of all its differences, of
all trackers and figures together. (In any unit of chance: recordings of the same people before the same noise are one.) So
every test's statistic is worked out for all ways to give the units signs, or for drawn ones where they are too many, and a
test's p is the share of them in which the largest statistic of any test is at least its own (the single-step max-T of Westfall
and Young, Resampling-Based Multiple Testing, 1993). That keeps the chance of any false alarm, however trackers, figures and
tests depend on each other, and costs no power where they do.

What the statistics are is the caller's choice; they are to have one scale, or the noisiest hides the others.
"""

from __future__ import annotations

import numpy as np

from trackers.arrays import Array
from twin.streams import stream

ALPHA = 0.05
"""The chance of a false alarm anywhere in a suite."""
_MOST_EXACT = 12
"""Up to so many changed units all signs are tried: 4096 ways."""
_MOST_AT_ONCE = 5_000_000
"""Statistics held at once."""
_ROUNDING = 1e-9


def family_wise_p(shares: Array) -> Array:
    """The p of each of t tests (t,), one-sided: how likely chance makes any statistic as large as this one.

    shares (u, t): what each of u units of chance adds to each statistic, positive for the worse, 0 where it takes no part.
    """
    changed = shares[(shares != 0).any(axis=1)]
    if not len(changed):
        return np.ones(shares.shape[1])
    signs = _signs(len(changed))
    largest = np.empty(len(signs))
    step = max(1, _MOST_AT_ONCE // max(1, shares.shape[1]))
    for first in range(0, len(signs), step):
        largest[first : first + step] = (signs[first : first + step] @ changed).max(axis=1)
    statistic = changed.sum(axis=0)
    as_large = np.searchsorted(np.sort(largest), statistic - _ROUNDING * np.abs(statistic).max())
    return 1 - as_large / len(signs)


def fewest_for_an_alarm() -> int:
    """Recordings that all have to get worse before their number alone is evidence."""
    return int(np.ceil(-np.log2(ALPHA)))


def _signs(count: int) -> Array:
    """Signs to try (f, count), the ones as observed first."""
    if count <= _MOST_EXACT:
        bits = np.arange(2**count)[:, None] >> np.arange(count) & 1
        return 1.0 - 2.0 * bits.astype(float)
    drawn = stream(count, "suite", "signs").integers(0, 2, size=(2**_MOST_EXACT, count))
    drawn[0] = 0
    return 1.0 - 2.0 * drawn.astype(float)
