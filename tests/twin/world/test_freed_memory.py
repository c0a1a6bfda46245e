"""Memory that is freed goes back to the system."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from twin.world import world
from twin.world.world import heap_trimmed, trim_heap

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="resident memory is read from /proc")
MIB = 2**20


def resident_mib() -> float:
    return int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1]) * 4096 / MIB


def test_memory_between_things_that_live_on_is_given_back() -> None:
    if world._malloc_trim() is None:
        pytest.skip("the C library has no malloc_trim")
    kept = []

    def use() -> float:
        freed = []
        for _ in range(4000):  # below the size at which the library asks the system for each
            freed.append(np.full(2500, 1.0))
            kept.append(np.full(40, 1.0))
        return resident_mib()

    trim_heap()
    before = resident_mib()
    with heap_trimmed():
        during = use()
    assert during - before > 60
    assert resident_mib() - before < 20
    assert len(kept) == 4000


def test_a_library_that_cannot_trim_is_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(world, "_malloc_trim", lambda: None)
    trim_heap()
