"""Clocks of tables: a tracker's period, due frames that it did not report, and the truth at any stamps."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from trackers.area import wrap_angle
from trackers.observations import NS_PER_S
from twin.recording.tables import TRUTH_NUMBERS, TrackTable, TruthTable

SILENCE_FACTOR = 1.5
USUAL_SHARE = 0.8  # share of the gaps between frames: what most gaps are
NEARLY_ALL = 0.95  # share of the gaps: with several clocks, a usual gap may be this long
SINGLE_SHARE = 2 / 3  # share of the gaps: above this share of single periods a tracker has one clock
SHARED_SINGLE_SHARE = 0.4  # the same if the tracker reports at the stamps of a truth that has one clock
NOTED_END_SHARE = 0.1  # share of all rows of people that lie beyond a table of tracks, above which a note is made
NOTED_END_S = 2.0  # least time beyond a table of tracks of which a note is made [s]
TICK_SHARE = 0.15  # of a period: greatest deviation of a gap from whole periods, by jitter
MAX_TRUTH_GAP_NS = NS_PER_S // 4
GAP_PERIODS = 2.5  # of a person's usual interval between rows: one row may be missing, not two
JITTER_SHARE = 0.25  # of a period: jitter of a frame due, as of one just outside the truth's span
_ANGLES = ("yaw", "head_yaw")


@dataclass(frozen=True)
class ReportClock:
    """Period of a tracker's reports, and the longest gap between two frames that is no silence [ns]."""

    period_ns: float
    silence_ns: float


def report_clock(track_stamps: NDArray[np.int64], truth_stamps: NDArray[np.int64]) -> ReportClock | None:
    """Estimate a tracker's clock from its stamps (n,); None where neither it nor the truth has two.

    A tracker could leave out difficult frames, so a frame due by its own clock is owed. It has one clock if four of five
    gaps are whole multiples of the median gap, to 15 % of it, and more than two of three are one period long: any gap
    above 1.5 periods is then a silence. With fewer single gaps, left-out frames look like sensors of different rates in
    turn, such as 10 Hz and 5 Hz half a period apart. There the truth decides: if four of five of its gaps are one period,
    and the tracker reports at its stamps and at two of five of its intervals, that period is the tracker's too. Otherwise
    several clocks take turns (see `_clocks_in_turn`).
    """
    stamps = track_stamps if track_stamps.size > 1 else truth_stamps
    gaps = np.diff(stamps)
    if gaps.size == 0:
        return None
    own = float(np.quantile(gaps, 0.5, method="lower"))
    if _is_clock(gaps, own, SINGLE_SHARE):
        return ReportClock(own, SILENCE_FACTOR * own)
    if truth_stamps.size > 1 and np.isin(stamps, truth_stamps).mean() >= USUAL_SHARE:
        truth_gaps = np.diff(truth_stamps)
        shared = float(np.median(truth_gaps))
        if _is_clock(truth_gaps, shared, USUAL_SHARE) and _is_clock(gaps, shared, SHARED_SINGLE_SHARE):
            return ReportClock(shared, SILENCE_FACTOR * shared)
    return _clocks_in_turn(gaps)


def _is_clock(gaps: NDArray[np.int64], period_ns: float, least_single: float) -> bool:
    """Return whether most gaps (n,) are whole multiples of a period, and more than this share of them one period."""
    ticks = np.maximum(np.rint(gaps / period_ns), 1)
    regular = np.mean(np.abs(gaps - ticks * period_ns) <= TICK_SHARE * period_ns)
    return bool(regular >= USUAL_SHARE and np.mean(ticks == 1) > least_single)


