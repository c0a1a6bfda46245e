"""Log times and header stamps of one sensor's messages: read without decoding, and split where the sensor's clock was set."""

from __future__ import annotations

from array import array
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from trackers.arrays import Array, Index, Mask, Nanoseconds
from trackers.arrival_order import MAX_WAIT_S
from trackers.observations import NS_PER_S
from twin.recording.bags.bag import Bag, Copies, header_of
from twin.recording.ros.ros_messages import LASER_SCAN
from twin.recording.ros.scan_messages import beams_of, copies_restamped, turns

_FEW = 3
_MOST_FRAMES = 20
"""Largest number of frame_ids counted per topic."""


@dataclass(frozen=True, eq=False)
class MessageTimes:
    """The messages of a topic in the order in which the bag hands them out.

    log_ns, stamp_ns: log time and header stamp [ns]; is_set: whether there is a stamp of the message's own: its header can
    be read, and the message before has not the same stamp with other content. frames: messages by their header's frame_id.
    arrived: number of each among the messages of all topics.

    turn: of a scanner that publishes a turn in several messages, the number of each message's turn (n_message,); the times
    are then those of the turns, stamped as their first message and logged as their last.

    copied_ns: how much later each copy of an earlier message was logged [ns]; copies are no messages of the topic. Nor are
    those under another stamp: restamped (of each message that is no copy of an earlier one, None: none), restamped_ns later.
    """

    log_ns: Nanoseconds
    stamp_ns: Nanoseconds
    is_set: Mask
    frames: Counter[str] = field(default_factory=Counter)
    arrived: Index = field(default_factory=lambda: np.empty(0, dtype=np.intp))
    turn: Index | None = None
    copied_ns: Nanoseconds = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    restamped: Mask | None = None
    restamped_ns: float = 0.0

    @property
    def n_message(self) -> int:
        """Number of messages."""
        return len(self) if self.turn is None else self.turn.size

    def __len__(self) -> int:
        return self.log_ns.size

    @property
    def falls_back(self) -> bool:
        """True where stamps fall back again and again in the order of the log times: two overlapping streams."""
        return int(np.count_nonzero(np.diff(self.stamp_ns) < -MAX_WAIT_S * NS_PER_S)) > _FEW


class _TopicTimes:
    def __init__(self, msgtype: str) -> None:
        self.log_ns, self.stamp_ns, self.is_set = array("q"), array("q"), array("b")
        self.beams = array("d") if msgtype == LASER_SCAN else None  # angle_min, angle_increment, count of each message
        self.arrived, self.content = array("q"), array("q")
        self.frames: Counter[str] = Counter()
        self._last: tuple[int, bytes] | None = None

    def add(self, arrived: int, log_ns: int, body: bytes, is_ros1: bool) -> None:
        header = header_of(body, is_ros1)
        stamp_ns, frame, ends = header or (0, "", len(body))
        if self.beams is not None:
            self.beams.extend(beams_of(body, is_ros1, ends))
            self.content.append(hash(bytes(body[ends:])))
        is_set = header is not None
        if self._last is not None and self._last[0] == stamp_ns and self._last[1] != body:
            is_set = False
        self._last = stamp_ns, body
        self.arrived.append(arrived)
        self.log_ns.append(log_ns)
        self.stamp_ns.append(stamp_ns)
        self.is_set.append(is_set)
        if frame in self.frames or len(self.frames) < _MOST_FRAMES:
            self.frames[frame] += 1

    def times(self, copied_ns: Sequence[int] = ()) -> MessageTimes:
        log_ns, stamp_ns, arrived, copied = (
            np.array(each, dtype=np.int64) for each in (self.log_ns, self.stamp_ns, self.arrived, copied_ns)
        )
        is_set, more = np.array(self.is_set, dtype=bool), dict[str, Any](copied_ns=copied)
        if self.beams is None:
            return MessageTimes(log_ns, stamp_ns, is_set, self.frames, arrived, **more)
        beams, content = np.array(self.beams).reshape(-1, 3), np.array(self.content, dtype=np.int64)
        if (again := copies_restamped(content, stamp_ns)).any():
            first = {each: stamp for each, stamp in zip(content[::-1].tolist(), stamp_ns[::-1].tolist(), strict=True)}
            later_ns = stamp_ns[again] - np.array([first[each] for each in content[again].tolist()])
            more |= {"restamped": again, "restamped_ns": float(np.median(later_ns))}
            log_ns, stamp_ns, arrived, content = (each[~again] for each in (log_ns, stamp_ns, arrived, content))
            is_set, beams = is_set[~again], beams[~again]
            is_set = is_set | (stamp_ns != 0)
            is_set[1:] &= (np.diff(stamp_ns) != 0) | (np.diff(content) == 0)
        if (turn := turns(beams, stamp_ns)) is None:
            return MessageTimes(log_ns, stamp_ns, is_set, self.frames, arrived, **more)
        firsts = np.flatnonzero(np.diff(turn, prepend=-1))
        lasts = np.append(firsts[1:], turn.size) - 1
        return MessageTimes(
            log_ns[lasts], stamp_ns[firsts], is_set[firsts], self.frames, arrived[lasts], turn=turn, **more
        )


