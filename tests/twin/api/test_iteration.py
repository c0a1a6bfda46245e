"""A Simulation is iterated once: any loop goes on where the last one stopped, and none starts over unsaid."""

from __future__ import annotations

import copy
import gc
import pickle
import re
import subprocess
import sys
import threading
import weakref
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import replace
from functools import cache
from itertools import islice
from multiprocessing import get_context
from typing import Any

import numpy as np
import pytest

import twin
from trackers.observations import Observation
from trackers.tracks import TrackFrame
from twin.scenario import Scenario

SCENARIO = twin.load_scenario("lab-five-people", ["duration_s=1.0", "background_frames=2"])


def told(observations: list[Observation]) -> list[tuple[str, int, bytes]]:
    return [
        (each.sensor, each.stamp_ns, np.ascontiguousarray(getattr(each, "ranges_m", 0)).tobytes())
        for each in observations
    ]


def whole(scenario: Scenario = SCENARIO) -> list[tuple[str, int, bytes]]:
    with twin.Simulation(scenario, images=False) as simulation:
        return told(list(simulation))


@cache
def usual() -> list[tuple[str, int, bytes]]:
    """What the scenario gives, worked out once."""
    return whole()


@pytest.mark.parametrize("n", [1, 7])
def test_loop_after_a_break_goes_on_where_it_stopped(n: int) -> None:
    truth: list[int] = []
    with twin.Simulation(SCENARIO, images=False, on_truth=lambda frame: truth.append(frame.stamp_ns)) as simulation:
        found = []
        for _ in range(2):
            for number, observation in enumerate(simulation, start=1):
                found.append(observation)
                if number == n:
                    break
        found += [delivered.observation for delivered in islice(simulation.deliveries(), 2)]
        found += simulation
    assert told(found) == usual()
    assert truth == sorted(set(truth))


def test_two_iterators_share_what_comes() -> None:
    with twin.Simulation(SCENARIO, images=False) as simulation:
        first, second = iter(simulation), iter(simulation)
        found = [next(first), next(second), next(first), *second]
    assert told(found) == usual()


def ended(simulation: twin.Simulation) -> None:
    list(simulation)


def stopped(simulation: twin.Simulation) -> None:
    with pytest.raises(ZeroDivisionError):
        list(simulation)


def closed(simulation: twin.Simulation) -> None:
    next(iter(simulation))
    simulation.close()


def fail(frame: object) -> None:
    raise ZeroDivisionError


@pytest.mark.parametrize(
    ("bring", "on_truth", "said"),
    [
        (ended, None, "has come to its end"),
        (stopped, fail, "was stopped by an error"),
        (closed, None, "is closed"),
    ],
)
def test_loop_where_nothing_comes_any_more_is_refused(
    bring: Callable[[twin.Simulation], None], on_truth: Callable[[object], object] | None, said: str
) -> None:
    with twin.Simulation(SCENARIO, images=False, on_truth=on_truth) as simulation:
        bring(simulation)
        for begin in (iter, twin.Simulation.deliveries):
            with pytest.raises(RuntimeError, match=re.escape(f"'lab-five-people' {said}; make another Simulation")):
                begin(simulation)


@pytest.mark.parametrize("begin", [iter, twin.Simulation.deliveries])
def test_an_iterator_of_a_closed_simulation_says_so(begin: Callable[[twin.Simulation], Iterator[object]]) -> None:
    with twin.Simulation(SCENARIO, images=False) as simulation:
        coming = begin(simulation)
        next(coming)
    with pytest.raises(RuntimeError, match="is closed; make another Simulation"):
        next(coming)


def test_what_is_left_in_the_middle_is_freed_without_the_collector() -> None:
    gc.disable()
    try:
        simulation = twin.Simulation(SCENARIO, images=False)
        next(iter(simulation))
        simulation.close()
        left = weakref.ref(simulation)
        del simulation
        assert left() is None
    finally:
        gc.enable()


@pytest.mark.parametrize("of", [copy.copy, copy.deepcopy, lambda each: pickle.loads(pickle.dumps(each))])
def test_copied_scenario_gives_the_same(of: Callable[[Scenario], Scenario]) -> None:
    assert whole(of(SCENARIO)) == usual()