def _clocks_in_turn(gaps: NDArray[np.int64]) -> ReportClock:
    """Estimate the clock of a tracker that reports at the stamps of several clocks in turn, from its gaps (n,).

    The gaps of m clocks of period T and any phases are distributed as T times Beta(1, m − 1), the spacings of m points on a
    circle (David and Nagaraja, "Order Statistics", 2003, section 6.4). Mean and variance of that give

        m = (1 + c²) / (1 − c²),   T = m times the mean gap,   c = standard deviation / mean,

    and no gap is longer than T. With very many clocks the longest of n gaps is expected to be (ln n + γ) mean gaps: m is no
    larger. A tracker that waits for scans of several sensors may have rarer gaps longer than T: 19 of 20 are usual too. That is
    fitted to the shortest 19 of 20 gaps, and again to all up to 1.5 T as long as that adds any: so silences are no part of
    it, unless they are more than that. With unlike periods T lies near the shortest. The period is the mean gap fitted.
    """
    rising = np.sort(gaps).astype(np.float64)
    n_fitted = int(np.ceil(NEARLY_ALL * rising.size))
    while True:
        fitted = rising[:n_fitted]
        mean_ns = float(fitted.mean())
        square = min(float(fitted.var()) / mean_ns**2, 1 - 1 / n_fitted)
        n_clock = min((1 + square) / (1 - square), np.log(n_fitted) + np.euler_gamma)
        longest_ns = max(n_clock * mean_ns, float(np.quantile(fitted, NEARLY_ALL)))
        silence_ns = max(SILENCE_FACTOR * longest_ns, float(fitted[-1]))
        n_usual = int(np.searchsorted(rising, silence_ns, side="right"))
        if n_usual == n_fitted:
            return ReportClock(mean_ns, silence_ns)
        n_fitted = n_usual


def with_stamps_between(stamps: NDArray[np.int64], gap_ns: float, period_ns: float) -> NDArray[np.int64]:
    """Add stamps at most a period apart between two of the truth's stamps (n,) no further apart than `gap_ns`."""
    if stamps.size < 2:
        return stamps
    gaps = np.diff(stamps)
    n_part = np.where(gaps <= gap_ns, np.ceil(gaps / period_ns), 1).astype(np.int64)
    before = np.repeat(stamps[:-1], n_part)
    part = np.arange(before.size) - np.repeat(np.cumsum(n_part) - n_part, n_part)
    between = before + (np.repeat(gaps / n_part, n_part) * part).astype(np.int64)
    return np.append(between, stamps[-1])


def silent_stamps(
    truth_stamps: NDArray[np.int64], track_stamps: NDArray[np.int64], clock: ReportClock | None
) -> NDArray[np.int64]:
    """Find the truth's stamps of frames due by the tracker's clock but not reported, ascending.

    In a silence one frame per period is due. Only those within half a period of a stamp of the truth are considered, since a
    silence may last for years.
    """
    if track_stamps.size == 0:
        return truth_stamps
    if clock is None:
        return np.zeros(0, dtype=np.int64)
    period, silent = clock.period_ns, clock.silence_ns
    first, last = int(track_stamps[0]), int(track_stamps[-1])
    start, end = int(truth_stamps[0]), int(truth_stamps[-1])
    wanted: list[NDArray[np.floating]] = [np.zeros(0)]
    before, after = track_stamps[:-1], track_stamps[1:]
    counts = ((after - before) / period + 0.5).astype(np.int64) - 1  # the last at least half a period before `after`
    counts[after - before <= silent] = 0
    inside = truth_stamps[(truth_stamps > first) & (truth_stamps <= last)]
    gap = np.searchsorted(track_stamps, inside, side="left") - 1
    for steps in _steps_near((inside - before[gap]) / period):
        kept = (steps >= 1) & (steps <= counts[gap])
        wanted.append(before[gap[kept]] + steps[kept] * period)
    if first - start > silent:
        n_step = int((first - start) / period + JITTER_SHARE)
        for steps in _steps_near((first - truth_stamps[truth_stamps < first]) / period):
            wanted.append(first - steps[(steps >= 1) & (steps <= n_step)] * period)
    if end - last > silent:
        n_step = int((end - last) / period + JITTER_SHARE)
        for steps in _steps_near((truth_stamps[truth_stamps > last] - last) / period):
            wanted.append(last + steps[(steps >= 1) & (steps <= n_step)] * period)
    times = np.concatenate(wanted)
    if not times.size:
        return np.zeros(0, dtype=np.int64)
    after = np.clip(np.searchsorted(truth_stamps, times), 1, max(truth_stamps.size - 1, 1))
    low, high = truth_stamps[after - 1], truth_stamps[np.minimum(after, truth_stamps.size - 1)]
    nearest = np.where(times - low <= high - times, low, high)
    # In a hole of the truth nothing near the due time can be judged.
    near = nearest[np.abs(nearest - times) <= period / 2]
    return np.setdiff1d(near, track_stamps)


