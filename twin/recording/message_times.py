"""When a bag's messages were logged, and when their headers say that they were made: read without decoding them."""

from __future__ import annotations

import struct
from array import array
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from trackers.arrays import Mask, Nanoseconds
from trackers.observations import NS_PER_S
from trackers.order import MAX_WAIT_S
from twin.recording.bag import Bag

_CDR_BYTES = 4
_FEW = 3
_MOST_FRAMES = 20
"""So many names of frames are counted of a topic; nobody reads more."""


@dataclass(frozen=True, eq=False)
class MessageTimes:
    """The messages of a topic in the order in which the bag hands them out.

    log_ns, stamp_ns: log time and header stamp [ns]; is_set: whether there is a stamp of the message's own: its header can
    be read, and the message before has not the same stamp with other content. frames: messages by their header's frame_id.
    """

    log_ns: Nanoseconds
    stamp_ns: Nanoseconds
    is_set: Mask
    frames: Counter[str] = field(default_factory=Counter)

    def __len__(self) -> int:
        return self.log_ns.size

    @property
    def falls_back(self) -> bool:
        """Whether stamps fall back again and again in the order of the log times: of two times that lie over one another."""
        return int(np.count_nonzero(np.diff(self.stamp_ns) < -MAX_WAIT_S * NS_PER_S)) > _FEW


class _Topic:
    def __init__(self) -> None:
        self.log_ns, self.stamp_ns, self.is_set = array("q"), array("q"), array("b")
        self.frames: Counter[str] = Counter()
        self._last: tuple[int, bytes] | None = None

    def add(self, log_ns: int, header: tuple[int, str] | None, body: bytes) -> None:
        stamp_ns, frame = header or (0, "")
        is_set = header is not None
        if self._last is not None and self._last[0] == stamp_ns and self._last[1] != body:
            is_set = False
        self._last = stamp_ns, body
        self.log_ns.append(log_ns)
        self.stamp_ns.append(stamp_ns)
        self.is_set.append(is_set)
        if frame in self.frames or len(self.frames) < _MOST_FRAMES:
            self.frames[frame] += 1

    def times(self) -> MessageTimes:
        log_ns, stamp_ns = (np.array(each, dtype=np.int64) for each in (self.log_ns, self.stamp_ns))
        return MessageTimes(log_ns, stamp_ns, np.array(self.is_set, dtype=bool), self.frames)


class _Unwound:
    """Makes log times go on where the recorder's clock was set back, by the rhythm of the topic that comes next."""

    def __init__(self) -> None:
        self.set_back_ns: list[int] = []
        self._shift_ns, self._last_ns = 0, None
        self._last_of: dict[str, int] = {}
        self._gap_of: dict[str, int] = {}

    def __call__(self, topic: str, log_ns: int) -> int:
        now_ns = log_ns + self._shift_ns
        if self._last_ns is not None and self._last_ns - now_ns > MAX_WAIT_S * NS_PER_S:
            next_ns = max(self._last_of.get(topic, self._last_ns) + self._gap_of.get(topic, 0), self._last_ns)
            self.set_back_ns.append(next_ns - now_ns)
            self._shift_ns += next_ns - now_ns
            now_ns = next_ns
        if (before := self._last_of.get(topic)) is not None:
            self._gap_of[topic] = now_ns - before
        self._last_of[topic] = now_ns
        self._last_ns = now_ns if self._last_ns is None else max(self._last_ns, now_ns)
        return now_ns


def read_times_as_written(bag: Bag, topics: Mapping[str, str]) -> tuple[dict[str, MessageTimes], list[int]]:
    """The same in the order of the file, log times made to go on, and by how much the recorder's clock was set back [ns]."""
    read, unwound = {topic: _Topic() for topic in topics}, _Unwound()
    for topic, log_ns, data, is_ros1 in bag.encoded_messages(topics, in_file_order=True):
        read[topic].add(unwound(topic, log_ns), header_of(data, is_ros1), data)
    return {topic: each.times() for topic, each in read.items()}, unwound.set_back_ns


def read_times(bag: Bag, topics: Mapping[str, str]) -> dict[str, MessageTimes]:
    """The times of all messages of these topics, by type, which begin with a header; one message is held at a time.

    Raises InputError where the bag is damaged.
    """
    read = {topic: _Topic() for topic in topics}
    for topic, log_ns, data, is_ros1 in bag.encoded_messages(topics):
        read[topic].add(log_ns, header_of(data, is_ros1), data)
    return {topic: each.times() for topic, each in read.items()}


def header_of(data: bytes, is_ros1: bool) -> tuple[int, str] | None:
    """Stamp [ns] and frame_id of an encoded message that begins with a header; None where they cannot be read."""
    try:
        if is_ros1:
            _, seconds, nanoseconds, length = struct.unpack_from("<IIII", data, 0)
            start = 16
        else:
            order = "<" if data[1] & 1 else ">"
            seconds, nanoseconds, length = struct.unpack_from(f"{order}iII", data, _CDR_BYTES)
            start = _CDR_BYTES + 12
    except (struct.error, IndexError):
        return None
    if nanoseconds >= NS_PER_S or start + length > len(data):
        return None
    frame = bytes(data[start : start + length]).rstrip(b"\0").decode("utf-8", "replace")
    return seconds * NS_PER_S + nanoseconds, frame
