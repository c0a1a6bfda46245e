"""Text files from users: read completely up to a size, or rejected in one sentence; and limits of size.

Limits stand against mistakes and attacks: sizes are compared before anything of that size is made. `--no-limits` lifts them
for the process and its children; nothing in a scenario, a room or a bag can. They cover sizes bounded by memory, disk or
time, not those bounded by a format or OpenGL.
"""

from __future__ import annotations

import codecs
import os
import reprlib
import stat
from pathlib import Path

from trackers.errors import InputError, LimitError, text_near_bound

NO_LIMITS = "TWIN_NO_LIMITS"
"""Environment variable that lifts the limits, also for workers."""


def lift_limits() -> None:
    """Lift the limits for this process and its later children."""
    os.environ[NO_LIMITS] = "1"


def are_limits_lifted() -> bool:
    """Return whether `--no-limits` was given."""
    return bool(os.environ.get(NO_LIMITS))


def refuse_unless_lifted(said: str, valid: str) -> None:
    """Raise LimitError for a size above a limit, if the limits hold.

    `said`: start of the sentence, with file, field and size; `valid`: what would be valid.
    """
    if not are_limits_lifted():
        raise LimitError(f"{said}; {valid}, or --no-limits, is expected")


def check_limit(asked: float, most: float, said: str, unit: str = "") -> None:
    """Raise LimitError where `asked` exceeds `most` and the limits hold.

    `said`: start of the sentence, with file, field and content; `unit` follows the numbers.
    """
    if asked > most:
        what = f" {unit}" if unit else ""
        refuse_unless_lifted(f"{said} {text_near_bound(asked, most, '.6g')}{what}", f"at most {most:.6g}")


AnyPath = str | os.PathLike[str]
"""A path in any form accepted from callers."""


def as_path(given: AnyPath, name: str) -> Path:
    """Return a caller's path, with the home folder for a leading `~`, as a shell has it.

    Raises InputError for anything but a text or an `os.PathLike`, and for `~` without a home; `name`: of the argument.
    """
    try:
        text = os.fspath(given)
    except TypeError:
        text = b""
    if not isinstance(text, str):
        raise InputError(f"{name}: {reprlib.repr(given)} is no path; a text or an os.PathLike is expected")
    if not text or "\0" in text:
        raise InputError(f"{name}: {reprlib.repr(text)} is no path; a text that is not empty, without NUL, is expected")
    path = Path(text)
    try:
        return path.expanduser() if path.parts[:1] == ("~",) else path
    except RuntimeError as error:
        raise InputError(
            f"{name}: {text}: this user ({os.getuid()}) has no home folder; another path is expected"
        ) from error


MOST_TEXT_BYTES = 64 * 1024 * 1024
"""Size above which a text file is rejected unread, since people do not write such files."""


_PACKED = {
    **{b"\x1f\x8b": "gzip", b"PK\x03\x04": "zip, or a spreadsheet", b"\x28\xb5\x2f\xfd": "zstd", b"BZh": "bzip2"},
    **{b"\xfd7zXZ\0": "xz", b"7z\xbc\xaf": "7z", b"PAR1": "Parquet", b"\x89HDF\r\n": "HDF5"},
}
"""Formats of files that hold texts or tables but are none, by their first bytes."""


def read_text(source: AnyPath, expected: str, most_bytes: int | None = MOST_TEXT_BYTES) -> str:
    """Read a text file in UTF-8, or in UTF-16 with a byte order mark. Raises InputError naming the file and its `expected`
    content.

    At most `most_bytes` are read (None: all) unless the limits are lifted. A device, which may never end, is rejected.
    """
    source = as_path(source, expected)
    try:
        mode = source.stat().st_mode
        if stat.S_ISCHR(mode) or stat.S_ISBLK(mode):
            raise InputError(f"{source}: is a device, not a file; {expected} is expected")
        with source.open("rb") as stream:
            content = stream.read() if most_bytes is None or are_limits_lifted() else stream.read(most_bytes + 1)
    except InputError:
        raise
    except OSError as error:
        raise InputError(f"{source}: cannot be read ({error.strerror}); {expected} is expected") from error
    except ValueError as error:  # a NUL in the path
        raise InputError(f"{str(source)!r}: is no path of a file ({error}); {expected} is expected") from error
    if most_bytes is not None and len(content) > most_bytes:
        refuse_unless_lifted(f"{source}: holds more than {most_bytes / 2**20:g} MiB", f"{expected} of no more")
    if packed := next((each for start, each in _PACKED.items() if content.startswith(start)), None):
        raise InputError(f"{source}: is packed ({packed}); {expected} as plain text is expected, so unpack it first")
    encoding = "utf-16" if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)) else "utf-8"
    try:
        return content.decode(encoding).replace("\r\n", "\n").replace("\r", "\n")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise InputError(f"{source}: is not a text file in UTF-8 (line {line}); {expected} is expected") from error


def is_file(path: AnyPath) -> bool:
    """Return whether this file exists; False for an impossible path (too long, a NUL in it)."""
    try:
        return Path(path).is_file()
    except (OSError, ValueError):
        return False