def _steps_near(steps: NDArray[np.float64]) -> list[NDArray[np.int64]]:
    """Round each of these (n,) and return the whole numbers around it, one on either side."""
    whole = np.rint(steps).astype(np.int64)
    return [whole - 1, whole, whole + 1]


def span_of(stamps: NDArray[np.int64]) -> str:
    """Format the span of stamps (n,), ascending."""
    return f"{stamps[0] / NS_PER_S:.3f} to {stamps[-1] / NS_PER_S:.3f} s"


def describe_silence(
    truth: TruthTable, tracks: TrackTable, silent: NDArray[np.int64], n_total: int, clock: ReportClock
) -> str:
    """Return a note on frames due but not reported, of `n_total`; with both spans of time where most are at the ends."""
    theirs = tracks.frame_stamps_ns
    # with a single frame the period is that of the truth
    otherwise = f", though it reports every {clock.period_ns / NS_PER_S:.3g} s otherwise" if theirs.size > 1 else ""
    spans = ""
    if theirs.size and 2 * np.count_nonzero((silent < theirs[0]) | (silent > theirs[-1])) > silent.size:
        spans = f"; its frames span {span_of(theirs)}, those of {truth.source} {span_of(truth.frame_stamps_ns)}"
    return (
        f"{tracks.source}: reports nothing in {silent.size} of {n_total} frames ({silent.size / n_total:.0%}), the first of "
        f"them at {silent[0] / NS_PER_S:.3f} s{otherwise}{spans}; everybody there counts as missed; a row with t alone says "
        "that a frame has no tracks"
    )


def empty_ends(truth: TruthTable, tracks: TrackTable) -> list[str]:
    """Return a note where a table's frames go on, but its tracks end well before the people, or begin well after them."""
    people = truth.stamps_ns[truth.in_area]
    frames = tracks.frame_stamps_ns
    people = people[(people >= frames[0]) & (people <= frames[-1])] if frames.size else people[:0]
    if not people.size:
        return []
    if not tracks.id.size:
        return [f"{tracks.source}: holds no track in any of {frames.size} frames; everybody counts as missed"]
    first, last = int(tracks.stamps_ns[0]), int(tracks.stamps_ns[-1])
    share = float(np.mean((people < first) | (people > last)))
    is_long = max(first - int(people[0]), int(people[-1]) - last) > NOTED_END_S * NS_PER_S
    if share <= NOTED_END_SHARE or not is_long:
        return []
    return [
        f"{tracks.source}: its tracks span {span_of(tracks.stamps_ns)}, people are in the area from {span_of(people)} by "
        f"{truth.source}: {share:.0%} of their rows come before or after all tracks, and count as missed"
    ]


def usual_interval_ns(truth: TruthTable) -> float:
    """Compute the median interval between a person's rows [ns]; between frames if no person has two rows."""
    order = np.lexsort((truth.stamps_ns, truth.id))
    same = np.diff(truth.id[order]) == 0
    own = np.diff(truth.stamps_ns[order])[same]
    intervals = own if own.size else np.diff(truth.frame_stamps_ns)
    return float(np.median(intervals)) if intervals.size else 0.0


def usual_gap_ns(stamps: NDArray[np.int64]) -> float:
    """Return the usual time between two stamps (n,) [ns]; infinite without two."""
    return float(np.median(np.diff(stamps))) if stamps.size > 1 else np.inf


def is_covered(truth_stamps: NDArray[np.int64], stamps: NDArray[np.int64], gap_ns: int) -> NDArray[np.bool_]:
    """Return at which stamps (n,) the truth is known, (n,)."""
    if not truth_stamps.size:
        return np.zeros(stamps.size, dtype=np.bool_)
    before = np.searchsorted(truth_stamps, stamps, side="right") - 1
    after = np.searchsorted(truth_stamps, stamps, side="left")
    bracketed = (before >= 0) & (after < truth_stamps.size)
    gap = truth_stamps[np.minimum(after, truth_stamps.size - 1)] - truth_stamps[np.maximum(before, 0)]
    return bracketed & (gap <= gap_ns)


