"""Bag files on disk: paths that `rosbags` can open, and an MCAP file that appears when it is complete.

Paths may hold characters with a meaning in a URI. MCAP files may have a profile other than that of ROS 2.
"""

from __future__ import annotations

import io
import os
import re
import shutil
import struct
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import lru_cache
from pathlib import Path
from types import TracebackType
from typing import Any, Self
from urllib.parse import quote

from rosbags import rosbag2
from rosbags.interfaces import Connection, ConnectionExtRosbag1, Qos
from rosbags.rosbag2 import StoragePlugin, Writer, metadata, storage_mcap, storage_sqlite3, writer

from trackers.errors import InputError
from trackers.user_input.plain_data import dump_yaml, parse_yaml, parse_yaml_value
from twin.recording.atomic_file import unwritable
from twin.recording.bags.bag_damage import MCAP_MAGIC
from twin.recording.ros.message_types import typestore

_NO_HASH = "RIHS00_" + 64 * "0"
"""Hash that ROS 2 writes for a type whose hash is not set."""

_METADATA = "metadata.yaml"
_parse_qos = metadata.parse_qos
_kept_qos_texts = lru_cache(maxsize=64)(lambda qos: metadata.dump_qos_v8(list(qos)))
# The library formats the same few QoS twice for every topic.
writer.dump_qos_v8 = lambda qos: _kept_qos_texts(tuple(qos))  # pyright: ignore[reportPrivateImportUsage]


@contextmanager
def _no_metadata_file() -> Iterator[None]:
    """Let the library format the metadata within an MCAP file alone: the file beside it is not kept, and as costly."""
    writer.YAML = _YamlWithinFile  # pyright: ignore[reportPrivateImportUsage]
    try:
        yield
    finally:
        writer.YAML = _Yaml  # pyright: ignore[reportPrivateImportUsage]


_Yaml = writer.YAML  # pyright: ignore[reportPrivateImportUsage]


class _YamlWithinFile(_Yaml):
    """Formatter of everything but the file beside a bag."""

    def dump(self, data: Any, stream: Any = None, **options: Any) -> Any:
        if "rosbag2_bagfile_information" not in data:
            super().dump(data, stream, **options)


