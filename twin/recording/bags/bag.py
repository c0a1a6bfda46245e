"""Any ROS bag, message by message: ROS 1 `.bag`, ROS 2 folder, single `.mcap` or `.db3`.

Messages come by log time, or in file order: the two differ if the recorder's clock was set back.
"""

from __future__ import annotations

import struct
import sys
from collections import defaultdict
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, cast

import apsw  # rosbags reads sqlite3 bags with it; imported for its error only
from rosbags import rosbag1, rosbag2
from rosbags.interfaces import Connection, ConnectionExtRosbag2
from rosbags.rosbag2.storage_mcap import McapReader
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from trackers.errors import InputError
from trackers.observations import NS_PER_S
from trackers.rig import normal_topic
from trackers.user_input.text_file import refuse_unless_lifted
from twin.recording.bags.bag_damage import describe_damage, reason_unreadable
from twin.recording.bags.bag_files import BagPath
from twin.recording.bags.bounded_readers import MOST_CHUNK_BYTES, open_reader
from twin.recording.losses import Loss
from twin.recording.ros.message_types import TRANSFORM_MESSAGES, normal_type, typestore
from twin.recording.ros.scan_messages import CDR_BYTES

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

# Exceptions of rosbags 0.11 on bags cut or overwritten anywhere: its own, and those of the underlying parsers and
# decoders.
_BROKEN_BAG = (
    rosbag1.ReaderError,
    rosbag2.ReaderError,
    SerdeError,
    apsw.Error,
    struct.error,
    AssertionError,
    EOFError,
    KeyError,
    MemoryError,
    OverflowError,
    RuntimeError,
    TypeError,
    ValueError,
    zstd.ZstdError,
)
_HASHED_BYTES = 16384
"""Number of bytes, evenly over a message, by which two of one stamp and length are compared."""
_REMEMBERED = 4096
"""Number of messages of a topic among which copies are looked for."""
_EXPECTED = "a whole ROS 1 .bag, ROS 2 bag folder, .mcap or .db3 is expected"


@cache
def _ros1_typestore() -> Typestore:
    """Return the messages of ROS 1, whose code is generated when first needed.

    rosbags' own are those of common_msgs: transforms, of tf2_msgs and tf, are not among them.
    """
    store = get_typestore(Stores.ROS1_NOETIC)
    for msgtype in TRANSFORM_MESSAGES:
        store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", msgtype))
    return store


@dataclass(frozen=True, slots=True)
class Topic:
    """Topic in a bag: the type of its messages in ROS 2 notation, and their number over all types.

    others: further types of messages on the topic, with their numbers.
    """

    msgtype: str
    message_count: int
    others: Mapping[str, int] = field(default_factory=dict)

    def count_of(self, msgtype: str) -> int:
        """Return the number of messages of a type, as the bag's index says."""
        if msgtype != self.msgtype:
            return self.others.get(msgtype, 0)
        return self.message_count - sum(self.others.values())

    def type_among(self, msgtypes: Collection[str]) -> str | None:
        """Return the one of these types with most messages on the topic; None without any."""
        have = [each for each in (self.msgtype, *self.others) if each in msgtypes]
        return max(have, key=self.count_of, default=None)


