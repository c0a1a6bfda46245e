"""Compare the stamps of a recording's messages with the log times, and correct errors of single sensors.

The age of a message is its log time minus its stamp. With a correct common clock it is the sensor's delay and varies little.
A clock that was set shows as a step, a drifting one as a slope, another clock as another level than the other sensors'. A
missing stamp (0, that of another message, or one in no rhythm) is replaced by the log time.

Headers are trusted if possible. Regular stamps are right whatever the log says (a stalling recorder, a bag with rewritten
log times). A level common to all sensors needs no correction (simulated time, a robot without a network). Only differences
between sensors are corrected, so a faultless recording keeps each stamp to the bit; another pace of all is reported.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from trackers.arrays import Array, Index, Nanoseconds
from trackers.arrival_order import MAX_WAIT_S
from trackers.feeding import NOTED_LOSS
from trackers.observations import NS_PER_S
from twin.recording.losses import Loss
from twin.recording.sensor_clock import BLOCKS, REGULAR_GAPS, SIGMAS, MessageTimes, SensorClock

_OTHER_CLOCK_S = 0.5
"""Age beyond that of other sensors from which a sensor is on another clock [s]; no tracker would wait for such a delay
anyway.
"""
_YOUNG = 0.05
"""Share of the messages that are younger than those by whose age a clock is known where most were held up."""
_PACE = 0.05
"""Greatest deviation of the pace of all stamps from that of the log times that is no other pace."""
_SIMULATED_S = 1e8
"""Latest stamp of a clock that counts from a start and not from 1970: three years [s]."""
_LINEAR = 0.2
"""Greatest deviation of a slope's blocks from the line, as a share of its rise, for a clock; a growing queue is less even.
"""


@dataclass(frozen=True, eq=False)
class CorrectedClocks:
    """Corrected stamps of each sensor's messages [ns], in the bag's order, and the faults found.

    ahead_s: lead of each sensor's corrected stamps over the others' logged at the same time [s]. jumps_ns: corrected stamps
    at which the clock of all sensors was set; tracks cannot coast over them. untold: sensors with stamps whose log times do not
    tell.
    """

    stamps_ns: dict[str, Nanoseconds]
    losses: list[Loss]
    ahead_s: dict[str, float]
    jumps_ns: tuple[int, ...] = ()
    untold: frozenset[str] = frozenset()

    def is_log_of_no_order(self, times: Mapping[str, MessageTimes]) -> bool:
        """Return True where messages are logged long after newer ones and the log times say nothing of when they came.

        They do not where a sensor's own messages are so, or were logged at another pace. times: by name.
        """
        heard = [name for name, each in times.items() if each.arrived.size]
        if not heard:
            return False
        order = np.argsort(np.concatenate([times[name].arrived for name in heard]))
        stamps = np.concatenate([self.stamps_ns[name] for name in heard])[order]
        own = any(_share_late(self.stamps_ns[name]) > NOTED_LOSS for name in heard)
        return (own or bool(self.untold)) and _share_late(stamps) > NOTED_LOSS


def _share_late(stamps_ns: Nanoseconds) -> float:
    """Return the share of messages that come later than any tracker waits."""
    return float(np.mean(np.maximum.accumulate(stamps_ns) - stamps_ns > MAX_WAIT_S * NS_PER_S))


OF_NO_ORDER = Loss(
    "all sensors",
    0,
    0,
    "messages were logged long after newer ones, in an order that says nothing of when they came",
    "they are taken in the order of their stamps",
    always=True,
)


def correct_clocks(
    times: Mapping[str, MessageTimes], offsets_ns: Mapping[str, int], *, keeps_stamps: bool = False
) -> CorrectedClocks:
    """Bring the stamps of several sensors onto one clock; `offsets_ns` of the rig are added first.

    keeps_stamps: only missing stamps are replaced, and all else is reported (a twin's recording, whose scenario may have asked
    for wrong clocks). A sensor whose offset the rig states is not moved to the clock of the others.
    """
    clocks = {name: SensorClock(name, each, offsets_ns.get(name, 0)) for name, each in times.items() if len(each)}
    telling = [clock for clock in clocks.values() if clock.tells]
    since_ns = min((int(clock.log[0]) for clock in clocks.values()), default=0)
    losses: list[Loss] = []
    slope = _common_slope(telling)
    for clock in telling:
        if (drift := _drift(clock, slope)) is not None:
            losses.append(drift if not keeps_stamps else _kept(drift))
            if not keeps_stamps:
                clock.stamp = clock.stamp + np.rint((clock.slope - slope) * (clock.log - since_ns)).astype(np.int64)
    common, names = _common_level(telling, slope, since_ns)
    stamps: dict[str, Nanoseconds] = {}
    levels: dict[str, float] = {}
    for name, clock in clocks.items():
        found, used = _levelled(clock, slope, since_ns, common, names, moves=not keeps_stamps)
        losses += found
        stamps[name] = used
        if clock.main.size and clock.tells:
            age = (clock.log - used).astype(float) - slope * (clock.log - since_ns)
            levels[name] = float(age[clock.main].min())  # held up messages tell no other clock
    if not keeps_stamps and (pace := _other_pace(list(clocks.values()))) is not None:
        losses.append(pace)
    jumps_ns = () if keeps_stamps else _common_jumps(clocks, stamps)
    if jumps_ns:
        first_ns = min(int(each.min()) for each in stamps.values())
        when = ", ".join(f"{(each - first_ns) / NS_PER_S:.2f} s" for each in jumps_ns[:5])
        what = f"the clock of all sensors was set at {when}: trackers restart there, with new ids"
        losses.append(
            Loss("all sensors", 0, 0, what, "cut the recording there, or keep the clock from being set", always=True)
        )
    for name, each in times.items():
        stamps.setdefault(name, each.stamp_ns)
    untold = frozenset(name for name, clock in clocks.items() if clock.set.size and not clock.tells)
    others = {
        name: [level for other, level in levels.items() if other != name] or [own] for name, own in levels.items()
    }
    ahead_s = {name: (float(np.median(others[name])) - own) / NS_PER_S for name, own in levels.items()}
    return CorrectedClocks(stamps, losses, ahead_s, jumps_ns, untold)


def _common_jumps(clocks: Mapping[str, SensorClock], stamps: Mapping[str, Nanoseconds]) -> tuple[int, ...]:
    """Return the corrected stamps [ns] at which the clocks of all sensors that reported before and after were set."""
    found: list[tuple[int, str]] = []
    for name, clock in clocks.items():
        rows = np.flatnonzero(clock.part >= 0)
        starts = rows[1:][np.diff(clock.part[rows]) != 0]
        found += [(int(stamps[name][row]), name) for row in starts]
    apart_ns = max([NS_PER_S, *(round(REGULAR_GAPS * clock.usual_ns) for clock in clocks.values())])
    groups: list[list[tuple[int, str]]] = []
    for at_ns, name in sorted(found):
        if not groups or at_ns - groups[-1][0][0] > apart_ns or name in {each for _, each in groups[-1]}:
            groups.append([])
        groups[-1].append((at_ns, name))
    jumps = []
    for group in groups:
        at_ns = group[0][0]
        here = {
            name for name, clock in clocks.items() if clock.tells and stamps[name].min() < at_ns <= stamps[name].max()
        }
        if here <= {name for _, name in group}:
            jumps.append(at_ns)
    return tuple(jumps)


def _other_pace(clocks: Sequence[SensorClock]) -> Loss | None:
    """Return as a loss that the stamps of all sensors pass faster or slower than the log times; None where they agree.

    A bag that was played at another speed and recorded again is so, simulated time, and a driver that mistakes the unit.
    """
    paced = [each for each in clocks if each.has_pace]
    paces = [each.logged_per_stamp for each in paced]
    logged_s = max((int(np.ptp(clock.log)) for clock in clocks), default=0) / NS_PER_S
    if not paces or min(abs(each - 1) for each in paces) <= _PACE or logged_s < 1:
        return None
    pace = float(np.median(paces))
    what = f"stamps pass {1 / pace:.3g} s in each second of the log times: they are used as they are"
    right = (
        "simulated time" if paced[0].stamp[0] < _SIMULATED_S * NS_PER_S else "a bag that was played at another speed"
    )
    remedy = f"right for {right}; else people have other speeds"
    return Loss("all sensors", 0, 0, what, remedy, always=True)


def _common_slope(clocks: list[SensorClock]) -> float:
    """Set each clock's slope of age over log time, and return the one of least magnitude."""
    for clock in clocks:
        rows = clock.main
        if rows.size >= 4 * BLOCKS:
            log, age = _blocks(clock.log[rows], clock.age()[rows])
            clock.slope = float(np.polyfit(log - log[0], age - age[0], 1)[0])
    return min((clock.slope for clock in clocks), key=abs, default=0.0)