@pytest.mark.parametrize("of", [copy.copy, copy.deepcopy, pickle.dumps])
def test_copying_a_simulation_is_refused_in_a_sentence(of: Callable[[twin.Simulation], object]) -> None:
    with twin.Simulation(SCENARIO, images=False) as simulation:
        with pytest.raises(TypeError, match="cannot be copied or pickled; copy its scenario"):
            of(simulation)
        assert told(list(simulation)) == usual()


def test_interleaved_simulations_do_not_meet() -> None:
    other = SCENARIO.model_copy(update={"seed": 3})
    with twin.Simulation(SCENARIO, images=False) as first, twin.Simulation(other, images=False) as second:
        pairs = list(zip(first, second, strict=True))
    assert told([a for a, _ in pairs]) == usual() and told([b for _, b in pairs]) == whole(other)


def test_threads_and_spawned_processes_give_the_same() -> None:
    expected = usual()
    with ThreadPoolExecutor(2) as threads, ProcessPoolExecutor(1, get_context("spawn")) as processes:
        found = [*threads.map(whole, [SCENARIO] * 2), *processes.map(whole, [SCENARIO])]
    assert found == [expected] * 3


def test_simulation_that_is_never_closed_ends_quietly() -> None:
    program = "import twin; s = twin.Simulation(twin.load_scenario('lab-five-people', ['duration_s=1'])); print(next(iter(s)))"
    ran = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60)
    assert ran.returncode == 0 and ran.stdout and not ran.stderr, ran.stderr


def test_tracker_used_for_a_second_run_warns_that_it_drops_all() -> None:
    with twin.Simulation(SCENARIO, images=False) as simulation:
        scans = list(simulation)
        tracker = twin.make_tracker("sort", simulation.rig, simulation.background())
        assert list(twin.track_frames(tracker, simulation.rig, scans))
        with pytest.warns(UserWarning, match="of 20 observations were dropped .* a new tracker for each run") as shown:
            twin.track_table(twin.track_frames(tracker, simulation.rig, scans))
        assert shown[0].filename == __file__


def test_iterator_that_is_used_up_is_told_where_it_gives_nothing() -> None:
    """Of an empty table nothing else would tell that frames, or observations, had gone to another loop before."""
    with twin.Simulation(SCENARIO, images=False) as simulation:
        rig, observations = simulation.rig, iter(simulation)
        frames = twin.track_frames(twin.make_tracker("sort", rig), rig, observations)
        assert list(frames)
        with pytest.warns(UserWarning, match="no frames came: an iterator gives what it has once") as shown:
            assert not len(twin.track_table(frames).id)
        assert shown[0].filename == __file__
        with pytest.warns(UserWarning, match="no observations came: an iterator gives what it has once"):
            assert not list(twin.track_frames(twin.make_tracker("sort", rig), rig, observations))


@pytest.mark.parametrize(("ns_per_s", "is_told"), [(1, True), (10**6, True), (10**9, False)])
def test_stamps_in_another_unit_than_nanoseconds_are_told(ns_per_s: int, is_told: bool) -> None:
    with twin.Simulation(SCENARIO, images=False) as simulation:
        scans = [replace(each, stamp_ns=round(each.stamp_ns * ns_per_s / 1e9)) for each in simulation]
        said: list[str] = []
        list(twin.track_frames(twin.make_tracker("sort", simulation.rig), simulation.rig, scans, said.append))
    assert any("stamp_ns in nanoseconds, s * 10**9, is expected" in each for each in said) == is_told


def test_look_at_what_is_not_there_is_refused_in_a_sentence() -> None:
    with twin.Simulation(SCENARIO, images=False) as simulation:
        assert simulation.look(0, "waist").keys() == {"waist"}
        with pytest.raises(twin.InputError, match="no sensor 'wast'; did you mean 'waist'"):
            simulation.look(0, ["wast"])
        for call in (simulation.snapshot, simulation.boxes, lambda t: simulation.look(t * 10**9)):
            for t in (1e9, float("nan")):
                with pytest.raises(
                    twin.InputError, match=r"is after the end of 'lab-five-people' at 1 s; a time before"
                ):
                    call(t)
        with pytest.raises(ValueError, match="time goes forward, and 3 s back; looks in order of time, or another"):
            simulation.look(-(10**9))


