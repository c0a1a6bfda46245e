"""The suite engine: how much faster two workers are, what a case costs besides itself, what the gate catches and lets pass."""

from __future__ import annotations

import json
import resource
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from unittest import mock

import psutil

from benchmarks.figure import Figure
from benchmarks.spread import other_noise
from twin.models import cache_folder
from twin.scenario import load_scenario
from twin.suites.cache import RecordingCache, cache_limit_bytes
from twin.suites.cache_keys import whole_code
from twin.suites.cluster import ENVIRONMENT, Workers, open_cluster
from twin.suites.comparison import Comparison, compare
from twin.suites.dask_runner import ProgressListener, run_on
from twin.suites.expansion import expand
from twin.suites.filmstrip import describe_change
from twin.suites.metrics import tolerances_of
from twin.suites.result_files import read_results, read_store
from twin.suites.run import run_suite
from twin.suites.spec import Suite, SuiteScenario, load_suite
from twin.suites.tasks import Task, TaskListener
from twin.suites.worker import CaseResult, CaseWork, run_case

_N_CASE = 16
_MANY = 200
_SCENARIO = "lab-five-people"
_TRACKERS = ("laser-fisheye-imm", "waist-fisheye-imm", "laser-imm")
_WORSENED = {
    "measurement noise R × 9": ("smoke", ("trunk.variance_m2=0.0135",)),
    "gate halved": (
        "smoke",
        ("trunk.gate_m=0.5", "legs.gate_m=0.25", "legs.gate_alone_m=0.35"),
    ),
    "histogram update off": ("looks", ("appearance.memory=0.999999",)),
}


def speed_up() -> Iterator[Figure]:
    """Sixteen short cases of the lab, recorded and tracked, on one worker and on two; start-up left out."""
    spent_s = {}
    for jobs in (1, 2):
        with tempfile.TemporaryDirectory() as folder, open_cluster(jobs) as cluster:
            warm = _tasks(Path(folder), range(100, 100 + jobs))
            run_on(cluster, warm, run_case, TaskListener())
            tasks = _tasks(Path(folder), range(_N_CASE))
            start = time.perf_counter()
            run_on(cluster, tasks, run_case, TaskListener())
            spent_s[jobs] = time.perf_counter() - start
    yield Figure(f"two workers against one, {_N_CASE} cases", spent_s[1] / spent_s[2], "×", ">= 1.7")


