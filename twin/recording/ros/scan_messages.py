"""LaserScan messages as drivers write them: fields that hold no value, other units, and turns published in sectors.

Several drivers publish each packet of a turning scanner as a LaserScan of its own: the next begins where the last one ended.
Trackers take a scan for a whole look around, so that the sectors of a turn are joined to one scan.

A scanner that is said to stand, and moves, sees what stands around it elsewhere (`StandingScanners`).

A driver whose ranges and limits are all in another unit contradicts itself nowhere. It is known by the width of what moves, and
by a room in which nothing is near (`RangeUnits`). Feet are not: what moves is then as wide as two people side by side, and
goes as fast as people run.
"""

from __future__ import annotations

import struct
from collections.abc import Collection, Sequence
from dataclasses import replace
from math import inf, pi, remainder

import numpy as np

from trackers.arrays import Array, Index, Mask, Nanoseconds
from trackers.observations import NS_PER_S, LaserScan
from trackers.rig import Rig
from twin.messages import counted

CDR_BYTES = 4
"""Head of a message encoded as CDR."""
_TURN_RAD = 1.1 * 2 * pi
"""Largest span of a turn: scanners that turn all around may go on a little."""
_NEXT = 1.5
"""Distance of a sector's first beam from the end of the one before, in beams, within which it goes on there."""
_FEWEST = 0.3
"""Least share of messages that go on where the last one ended; half of those in two sectors a turn do."""
_MOST_COPIES, _FEWEST_COPIES, _ALIKE = 3, 5, 0.8
"""Messages of one content at most, and copies, and their share at one distance, at least, of a topic sent twice."""
_PAUSE = 3.0
"""Longest time between two sectors of a turn, in long ones (90 %) of as many sectors."""


def beams_of(data: bytes, is_ros1: bool, header_ends: int) -> tuple[float, float, int]:
    """Read angle_min [rad], angle_increment [rad] and the number of beams of an encoded LaserScan; NaN, NaN, 0 where cut."""
    order = "<" if is_ros1 or data[1] & 1 else ">"
    start = header_ends if is_ros1 else header_ends + (CDR_BYTES - header_ends) % 4
    try:
        angle_min, _, increment, _, _, _, _, count = struct.unpack_from(f"{order}7fI", data, start)
    except struct.error:
        return float("nan"), float("nan"), 0
    return angle_min, increment, count


def copies_restamped(content: Nanoseconds, stamp_ns: Nanoseconds) -> Mask:
    """Return which messages (n,) repeat the ranges of an earlier one under another stamp, as a relay that restamps sends them.

    content: a hash of each message after its header. A scanner that hangs repeats one scan more often; one without noise in a
    still room, and an empty scan, come again at any distance: they are no copies.
    """
    _, first, which, count = np.unique(content, return_index=True, return_inverse=True, return_counts=True)
    offset_ns = stamp_ns - stamp_ns[first[which]]
    again = (np.arange(content.size) != first[which]) & (count[which] <= _MOST_COPIES)
    again &= (offset_ns != 0) & (np.abs(offset_ns) <= NS_PER_S)
    if np.count_nonzero(again) < _FEWEST_COPIES:
        return np.zeros(content.size, np.bool_)
    usual_ns = float(np.median(offset_ns[again]))
    at_usual = again & (np.abs(offset_ns - usual_ns) <= 0.2 * abs(usual_ns))
    return at_usual if np.count_nonzero(at_usual) >= _ALIKE * np.count_nonzero(again) else np.zeros_like(again)


def turns(beams: Array, stamp_ns: Nanoseconds) -> Index | None:
    """Return the number of each message's turn, (n,); None where each message is a look around of its own.

    beams: angle_min, angle_increment [rad] and number of beams of each message, (n, 3). A turn ends where the next sector does
    not lie ahead, has other beams, would make more than a turn, or comes after a pause. Lost sectors leave a gap in it.
    """
    start, step, count = beams.T
    if len(beams) < 3 or not np.isfinite(beams).all():
        return None
    end = start + step * count
    ahead = (start[1:] - end[:-1]) / np.where(step[:-1] == 0, np.nan, step[:-1])  # in beams
    ahead[count[:-1] == 0] = -np.inf
    if np.mean(np.abs(ahead) <= _NEXT) < _FEWEST:
        return None
    gaps_ns = np.abs(np.diff(stamp_ns)).astype(float)
    skipped = 1 + np.maximum(ahead, 0) / np.maximum(count[:-1], 1)
    goes_on = (ahead >= -_NEXT) & np.isclose(step[1:], step[:-1], rtol=0.01)
    goes_on &= gaps_ns <= _PAUSE * max(float(np.quantile(gaps_ns, 0.9)), 1.0) * skipped
    return _numbers(goes_on, start, end)