def _blocks(log: Nanoseconds, age: Array) -> tuple[Array, Array]:
    """Return medians of log times and ages over blocks of messages."""
    medians = [
        (np.median(a), np.median(b))
        for a, b in zip(np.array_split(log, BLOCKS), np.array_split(age, BLOCKS), strict=True)
    ]
    first, second = np.array(medians).T
    return first, second


def _drift(clock: SensorClock, slope: float) -> Loss | None:
    """Return the drift of a clock against the common one as a loss; None where it stays within a scan."""
    excess, rows = clock.slope - slope, clock.main
    if not excess:
        return None
    log, age = _blocks(clock.log[rows], clock.age(slope, int(clock.log[rows[0]]))[rows])
    rise = excess * (log[-1] - log[0])
    line = age[0] + excess * (log - log[0])
    leaves = float(np.abs(age - line - np.median(age - line)).max())
    if abs(rise) <= max(clock.usual_ns, SIGMAS * _noise(clock, rows)) or leaves > _LINEAR * abs(rise):
        return None
    verb = "loses" if excess > 0 else "gains"
    what = f"were stamped by a clock that {verb} {1e3 * abs(excess):.3g} ms per second on that of the other sensors"
    return Loss(clock.name, rows.size, clock.log.size, what, "it was corrected by the log times", always=True)