def cost() -> Iterator[Figure]:
    """Measure time and retained memory of the engine, results and files for a case that does nothing."""
    suite, path = _made_up(_MANY)
    marks: list[tuple[float, float]] = []
    process = psutil.Process()
    with tempfile.TemporaryDirectory() as folder:
        cache = RecordingCache(Path(folder) / "cache", 10**9)

        def state(now: object) -> None:
            marks.append((time.perf_counter(), process.memory_info().rss / 2**20))

        run_suite(
            suite,
            path,
            Path(folder) / "out",
            cache,
            Workers(jobs=2),
            progress=ProgressListener(state=state),
            function=nothing,
        )
    per_case_ms = 1e3 * (marks[-1][0] - marks[len(marks) // 10][0]) / (0.9 * _MANY)
    yield Figure("the engine's own cost of a case, two workers", per_case_ms, "ms", "<= 50")
    early, late = marks[len(marks) // 5][1], marks[-1][1]
    yield Figure(f"memory of the process over {_MANY} cases: end over a fifth of the way", late / early, "×", "<= 1.1")


def regression() -> Iterator[Figure]:
    """The suite `regression` from an empty cache and from a full one: CPU time over two cores, whatever else uses them."""
    with tempfile.TemporaryDirectory() as folder:
        cache = RecordingCache(Path(folder) / "cache", 10**11)
        for number, (cached, target) in enumerate((("an empty cache", "<= 20"), ("a full one", "<= 5"))):
            before_s = _cpu_s()
            _run("regression", (), Path(folder) / str(number), cache)
            yield Figure(f"regression from {cached}, CPU time over two", (_cpu_s() - before_s) / 120, "min", target)


def gate() -> Iterator[Figure]:
    """Three trackers made worse on purpose, each caught; uses the user's cache of recordings."""
    with tempfile.TemporaryDirectory() as folder:
        known: dict[str, Path] = {}
        for number, (name, (suite, options)) in enumerate(_WORSENED.items()):
            if suite not in known:
                known[suite] = _run(suite, (), Path(folder) / suite)
            changes = [f"trackers.{tracker}.{option}" for tracker in _TRACKERS for option in options]
            presets = [f"trackers.{tracker}.preset={tracker}" for tracker in _TRACKERS]
            now = _run(suite, (*presets, *changes), Path(folder) / f"worse-{number}")
            found = _compare(known[suite], now)
            for change in found.worse:
                print(
                    f"{name}: {change.key.scenario}, {change.key.tracker}: {describe_change(change)}", file=sys.stderr
                )
            yield Figure(f"{name}, on {suite}: figures that got worse", len(found.worse), "", ">= 1")


def harmless() -> Iterator[Figure]:
    """Twenty changes that must raise no alarm, on the lab of `smoke`; beside them, noise that doubled, which must."""
    with tempfile.TemporaryDirectory() as folder:
        base = _run("smoke", (), Path(folder) / "base")

        def alarms(number: int, changes: Sequence[str], n_thread: int = 0) -> int:
            with mock.patch.dict(ENVIRONMENT, LP_NUM_THREADS=str(n_thread)):
                cache = RecordingCache(Path(folder) / f"cache-{number}", 10**10)
                found = _compare(base, _run("smoke", changes, Path(folder) / str(number), cache))
            reported = [(each.key.scenario, each.key.tracker, describe_change(each)) for each in found.worse]
            print(number, changes[:1], reported, file=sys.stderr, flush=True)
            return len(found.worse)

        reported = [alarms(number, *each) for number, each in enumerate(_harmless_changes())]
        wrong = sum(n > 0 for n in reported)
        yield Figure(
            f"harmless changes of {len(reported)} that raised an alarm, on the lab of smoke", wrong, "", "<= 0"
        )
        for number, (name, changes) in enumerate(_doubled_noise().items(), start=len(reported)):
            yield Figure(f"{name}: figures that got worse", alarms(number, changes), "", ">= 1")


def nothing(work: CaseWork) -> CaseResult:
    """A case that takes no time, with a report of the usual size."""
    metrics = {"mota": 0.9, "motp_m": 0.06, "idf1": 0.9, "hota": 0.9, "misses": work.case.seed}
    return CaseResult(metrics, (), {"report.html": bytes(160_000)}, "none")


def _cpu_s() -> float:
    """CPU time of this process and of all those that it started and that have ended [s]."""
    usages = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(usage.ru_utime + usage.ru_stime for usage in usages)


def _tasks(folder: Path, seeds: Sequence[int]) -> list[Task]:
    suite, path = _made_up(1, seeds, duration_s=3)
    work = [CaseWork(case, RecordingCache(folder, 10**10), whole_code()) for case in expand(suite, path)]
    return [Task(each.case.id, each, 600) for each in work]


def _made_up(n_case: int, seeds: Sequence[int] | None = None, duration_s: float = 1) -> tuple[Suite, Path]:
    scenario = SuiteScenario(scenario=_SCENARIO, set={"duration_s": duration_s})
    suite = Suite(
        name="made-up", seeds=tuple(seeds or range(n_case)), trackers=("laser-fisheye-imm",), scenarios=[scenario]
    )
    return suite, Path("made-up.yaml")


def _run(suite: str, changes: Sequence[str], folder: Path, cache: RecordingCache | None = None) -> Path:
    """The results of a suite; of `smoke` that part in the lab, whose people and sensors the changes name."""
    described, path = load_suite(suite)
    if suite == "smoke":
        lab = [entry for entry in described.scenarios if entry.scenario == _SCENARIO and entry.name is None]
        described = described.model_copy(update={"scenarios": lab})
    cache = cache or RecordingCache(cache_folder(), cache_limit_bytes())
    run_suite(described, path, folder, cache, changes=changes)
    return folder


def _compare(before: Path, now: Path) -> Comparison:
    with read_store(now) as store:
        return compare(read_results(before), read_results(now), tolerances_of(store.facts()))


def _harmless_changes() -> Iterator[tuple[tuple[str, ...], int]]:
    """Changes of the scenario, and the renderer's threads; a sensor under another name draws other noise."""
    scenario = load_scenario(_SCENARIO).model_dump(mode="json", exclude_none=True)
    renamed = (("fisheye",), ("waist",), ("knee",), ("waist", "knee"), ("waist", "knee", "fisheye"))
    for number in range(12):
        sensors = renamed[number % len(renamed)]
        yield tuple(f"{path}={json.dumps(value)}" for path, value in other_noise(number, *sensors).items()), 1
    names = list(scenario["people"])
    for number in range(1, 5):
        turned = [*names[number:], *names[:number]]
        yield (f"people={json.dumps({name: scenario['people'][name] for name in turned})}",), 1
    sensors = scenario["sensors"]
    yield (f"sensors={json.dumps(dict(reversed(sensors.items())))}",), 1
    third = {name: value for name, value in sensors["waist"].items() if name != "role"}
    third["mount"] = {"xyz": [2.3, 1.5, 1.2], "yaw_deg": 180}
    yield (f"sensors={json.dumps({'third': third, **sensors})}",), 1
    for n_thread in (2, 3):
        yield (), n_thread


def _doubled_noise() -> dict[str, tuple[str, ...]]:
    """Both scanners' noise twice as large: the same draw of it, and another."""
    scanners = ("waist", "knee")
    described = load_scenario(_SCENARIO).model_dump(mode="json", exclude_none=True)["sensors"]
    noise = {name: described[name]["noise"] | {"sigma_m": 2 * described[name]["noise"]["sigma_m"]} for name in scanners}
    other = other_noise(20, *scanners) | {
        f"sensors.{name}_20": described[name] | {"noise": noise[name]} for name in noise
    }
    return {
        "the scanners' noise doubled": tuple(f"sensors.{name}.noise={json.dumps(noise[name])}" for name in noise),
        "the scanners' noise doubled, in another draw": tuple(
            f"{path}={json.dumps(value)}" for path, value in other.items()
        ),
    }