class McapFile:
    """Writer of messages to `path` (a `.mcap`) as they come; a context manager.

    The bag grows in a hidden folder next to `path` and takes its name when the block ends normally; an exception, Ctrl-C
    included, removes it and leaves an older file of that name untouched. Raises ValueError for a path without `.mcap`, and
    InputError where the disk is full or cannot be written.
    """

    def __init__(self, path: Path) -> None:
        if path.suffix != ".mcap":
            raise ValueError(f"{path}: a recording's name ends with .mcap")
        self._path = path
        self._connections: dict[str, Connection] = {}
        self._folder: Path | None = None
        self._writer: Writer | None = None

    def __enter__(self) -> Self:
        try:
            with self._disk_errors():
                self._path.parent.mkdir(parents=True, exist_ok=True)
                if self._path.is_dir():
                    raise InputError(f"{self._path}: is a folder; the name of a file to write is expected")
                self._folder = Path(
                    tempfile.mkdtemp(prefix=f".{self._path.name}.", suffix=".partial", dir=self._path.parent)
                )
                # Version 8 of the metadata is the newest that every maintained ROS 2 distribution reads.
                self._writer = Writer(self._folder / self._path.stem, version=8, storage_plugin=StoragePlugin.MCAP)
                self._writer.open()
        except BaseException:
            self.discard()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        try:
            if kind is None:
                assert self._writer is not None
                with self._disk_errors(), _no_metadata_file():
                    self._writer.close()
                    os.replace(self._writer.path / f"{self._path.stem}.mcap", self._path)
        finally:
            self.discard()

    def connect(self, topic: str, msgtype: str, qos: Sequence[Qos] = ()) -> None:
        """Add a topic of a standard type."""
        assert self._writer is not None
        self._connections[topic] = self._writer.add_connection(
            topic, msgtype, typestore=typestore(msgtype), offered_qos_profiles=qos
        )

    def write(self, topic: str, log_time_ns: int, data: bytes | memoryview) -> None:
        """Write a message (CDR) of a topic."""
        self.write_on(self._connections[topic], log_time_ns, data)

    def connect_text(self, topic: str, msgtype: str, definition: str, type_hash: str) -> Connection:
        """Add a topic of a type defined by this text."""
        assert self._writer is not None
        return self._writer.add_connection(topic, msgtype, msgdef=definition, rihs01=type_hash)

    def connect_as(self, other: Connection) -> Connection:
        """Add a topic with the connection of another ROS 2 bag, of any type."""
        assert self._writer is not None
        assert not isinstance(other.ext, ConnectionExtRosbag1)
        return self._writer.add_connection(
            other.topic,
            other.msgtype,
            msgdef=other.msgdef.data,
            rihs01=other.digest or _type_hash(other.msgtype),
            serialization_format=other.ext.serialization_format,
            offered_qos_profiles=other.ext.offered_qos_profiles,
        )

    def write_on(self, connection: Connection, log_time_ns: int, data: bytes | memoryview) -> None:
        """Write a message (CDR) of a connection that `connect_as` gave."""
        assert self._writer is not None, "a bag is written in a with block"
        try:
            self._writer.write(connection, log_time_ns, data)
        except OSError as error:
            raise unwritable(self._path, error) from error

    @contextmanager
    def _disk_errors(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise unwritable(self._path, error) from error

    def discard(self) -> None:
        """Remove the temporary folder."""
        if self._writer is not None:
            # A full disk makes closing fail again, which no longer matters.
            with suppress(OSError):
                self._writer.abort()
            self._writer = None
        if self._folder is not None:
            shutil.rmtree(self._folder)
            self._folder = None


def _type_hash(msgtype: str) -> str:
    """Return the hash of a standard type's definition; an MCAP file does not keep it."""
    store = typestore(msgtype)
    return store.hash_rihs01(msgtype) if msgtype in store.types else _NO_HASH


_QOS_TIMES = ("deadline", "lifespan", "liveliness_lease_duration")
_CONVENTIONS = "avoid_ros_namespace_conventions"
_QOS_KINDS = ("history", "reliability", "durability", "liveliness")


def _whole_qos(offered: Any) -> list[Qos]:
    """Read the QoS of a topic, of which nothing depends: a field that is missing or no number is unknown, or 0."""
    try:
        listed = parse_yaml_value(offered, "offered_qos_profiles") if isinstance(offered, str) else offered
    except InputError:
        return []
    whole = []
    for each in listed if isinstance(listed, list) else ():
        given = each if isinstance(each, dict) else {}
        times = {name: value if isinstance(value := given.get(name), dict) else {} for name in _QOS_TIMES}
        whole.append(
            {name: value if isinstance(value := given.get(name), int | str) else "unknown" for name in _QOS_KINDS}
            | {name: {key: _count_in(time, key) for key in ("sec", "nsec")} for name, time in times.items()}
            | {"depth": _count_in(given, "depth"), "avoid_ros_namespace_conventions": bool(given.get(_CONVENTIONS))}
        )
    return _parse_qos(whole)


def _count_in(mapping: Mapping[str, Any], key: str) -> int:
    value = mapping.get(key)
    return value if isinstance(value, int) else 0


for _module in (rosbag2.reader, storage_mcap, storage_sqlite3):
    vars(_module)["parse_qos"] = _whole_qos


def readable_metadata(folder: Path) -> tuple[str | None, tuple[str, ...]]:
    """Return the metadata.yaml of a bag folder as the library reads it (None: as it is), and a clause per unread file.

    Files are named by any path; of several, those that are not there are left out. How topics are offered stands in the
    files too.
    """
    try:
        content = parse_yaml((folder / _METADATA).read_text(encoding="utf-8-sig"), _METADATA, "metadata")
        about = content["rosbag2_bagfile_information"]
        named = [re.split(r"[\\/]", each)[-1] for each in about["relative_file_paths"]]
        topics = [each["topic_metadata"] for each in about["topics_with_message_count"]]
        for each in topics:
            each.pop("offered_qos_profiles", None)
    except (InputError, OSError, UnicodeDecodeError, KeyError, TypeError, AttributeError):
        return None, ()  # the library says what is wrong
    missing = [each for each in named if not (folder / each).exists()]
    unpacked = [each.removesuffix(".zstd") for each in named]
    if len(missing) == len(named) and all((folder / each).exists() for each in unpacked):
        named, about["compression_mode"] = unpacked, ""
    if 0 < len(missing) < len(named):
        named = [each for each in named if each not in missing]
    else:
        missing = []
    held = [each.name for each in folder.iterdir() if re.search(r"\.(mcap|db3)(\.zstd)?$", each.name)]
    beside = sorted(set(held) - set(named) - {each.removesuffix(".zstd") for each in named})
    about["relative_file_paths"] = named
    kinds = {each.removesuffix(".zstd").rpartition(".")[-1] for each in named}
    if kinds == {"mcap"} or kinds == {"db3"}:
        about["storage_identifier"] = "mcap" if kinds == {"mcap"} else "sqlite3"
    unread = [f"names {', '.join(missing)}, and no such file is there: without the messages in it"] if missing else []
    unread += [f"does not name {', '.join(beside)}, which lies beside it and is not read"] if beside else []
    return dump_yaml(content), tuple(unread)


_HEADER, _FOOTER, _SCHEMA, _DATA_END = 0x01, 0x02, 0x03, 0x0F
_PROFILE = struct.pack("<I", 4) + b"ros2"
_FOOTER_BYTES = 37  # with the magic at the end
_ROS1, _ROS2 = b"ros1msg", b"ros2msg"
_KNOWN_ENCODINGS = (_ROS2, b"ros2idl", b"omgidl", b"")


class BagPath(type(Path())):
    """Path that `rosbags` may write into an SQLite URI, with MCAP files of any profile.

    The library opens `file:{path}?immutable=1`, in which `#`, `?` and `%` would end or change the path. It also rejects an
    MCAP file without the profile "ros2" and schemas of other encodings than ROS 2's, though it needs neither for standard
    messages: it is given the profile, and such schemas without their text.
    """

    @property
    def suffix(self) -> str:
        """The end of the name in small letters: Windows writes .BAG."""
        return super().suffix.lower()

    def __format__(self, spec: str) -> str:
        return quote(str(self)) if self.suffix == ".db3" else format(str(self), spec)

    def open(self, *args: Any, **options: Any) -> Any:
        """Open the file; an MCAP file for reading bytes is adapted to the library."""
        if self.suffix == ".mcap" and (args or (options.get("mode"),))[0] == "rb":
            return _McapShown(self)
        return super().open(*args, **options)

    def read_text(self, *args: Any, **options: Any) -> str:
        """Read the file; of a bag's metadata, what the library can read (see `readable_metadata`)."""
        whole = readable_metadata(Path(self).parent)[0] if self.name == _METADATA else None
        return super().read_text(*args, **options) if whole is None else whole


class _McapShown(io.BufferedReader):
    """MCAP file with a few of its bytes replaced by as many others."""

    def __init__(self, path: Path) -> None:
        super().__init__(io.FileIO(path, "rb"))
        self._patches = self._exchanged()
        self.seek(0)

    def read(self, size: int | None = -1, /) -> bytes:
        start = self.tell()
        data = super().read(size)
        end = start + len(data)
        for place, patch in self._patches:
            if place < end and start < place + len(patch):
                first, last = max(place, start), min(place + len(patch), end)
                data = data[: first - start] + patch[first - place : last - place] + data[last - start :]
        return data

    def _exchanged(self) -> list[tuple[int, bytes]]:
        """Return the replacement bytes by offset in the file; none for an incomplete or other file."""
        self._patches = []
        if self.read(len(MCAP_MAGIC)) != MCAP_MAGIC:
            return []
        patches = []
        op, size = self._record()
        data_start = self.tell() + size
        content = self.read(size) if op == _HEADER and 8 <= size < 1 << 20 else b""
        if content and content[:8] != _PROFILE:
            patches.append((8 + 9, _PROFILE + content[8:]))
        if self.seek(0, io.SEEK_END) < _FOOTER_BYTES + 8:
            return patches
        self.seek(-_FOOTER_BYTES, io.SEEK_END)
        footer_start = self.tell()
        footer = self.read(_FOOTER_BYTES)
        summary_start = struct.unpack_from("<Q", footer, 9)[0] if footer[0] == _FOOTER else 0
        if not 0 <= summary_start < footer_start:
            return patches
        self.seek(summary_start or data_start)  # without a summary the library reads the data from its start
        while self.tell() < footer_start:
            op, size = self._record()
            place = self.tell()
            if op not in range(_SCHEMA, _DATA_END) or place + size > footer_start:
                break
            if op == _SCHEMA and (shown := _schema_shown(self.read(size))) is not None:
                patches.append((place, shown))
            self.seek(place + size)
        return patches

    def _record(self) -> tuple[int, int]:
        head = self.read(9)
        return (head[0], struct.unpack("<Q", head[1:])[0]) if len(head) == 9 else (0, 0)


def _schema_shown(content: bytes) -> bytes | None:
    """Return a schema of an unknown encoding with the same length, without encoding and text; None for known ones."""
    try:
        (name_bytes,) = struct.unpack_from("<I", content, 2)
        (encoding_bytes,) = struct.unpack_from("<I", content, 6 + name_bytes)
    except struct.error:
        return None
    start = 6 + name_bytes
    encoding = content[start + 4 : start + 4 + encoding_bytes]
    if encoding == _ROS1:  # the texts are equally readable, and the names equally long
        return content[: start + 4] + _ROS2 + content[start + 4 + encoding_bytes :]
    if encoding in _KNOWN_ENCODINGS or len(content) < start + 8:
        return None
    left = len(content) - start - 8
    return content[:start] + struct.pack("<II", 0, left) + bytes(left)
