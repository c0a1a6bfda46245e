"""Memory of a process that runs tests (`tests/conftest.py`): what tests leave in cycles and in caches must not add up.

Python looks for cycles by the number of new objects, and one compiled room of 100 MB is a few of them.
"""

from __future__ import annotations

import ctypes
import gc
import re
import sys
from collections.abc import Iterator
from contextlib import suppress
from functools import _lru_cache_wrapper
from pathlib import Path
from types import ModuleType
from typing import Any

GROWTH_MIB = 48.0
"""Growth of the resident memory since the last search for cycles, or release of caches, that causes another."""

LARGE_CACHES = (
    ("trackers.rig_sensors", "_placed_camera"),  # rays of every pixel
    ("twin.people.body.person_spec", "_kept_spec"),
    ("twin.studies.worker", "_scenes"),
    ("twin.world.empty_room", "_kept"),
)
"""Caches of the code that hold megabytes an entry."""

_TRIM_THRESHOLD, _MMAP_THRESHOLD, _ARENA_MAX = -1, -3, -8
"""Options of mallopt, from malloc.h."""

_TESTS = str(Path(__file__).parent)
_STATUS = Path("/proc/self/statm")
_PEAK = re.compile(r"^VmHWM:\s*(\d+) kB", re.MULTILINE)
_settled_mib = 0.0
_released_mib = 0.0


def map_large_arrays() -> None:
    """Have the C library (glibc) map every large array, and share one heap among threads.

    By itself it puts arrays of up to 32 MiB among what lives on, where the gap that each leaves is not given back.
    """
    if (mallopt := getattr(ctypes.CDLL(None), "mallopt", None)) is not None:
        for option, value in ((_MMAP_THRESHOLD, 2 * 2**20), (_TRIM_THRESHOLD, 64 * 2**20), (_ARENA_MAX, 1)):
            mallopt(option, value)


def resident_mib() -> float:
    """Return this process's resident memory, 0 on a system that does not tell it in /proc."""
    try:
        return int(_STATUS.read_bytes().split()[1]) / 256  # pages of 4 KiB
    except OSError:
        return 0.0


def peak_mib() -> float:
    """Return the greatest resident memory that this process had, 0 on a system that does not tell it in /proc."""
    try:
        found = _PEAK.search(Path("/proc/self/status").read_text())
    except OSError:
        return 0.0
    return 0.0 if found is None else int(found[1]) / 1024


class Peaks:
    """The greatest resident memory of a process during each file of tests [MiB]."""

    def __init__(self) -> None:
        self.of_file: dict[str, float] = {}

    def note(self, file: str) -> None:
        """Note the peak at the end of a file of tests, and have the system (Linux) forget it."""
        self.of_file[file] = peak_mib()
        with suppress(OSError):
            Path("/proc/self/clear_refs").write_text("5")

    def heaviest(self) -> list[tuple[float, str]]:
        """Return the peaks of the three heaviest files, the greatest first."""
        return sorted(((mib, file) for file, mib in self.of_file.items()), reverse=True)[:3]


def collect_if_grown() -> None:
    """Search for cycles if memory has grown since it was last searched."""
    global _settled_mib
    now_mib = resident_mib()
    _settled_mib = min(_settled_mib, now_mib)
    if now_mib > _settled_mib + GROWTH_MIB:
        _collect()


def end_file(of_tests: ModuleType) -> None:
    """Free what the file's own caches keep, and those that files share if memory has grown; no later search looks at the rest."""
    global _released_mib
    for each in vars(of_tests).values():
        if getattr(each, "__module__", None) == of_tests.__name__ and hasattr(each, "cache_clear"):
            each.cache_clear()
    _collect()
    if _settled_mib > _released_mib + GROWTH_MIB:
        for cache in shared_caches():
            cache.cache_clear() if hasattr(cache, "cache_clear") else cache.clear()
        gc.unfreeze()
        _collect()
        _released_mib = _settled_mib
    gc.freeze()  # modules and caches of the code: searching them costs a quarter of a second a file


def shared_caches() -> Iterator[Any]:
    """Yield the large caches of the code, and all caches of modules that files of tests share."""
    for module, name in LARGE_CACHES:
        if module in sys.modules:
            yield getattr(sys.modules[module], name)
    for module in list(sys.modules.values()):
        if str(getattr(module, "__file__", None)).startswith(_TESTS):
            yield from (each for each in vars(module).values() if isinstance(each, _lru_cache_wrapper))


def _collect() -> None:
    global _settled_mib
    from twin.world.world import trim_heap  # not before shapes of the trackers' arrays are checked

    gc.collect()
    trim_heap()
    _settled_mib = resident_mib()
