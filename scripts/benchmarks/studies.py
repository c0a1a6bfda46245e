"""Placement studies: what a candidate costs beside a suite's case, what coverage costs, how fast sets are scored and proven."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator
from itertools import combinations, islice
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import spearmanr

from benchmarks.figure import Figure
from trackers.configuration import validate
from twin.run.inputs import ChosenTracker
from twin.scenario import Scenario, load_scenario
from twin.studies.apply_placement import apply_placement
from twin.studies.candidate_set import CandidateSet
from twin.studies.coverage import PoseCoverage
from twin.studies.search import Searcher
from twin.studies.set_cover import CoverProblem, exact, greedy
from twin.studies.spec import Coverage, Study
from twin.studies.visibility import SampledWorld, SensorVisibility, floor_cells, packed
from twin.studies.worker import EvaluationTask, evaluate_task
from twin.suites.cache import RecordingCache
from twin.suites.cache_keys import whole_code
from twin.suites.expansion import expand
from twin.suites.spec import Suite, SuiteScenario
from twin.suites.worker import CaseWork, run_case
from twin.world.scene import build_scene
from twin.world.world import PrecomputedScene, precompute_people

_HALL = ["duration_s=25", "sensors.camera=null"]
_LAB = {"duration_s": 10, "sensors.fisheye": None}


def placement() -> Iterator[Figure]:
    """A placement sensed again, tracked and judged, lasers only, beside a suite's case recorded and tracked anew; CPU time."""
    with tempfile.TemporaryDirectory() as folder:
        cache = RecordingCache(Path(folder), 10**10)
        for name, set_, tracker, target in (
            ("lab-five-people", _LAB, "laser-imm", "<= 0.3"),
            ("library-hall", {"duration_s": 25, "sensors.camera": None}, "sort", "<= 2"),
        ):
            scenario = load_scenario(
                name, [f"{path}={'null' if value is None else value}" for path, value in set_.items()]
            )
            work = EvaluationTask(scenario, (ChosenTracker(tracker, tracker),), cache, whole_code())
            evaluate_task(work)  # moves the people, compiles the scene
            spent = min(_cpu_s(lambda work=work: evaluate_task(work)) for _ in range(3))
            entry = SuiteScenario(scenario=name, set=set_)
            suite = Suite(name="anew", seeds=(0,), trackers=(tracker,), scenarios=[entry])
            (case,) = expand(suite, Path("anew.yaml"))
            anew = _cpu_s(lambda case=case: run_case(CaseWork(case, cache, whole_code())))
            yield Figure(f"study: a candidate of {name} on a seed, CPU time", spent, "s", target)
            yield Figure(f"study: the same over a suite's case anew, {name}", spent / anew, "×", "<= 0.2")


def coverage() -> Iterator[Figure]:
    """Rays of a scanner's and of a camera's place; CPU time."""
    hall = load_scenario("library-hall", _HALL)
    sampled = _crowd(hall, 100)
    cells = floor_cells(sampled.area, 0.05)
    visibility = SensorVisibility(hall, "west", Coverage(of="floor", cell_m=0.05))
    spent = _cpu_s(lambda: (visibility.floor(sampled, cells), visibility.people(sampled)))
    yield Figure(
        f"study: a scanner's place, 100 times, {len(cells)} cells and the hall's people", spent, "s", "<= 0.25"
    )
    meeting = load_scenario("meeting-three-people")
    empty = SampledWorld(meeting, None, [])
    floor = floor_cells(empty.area, 0.05)
    camera = SensorVisibility(meeting, "stereo_1", Coverage(of="floor", cell_m=0.05))
    spent = min(_cpu_s(lambda: camera.floor(empty, floor)) for _ in range(3))
    yield Figure(f"study: a camera's place, {len(floor)} cells at 3 heights", spent, "s", "<= 0.1")
    watched = load_scenario("library-hall", ["duration_s=25"])
    camera = SensorVisibility(watched, "camera", Coverage(px_per_m=25))
    yield Figure(
        "study: a camera's place, the hall's people at 100 times", _cpu_s(lambda: camera.people(sampled)), "s", "<= 2"
    )


def sets() -> Iterator[Figure]:
    """Sets of four scored from kept bits; the exact search of 60 places; coverage beside tracking."""
    with tempfile.TemporaryDirectory() as folder:
        cache = RecordingCache(Path(folder), 10**10)
        study, scenario = _hall_study(every_m=1.75), load_scenario("library-hall", _HALL)
        candidate_set = CandidateSet.of(study, scenario, build_scene(scenario), "hall")
        seen = PoseCoverage(study, candidate_set, cache)
        first = list(range(len(candidate_set.poses)))[:60]
        bits = np.array([seen.bits(each)[0] for each in first])
        yield Figure("study: sets of 4 scored, person-moments, a minute", _scored_a_minute(bits), "", ">= 5e6")
        sampled = seen.targets.sampled_worlds[0]
        cells = floor_cells(sampled.area, 0.05)
        wide = Coverage(of="floor", cell_m=0.05)
        rows = []
        for each in first[:12]:
            alone = apply_placement(study, scenario, [candidate_set.poses[each]])
            rows.append(packed(SensorVisibility(alone, "west", wide).floor(sampled, cells)))
        yield Figure(
            "study: sets of 4 scored, hall 5 cm × 100 times, a minute", _scored_a_minute(np.array(rows)), "", ">= 1e5"
        )
        counts, stay, weight = seen.counts(first)
        for k, target in ((1, "<= 5"), (2, "<= 15")):
            choice = CoverProblem(counts, stay, weight, k, ["scanner"] * len(first), lambda chosen: True)
            start = time.process_time()
            best = exact(choice, {"scanner": 4}, 300)
            spent = time.process_time() - start
            yield Figure(f"study: exact, {len(first)} places choose 4, k = {k}, {best.summary()}", spent, "s", target)
            found = greedy(choice, {"scanner": 4}).value / best.value
            yield Figure(f"study: greedy over exact, k = {k}", found, "", ">= 0.98")


