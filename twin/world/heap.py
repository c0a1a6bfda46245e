"""Release of freed memory to the system.

The C library keeps the space of large images between small live objects; over many runs in one process that grew to
gigabytes.
"""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any


def trim_heap() -> None:
    """Return freed memory to the system, if the C library can (glibc)."""
    if (trim := _malloc_trim()) is not None:
        trim(0)


@contextmanager
def heap_trimmed() -> Iterator[None]:
    """Trim the heap at the end of the block."""
    try:
        yield
    finally:
        trim_heap()


@cache
def _malloc_trim() -> Any:
    """Return the function of the C library; None if missing: musl, macOS."""
    return getattr(ctypes.CDLL(None), "malloc_trim", None)
