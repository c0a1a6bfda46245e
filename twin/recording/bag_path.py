"""Paths of bags as `rosbags` can open them: signs that a URI has a use for, and MCAP files of other profiles than ROS 2's."""

from __future__ import annotations

import io
import struct
from pathlib import Path
from typing import Any
from urllib.parse import quote

_MAGIC = b"\x89MCAP0\r\n"
_HEADER, _FOOTER, _SCHEMA, _DATA_END = 0x01, 0x02, 0x03, 0x0F
_PROFILE = struct.pack("<I", 4) + b"ros2"
_FOOTER_BYTES = 37  # with the magic at the end
_ROS1, _ROS2 = b"ros1msg", b"ros2msg"
_KNOWN_ENCODINGS = (_ROS2, b"ros2idl", b"omgidl", b"")


class BagPath(type(Path())):
    """A path that `rosbags` may write into an SQLite URI, and whose MCAP files it takes whatever their profile is.

    The library opens `file:{path}?immutable=1`, in which `#`, `?` and `%` would end or change the path. And it refuses an
    MCAP file without the profile "ros2" and schemas of other encodings than ROS 2's, though it needs neither to read
    messages of standard types: it is shown the profile, and such schemas without their text.
    """

    def __format__(self, spec: str) -> str:
        return quote(str(self)) if self.suffix == ".db3" else format(str(self), spec)

    def open(self, *args: Any, **options: Any) -> Any:
        """Open the file, an MCAP file for reading bytes as the library takes it."""
        if self.suffix == ".mcap" and (args or (options.get("mode"),))[0] == "rb":
            return _McapShown(self)
        return super().open(*args, **options)


class _McapShown(io.BufferedReader):
    """An MCAP file with a few of its bytes exchanged for as many others."""

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
        """What to show instead, by place in the file; nothing of a file that is none or not whole."""
        self._patches = []
        if self.read(8) != _MAGIC:
            return []
        patches = []
        op, size = self._record()
        content = self.read(size) if op == _HEADER and 8 <= size < 1 << 20 else b""
        if content and content[:8] != _PROFILE:
            patches.append((8 + 9, _PROFILE + content[8:]))
        if self.seek(0, io.SEEK_END) < _FOOTER_BYTES + 8:
            return patches
        self.seek(-_FOOTER_BYTES, io.SEEK_END)
        footer_start = self.tell()
        footer = self.read(_FOOTER_BYTES)
        summary_start = struct.unpack_from("<Q", footer, 9)[0] if footer[0] == _FOOTER else 0
        if not 0 < summary_start < footer_start:
            return patches
        self.seek(summary_start)
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
    """A schema of an encoding that the library does not know, as long, without encoding and text; None for others."""
    try:
        (name_bytes,) = struct.unpack_from("<I", content, 2)
        (encoding_bytes,) = struct.unpack_from("<I", content, 6 + name_bytes)
    except struct.error:
        return None
    start = 6 + name_bytes
    if content[start + 4 : start + 4 + encoding_bytes] == _ROS1:  # the texts read alike, and the names are as long
        return content[: start + 4] + _ROS2 + content[start + 4 + encoding_bytes :]
    if content[start + 4 : start + 4 + encoding_bytes] in _KNOWN_ENCODINGS or len(content) < start + 8:
        return None
    left = len(content) - start - 8
    return content[:start] + struct.pack("<II", 0, left) + bytes(left)