def foretold() -> Iterator[Figure]:
    """Rank correlation of what a single scanner sees of people and how well they are tracked, 26 places of the hall.

    By six beams, the default, and by four, which is what `sort` needs to follow two legs.
    """
    with tempfile.TemporaryDirectory() as folder:
        cache = RecordingCache(Path(folder), 10**10)
        study, scenario = _hall_study(every_m=4.2), load_scenario("library-hall", _HALL)
        candidate_set = CandidateSet.of(study, scenario, build_scene(scenario), "hall")
        chosen = np.linspace(0, len(candidate_set.poses) - 1, 26).round().astype(int)
        hota = []
        for each in chosen:
            alone = apply_placement(study, scenario, [candidate_set.poses[int(each)]])
            seeds = [alone.model_copy(update={"seed": seed, "trackers": {}}) for seed in range(2700, 2704)]
            figures = [
                evaluate_task(EvaluationTask(one, (ChosenTracker("sort", "sort"),), cache, whole_code())).metrics
                for one in seeds
            ]
            hota.append(float(np.mean([one["sort"]["hota"] or 0.0 for one in figures])))
        for beams, target in ((6, ">= 0.75"), (4, "")):
            coverage = study.coverage.model_copy(update={"beams": beams})
            seen = PoseCoverage(study.model_copy(update={"coverage": coverage}), candidate_set, cache)
            rho = float(spearmanr([seen.share((int(each),)) for each in chosen], hota).statistic)
            yield Figure(f"study: rank correlation of coverage by {beams} beams and HOTA, 26 places", rho, "", target)


def proven() -> Iterator[Figure]:
    """Greedy beside exact on the shipped study that exact closes."""
    from twin.studies.preflight import prepare

    with tempfile.TemporaryDirectory() as folder:
        prepared = prepare("meeting-room-cameras")
        seen = PoseCoverage(prepared.study, prepared.candidate_set, RecordingCache(Path(folder), 10**10))
        searcher = Searcher(prepared.study, prepared.candidate_set, seen, lambda trials, number: None)
        choice = searcher.cover_problem()
        for number in searcher.numbers():
            start = time.process_time()
            best = exact(choice, number, 60)
            found = greedy(choice, number).value / best.value
            what = f"meeting-room-cameras, {number['camera']}, {best.summary()} in {time.process_time() - start:.1f} s"
            yield Figure(f"study: greedy over exact, {what}", found, "", ">= 0.98")


def _hall_study(every_m: float) -> Study:
    content: dict[str, Any] = {
        "name": "hall",
        "scenarios": [{"scenario": "library-hall"}],
        "devices": {
            "scanner": {
                "sensors": ["west", "east"],
                "walls": {"height_m": [0.35, 0.35], "every_m": every_m, "off_m": 0.2},
                "count": [1, 4],
            }
        },
        "objectives": [{"kind": "coverage"}],
        "coverage": {"seeds": [1290], "moments": 100},
        "search": {"method": "exact"},
    }
    return validate(Study, content, "hall")


def _crowd(scenario: Scenario, samples: int) -> SampledWorld:
    times = ((np.arange(samples) + 0.5) / samples * scenario.duration_s).tolist()
    return SampledWorld(scenario, PrecomputedScene.of(scenario, *precompute_people(scenario)), times)


def _scored_a_minute(bits: np.ndarray) -> float:
    """Sets of four in order, those of three kept on the way, each set's rows counted, a minute of CPU time."""
    n, done = len(bits), 0
    parts = np.array_split(bits, max(1, bits.shape[1] // 16_384), axis=1)  # so many words stay in the cache
    start = time.process_time()
    for a, b, c in islice(combinations(range(n), 3), 4000):
        if c + 1 == n:
            continue
        seen = np.zeros(n - c - 1, dtype=np.int64)
        for part in parts:
            seen += np.bitwise_count(part[a] | part[b] | part[c] | part[c + 1 :]).sum(axis=1, dtype=np.uint32)
        done += len(seen)
        if time.process_time() - start > 5:
            break
    return 60 * done / (time.process_time() - start)


def _cpu_s(call: Any) -> float:
    start = time.process_time()
    call()
    return time.process_time() - start
