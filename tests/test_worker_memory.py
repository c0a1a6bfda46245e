"""What tests leave in cycles and in shared caches is freed before it adds up; BLAS has one thread, as in the command."""

from __future__ import annotations

import gc
import importlib
import weakref
from functools import cache
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
import threadpoolctl  # scikit-learn's
import worker_memory
from worker_memory import GROWTH_MIB, LARGE_CACHES, Peaks, collect_if_grown, end_file, resident_mib, shared_caches

resident = pytest.mark.skipif(resident_mib() == 0.0, reason="resident memory is read from /proc")


class Held:
    """An array in a cycle."""

    def __init__(self, mib: float) -> None:
        self.array = np.ones(round(mib * 2**17))
        self.itself = self


def left_in_a_cycle(mib: float) -> weakref.ref[Held]:
    return weakref.ref(Held(mib))


@resident
def test_large_cycles_are_freed_between_two_tests_and_small_ones_left_to_python() -> None:
    end_file(ModuleType("of_another_file"))
    gc.disable()
    try:
        small = left_in_a_cycle(GROWTH_MIB / 4)
        collect_if_grown()
        assert small() is not None
        large = left_in_a_cycle(3 * GROWTH_MIB)  # however much the system takes back meanwhile
        collect_if_grown()
        assert small() is None and large() is None
    finally:
        gc.enable()


def test_every_large_cache_is_there() -> None:
    for module, name in LARGE_CACHES:
        assert hasattr(importlib.import_module(module), name), f"{module} has no cache {name}"
    assert len(list(shared_caches())) >= len(LARGE_CACHES)


@resident
def test_a_files_own_caches_end_with_it_and_shared_ones_once_memory_has_grown(monkeypatch: pytest.MonkeyPatch) -> None:
    own, shared = ModuleType("a_file_of_tests"), cache(lambda: Held(2 * GROWTH_MIB))
    kept = cache(lambda: 1)
    kept.__module__, own.kept = own.__name__, kept  # type: ignore[attr-defined]
    monkeypatch.setattr(worker_memory, "shared_caches", lambda: [shared])
    end_file(own)
    kept()
    end_file(own)
    assert kept.cache_info().currsize == 0
    shared()
    end_file(own)
    assert shared.cache_info().currsize == 0


def test_blas_has_one_thread() -> None:
    importlib.import_module("scipy.linalg")  # brings a library of its own

    found = [each for each in threadpoolctl.threadpool_info() if each["user_api"] == "blas"]
    assert found and {each["num_threads"] for each in found} == {1}, found


@pytest.mark.skipif(not Path("/proc/self/clear_refs").exists(), reason="peaks are forgotten on Linux alone")
def test_peaks_are_those_of_each_file_and_the_heaviest_are_said() -> None:
    peaks = Peaks()
    peaks.note("before")
    held = np.ones(round(2 * GROWTH_MIB * 2**17))
    peaks.note("heavy")
    del held
    peaks.note("as heavy at its start")
    peaks.note("light")
    assert peaks.of_file["heavy"] > peaks.of_file["light"] + GROWTH_MIB
    assert [mib for mib, _ in peaks.heaviest()] == sorted(peaks.of_file.values(), reverse=True)[:3]