def test_simulation_with_images_is_iterated_in_one_thread_and_closed_in_another() -> None:
    scenario = twin.load_scenario("lab-five-people", ["duration_s=0.3"])
    simulation = twin.Simulation(scenario)
    with ThreadPoolExecutor(1) as thread:
        assert thread.submit(list, simulation).result()
        simulation.close()


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: twin.Simulation("lab-five-people"), "twin.load_scenario makes one"),  # pyright: ignore[reportArgumentType]
        (lambda: twin.run_scenario("lab-five-people"), "twin.load_scenario makes one"),  # pyright: ignore[reportArgumentType]
        (lambda: twin.load_scenario("lab-five-people", "seed=3"), "a list of texts is expected"),
        (lambda: twin.load_scenario("lab-five-people", {"seed": "3"}), "a list of texts is expected"),  # pyright: ignore[reportArgumentType]
        (lambda: twin.truth_table([TrackFrame(0, ())]), "an iterable of TruthFrame is expected"),  # pyright: ignore[reportArgumentType]
        (lambda: twin.track_table([TrackFrame(0, ())] * 2), "frame at 0 ns stands there 2 times"),
        (lambda: twin.track_table(TrackFrame(0, ())), "an iterable of TrackFrame is expected"),  # pyright: ignore[reportArgumentType]
        (lambda: twin.run_scenario(twin.load_scenario("pair"), trackers="sort"), r"expected, as \['sort'\]"),
        (lambda: twin.track_recording("none.mcap", trackers="sort"), r"expected, as \['sort'\]"),
        (lambda: twin.track_recording("none.mcap", trackers=[]), r"none is named; a list of names, as \['sort'\]"),
        (
            lambda: twin.run_scenario(SCENARIO.model_copy(update={"duration_s": -1})),
            "duration_s: a number greater than 0 is",
        ),
        (
            lambda: twin.Simulation(SCENARIO.model_copy(update={"durations": 3})),
            "durations: unknown key; did you mean 'duration_s",
        ),
        (lambda: twin.run_scenario(SCENARIO, truth="none"), "'all' or 'positions' is expected"),  # pyright: ignore[reportArgumentType]
        (lambda: twin.run_scenario(SCENARIO, video="no"), "video 'no': True or False is expected"),  # pyright: ignore[reportArgumentType]
        (
            lambda: twin.track_recording("none.mcap", trackers=["sort"], changes="trackers.sort.gate_m=1"),
            "a list of texts is expected",
        ),
        (lambda: twin.evaluate_tracks("truth.csv", "tracks.csv"), "twin.read_truth"),  # pyright: ignore[reportArgumentType]
    ],
)
def test_what_is_not_what_is_expected_is_refused_in_a_sentence(call: Callable[[], object], said: str) -> None:
    with pytest.raises(twin.InputError, match=said):
        call()


def test_overrides_of_an_iterator_count() -> None:
    assert twin.load_scenario("lab-five-people", (each for each in ["duration_s=3"])).duration_s == 3  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize("seed", [None, 3.0, "3", -1, np.float64(3)])
def test_stream_without_a_whole_seed_is_refused(seed: Any) -> None:
    with pytest.raises(twin.InputError, match="seed is .*; a whole number from 0 on is expected"):
        twin.stream(seed, "person", "ann")


def test_warnings_of_a_run_are_pythons_where_nobody_asks_for_them(tmp_path) -> None:
    scenario = twin.load_scenario("lab-five-people", ["duration_s=0.3"])
    with pytest.warns(UserWarning, match="sort: makes no use of fisheye") as shown:
        twin.run_scenario(scenario, trackers=["sort"], out=tmp_path / "run", video=False)
    assert {each.filename for each in shown if each.category is UserWarning} == {__file__}


def test_loop_of_another_thread_is_named() -> None:
    said: list[str] = []

    def begin() -> None:
        with pytest.raises(RuntimeError) as refused:
            iter(simulation)
        said.append(str(refused.value))

    def look(frame: object) -> None:
        if not said:
            thread = threading.Thread(target=begin)
            thread.start()
            thread.join()

    with twin.Simulation(SCENARIO, images=False, on_truth=look) as simulation:
        next(iter(simulation))
    assert "is in the loop of another thread" in said[0]