def truth_at(truth: TruthTable, stamps: NDArray[np.int64], frames_ns: NDArray[np.int64]) -> TruthTable:
    """Interpolate the truth at those of the stamps (f,), ascending [ns], at which it is known, by the rule of `align`.

    frames_ns: stamps of the sensor at which tracks are reported [ns], for their period.
    """
    gap_ns, near_ns = longest_gap_ns(truth), pairing_ns(truth, usual_gap_ns(np.unique(frames_ns)))
    paired = paired_stamps(truth.frame_stamps_ns, stamps, near_ns)
    return people_at(truth, stamps[is_covered(truth.frame_stamps_ns, paired, gap_ns)], gap_ns, near_ns)


def pairing_ns(truth: TruthTable, period_ns: float) -> int:
    """Return the time within which a stamp is that of the truth's nearest frame [ns]: tables round, clocks jitter."""
    shorter_ns = min(period_ns, usual_gap_ns(truth.frame_stamps_ns))
    return int(shorter_ns / 2) if np.isfinite(shorter_ns) else 0


def paired_stamps(truth_stamps: NDArray[np.int64], stamps: NDArray[np.int64], near_ns: int) -> NDArray[np.int64]:
    """Return the truth's stamp nearest to each stamp (n,) within this time, else the stamp itself, (n,) ascending."""
    after = np.searchsorted(truth_stamps, stamps).clip(1, max(truth_stamps.size - 1, 1))
    before, after = (truth_stamps[np.minimum(each, truth_stamps.size - 1)] for each in (after - 1, after))
    nearest = np.where(stamps - before < after - stamps, before, after)
    return np.where(abs(nearest - stamps) <= near_ns, nearest, stamps)


def longest_gap_ns(truth: TruthTable) -> int:
    """Return the longest interval between two rows in which a person's position is known [ns]."""
    return max(MAX_TRUTH_GAP_NS, int(GAP_PERIODS * usual_interval_ns(truth)))


def people_at(truth: TruthTable, stamps: NDArray[np.int64], gap_ns: int, near_ns: int) -> TruthTable:
    """Interpolate each person between their own rows at the stamps (f,), a frame each; flags and shares as in the nearer row."""
    low, high, where = [], [], []
    paired = paired_stamps(truth.frame_stamps_ns, stamps, near_ns)
    order = np.argsort(truth.id, kind="stable")
    for rows in np.split(order, np.flatnonzero(np.diff(truth.id[order])) + 1):
        own = truth.stamps_ns[rows]
        first, last = (
            (np.searchsorted(paired, own[0]), np.searchsorted(paired, own[-1], "right")) if own.size else (0, 0)
        )
        between = is_covered(own, stamps[first:last], gap_ns)
        there = np.flatnonzero(between | np.isin(paired[first:last], own))
        at = np.where(between, stamps[first:last], paired[first:last])[there]
        low.append(rows[np.searchsorted(own, at, side="right") - 1])
        high.append(rows[np.searchsorted(own, at, side="left")])
        where.append(first + there)
    low, high, where = np.concatenate(low), np.concatenate(high), np.concatenate(where)
    by_stamp = np.argsort(where, kind="stable")
    low, high, where = low[by_stamp], high[by_stamp], where[by_stamp]
    span = truth.stamps_ns[high] - truth.stamps_ns[low]
    share = (stamps[where] - truth.stamps_ns[low]) / np.maximum(span, 1)  # 0 at a stamp of the person's own
    numbers = {}
    for name in TRUTH_NUMBERS:
        values = getattr(truth, name)
        change = values[high] - values[low]
        numbers[name] = values[low] + share * (wrap_angle(change) if name in _ANGLES else change)
    near = np.where(share <= 0.5, low, high)
    return replace(
        truth,
        frame_stamps_ns=stamps,
        stamps_ns=stamps[where],
        id=truth.id[low],
        **numbers,
        in_area=truth.in_area[near],
        visible={sensor: shown[near] for sensor, shown in truth.visible.items()},
    )
