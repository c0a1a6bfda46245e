"""Runs of a reproduction: a suite with its own seeds, run by the suite engine, and read by condition; and its incidents.

A condition is an entry of the suite, or one of its variants. Incidents are misidentifications and losses, in a table and as
film strips.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Collection, Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from trackers.arrays import Array
from trackers.environment import Environment
from trackers.errors import InputError
from trackers.feeding import track_frames
from trackers.observations import Observation
from trackers.presets import make_tracker
from trackers.prior import Prior
from trackers.rig import Rig
from twin.messages import OnProgress, no_progress, printable
from twin.models import cache_folder
from twin.recording.atomic_file import write_csv
from twin.recording.reader import Recording
from twin.recording.tables import TrackTable, TruthTable, read_tracks, read_truth, track_table
from twin.reproduce.registry import Request
from twin.reproduce.results import Bootstrap, make_folder, write_pictures
from twin.streams import stream
from twin.suites.cache import RecordingCache, cache_limit_bytes
from twin.suites.cache_keys import recording_key
from twin.suites.cluster import Workers
from twin.suites.dask_runner import ProgressListener, open_workers
from twin.suites.expansion import Case, expand, with_variant
from twin.suites.filmstrip import FilmstripWork, draw_filmstrip
from twin.suites.result_files import read_store
from twin.suites.run import run_suite
from twin.suites.spec import Suite, load_suite
from twin.suites.store import DONE
from twin.suites.tasks import State, Task, TaskListener, TaskResult
from twin.suites.worker import RECORDING, TRUTH, Incident, case_recording

SUITE_FOLDER = "suite"
"""Folder of the suite's results within the reproduction's."""


@dataclass(frozen=True)
class SuiteRuns:
    """Results of the suite engine: cases of each condition by seed and tracker, their metrics and incidents.

    by_condition holds the seeds of which all wanted trackers are done; not_done the ids of other cases.
    """

    by_condition: Mapping[str, Mapping[int, Mapping[str, Case]]]
    metrics: Mapping[str, Mapping[str, float | None]]  # case id -> metric of metrics.json -> value
    incidents: Mapping[str, Sequence[Incident]]  # case id
    cache: RecordingCache
    folder: Path
    not_done: tuple[str, ...]

    def first_cases(self, condition: str) -> Mapping[str, Case]:
        """Return the cases of a condition's first run, by tracker."""
        return next(iter(self.by_condition[condition].values()))


@dataclass(frozen=True, eq=False)
class Condition:
    """n runs of a condition: metrics by tracker and name, (n,), NaN where one does not apply."""

    name: str
    seeds: tuple[int, ...]
    metrics: Mapping[str, Mapping[str, Array]]

    @property
    def trackers(self) -> tuple[str, ...]:
        """Trackers that did these runs."""
        return tuple(self.metrics)

    def bootstrap(self, stream_name: str, n_run: int | None = None) -> Bootstrap:
        """Draw replicates of the runs (None: of all), with this stream of the first seed."""
        return Bootstrap(n_run or len(self.seeds), stream(self.seeds[0], "reproduce", stream_name))


@dataclass(frozen=True, eq=False)
class LoadedRecording:
    """Recording in memory, to be tracked again; its truth, and the environment given to trackers, if any."""

    rig: Rig
    background: Sequence[Observation]
    observations: Sequence[Observation]
    truth: TruthTable
    environment: Environment | None

    @classmethod
    def of(cls, case: Case, runs: SuiteRuns, environment: Environment | None = None) -> LoadedRecording:
        """Load the recording of a case, made again if no longer in the cache."""
        with case_recording(case, runs.cache) as entry:
            bag = Recording(entry / RECORDING)
            truth = read_truth(entry / TRUTH)
            return cls(bag.rig, list(bag.background), list(bag.observations()), truth, environment)

    def tracker(self, preset: str, seed: int, options: Mapping[str, Any] | None = None) -> Any:
        """Make a tracker as a run of this seed does."""
        prior = Prior(self.background, self.environment)
        return make_tracker(preset, self.rig, prior, stream(seed, "tracker", preset), options)

    def track(self, preset: str, seed: int, options: Mapping[str, Any] | None = None) -> TrackTable:
        """Run a tracker; return its tracks."""
        return track_table(track_frames(self.tracker(preset, seed, options), self.rig, self.observations))


