"""Bag readers with bounded decompression: the claimed sizes of compressed parts are first compared with a budget.

A chunk of some hundred kilobytes can unpack to gigabytes. `rosbags` has no limit: these are its readers with sizes checked
first, and decoders that stop where a part exceeds its claim.
"""

from __future__ import annotations

import bz2
import io
import struct
import sys
from collections.abc import Callable, Collection, Generator, Iterator, Mapping, Sequence
from functools import lru_cache, partial
from heapq import heappop, heappush
from itertools import count
from pathlib import Path
from types import MappingProxyType
from typing import Any, BinaryIO

import apsw
import lz4.frame
import numpy as np
from rosbags import rosbag1, rosbag2
from rosbags.interfaces import Connection, Qos
from rosbags.interfaces.typing import RPath
from rosbags.rosbag1.reader import Chunk, Header, RecordType
from rosbags.rosbag2 import storage_mcap
from rosbags.rosbag2.reader import DirectoryReader
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader

from trackers.errors import InputError
from trackers.user_input.text_file import are_limits_lifted, check_limit, refuse_unless_lifted
from twin.recording.bags.bag_damage import MCAP_MAGIC
from twin.recording.bags.bag_files import readable_metadata

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

MOST_CHUNK_BYTES = 2**27
"""Size of one chunk or message, unpacked."""
MOST_HELD_BYTES = 2**29
"""Size of the chunks overlapping in time, held together to sort their messages."""
MOST_BAG_BYTES = 2**28
"""Size of all chunks of a small bag."""
MOST_GROWTH = 100
"""Unpacked size of a large bag relative to its own. Scans and pictures grow two- to twentyfold."""
_MOST_AGAIN = 20
"""Total number of repeated decompressions: a ROS 1 bag unpacks a chunk again wherever it overlaps another."""

_MIB = 2**20
_CHUNK = 0x06
_ZSTD_MAGIC, _SKIPPABLE_MAGIC = 0xFD2FB528, 0x184D2A5  # the second without its last four bits (RFC 8878, 3.1)
_ZSTD_BLOCK_BYTES = 2**17

Messages = Generator[tuple[Connection, int, bytes], None, None]
"""Connection, log time [ns], encoded message."""


def open_reader(path: Path) -> rosbag1.Reader | rosbag2.Reader:
    """Open a bag's reader; raises what `rosbags` does, and InputError for parts larger than the limits."""
    is_ros1 = path.suffix == ".bag" and path.is_file()
    reader = _Ros1Reader(path) if is_ros1 else _Ros2Reader(path)
    reader.open()
    return reader


def unpack(make: Callable[[], Any], data: bytes, n_bytes: int) -> bytes:
    """Decode compressed data by decoders of this class; raises ValueError where it holds more than `n_bytes`."""
    parts, left = [], n_bytes
    while data:
        decoder = make()
        part = decoder.decompress(data, max_length=left + 1)
        if len(part) > left:
            raise ValueError(f"a compressed part holds more than the {n_bytes} bytes that it claims")
        if not decoder.eof:
            raise EOFError("a compressed part has no end")
        parts.append(part)
        left -= len(part)
        data = decoder.unused_data or b""
    return parts[0] if len(parts) == 1 else b"".join(parts)


# The library takes MCAP's decoders from here, and passes each the claimed size of the chunk.
storage_mcap.DECOMPRESSORS.update(
    lz4=partial(unpack, lz4.frame.LZ4FrameDecompressor), zstd=partial(unpack, zstd.ZstdDecompressor)
)
_MOST_QOS_BYTES = 2**14
"""Size up to which a topic's offered QoS is cached; ROS writes less than 1 kB."""
_kept_qos = lru_cache(maxsize=64)(storage_mcap.get_qos)


def _qos(metadata: bytes) -> list[Qos]:
    """Read the QoS that a topic was offered with; the library parses the same few texts anew whenever a bag is opened."""
    return list(_kept_qos(metadata)) if len(metadata) <= _MOST_QOS_BYTES else _kept_qos.__wrapped__(metadata)


storage_mcap.get_qos = _qos
_ROS1_DECODERS: dict[str, Callable[[], Any]] = {"bz2": bz2.BZ2Decompressor, "lz4": lz4.frame.LZ4FrameDecompressor}


class _Ros1Reader(rosbag1.Reader):
    """ROS 1 bag whose chunks match their headers and the limits."""

    def open(self) -> None:
        self._claimed: list[int] = []
        self._unpacked = 0
        super().open()
        _check_chunks(self.path, self._claimed)

    def read_chunk(self) -> Chunk:
        """Read the head of a chunk: where it lies, and a decoder that knows how much it may hold."""
        assert self.bio is not None
        start = self.bio.tell()
        header = Header.read(self.bio, RecordType.CHUNK)
        self.bio.seek(start)
        chunk = super().read_chunk()
        make = _ROS1_DECODERS.get(header.get_string("compression"))
        if make is None:
            return chunk
        n_bytes = header.get_uint32("size")
        check_limit(n_bytes / _MIB, MOST_CHUNK_BYTES / _MIB, f"{self.path!s}: a chunk unpacks to", "MiB")
        self._claimed.append(n_bytes)
        return chunk._replace(decompressor=partial(self._unpack, make, n_bytes))

    def _unpack(self, make: Callable[[], Any], n_bytes: int, data: bytes) -> bytes:
        self._unpacked += n_bytes
        if self._unpacked > MOST_BAG_BYTES + _MOST_AGAIN * sum(self._claimed):
            refuse_unless_lifted(
                f"{self.path!s}: its chunks overlap in time, so that each would be unpacked for every message",
                "messages in order of time",
            )
        return unpack(make, data, n_bytes)


