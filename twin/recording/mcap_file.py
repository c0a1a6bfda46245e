"""A ROS 2 bag as one MCAP file that appears when it is complete."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import Self

from rosbags.interfaces import Connection, ConnectionExtRosbag1, Qos
from rosbags.rosbag2 import StoragePlugin, Writer

from trackers.errors import InputError
from twin.recording.ros_messages import TYPESTORE

_NO_HASH = "RIHS00_" + 64 * "0"
"""Hash that ROS 2 writes for a type whose hash is not set."""


class McapFile:
    """A context manager that writes messages to `path` (a `.mcap`) as they come.

    The bag grows in a hidden folder next to `path` and takes its name when the block ends well; an exception, Ctrl-C included,
    removes it and leaves an older file of that name untouched. Raises ValueError for a path without `.mcap`, and InputError
    where the disk is full or cannot be written.
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
                with self._disk_errors():
                    self._writer.close()
                    os.replace(self._writer.path / f"{self._path.stem}.mcap", self._path)
        finally:
            self.discard()

    def connect(self, topic: str, msgtype: str, qos: Sequence[Qos] = ()) -> None:
        """Add a topic of a standard type."""
        assert self._writer is not None
        self._connections[topic] = self._writer.add_connection(
            topic, msgtype, typestore=TYPESTORE, offered_qos_profiles=qos
        )

    def write(self, topic: str, log_time_ns: int, data: bytes | memoryview) -> None:
        """Write a message (CDR) of a topic."""
        self.write_on(self._connections[topic], log_time_ns, data)

    def connect_text(self, topic: str, msgtype: str, definition: str, type_hash: str) -> Connection:
        """Add a topic of a type defined by this text."""
        assert self._writer is not None
        return self._writer.add_connection(topic, msgtype, msgdef=definition, rihs01=type_hash)

    def connect_as(self, other: Connection) -> Connection:
        """Add a topic as another ROS 2 bag has it, whatever its type."""
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
        with self._disk_errors():
            self._writer.write(connection, log_time_ns, data)

    @contextmanager
    def _disk_errors(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise InputError(
                f"{self._path}: cannot be written ({error.strerror}); a writable place with free space is needed"
            ) from error

    def discard(self) -> None:
        """Remove what is left of the temporary folder."""
        if self._writer is not None:
            # What a full disk kept from being written makes closing fail again, and is not wanted any more.
            with suppress(OSError):
                self._writer.abort()
            self._writer = None
        if self._folder is not None:
            shutil.rmtree(self._folder)
            self._folder = None


def _type_hash(msgtype: str) -> str:
    """Return the hash of a standard type's definition; an MCAP file does not keep it."""
    return TYPESTORE.hash_rihs01(msgtype) if msgtype in TYPESTORE.types else _NO_HASH