class Unwound:
    """Makes log times go on where the recorder's clock was set back, by the rhythm of the topic that comes next."""

    def __init__(self) -> None:
        self.set_back_ns: list[int] = []
        self._shift_ns, self._last_ns = 0, None
        self._last_of: dict[str, int] = {}
        self._gap_of: dict[str, int] = {}

    def __call__(self, topic: str, log_ns: int) -> int:
        now_ns = log_ns + self._shift_ns
        own_ns = self._last_of.get(topic)  # topics written one after another do not fall back themselves
        if self._last_ns is not None and own_ns is not None and own_ns - now_ns > MAX_WAIT_S * NS_PER_S:
            next_ns = max(own_ns + self._gap_of.get(topic, 0), self._last_ns)
            self.set_back_ns.append(next_ns - now_ns)
            self._shift_ns += next_ns - now_ns
            now_ns = next_ns
        if (before := self._last_of.get(topic)) is not None:
            self._gap_of[topic] = now_ns - before
        self._last_of[topic] = now_ns
        self._last_ns = now_ns if self._last_ns is None else max(self._last_ns, now_ns)
        return now_ns


def read_times(bag: Bag, topics: Mapping[str, str], unwound: Unwound | None = None) -> dict[str, MessageTimes]:
    """Read the times of all messages of these topics, by type, which begin with a header; one message is held at a time.

    unwound: for the order of the file, with log times continued where the recorder's clock steps back. Raises InputError where
    the bag is damaged.
    """
    read, copies = {topic: _TopicTimes(msgtype) for topic, msgtype in topics.items()}, Copies()
    messages = bag.encoded_messages(topics, in_file_order=unwound is not None)
    for arrived, (topic, log_ns, data, is_ros1) in enumerate(messages):
        on_ns = log_ns if unwound is None else unwound(topic, log_ns)
        if not copies.add(topic, on_ns, data, is_ros1):
            read[topic].add(arrived, on_ns, data, is_ros1)
    return {topic: each.times(copies.later_ns[topic]) for topic, each in read.items()}


def all_pause(times: Mapping[str, MessageTimes]) -> bool:
    """Return True where all topics together are silent for a second and far longer than usual: the recorder's clock, perhaps."""
    log_ns = np.sort(np.concatenate([each.log_ns for each in times.values()])) if times else np.empty(0)
    gaps = np.diff(log_ns)
    return gaps.size > _FEW and bool(gaps.max() > max(NS_PER_S, REGULAR_GAPS * float(np.median(gaps))))


def first_frame(bag: Bag, topic: str) -> str:
    """Return the frame_id of the first message on a topic whose header can be read; '' where there is none."""
    for _, _, data, is_ros1 in bag.encoded_messages({topic: bag.topics[topic].msgtype}):
        if (header := header_of(data, is_ros1)) is not None:
            return header[1].strip("/")
    return ""


def topic_of_frame(bag: Bag, topic: str, msgtype: str, but: Collection[str]) -> str:
    """Return the only topic of a type whose messages are of the frame of those on another topic; '' for none and several.

    but: topics that are others'.
    """
    frame = first_frame(bag, topic) if topic in bag.topics else ""
    of_type = [name for name, each in bag.topics.items() if each.msgtype == msgtype and name not in but]
    same = [name for name in of_type if frame and first_frame(bag, name) == frame]
    return same[0] if len(same) == 1 else ""