def _numbers(goes_on: Mask, start: Array, end: Array) -> Index:
    number = np.zeros(start.size, dtype=np.intp)
    first = 0
    for k in range(1, start.size):
        if not goes_on[k - 1] or abs(end[k] - start[first]) > _TURN_RAD:
            first = k
            number[k] = number[k - 1] + 1
        else:
            number[k] = number[k - 1]
    return number


class TurnJoiner:
    """Joins the sectors of one topic to turns, by the number of each message's turn, (n_message,)."""

    def __init__(self, turn: Index) -> None:
        self.turn = turn
        self._is_last = np.append(np.diff(turn) != 0, True)
        self._sectors: list[LaserScan] = []
        self._turn, self._offset_ns = -1, 0

    def offset_ns(self, number: int, stamp_ns: int, corrected_ns: int) -> int:
        """Return what to add to the stamp of a message: for a whole turn, what brings its first one to the corrected stamp."""
        if self.turn[number] != self._turn:
            self._turn, self._offset_ns = int(self.turn[number]), corrected_ns - stamp_ns
        return self._offset_ns

    def add(self, number: int, sector: LaserScan | None) -> LaserScan | None:
        """Add the sector of the message of this number (None: unusable); return the turn if that was its last message."""
        if sector is not None:
            self._sectors.append(sector)
        if not self._is_last[number]:
            return None
        sectors, self._sectors = self._sectors, []
        return joined(sectors) if sectors else None


def joined(sectors: Sequence[LaserScan]) -> LaserScan:
    """Return the sectors of a turn, in order, as one scan with the stamp of the first; beams between them are NaN.

    The beams' times follow from their time_increment, or from the stamps of first and last where there is none.
    """
    first, last = sectors[0], sectors[-1]
    places = [round((each.angle_min_rad - first.angle_min_rad) / first.angle_increment_rad) for each in sectors]
    ranges_m = np.full(places[-1] + last.ranges_m.size, np.nan, dtype=np.float32)
    for place, each in zip(places, sectors, strict=True):
        ranges_m[max(place, 0) : place + each.ranges_m.size] = each.ranges_m[max(-place, 0) :]
    beam_s = first.sweep_time_s / max(first.ranges_m.size - 1, 1)
    if not beam_s and places[-1] > 0:
        beam_s = (last.stamp_ns - first.stamp_ns) / NS_PER_S / places[-1]
    return replace(first, ranges_m=ranges_m, sweep_time_s=beam_s * (ranges_m.size - 1))


_LOOKS_NS = NS_PER_S // 5
"""Least time between two scans of a scanner that are examined for its unit [ns]."""
_BEARINGS, _STEP, _STEPS = 720, 0.1, 140
"""Bearings, and steps of distance in logarithms from a millimetre on, in which returns are counted."""
_AROUND = np.array([-1, 0, 1])
_STANDS = 5
"""Looks at a return of about the same bearing and distance after which it is of a thing."""
_NEARER = 0.8
"""Share of the farthest range of a bearing below which a return is of something before that."""
_EVEN = 0.1
"""Greatest change of range from beam to beam, as a share, on one thing."""
_FEWEST_BEAMS, _FEWEST_THINGS, _FEWEST_LOOKS = 3, 20, 5
_WIDEST_M, _NEAREST_M = 2.5, 1.0
"""Median width of moving things beyond that of people, even in groups, and distance within which something always comes [m]."""
_NO_ROOM_M = 10.0, 60.0
"""Distances of the nearest and of half of the returns at which a scanner shows nobody [m]."""


def _things(beam: Index, ranges: Array) -> tuple[Index, Index]:
    """Return the places of the first and of the last return of each thing, on which the range changes little."""
    goes_on = (np.diff(beam) == 1) & (np.abs(np.diff(ranges)) < _EVEN * ranges[:-1])
    ends = np.flatnonzero(~goes_on)
    return np.append(0, ends + 1), np.append(ends, beam.size - 1)