class Bag:
    """An open bag; made by `open_bag`.

    Attributes: `start_ns`, `end_ns`: log times of the first and the last message as the bag's index has them [ns], equal for
    an empty bag.
    """

    def __init__(self, path: Path, reader: rosbag1.Reader | rosbag2.Reader) -> None:
        self._path = path
        self._reader = reader
        is_empty = reader.duration <= 0
        self.start_ns = 0 if is_empty else reader.start_time
        self.end_ns = 0 if is_empty else reader.end_time - 1  # rosbags counts to 1 ns after the last

    @property
    def topics(self) -> dict[str, Topic]:
        """Topics by name, each with one slash in front; a topic of several types has the type of the first."""
        topics: dict[str, Topic] = {}
        for connection in self._reader.connections:
            name, msgtype, count = normal_topic(connection.topic), self._type(connection), connection.msgcount
            known = topics.get(name, Topic(msgtype, 0))
            others = dict(known.others)
            if msgtype != known.msgtype:
                others[msgtype] = others.get(msgtype, 0) + count
            topics[name] = Topic(known.msgtype, known.message_count + count, others)
        return topics

    @property
    def unread(self) -> list[Loss]:
        """Files of a bag folder that are not there, or that its metadata.yaml does not name."""
        remedy = f"`ros2 bag reindex {self._path.name}` writes it of all files that are there"
        clauses = getattr(getattr(self._reader, "storage", None), "unread", ())
        return [Loss("metadata.yaml", 0, 0, each, remedy, always=True) for each in clauses]

    @property
    def duration_s(self) -> float:
        """From the first message logged to the last [s]; 0 for an empty bag."""
        return (self.end_ns - self.start_ns) / 1e9

    def encoded_messages(
        self, topics: Mapping[str, str], *, in_file_order: bool = False
    ) -> Iterator[tuple[str, int, bytes, bool]]:
        """Yield topic, log time [ns], encoded message and is_ros1 (encoded as ROS 1 does), in order of log time.

        `topics`: the wanted type of messages per topic. Messages of one log time are in file order. `in_file_order`: all in
        file order, for a recorder whose clock was set back. Raises InputError where the bag is damaged.
        """
        connections = [
            connection
            for connection in self._reader.connections
            if topics.get(normal_topic(connection.topic)) == self._type(connection)
        ]
        if not connections:
            return  # rosbags would yield all
        is_ros1 = {connection.id: self.is_ros1_encoded(connection) for connection in connections}
        with _bag_errors(self._path):
            read = _as_written(self._reader, connections) if in_file_order else self._reader.messages(connections)
            for connection, log_time_ns, data in read:
                yield normal_topic(connection.topic), log_time_ns, data, is_ros1[connection.id]

    def messages(self, topics: Collection[str]) -> Iterator[tuple[str, int, Any]]:
        """Yield topic, log time [ns] and message, in order of log time, read one at a time.

        Of a topic of several types, only messages of the first are read. Raises InputError for a damaged bag or message.
        """
        types = {name: topic.msgtype for name, topic in self.topics.items() if name in topics}
        for topic, log_time_ns, data, is_ros1 in self.encoded_messages(types):
            with _bag_errors(self._path):
                message = decode(data, types[topic], is_ros1)
            yield topic, log_time_ns, message

    @property
    def connections(self) -> list[Connection]:
        """Topics with their types, one entry per publisher."""
        return list(self._reader.connections)

    def raw_messages(
        self, connections: Sequence[Connection], *, in_file_order: bool = False
    ) -> Iterator[tuple[Connection, int, bytes]]:
        """Yield connection, log time [ns] and encoded message, in order of log time or of the file.

        Raises InputError where the bag is damaged.
        """
        if connections:
            with _bag_errors(self._path):
                read = _as_written(self._reader, connections) if in_file_order else self._reader.messages(connections)
                yield from read

    def is_ros1_encoded(self, connection: Connection) -> bool:
        """Return True for messages encoded as in ROS 1, in a ROS 1 bag or an MCAP file."""
        extra = connection.ext
        return not isinstance(extra, ConnectionExtRosbag2) or extra.serialization_format == "ros1"

    def _type(self, connection: Connection) -> str:
        """Return the type in ROS 2 notation; for an encoding that cannot be read, with the encoding's name."""
        msgtype = normal_type(connection.msgtype)
        extra = connection.ext
        if isinstance(extra, ConnectionExtRosbag2) and extra.serialization_format not in ("cdr", "ros1"):
            return f"{msgtype} encoded as {extra.serialization_format or 'nothing that is named'}"
        return msgtype


def header_of(data: bytes, is_ros1: bool) -> tuple[int, str, int] | None:
    """Read stamp [ns], frame_id and length [bytes] of the header of an encoded message; None where they cannot be read."""
    try:
        if is_ros1:
            _, seconds, nanoseconds, length = struct.unpack_from("<IIII", data, 0)
            start = 16
        else:
            order = "<" if data[1] & 1 else ">"
            seconds, nanoseconds, length = struct.unpack_from(f"{order}iII", data, CDR_BYTES)
            start = CDR_BYTES + 12
    except (struct.error, IndexError):
        return None
    if nanoseconds >= NS_PER_S or start + length > len(data):
        return None
    frame = bytes(data[start : start + length]).rstrip(b"\0").decode("utf-8", "replace")
    return seconds * NS_PER_S + nanoseconds, frame, start + length