def metric_arrays(
    runs: Collection[Mapping[str, Case]], metrics: Mapping[str, Mapping[str, float | None]]
) -> dict[str, dict[str, Array]]:
    """Return every metric of these n runs by tracker, (n,) each, NaN where it does not apply."""
    names = dict.fromkeys(name for run in runs for case in run.values() for name in metrics.get(case.id, ()))
    of_case = {case.id: metrics.get(case.id, {}) for run in runs for case in run.values()}
    return {
        tracker: {name: np.array([of_case[run[tracker].id].get(name) for run in runs], float) for name in names}
        for tracker in next(iter(runs))
    }


def condition_name(case: Case) -> str:
    """Name a case's condition: its entry's name, and its difference from that entry's other variants."""
    return with_variant(case.scenario, case.variant)


def load_seeded_suite(request: Request) -> tuple[Suite, Path]:
    """Load the suite of a request, with its seeds in every entry; return it and its file. Raises InputError as
    `load_suite`.
    """
    suite, path = load_suite(request.suite or request.name)
    entries = [entry.model_copy(update={"seeds": None}) for entry in suite.scenarios]
    return suite.model_copy(update={"seeds": tuple(request.seed_range), "scenarios": entries}), path


def check_entries(
    suite: Suite,
    path: Path,
    needed: Mapping[str, str],
    trackers: Sequence[str] = (),
    more: Mapping[str, Sequence[str]] = MappingProxyType({}),
) -> None:
    """Raise InputError for a suite without an entry of these names, or with an entry without one of its trackers.

    needed: what each entry is; trackers: of all entries; more: by entry.
    """
    entries = {entry.name or entry.scenario: entry for entry in suite.scenarios}
    for name, what in needed.items():
        if name not in entries:
            raise InputError(f"{path}: scenarios: none is named {name}; one, {what}, is expected")
    for name, entry in entries.items():
        for tracker in (*trackers, *more.get(name, ())):
            if tracker not in (entry.trackers or suite.trackers):
                raise InputError(f"{path}: trackers: {name} is run without {tracker}; it is expected among them")


def run_conditions(
    folder: Path,
    suite: Suite,
    path: Path,
    request: Request,
    on_progress: OnProgress,
    trackers: Collection[str] | None = None,
) -> SuiteRuns:
    """Run the suite into `folder` and read its results. A run counts if all of `trackers` (None: all of its condition's) are
    done.

    Raises InputError for a folder with another suite's runs (or the same one's, without `--resume`), where it cannot be
    written, and where a condition has fewer than two such runs.
    """
    make_folder(folder / SUITE_FOLDER)

    def state(now: State) -> None:
        on_progress("twin runs", now.done + now.failed, now.waiting + now.running + now.done + now.failed)

    cache = RecordingCache(cache_folder(), cache_limit_bytes())
    run_suite(
        suite,
        path,
        folder / SUITE_FOLDER,
        cache,
        Workers(request.jobs),
        resume=request.resume,
        progress=ProgressListener(failed=warn_of_failure, state=state),
    )
    return _read_runs(suite, path, folder, cache, trackers)


_FEWEST_RUNS = 2  # an interval over runs needs two


def _read_runs(
    suite: Suite, path: Path, folder: Path, cache: RecordingCache, trackers: Collection[str] | None
) -> SuiteRuns:
    by_condition: dict[str, dict[int, dict[str, Case]]] = {}
    for case in expand(suite, path):
        by_condition.setdefault(condition_name(case), {}).setdefault(case.seed, {})[case.tracker] = case
    with read_store(folder / SUITE_FOLDER) as store:
        done = {each.id for each in store.cases() if each.status == DONE}
        metrics = store.metrics()
        incidents = {case_id: store.incidents(case_id) for case_id in done}
    wanted = [case.id for by_seed in by_condition.values() for cases in by_seed.values() for case in cases.values()]
    whole = {}
    for name, by_seed in by_condition.items():
        wanted_trackers = trackers or next(iter(by_seed.values()))
        whole[name] = {
            seed: cases for seed, cases in by_seed.items() if all(cases[each].id in done for each in wanted_trackers)
        }
        if len(whole[name]) < _FEWEST_RUNS:
            raise InputError(
                f"{folder}: {name} has {len(whole[name])} runs in which all of {', '.join(wanted_trackers)} are done; "
                f"{_FEWEST_RUNS} or more are expected, and --resume does the rest"
            )
    return SuiteRuns(whole, metrics, incidents, cache, folder, tuple(each for each in wanted if each not in done))