class _ReturnCounts:
    """Returns of one scanner so far: farthest range and looks by bearing, widths of what moves, and distances."""

    def __init__(self) -> None:
        self.examined_ns: int | None = None
        self.n_beams: list[int] = []
        self.widths_m: list[float] = []
        self.nearest_m = inf
        self.middle_m: list[float] = []
        self._farthest_m = np.zeros(_BEARINGS)
        self._n_look = np.zeros((_BEARINGS, _STEPS + 2), np.int32)

    def add(self, scan: LaserScan, *, stands: bool) -> None:
        """Add a scan; of a scanner that moves, only the distances count."""
        self.n_beams += [scan.ranges_m.size] * bool(scan.ranges_m.size)
        if self.nearest_m <= _NEAREST_M:  # these are metres, whatever follows
            return
        beam = np.flatnonzero(np.isfinite(scan.ranges_m) & (scan.ranges_m > 0))
        ranges, angles = scan.ranges_m[beam].astype(np.float64), scan.angles_rad[beam]
        if not beam.size:
            return
        nearest_first = np.sort(ranges)
        self.nearest_m = min(self.nearest_m, float(nearest_first[ranges.size // 100]))
        self.middle_m.append(float(nearest_first[ranges.size // 2]))
        if not stands:
            return
        bearing = np.floor(angles / (2 * pi) * _BEARINGS).astype(np.intp) % _BEARINGS
        step = 1 + np.clip(np.log(ranges / 1e-3) / _STEP, 0, _STEPS - 1).astype(np.intp)
        moved = (ranges < _NEARER * self._farthest_m[bearing]) & (self._n_look[bearing, step] < _STANDS)
        self._measure(beam[moved], ranges[moved], angles[moved])
        np.maximum.at(self._farthest_m, bearing, ranges)
        self._n_look[bearing[:, None], step[:, None] + _AROUND] += 1  # once per cell, however many beams meet it

    def _measure(self, beam: Index, ranges: Array, angles: Array) -> None:
        """Measure the widths of things that move, from the first beam on each to the last [m]."""
        first, last = _things(beam, ranges)
        many = last - first + 1 >= _FEWEST_BEAMS
        places = ranges * np.exp(1j * angles)
        self.widths_m += np.abs(places[last[many]] - places[first[many]]).tolist()

    def sentence(self) -> str:
        """Describe what contradicts ranges in metres, or that there are too few; '' where nothing does."""
        usual = int(np.median(self.n_beams or [_FEWEST_BEAMS]))
        if usual < _FEWEST_BEAMS:
            said = f"has {counted(usual, 'beam')} in a scan, of which {_FEWEST_BEAMS} side by side show a person"
            return f"{said}; a scanner of more beams is expected"
        if len(self.middle_m) < _FEWEST_LOOKS or self.nearest_m <= _NEAREST_M:
            return ""
        nearest_m, middle_m = self.nearest_m, float(np.median(self.middle_m))
        expected = "ranges and limits in m are expected, not in cm or inches"
        if len(self.widths_m) >= _FEWEST_THINGS:
            width_m = float(np.median(self.widths_m))
            if width_m > _WIDEST_M:
                return (
                    f"what moves is {width_m:.3g} m wide in the median, and nothing comes nearer than {nearest_m:.3g} m: no "
                    f"people; {expected}"
                )
        if nearest_m > _NO_ROOM_M[0] and middle_m > _NO_ROOM_M[1]:
            return (
                f"sees nothing nearer than {nearest_m:.3g} m in {len(self.middle_m)} scans, and half of all beyond "
                f"{middle_m:.3g} m, where it shows nobody; {expected}"
            )
        return ""


class RangeUnits:
    """Examines the scans of a run for ranges that cannot be in metres, and for too few beams to show anybody."""

    def __init__(self, rig: Rig) -> None:
        self._stands = {name: sensor.mounted_on is None for name, sensor in rig.lasers().items()}
        self._looks = {name: _ReturnCounts() for name in self._stands}

    def add(self, scan: LaserScan) -> None:
        """Take the next scan; five per second and scanner are examined."""
        looks = self._looks.get(scan.sensor)
        if looks is None or (looks.examined_ns is not None and 0 <= scan.stamp_ns - looks.examined_ns < _LOOKS_NS):
            return
        looks.examined_ns = scan.stamp_ns
        looks.add(scan, stands=self._stands[scan.sensor])

    def warnings(self, unused: Collection[str] = ()) -> dict[str, str]:
        """Return a sentence for each scanner whose scans are no use to trackers; unused: scanners left out."""
        found = {name: looks.sentence() for name, looks in self._looks.items() if name not in unused}
        return {name: f"{name}: {sentence}" for name, sentence in found.items() if sentence}


_TURN_LOOKS_NS = NS_PER_S
_FIRST_LOOKS, _TURNED_LOOKS = 1, 2
"""Scans that say what stands around, and later ones that fit it better turned, for a warning."""
_TURNED, _FITS, _STRANGE = 0.12, 0.6, 0.4
"""Share of the returns by which a turned scan fits better, and the least that then fits; one below which a scan fits nowhere."""
_AROUND_BEARINGS, _LEAST_TURN, _MOST_RETURNS = 90, 5, 200
"""Bearings of wide things that show anything around, least turn tried [cells], and returns of a scan that are compared."""
_TURN_CELLS, _TURN_STEPS, _TURN_M = 720, 100, 0.5
"""Bearings, and steps of distance and their length [m], in which returns are compared."""
_WIDER_M = 1.0
"""Width of a thing above which it is no person [m]."""


class _Around:
    """Returns of one scanner by bearing and distance; shares of a scan's where some were before, turns that fit better."""

    def __init__(self) -> None:
        self.examined_ns: int | None = None
        self.shares: list[float] = []
        self.turns_deg: list[float] = []
        self._n_look = 0
        self._known = np.zeros((_TURN_STEPS + 2, _TURN_CELLS), np.bool_)

    def add(self, scan: LaserScan) -> None:
        """Take a scan that shows things wider than people: people alone are elsewhere in each."""
        hit = np.flatnonzero((scan.ranges_m > 0) & (scan.ranges_m <= scan.range_max_m) & (scan.ranges_m < inf))
        if not hit.size:
            return
        ranges = scan.ranges_m[hit].astype(np.float64)
        bearing = np.floor(scan.angles_rad[hit] / (2 * pi) * _TURN_CELLS).astype(np.intp) % _TURN_CELLS
        step = 1 + np.minimum(ranges / _TURN_M, _TURN_STEPS - 1).astype(np.intp)
        first, last = _things(hit, ranges)
        width_m = np.add.reduceat(ranges * abs(scan.angle_increment_rad), first)
        is_wide = np.repeat(width_m > _WIDER_M, last - first + 1)
        if np.unique(bearing[is_wide]).size < _AROUND_BEARINGS:
            return
        self._n_look += 1
        if self._n_look > _FIRST_LOOKS:
            some = slice(None, None, -(-hit.size // _MOST_RETURNS))
            fits = self._fits(bearing[some], step[some])
            self.shares.append(float(fits[0]))
            fits[:_LEAST_TURN], fits[1 - _LEAST_TURN :] = 0.0, 0.0
            best = int(fits.argmax())
            if fits[best] >= max(_FITS, self.shares[-1] + _TURNED):  # what it shows is not where it was
                self.turns_deg.append(abs(remainder(360.0 * best / _TURN_CELLS, 360.0)))
                return
        self._known[step[:, None] + _AROUND, bearing[:, None]] = True

    def _fits(self, bearing: Index, step: Index) -> Array:
        """Return the share of returns (n,) that are where some were before, by the turn of the scan [cells]."""
        twice = np.concatenate([self._known, self._known], axis=1)
        turned = np.lib.stride_tricks.sliding_window_view(twice, _TURN_CELLS, axis=1)
        return turned[step, bearing].sum(axis=0, dtype=np.uint16) / bearing.size

    def sentence(self) -> str:
        """Describe what shows that the scanner moves; '' where nothing does."""
        n, turns = len(self.shares), self.turns_deg
        if len(turns) >= _TURNED_LOOKS:
            said = f"seems to turn, though it is said to stand: {len(turns)} of {n} scans, one a second, fit what it saw before"
            return f"{said} when turned, by {np.median(turns):.0f}° in the median"
        if n < _FEWEST_LOOKS or (share := float(np.median(self.shares))) >= _STRANGE:
            return ""
        said = f"seems to move, though it is said to stand: in half of {n} scans, one a second, at most {100 * share:.0f} %"
        return f"{said} of the returns are where some were before"


class StandingScanners:
    """Examines the scans of scanners that are said to stand for a motion: what stands around them is then elsewhere."""

    def __init__(self, rig: Rig) -> None:
        self._around = {name: _Around() for name, sensor in rig.lasers().items() if sensor.mounted_on is None}

    def add(self, scan: LaserScan) -> None:
        """Take the next scan; one per second and scanner is examined."""
        mine = self._around.get(scan.sensor)
        if mine is None or (mine.examined_ns is not None and 0 <= scan.stamp_ns - mine.examined_ns < _TURN_LOOKS_NS):
            return
        mine.examined_ns = scan.stamp_ns
        mine.add(scan)

    def warnings(self, unused: Collection[str] = ()) -> list[str]:
        """Return a sentence for each scanner that moves, though it is said to stand; unused: scanners left out."""
        remedy = "a mount that holds, or odometry (`kind: odometry`) on which it is `mounted_on`, is expected"
        found = {name: each.sentence() for name, each in self._around.items() if name not in unused}
        return [f"{name}: {sentence}; {remedy}" for name, sentence in found.items() if sentence]