class Copies:
    """Finds messages that come again, as through a second relay or recorder: of one topic, stamp (not 0) and content."""

    def __init__(self) -> None:
        self._logged_ns: defaultdict[str, dict[tuple[int, int, int], int]] = defaultdict(dict)
        self.later_ns: defaultdict[str, list[int]] = defaultdict(list)
        """Time from the first message to each copy of it, by the log [ns], by topic."""

    def add(self, topic: str, log_ns: int, data: bytes, is_ros1: bool) -> bool:
        """Add a message; return True for a copy of an earlier one."""
        stamp_ns, _, _ = header_of(data, is_ros1) or (0, "", 0)
        if not stamp_ns:
            return False
        body = data[4:] if is_ros1 else data  # ROS 1 counts each publisher's messages there
        known = self._logged_ns[topic]
        key = stamp_ns, len(body), hash(bytes(body[:: 1 + len(body) // _HASHED_BYTES]))
        if key in known:
            self.later_ns[topic].append(log_ns - known[key])
            return True
        known[key] = log_ns
        if len(known) > _REMEMBERED:
            del known[next(iter(known))]
        return False


@contextmanager
def open_bag(path: Path) -> Iterator[Bag]:
    """Open a bag for reading; raises InputError for one that is missing, of another kind, or damaged."""
    if not path.exists():
        raise InputError(f"{path}: does not exist; {_EXPECTED}")
    if not path.is_dir() and not path.is_file():  # a pipe would be waited for
        raise InputError(f"{path}: is a pipe or a device, neither a file nor a folder; {_EXPECTED}")
    with _bag_errors(path):
        if reason := reason_unreadable(path):
            raise InputError(f"{path}: {reason}; {_EXPECTED}")
        reader = open_reader(cast("Path", BagPath(path)))
    try:
        yield Bag(path, reader)
    finally:
        reader.close()


def decode(data: bytes, msgtype: str, is_ros1: bool) -> Any:
    """Decode a message of a standard type; raises what `rosbags` does for other bytes.

    The definitions in the bag, which may be damaged, are not parsed: only standard messages are used.
    """
    store = _ros1_typestore() if is_ros1 else typestore(msgtype)
    return (store.deserialize_ros1 if is_ros1 else store.deserialize_cdr)(data, msgtype)


def decoded(data: bytes, msgtype: str, is_ros1: bool) -> Any:
    """Decode as `decode` does; raises InputError for invalid bytes."""
    try:
        return decode(data, msgtype, is_ros1)
    except _BROKEN_BAG as error:
        raise InputError(f"{len(data)} bytes that are no {msgtype} ({_first_line(error)})") from error


@contextmanager
def _bag_errors(path: Path) -> Iterator[None]:
    try:
        yield
    except InputError:
        raise
    except _BROKEN_BAG as error:
        if isinstance(error, apsw.TooBigError) or isinstance(error.__cause__, apsw.TooBigError):
            refuse_unless_lifted(
                f"{path}: holds a value that is larger than any message", f"at most {MOST_CHUNK_BYTES >> 20} MiB"
            )
        raise InputError(f"{path}: {describe_damage(path, _first_line(error))}; {_EXPECTED}") from error
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error}); {_EXPECTED}") from error


def _first_line(error: BaseException) -> str:
    return (str(error) or type(error).__name__).splitlines()[0].rstrip(".")


Message = tuple[Connection, int, bytes]
"""Connection, log time [ns], encoded message."""


def _as_written(reader: rosbag1.Reader | rosbag2.Reader, connections: Sequence[Connection]) -> Iterator[Message]:
    """Yield the messages of these connections in file order."""
    if isinstance(reader, rosbag1.Reader):
        yield from _ros1(reader, connections)
        return
    storage: Any = reader.storage
    for each in getattr(storage, "storages", [storage]):
        wanted = {(connection.topic, connection.msgtype): connection for connection in connections}
        own = {other.id: wanted[key] for other in each.connections if (key := (other.topic, other.msgtype)) in wanted}
        found = _written_in(each, [other for other in each.connections if other.id in own])
        yield from ((own[number], log_time_ns, data) for number, log_time_ns, data in found)


def _ros1(reader: rosbag1.Reader, connections: Sequence[Connection]) -> Iterator[Message]:
    """Read a ROS 1 bag in file order: the library keeps the order of a single connection's index."""
    entries = [entry for connection in connections for entry in reader.indexes[connection.id]]
    kept, first = reader.indexes, connections[0]
    reader.indexes = kept | {first.id: sorted(entries, key=lambda entry: (entry.chunk_pos, entry.offset))}
    try:
        yield from reader.messages([first])
    finally:
        reader.indexes = kept


def _written_in(storage: Any, connections: Sequence[Connection]) -> Iterator[tuple[int, int, bytes]]:
    """Yield connection number, log time [ns] and message of one file of a ROS 2 bag."""
    if storage.are_messages_packed:
        for number, log_time_ns, data in _stored_in(storage, connections):
            yield number, log_time_ns, zstd.decompress(data)
    else:
        yield from _stored_in(storage, connections)


def _stored_in(storage: Any, connections: Sequence[Connection]) -> Iterator[tuple[int, int, bytes]]:
    """Yield the same with messages as stored, compressed or not."""
    if isinstance(storage, McapReader):
        for connection, log_time_ns, data in storage.messages_scan(connections):
            yield connection.id, log_time_ns, data
    if isinstance(storage, Sqlite3Reader):
        assert storage.dbconn is not None
        numbers = [connection.id for connection in connections]
        places = ",".join("?" for _ in numbers)
        query = f"SELECT topic_id, timestamp, data FROM messages WHERE topic_id IN ({places}) ORDER BY id"
        yield from storage.dbconn.execute(query, numbers)
