"""Files that appear under their final name only when they are complete."""

from __future__ import annotations

import csv
import errno
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TextIO

from trackers.errors import InputError

NO_SPACE = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""Errors of a full disk, a used-up quota, and a limit on the size of files (`ulimit -f`)."""


@contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """Yield a hidden path in the same folder to write to; it takes the name `path` when the block ends normally.

    Otherwise it is removed: after an exception, Ctrl-C or a kill an older file of that name is untouched. Missing folders
    are made. Raises InputError where the path cannot be written or the disk is full.
    """
    partial = partial_path(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.is_dir():
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
        partial.touch()
    except OSError as error:
        raise unwritable(path, error) from error
    try:
        try:
            yield partial
        except OSError as error:
            # Another OSError of the block is not about this file and passes unchanged.
            if error.errno in NO_SPACE:
                raise unwritable(path, error) from error
            raise
        try:
            os.replace(partial, path)
        except OSError as error:
            raise unwritable(path, error) from error
    except BaseException:
        partial.unlink(missing_ok=True)
        raise


@contextmanager
def open_atomic(path: Path) -> Iterator[TextIO]:
    """Open `path` for writing UTF-8 text; it appears when complete, see `atomic_path`.

    File names that Python could not decode, as with LANG=C, are written with their original bytes.
    """
    with (
        atomic_path(path) as partial,
        partial.open("w", encoding="utf-8", errors="surrogateescape", newline="") as stream,
    ):
        yield stream


def write_atomic(path: Path, content: str | bytes) -> None:
    """Write a whole file, as `open_atomic` does a text."""
    if isinstance(content, str):
        with open_atomic(path) as stream:
            stream.write(content)
    else:
        with atomic_path(path) as partial:
            partial.write_bytes(content)


def write_csv(path: Path, rows: Iterable[Iterable[object]]) -> None:
    """Write the rows of a table, its heads first, as `open_atomic` does a text."""
    with open_atomic(path) as stream:
        csv.writer(stream, lineterminator="\n").writerows(rows)


def check_writable(path: Path) -> None:
    """Raise InputError where a file of this name could not be written, before the work for it; leaves nothing."""
    folder = next(each for each in path.absolute().parents if each.exists())
    probe = folder / partial_path(path).name
    try:
        if path.is_dir():
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise unwritable(path, error) from error


def partial_path(path: Path) -> Path:
    """Return the hidden path beside a file or folder for writing it until complete."""
    return path.with_name(f".{path.name}.{os.getpid()}.partial")


def unwritable(path: Path | str, error: OSError) -> InputError:
    """Describe why a file or folder, called so, cannot be written."""
    return InputError(f"{path}: cannot be written ({error.strerror}); a writable place with free space is needed")
