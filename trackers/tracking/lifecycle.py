"""When a track is confirmed, coasts, ends and starts: named rules, each a function from the roster to a mask.

Times are integer nanoseconds, as stamps are, so that a rule holds or does not whatever floating-point arithmetic does.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float
from numpy.typing import NDArray

from trackers.arrays import Array, Mask
from trackers.filters.gating import distances
from trackers.observations import NS_PER_S
from trackers.tracking.roster import Roster


def nanoseconds(seconds: Array | float) -> NDArray[np.int64] | np.int64:
    """Seconds as whole nanoseconds, of the same shape."""
    return np.rint(np.asarray(seconds) * NS_PER_S).astype(np.int64)


def measured_now(roster: Roster, ns: int) -> Bool[Mask, "n"]:
    """Whoever was measured at stamp ns; confirmed ones who were not are coasting."""
    return roster.measured_ns == ns


def measured_for_longer(
    roster: Roster, ns: int, after_s: Float[Array, "n"] | float, period_s: float
) -> Bool[Mask, "n"]:
    """Confirmation by time: tentative tracks, measured at ns, for longer than `after_s`.

    Each measurement stands for one scan period, so that a track first measured at this stamp was measured for `period_s`.
    """
    measured_for_ns = ns - roster.born_ns + nanoseconds(period_s)
    return ~roster.confirmed & measured_now(roster, ns) & (measured_for_ns > nanoseconds(after_s))


def lasted_s(since_ns: int, ns: int, before_ns: int) -> float:
    """Time [s] for which a thing first seen at `since_ns` has been seen at `ns`; 0 at first sight.

    Each frame stands for the time since the frame before it (`before_ns`), so that a rule by this time asks for twice as many
    frames of a sensor twice as fast, and jitter of a few milliseconds does not shift it by a whole frame.
    """
    return 0.0 if ns <= since_ns else (ns - since_ns + ns - before_ns) / NS_PER_S


def measured_often(roster: Roster, ns: int, at_least: int) -> Bool[Mask, "n"]:
    """Confirmation by count: tentative tracks, measured at ns, `at_least` times in all."""
    return ~roster.confirmed & measured_now(roster, ns) & (roster.n_measured >= at_least)


def coasting_within(roster: Roster, ns: int, confirmed_s: Array | float, tentative_s: float) -> Bool[Mask, "n"]:
    """Who goes on: last measured no longer ago than `confirmed_s`, tentative ones `tentative_s`."""
    allowed_s = np.where(roster.confirmed, confirmed_s, tentative_s)
    return ns - roster.measured_ns <= nanoseconds(allowed_s)


def clear_of(
    position: Float[Array, "k 2"], bodies: Float[Array, "p 2"], clearance_m: Float[Array, "k"] | float
) -> Bool[Mask, "k"]:
    """Where somebody new may start: measurements farther than `clearance_m` from every body."""
    if len(bodies) == 0:
        return np.ones(len(position), np.bool_)
    return distances(position, bodies).min(axis=1) > clearance_m
