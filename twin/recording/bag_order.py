"""A bag's messages by log time, or as they were written: the two differ where the clock of the recorder was set back."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from typing import Any

from rosbags import rosbag1, rosbag2
from rosbags.interfaces import Connection
from rosbags.rosbag2.storage_mcap import McapReader
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

Message = tuple[Connection, int, bytes]
"""Connection, log time [ns], encoded message."""


def messages_by_time(reader: rosbag1.Reader | rosbag2.Reader, connections: Sequence[Connection]) -> Iterator[Message]:
    """The messages of these connections in order of log time."""
    return reader.messages(connections)


def as_written(reader: rosbag1.Reader | rosbag2.Reader, connections: Sequence[Connection]) -> Iterator[Message]:
    """The messages of these connections in the order in which they stand in the file."""
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
    """The library merges the sorted indexes of connections; of a single one it keeps the order, whatever that is."""
    entries = [entry for connection in connections for entry in reader.indexes[connection.id]]
    kept, first = reader.indexes, connections[0]
    reader.indexes = kept | {first.id: sorted(entries, key=lambda entry: (entry.chunk_pos, entry.offset))}
    try:
        yield from reader.messages([first])
    finally:
        reader.indexes = kept


def _written_in(storage: Any, connections: Sequence[Connection]) -> Iterator[tuple[int, int, bytes]]:
    """Number of the connection, log time [ns] and message of one file of a ROS 2 bag."""
    if storage.are_messages_packed:
        for number, log_time_ns, data in _stored_in(storage, connections):
            yield number, log_time_ns, zstd.decompress(data)
    else:
        yield from _stored_in(storage, connections)


def _stored_in(storage: Any, connections: Sequence[Connection]) -> Iterator[tuple[int, int, bytes]]:
    """The same as it stands in the file."""
    if isinstance(storage, McapReader):
        for connection, log_time_ns, data in storage.messages_scan(connections):
            yield connection.id, log_time_ns, data
    if isinstance(storage, Sqlite3Reader):
        assert storage.dbconn is not None
        numbers = [connection.id for connection in connections]
        places = ",".join("?" for _ in numbers)
        query = f"SELECT topic_id, timestamp, data FROM messages WHERE topic_id IN ({places}) ORDER BY id"
        yield from storage.dbconn.execute(query, numbers)
