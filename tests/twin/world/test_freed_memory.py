"""Memory that is freed goes back to the system, and a run's is freed at its end."""

from __future__ import annotations

import gc
import sys
import weakref
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import cast

import numpy as np
import pytest

import twin
from trackers.observations import Image
from trackers.tracks import TrackFrame
from twin.report.floor_panel import PreviewFrame
from twin.report.preview import PreviewWriter
from twin.run.feed import Preview
from twin.world import world
from twin.world.world import heap_trimmed, trim_heap

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="resident memory is read from /proc")
MIB = 2**20
OF_THE_LIBRARY = "_YamlWithinFile"
"""Formatter of a bag's metadata: ruamel's refer to themselves, and hold nothing of the run."""


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


def garbage_of(work: Callable[[], object]) -> Counter[str]:
    """Objects of ours, by class, that after this work only a search for garbage would free."""
    gc.collect()
    debugged, were_enabled = gc.get_debug(), gc.isenabled()
    gc.disable()
    gc.set_debug(gc.DEBUG_SAVEALL)
    try:
        work()
        gc.collect()
        kinds = [type(each) for each in gc.garbage]
    finally:
        gc.garbage.clear()
        gc.set_debug(debugged)
        if were_enabled:
            gc.enable()
    return Counter(each.__qualname__ for each in kinds if each.__module__.partition(".")[0] in ("twin", "trackers"))


@pytest.mark.parametrize("images", [False, True])
def test_run_leaves_nothing_to_the_collector(tmp_path: Path, images: bool) -> None:
    scenario = twin.load_scenario("lab-five-people", ["duration_s=0.5", "background_frames=2"])
    tracker = "laser-fisheye-imm" if images else "laser-imm"

    def run() -> None:
        twin.run_scenario(scenario, trackers=[tracker], out=tmp_path / "run", images=images, video=images)

    def track() -> None:
        twin.track_recording(
            tmp_path / "run" / "recording.mcap", trackers=["sort"], out=tmp_path / "tracked", video=images
        )

    assert garbage_of(lambda: "nothing") == {}
    assert garbage_of(run).keys() <= {OF_THE_LIBRARY}
    assert garbage_of(track) == {}


def test_simulation_that_its_listeners_hold_is_freed_once_closed() -> None:
    scenario = twin.load_scenario("lab-five-people", ["duration_s=0.2", "background=none"])

    def simulate() -> None:
        held: list[object] = []
        hold = held.append
        with twin.Simulation(scenario, images=False, on_truth=hold, on_detail=hold) as simulation:
            hold(simulation)
            list(simulation)

    assert garbage_of(simulate) == {}


def test_preview_drops_pictures_that_no_later_frame_shows() -> None:
    shown: list[int] = []

    class Film:
        def frame(self, stamp_ns: int, frame: PreviewFrame) -> None:
            shown.append(frame.newest["fisheye"].stamp_ns)

    with twin.Simulation(twin.load_scenario("lab-five-people", ["background=none"]), images=False) as simulation:
        preview = Preview(cast("PreviewWriter", Film()), simulation.rig)
    alive: list[weakref.ref[Image]] = []
    stamps = [0, 1, 2, 3, 5, 4, 6, 7, 8]  # one arrives late
    for stamp_ns in stamps:
        image = Image("fisheye", stamp_ns, np.zeros((4, 4, 3), np.uint8))
        alive.append(weakref.ref(image))
        preview.observe(image)
        if stamp_ns != 6:  # nothing is tracked at this one
            preview.draw(TrackFrame(stamp_ns, ()))
        del image
    preview.finish()
    assert shown == [0, 1, 2, 3, 5, 7, 8]
    assert [stamp_ns for stamp_ns, each in zip(stamps, alive, strict=True) if each() is not None] == [8]
