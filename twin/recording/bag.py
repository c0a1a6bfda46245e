"""Any ROS bag, message by message: ROS 1 `.bag`, ROS 2 folder, single `.mcap` or `.db3`."""

from __future__ import annotations

import struct
import sys
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import apsw  # what rosbags reads sqlite3 bags with; named here for its error only
from rosbags import rosbag1, rosbag2
from rosbags.interfaces import Connection
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_typestore

from trackers.errors import InputError
from twin.recording.messages import TYPESTORE

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

# What rosbags 0.11 raises on bags cut or overwritten at any place: its own errors, and those of the parsers, decoders
# and assertions under it that it lets through.
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
_EXPECTED = "a whole ROS 1 .bag, ROS 2 bag folder, .mcap or .db3 is expected"


@dataclass(frozen=True, slots=True)
class Topic:
    """A topic in a bag: the type of its messages in ROS 2 notation, and how many there are."""

    msgtype: str
    message_count: int


class Bag:
    """An open bag; made by `open_bag`."""

    def __init__(self, path: Path, reader: rosbag1.Reader | rosbag2.Reader) -> None:
        self._path = path
        self._reader = reader
        # Only standard messages are used; the definitions in the bag need not be parsed, and cannot break anything.
        is_ros1 = isinstance(reader, rosbag1.Reader)
        self._deserialize = get_typestore(Stores.ROS1_NOETIC).deserialize_ros1 if is_ros1 else TYPESTORE.deserialize_cdr

    @property
    def topics(self) -> dict[str, Topic]:
        """The topics by name, each with one slash in front; a topic of several types has the type of the first."""
        topics: dict[str, Topic] = {}
        for connection in self._reader.connections:
            name = normal_topic(connection.topic)
            known = topics.get(name, Topic(connection.msgtype, 0))
            topics[name] = Topic(known.msgtype, known.message_count + connection.msgcount)
        return topics

    @property
    def duration_s(self) -> float:
        """From the first message logged to the last [s]; 0 for an empty bag."""
        return max(self._reader.duration - 1, 0) / 1e9  # rosbags counts to 1 ns after the last

    def messages(self, topics: Collection[str]) -> Iterator[tuple[str, int, Any]]:
        """Topic, log time [ns] and message, in order of log time, read as they are asked for.

        Messages of one log time come as they were written. Raises InputError where the bag is damaged.
        """
        topic_types = self.topics
        connections = [
            connection
            for connection in self._reader.connections
            if (name := normal_topic(connection.topic)) in topics and connection.msgtype == topic_types[name].msgtype
        ]
        if not connections:
            return  # rosbags takes no connections for all
        with _bag_errors(self._path):
            for connection, log_time_ns, data in self._reader.messages(connections):
                message = self._deserialize(data, connection.msgtype)
                yield normal_topic(connection.topic), log_time_ns, message

    @property
    def connections(self) -> list[Connection]:
        """What the bag holds messages of: topics with their types, one entry for each publisher."""
        return list(self._reader.connections)

    def raw_messages(self, connections: Sequence[Connection]) -> Iterator[tuple[Connection, int, bytes]]:
        """Connection, log time [ns] and message as it stands in the bag, in order of log time.

        Raises InputError where the bag is damaged.
        """
        if connections:
            with _bag_errors(self._path):
                yield from self._reader.messages(connections)


@contextmanager
def open_bag(path: Path) -> Iterator[Bag]:
    """Open a bag for reading; raises InputError for one that is missing, of another kind, or damaged."""
    if not path.exists():
        raise InputError(f"{path}: does not exist; {_EXPECTED}")
    if path.is_dir() and not (path / "metadata.yaml").exists():
        raise InputError(f"{path}: is a folder without metadata.yaml, so no ROS 2 bag; {_EXPECTED}")
    if not path.is_dir() and path.suffix not in (".bag", ".mcap", ".db3"):
        raise InputError(f"{path}: is not named like a bag; {_EXPECTED}")
    with _bag_errors(path):
        reader = rosbag1.Reader(path) if path.suffix == ".bag" and path.is_file() else rosbag2.Reader(path)
        reader.open()
    try:
        yield Bag(path, reader)
    finally:
        reader.close()


def normal_topic(name: str) -> str:
    """A topic's name with one slash in front, as ROS 1 and ROS 2 may or may not write it."""
    return "/" + name.strip("/")


@contextmanager
def _bag_errors(path: Path) -> Iterator[None]:
    try:
        yield
    except InputError:
        raise
    except _BROKEN_BAG as error:
        reason = (str(error) or type(error).__name__).splitlines()[0].rstrip(".")
        raise InputError(f"{path}: is truncated or damaged ({reason}); {_EXPECTED}") from error
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error}); {_EXPECTED}") from error