def _noise(clock: SensorClock, rows: Index) -> float:
    steps = np.diff(clock.age()[rows])
    return float(np.median(np.abs(steps))) if steps.size else 0.0


def _level(age: Array) -> float:
    """Return the usual age of messages [ns]; where most were held up, that of the youngest, which tell the clock.

    From half the age on that is another clock's: a usual delay may come to it.
    """
    usual, young = np.quantile(age, [0.5, _YOUNG])
    return float(young if usual - young > _OTHER_CLOCK_S * NS_PER_S / 2 else usual)


def _common_level(clocks: list[SensorClock], slope: float, since_ns: int) -> tuple[float, list[str]]:
    """Return the most frequent age [ns] of messages, and the sensors that have it; of two equally frequent ones the smaller."""
    levels = []
    for clock in clocks:
        age = clock.age(slope, since_ns)
        for number in range(clock.part.max() + 1):
            rows = clock.part == number
            levels.append((_level(age[rows]), int(np.count_nonzero(rows)), clock.name))
    if not levels:
        return 0.0, []
    levels.sort()
    groups = [[levels[0]]]
    for level in levels[1:]:
        if level[0] - groups[-1][-1][0] > _OTHER_CLOCK_S * NS_PER_S:
            groups.append([])
        groups[-1].append(level)
    best = max(groups, key=lambda group: (sum(count for _, count, _ in group), -abs(group[0][0])))
    return float(np.median([level for level, _, _ in best])), sorted({name for _, _, name in best})


def _levelled(
    clock: SensorClock, slope: float, since_ns: int, common: float, names: list[str], *, moves: bool
) -> tuple[list[Loss], Nanoseconds]:
    """Return the losses of a clock, and its stamps with each part shifted to the level of the recording."""
    n, stamp, age = clock.log.size, clock.stamp.copy(), clock.age(slope, since_ns)
    found: list[Loss] = []
    parts = [np.flatnonzero(clock.part == number) for number in range(clock.part.max() + 1)] if clock.tells else []
    levels = [_level(age[rows]) for rows in parts]
    near = [k for k, level in enumerate(levels) if abs(level - common) <= _OTHER_CLOCK_S * NS_PER_S]
    is_stated = clock.offset_ns != 0
    most = max(range(len(parts)), key=lambda k: parts[k].size, default=None)
    own = common if most is None else levels[near[0] if near else most]
    is_other = bool(parts) and not near
    set_parts = [k for k, level in enumerate(levels) if abs(level - own) > clock.step_ns]
    for k in set_parts:
        k_before = k - 1 if k else k + 1
        by_s = (levels[k] - levels[k_before]) / NS_PER_S * (1 if k else -1)
        at_s = (int(clock.log[parts[max(k, 1)][0]]) - since_ns) / NS_PER_S
        when = "after" if k else "before"
        way = "back" if by_s > 0 else "ahead"
        what = f"were stamped {when} the clock was set {way} by {abs(by_s):.3f} s, {at_s:.1f} s from the start"
        loss = Loss(clock.name, parts[k].size, n, what, f"time was made to go on by {clock.timed_by}", always=True)
        found.append(loss if moves else _kept(loss))
        if moves:
            stamp[parts[k]] += round(levels[k] - own)
    if is_other:
        by_s = (own - common) / NS_PER_S
        way = "behind" if by_s > 0 else "ahead of"
        what = f"were stamped by another clock, {abs(by_s):.3f} s {way} that of {', '.join(names)} by the log times"
        typed = f"`time_offset_s: {clock.offset_ns / NS_PER_S + by_s:.3f}` for {clock.name} in rig.yaml"
        if moves and not is_stated:
            remedy = f"they were moved onto it; {typed} says so for good"
            stamp[clock.part >= 0] += round(own - common)
            own = common
        else:
            remedy = f"{typed} sets it right" if moves else _KEPT
        found.append(Loss(clock.name, n, n, what, remedy, always=True))
    elif not parts:
        own = common
    level = own if clock.tells else common
    by_log = np.rint(clock.log - level - slope * (clock.log - since_ns)).astype(np.int64)
    stamp[clock.unset] = by_log[clock.unset]
    if clock.unset.any():
        what = "have no stamp of their own (0, unreadable, that of another message, or in no rhythm)"
        found.append(Loss(clock.name, int(clock.unset.sum()), n, what, _BY_LOG, always=True))
    alone = (clock.part < 0) & ~clock.unset
    if alone.any():
        far_s = float(np.abs(age[alone] - own).max()) / NS_PER_S
        what = f"have a stamp up to {far_s:.6g} s from those about it"
        loss = Loss(clock.name, int(alone.sum()), n, what, _BY_LOG, always=True)
        found.append(loss if moves else _kept(loss))
        if moves:
            stamp[alone] = by_log[alone]
    return found, stamp


_BY_LOG = "the times at which they were logged are used for them"
_KEPT = "a twin's recording keeps its stamps, as its scenario may have asked for them"


def _kept(loss: Loss) -> Loss:
    return replace(loss, remedy=_KEPT)