class _McapReader(storage_mcap.McapReader):
    """MCAP file whose chunks keep the limits, alone, together, and those held at once."""

    are_messages_packed = False

    def meta_scan(self) -> None:
        """Scan the whole file for content missing in its summary."""
        self._check_walked()
        super().meta_scan()

    def messages_scan(
        self, connections: Collection[Connection], start: int | None = None, stop: int | None = None
    ) -> Messages:
        """Read messages as they stand in the file."""
        self._check_walked()
        yield from _checked(self, super().messages_scan(connections, start, stop))

    def messages(
        self, connections: Collection[Connection], start: int | None = None, stop: int | None = None
    ) -> Messages:
        """Read messages in order of log time."""
        if self.chunks:
            _check_chunks(self.path, [each.uncompressed_size for each in self.chunks if each.compression])
            self._check_held()
        yield from _checked(self, super().messages(connections, start, stop))

    def _check_held(self) -> None:
        """Raise InputError where chunks overlapping in time are too large together."""
        spans = np.array([(each.message_start_time, each.message_end_time) for each in self.chunks], dtype=np.uint64)
        sizes = np.array([each.uncompressed_size for each in self.chunks], dtype=np.float64)
        when, change = spans.T.ravel(), np.concatenate([sizes, -sizes])
        order = np.lexsort((-change, when))  # at equal times, begins before ends
        most = float(np.cumsum(change[order]).max())
        said = f"{self.path!s}: chunks that overlap in time, which are held at once, unpack to"
        check_limit(most / _MIB, MOST_HELD_BYTES / _MIB, said, "MiB")

    def _check_walked(self) -> None:
        """Raise InputError for too large chunks, found record by record."""
        assert self.bio is not None
        _check_chunks(self.path, list(_claimed_on_the_way(self.bio, self.data_end)))


class _SqliteReader(Sqlite3Reader):
    """SQLite file whose values keep the limits, and are stored, not computed."""

    are_messages_packed = False

    def open(self) -> None:
        if are_limits_lifted():
            super().open()
            return
        hooks = apsw.connection_hooks
        hooks.append(_limit_values)  # the library opens two connections, and reads at once
        try:
            super().open()
        finally:
            hooks.remove(_limit_values)
        assert self.dbconn is not None
        for table in ("messages", "topics"):
            for column in self.dbconn.execute(f"PRAGMA table_xinfo({table})"):
                if column[-1]:  # hidden or generated: a file of a few kilobytes could make gigabytes
                    raise InputError(
                        f"{self.path!s}: column {column[1]!r} of its table {table!r} is worked out from others; a table as ROS 2 "
                        "writes it is expected"
                    )

    def messages(
        self, connections: Collection[Connection], start: int | None = None, stop: int | None = None
    ) -> Messages:
        """Read messages in order of log time."""
        yield from _checked(self, super().messages(connections, start, stop))


class _FolderReader(DirectoryReader):
    """ROS 2 bag folder whose files and messages keep the limits when unpacked."""

    STORAGE_PLUGINS: Mapping[str, type[Any]] = MappingProxyType({"mcap": _McapReader, "sqlite3": _SqliteReader})
    unread: tuple[str, ...] = ()
    """Files of the folder that are not read, a clause each."""

    def open(self) -> None:
        _, self.unread = readable_metadata(Path(str(self.path)))
        for packed in sorted(self.path.glob("*.zst*")):  # unpacked where metadata.yaml says so, on opening
            with packed.open("rb") as stream:
                n_bytes = zstd_bound(stream)
            _check_bag(packed, n_bytes, packed.stat().st_size)
        super().open()
        for each in self.storages:
            each.are_messages_packed = self.metadata.compression_mode == "message"
        self._complete_topics()

    def _complete_topics(self) -> None:
        """Take what the files say of their topics where the metadata lacks a topic, or says otherwise how it is offered."""
        named = {(each.topic, each.msgtype): each for each in self.connections}
        found: dict[tuple[str, str], Connection] = {}
        for each in (connection for file in self.storages for connection in file.connections):
            key = each.topic, each.msgtype
            so_far = named.get(key) or found.get(key) or each._replace(id=0, msgcount=0, owner=self)
            count = so_far.msgcount if key in named else so_far.msgcount + each.msgcount
            found[key] = so_far._replace(ext=each.ext, msgcount=count)
        numbered = (named | found).values()
        self.connections = [each._replace(id=number) for number, each in enumerate(numbered, start=1)]

    def messages(
        self, connections: Collection[Connection], start: int | None = None, stop: int | None = None
    ) -> Messages:
        """Read messages in order of log time, though the files may stand in any order, and overlap in time."""
        waiting = sorted(enumerate(self.storages), key=lambda each: (each[1].metadata.start_time, each[0]))[::-1]
        heads: list[tuple[int, int, tuple[Connection, int, bytes], Messages]] = []
        while waiting or heads:
            if waiting and (not heads or waiting[-1][1].metadata.start_time <= heads[0][0]):
                place, file = waiting.pop()
                read = self._of_file(file, connections, start, stop)
            else:
                _, place, message, read = heappop(heads)
                yield message
            if (following := next(read, None)) is not None:
                heappush(heads, (following[1], place, following, read))

    def _of_file(self, file: Any, connections: Collection[Connection], start: int | None, stop: int | None) -> Messages:
        """Read the messages of one file, by topic and type: how a topic was offered may differ from file to file."""
        wanted = {(each.topic, each.msgtype): each for each in connections or self.connections}
        own = {each.id: wanted[key] for each in file.connections if (key := (each.topic, each.msgtype)) in wanted}
        if own:
            for connection, log_time_ns, data in file.messages(
                [each for each in file.connections if each.id in own], start, stop
            ):
                yield own[connection.id], log_time_ns, zstd.decompress(data) if file.are_messages_packed else data


