"""Text files that appear under their final name only when they are whole."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TextIO

from trackers.errors import InputError


@contextmanager
def whole_file(path: Path) -> Iterator[TextIO]:
    """Open `path` for writing UTF-8 text; the file takes its name when the block ends well, and is removed otherwise.

    Until then it is a hidden file beside the target, so that an exception, Ctrl-C or a kill leaves nothing half-written
    under the final name and an older file of that name untouched. Folders on the way are made. Raises InputError where
    the place cannot be written or the disk is full.
    """
    partial = path.with_name(f".{path.name}.{os.getpid()}.partial")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.is_dir():
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
        stream = partial.open("w", encoding="utf-8", newline="")
    except OSError as error:
        raise _unwritable(path, error) from error
    try:
        try:
            with stream:
                yield stream
        except OSError as error:
            # Another OSError of the block is not about this file and stays what it is.
            if error.errno in (errno.ENOSPC, errno.EDQUOT):
                raise _unwritable(path, error) from error
            raise
        try:
            os.replace(partial, path)
        except OSError as error:
            raise _unwritable(path, error) from error
    except BaseException:
        partial.unlink(missing_ok=True)
        raise


def _unwritable(path: Path, error: OSError) -> InputError:
    return InputError(f"{path}: cannot be written ({error.strerror}); a writable place with free space is needed")