def warn_of_failure(case_id: str, error: str) -> None:
    """Warn on stderr that a case failed."""
    sys.stderr.write(printable(f"twin: warning: {case_id} failed: {error.splitlines()[0] if error else ''}\n"))


def case_truth(case: Case, runs: SuiteRuns) -> TruthTable:
    """Read the truth of a case's recording."""
    with case_recording(case, runs.cache) as entry:
        return read_truth(entry / TRUTH)


def case_tracks(case: Case, runs: SuiteRuns) -> TrackTable:
    """Read the tracks of a finished case."""
    return read_tracks(runs.folder / SUITE_FOLDER / "cases" / case.id / "tracks" / f"{case.tracker}.csv")


_LIMIT_S = 300.0


@dataclass(frozen=True)
class CaseIncident:
    """Misidentification or loss, and its case."""

    case: Case
    incident: Incident


@dataclass(frozen=True)
class FilmStrip:
    """A drawn incident: `picture` is a JPEG."""

    condition: str
    column: str
    seed: int
    t_s: float
    what: str
    kind: str
    report: str  # relative to the reproduction's folder
    picture: bytes


def round_robin(incidents: Sequence[CaseIncident]) -> list[CaseIncident]:
    """Order incidents: the first of each kind of every run, then the second ones and so on, otherwise stable."""
    rank: dict[tuple[int, str], int] = {}
    ranked = []
    for each in incidents:
        key = (each.case.seed, each.incident.kind)
        rank[key] = rank.get(key, 0) + 1
        ranked.append((rank[key], each))
    return [each for _, each in sorted(ranked, key=lambda pair: pair[0])]


def draw_film_strips(
    incidents: Sequence[CaseIncident],
    names: Mapping[str, str],
    cache: RecordingCache,
    place: Workers,
    on_progress: OnProgress = no_progress,
) -> list[FilmStrip]:
    """Draw the incidents in order; those that fail are left out with a warning. names: labels of trackers."""
    tasks = [
        Task(
            f"strip-{number}",
            FilmstripWork(each.case, cache, each.incident.t_s),
            _LIMIT_S,
            recording_key(each.case.resolved, ""),
        )
        for number, each in enumerate(incidents)
    ]
    pictures: dict[str, bytes] = {}

    def ended(end: TaskResult) -> None:
        if end.status == "done":
            pictures[end.task.id] = end.value
        else:
            warn_of_failure("strip", f"{end.task.work.case.id} at {end.task.work.t_s:.1f} s: no strip: {end.error}")

    def state(now: State) -> None:
        on_progress("strips", now.done + now.failed, len(tasks))

    if tasks:
        with ExitStack() as stack:
            open_workers(place, stack, ProgressListener())(
                tasks, draw_filmstrip, TaskListener(ended=ended, state=state), None
            )
    return [
        FilmStrip(
            condition=condition_name(each.case),
            column=names[each.case.tracker],
            seed=each.case.seed,
            t_s=each.incident.t_s,
            what=each.incident.what,
            kind=each.incident.kind,
            report=_report(each.case),
            picture=pictures[task.id],
        )
        for task, each in zip(tasks, incidents, strict=True)
        if task.id in pictures
    ]


def _report(case: Case) -> str:
    """Return the page of a case, relative to the reproduction's folder."""
    return f"{SUITE_FOLDER}/cases/{case.id}/report.html"


def write_film_strips(folder: Path, strips: Sequence[FilmStrip]) -> None:
    """Write the pictures under descriptive names; raises InputError where they cannot be written."""
    names = (f"{each.condition}-{each.seed}-{each.column}-{each.t_s:.1f}s-{each.kind}" for each in strips)
    write_pictures(
        folder,
        {re.sub("[^A-Za-z0-9.]+", "-", name): each.picture for name, each in zip(names, strips, strict=True)},
    )


def write_incidents(path: Path, incidents: Iterable[CaseIncident], names: Mapping[str, str]) -> None:
    """Write every misidentification and loss as a row: condition, seed, column, t_s, kind, what, report.

    names: labels of trackers. At most 20 events of a case, switches included.
    """
    rows: list[tuple[object, ...]] = [("condition", "seed", "column", "t_s", "kind", "what", "report")]
    for each in incidents:
        case, incident = each.case, each.incident
        who = condition_name(case), case.seed, names[case.tracker]
        rows.append((*who, f"{incident.t_s:.2f}", incident.kind, incident.what, _report(case)))
    write_csv(path, rows)
