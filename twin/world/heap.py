"""Memory that a run has freed, given back to the system.

The C library keeps what large pictures leave between small things that live on; run after run in one process that came to
gigabytes. Nothing is lost by giving it back: it is memory that nobody holds.
"""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any


def trim_heap() -> None:
    """Give freed memory back to the system, where the C library is one that can (glibc)."""
    if (trim := _malloc_trim()) is not None:
        trim(0)


@contextmanager
def heap_trimmed() -> Iterator[None]:
    """Trim the heap when the block is left."""
    try:
        yield
    finally:
        trim_heap()


@cache
def _malloc_trim() -> Any:
    """Return the function of the C library; None where it has none: musl, macOS."""
    return getattr(ctypes.CDLL(None), "malloc_trim", None)