class _Ros2Reader(rosbag2.Reader):
    """Any ROS 2 bag, by the readers here."""

    STORAGE_PLUGINS: Mapping[str, type[Any]] = MappingProxyType(
        {"dir": _FolderReader, ".mcap": _McapReader, ".db3": _SqliteReader}
    )


def zstd_bound(stream: BinaryIO) -> int:
    """Return an upper bound of the bytes in zstd frames, from the headers of their blocks, without decoding (RFC 8878, 3.1).

    Errors after the last complete block are left to the decoder.
    """
    total = 0
    while len(head := stream.read(4)) == 4:
        (magic,) = struct.unpack("<I", head)
        if magic >> 4 == _SKIPPABLE_MAGIC:
            (size,) = struct.unpack("<I", stream.read(4).rjust(4, b"\0"))
            stream.seek(size, 1)
            continue
        descriptor = stream.read(1)
        if magic != _ZSTD_MAGIC or not descriptor:
            return total
        is_single, has_checksum = descriptor[0] >> 5 & 1, descriptor[0] >> 2 & 1
        stream.seek((1, 2, 4, 8)[descriptor[0] >> 6] if is_single or descriptor[0] >> 6 else 0, 1)
        stream.seek((0, 1, 2, 4)[descriptor[0] & 3] + (not is_single), 1)
        for _ in count():
            block = stream.read(3)
            if len(block) < 3:
                return total
            number = int.from_bytes(block, "little")
            is_last, kind, size = number & 1, number >> 1 & 3, number >> 3
            total += size if kind in (0, 1) else _ZSTD_BLOCK_BYTES
            stream.seek(1 if kind == 1 else size, 1)
            if is_last:
                break
        stream.seek(4 * has_checksum, 1)
    return total


def _claimed_on_the_way(stream: BinaryIO, end: int) -> Iterator[int]:
    """Yield the claimed sizes [bytes] of the compressed chunks of an MCAP file, record by record up to `end`."""
    stream.seek(len(MCAP_MAGIC))
    while stream.tell() < end and len(head := stream.read(9)) == 9:
        op, size = head[0], struct.unpack("<Q", head[1:])[0]
        next_record = stream.tell() + size
        if next_record > end:
            return  # reported by the library
        if op == _CHUNK and size >= 32:
            _, _, claimed, _, name_bytes = struct.unpack("<QQQII", stream.read(32))
            if name_bytes:
                yield claimed
        stream.seek(next_record)


def _check_chunks(path: RPath, claimed: Sequence[int]) -> None:
    """Raise InputError for compressed chunks that claim to hold more than the limits, alone or together [bytes]."""
    if claimed:
        check_limit(max(claimed) / _MIB, MOST_CHUNK_BYTES / _MIB, f"{path!s}: a chunk unpacks to", "MiB")
        _check_bag(path, sum(claimed), path.stat().st_size)


def _check_bag(path: RPath, n_bytes: int, file_bytes: int) -> None:
    most = max(MOST_BAG_BYTES, MOST_GROWTH * file_bytes)
    check_limit(n_bytes / _MIB, most / _MIB, f"{path!s}: its {file_bytes} bytes unpack to", "MiB")


def _checked(storage: _McapReader | _SqliteReader, messages: Messages) -> Messages:
    """Yield the messages of a storage; raises InputError for a packed one larger than the limits, before it is unpacked."""
    for message in messages:
        if storage.are_messages_packed:
            most = zstd_bound(io.BytesIO(message[2])) / _MIB
            check_limit(most, MOST_CHUNK_BYTES / _MIB, f"{storage.path!s}: a message unpacks to", "MiB")
        yield message


def _limit_values(connection: apsw.Connection) -> None:
    connection.limit(apsw.SQLITE_LIMIT_LENGTH, MOST_CHUNK_BYTES)