_AHEAD = 5
"""Number of messages ahead that separate a clock that was set from one wrong stamp."""
REGULAR_GAPS = 3.0
"""Greatest gap of a continuing sensor, in usual ones."""
SIGMAS = 6.0
"""Number of standard deviations beyond noise."""
_REGULAR = 0.9
"""Least share of the gaps between log times near the median for a regular log."""
_TO_SIGMA = 1.4826
_CLOSE = 0.6
"""Stamps nearer to each other than this share of the usual gap lie over one another."""
BLOCKS = 10
"""Number of parts whose medians give a slope."""


class SensorClock:
    """One sensor's stamps: which are its own, and the parts between which the clock was set."""

    def __init__(self, name: str, times: MessageTimes, offset_ns: int) -> None:
        self.name, self.offset_ns = name, offset_ns
        self.log, self.stamp = times.log_ns, times.stamp_ns + offset_ns
        unset = ~times.is_set
        zero = times.stamp_ns == 0
        if np.count_nonzero(zero) > 1:
            unset = unset | zero
        if 2 * np.count_nonzero(unset) > unset.size:
            unset = np.ones_like(unset)
        self.logged_per_stamp = self._logged_per_stamp(~unset)
        if self._has_no_rhythm(~unset):
            unset = np.ones_like(unset)
        self.unset = unset
        self.step_ns = 0.0
        self.set = np.flatnonzero(~unset)
        self.part = np.full(self.log.size, -1)  # (n,) number of the part; -1: no stamp, or one far from all others
        self.usual_ns = _usual_gap(self.stamp[self.set])
        self.tells = self.set.size > 0 and 0.5 <= self.logged_per_stamp <= 2.0
        self.timed_by = "the log times"
        if self.set.size and not self.tells and (unwound := self._unwound()) is not None:
            self.log, self.tells, self.timed_by = unwound, True, "its own rhythm, as the log times do not tell"
        if self.set.size:
            self.part[self.set] = self._parts() if self.tells else 0
        self.slope = 0.0

    def age(self, slope: float = 0.0, since_ns: int = 0) -> Array:
        """Return log time minus stamp [ns], less a common slope."""
        return (self.log - self.stamp).astype(np.float64) - np.float64(slope) * (self.log - since_ns)

    @property
    def main(self) -> Index:
        """The messages of the longest part."""
        numbers = self.part[self.part >= 0]
        return np.flatnonzero(self.part == np.bincount(numbers).argmax()) if numbers.size else np.empty(0, np.intp)

    def _logged_per_stamp(self, is_set: Mask) -> float:
        """Return how long the log passes in a second of the stamps [s]; far from 1 where it was written at another time."""
        log, stamp = self.log[is_set], self.stamp[is_set]
        if log.size < 3:
            return 1.0
        step = max(1, log.size // BLOCKS)
        passed = stamp[step:] - stamp[:-step]
        logged = (log[step:] - log[:-step])[passed != 0]
        return float(np.median(logged / passed[passed != 0])) if logged.size else 0.0

    def _has_no_rhythm(self, is_set: Mask) -> bool:
        """Return True where most stamps leave the rhythm in which messages were regularly logged.

        No clock does so: the nanoseconds hold another unit, or something else.
        """
        if np.count_nonzero(is_set) <= BLOCKS:
            return False
        log = self.log[is_set]
        logged, step = np.diff(log).astype(float), max(1, log.size // BLOCKS)
        usual = float(np.median(log[step:] - log[:-step])) / step  # of the log as a whole: it may come in bursts
        is_regular = (logged >= 0.5 * usual) & (logged <= 2 * usual) & (logged > 0)
        if np.mean(is_regular) < _REGULAR or self._share_along(is_set) >= 0.5:
            return False
        # the same rhythm, logged in another order
        gaps = np.diff(np.sort(self.stamp[is_set])).astype(float)
        return bool(np.mean((gaps >= 0.5 * usual) & (gaps <= 2 * usual)) < _REGULAR)

    def _share_along(self, is_set: Mask) -> float:
        """Return the share of gaps between stamps that are, at the common pace, about as long as those between log times."""
        logged, passed = (np.diff(each[is_set]).astype(float) for each in (self.log, self.stamp))
        share = passed[logged > 0] * self.logged_per_stamp / logged[logged > 0]
        return float(np.mean((share >= 0.5) & (share <= 2))) if share.size else 0.0

    @property
    def has_pace(self) -> bool:
        """True where there are enough stamps, and most, and the whole, go along with the log times at one pace."""
        if self.set.size < 2 * BLOCKS or self._share_along(~self.unset) <= 0.5:
            return False
        whole = float(np.ptp(self.stamp[self.set])) * self.logged_per_stamp  # else messages were logged in bursts
        return 0.5 * whole <= float(np.ptp(self.log[self.set])) <= 2 * whole

    def _unwound(self) -> Nanoseconds | None:
        """Return times that go on in the order of the messages where stamps fall back for good; None where none do."""
        stamp = self.stamp[self.set]
        gaps = np.diff(stamp)
        is_regular = (gaps > 0) & (gaps <= REGULAR_GAPS * self.usual_ns)
        back = np.flatnonzero(gaps < -MAX_WAIT_S * NS_PER_S)
        falls = [k + 1 for k in back if is_regular[k - 1 : k].all() and is_regular[k + 1 : k + 1 + _AHEAD].all()]
        in_order = np.diff(np.sort(stamp))
        is_whole = (
            np.count_nonzero(in_order < _CLOSE * self.usual_ns) <= 2
            and (in_order <= REGULAR_GAPS * self.usual_ns).all()
        )
        if not falls or is_whole:  # messages came late, no clock was set
            return None
        goes_on = stamp.copy()
        for k in falls:
            goes_on[k:] += goes_on[k - 1] - goes_on[k] + round(self.usual_ns)
        return np.interp(np.arange(self.log.size), self.set, goes_on - goes_on[0]).astype(np.int64) + goes_on[0]

    def _parts(self) -> Index:
        """Return the part of each message that has a stamp, -1 for a stamp far from its neighbours."""
        stamp = self.stamp[self.set]
        age = (self.log[self.set] - stamp).astype(float)
        steps = np.diff(age)
        sigma = _TO_SIGMA * float(np.median(np.abs(steps - np.median(steps)))) if steps.size else 0.0
        self.step_ns = max(MAX_WAIT_S * NS_PER_S, REGULAR_GAPS * self.usual_ns, SIGMAS * sigma)
        if not (np.abs(steps) > self.step_ns).any() or self._is_late_only(stamp):
            return np.zeros(stamp.size, np.intp)
        return self._split(stamp, age)

    def _is_late_only(self, stamp: Nanoseconds) -> bool:
        """Return True where the sorted stamps are those of a clock that runs on: messages were late, no clock was set."""
        log = self.log[self.set]
        once = np.concatenate([[True], np.diff(stamp) != 0])  # a message that came twice says nothing of the clock
        gaps = np.diff(np.sort(stamp[once]))
        lie_over = np.count_nonzero(gaps < _CLOSE * self.usual_ns) > 2
        return not lie_over and float(np.ptp(stamp)) - float(np.ptp(log)) <= self.step_ns

    def _split(self, stamp: Nanoseconds, age: Array) -> Index:
        part, number, level, last = np.full(age.size, -1), -1, np.inf, None
        for k in range(age.size):
            ahead = age[k + 1 : k + 1 + _AHEAD]
            goes_on = last is not None and 0 < stamp[k] - last <= REGULAR_GAPS * self.usual_ns
            if abs(age[k] - level) > self.step_ns and not goes_on:
                here = np.count_nonzero(np.abs(ahead - age[k]) <= self.step_ns)
                before = np.count_nonzero(np.abs(ahead - level) <= self.step_ns)
                if here <= before or 2 * here <= ahead.size:
                    continue  # one stamp that is wrong
                number += 1
            part[k], level, last = number, age[k], stamp[k]
        if number < 0:
            part[:] = 0
        return part


def _usual_gap(stamps_ns: Nanoseconds) -> float:
    gaps = np.diff(stamps_ns)
    gaps = gaps[gaps > 0]
    return float(np.median(gaps)) if gaps.size else 0.0
