"""Run a suite: every case, and every result into its store."""

from __future__ import annotations

import json
import os
import shutil
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import asdict, replace
from itertools import chain
from pathlib import Path
from typing import Any

from twin.messages import counted
from twin.recording.atomic_file import write_atomic
from twin.run.inputs import NONE_TRUSTED, TrustedClasses, unused_changes
from twin.run.outcome import versions
from twin.scenario.run_size import total
from twin.suites.cache import RecordingCache, write_sums
from twin.suites.cache_keys import Provenance, whole_code
from twin.suites.cluster import Workers
from twin.suites.dask_runner import ProgressListener, RunTasks, open_workers
from twin.suites.expansion import Case, check_case_count, expand
from twin.suites.filmstrip import STRIP, FilmstripWork, draw_filmstrip
from twin.suites.metrics import flatten_metrics
from twin.suites.result_files import kind_of_warning, open_store
from twin.suites.results import collect_results, worst_cases
from twin.suites.spec import Suite
from twin.suites.store import DONE, FAILED, RecordingInfo, Requirement, ResultStore
from twin.suites.tasks import State, Task, TaskListener, TaskResult
from twin.suites.variants import format_overrides, is_of_trackers
from twin.suites.worker import (
    NO_RENDERER,
    WORST,
    CaseResult,
    CaseWork,
    Incident,
    renderer_of,
    resolved_scenario,
    run_case,
)

_MAX_FILMSTRIPS = 24


def run_suite(
    suite: Suite,
    path: Path,
    folder: Path,
    cache: RecordingCache,
    workers: Workers | None = None,
    *,
    changes: Sequence[str] = (),
    trusted: TrustedClasses = NONE_TRUSTED,
    resume: bool = False,
    progress: ProgressListener | None = None,
    function: Callable[[CaseWork], CaseResult] | None = None,
    limits: bool = True,
    check: Callable[[Sequence[Case]], None] = lambda cases: None,
) -> None:
    """Run every case of the suite into `folder`/results.sqlite, with its files; then draw film strips.

    changes: 'path=value' texts for every case; trusted: classes that the suite and its scenarios may name; function: handles
    a case, importable by workers (None: `run_case`); limits: whether to refuse implausible numbers of cases, people and
    bytes; check: called with the cases before the first starts, to raise for what they lack. A failed case is noted, and the
    rest goes on. Raises InputError for an invalid suite, without a scheduler's answer or OpenGL, and for a folder with other
    results; also where the disk is full or the workers have died, which keeps all results so far.
    """
    progress, workers = progress or ProgressListener(), workers or Workers()
    # The user's own classes on a scheduler's workers are not known here.
    if limits:
        check_case_count(suite, path)
    if not suite.recordings:  # a pattern may stand for many
        progress.planned(counted(suite.n_case, "case"))
    cases = expand(
        suite, path, changes, plug_ins=workers.scheduler is None, trusted=trusted, limits=limits, scenes=True
    )
    if suite.recordings:
        progress.planned(counted(len(cases), "case"))
    check(cases)
    for warning in (*idle_settings(suite), *idle_changes(cases), *_idle_of_command(changes, cases)):
        progress.warned(warning)
    recordings = {case.resolved: case.size for case in cases}
    progress.planned(f"{counted(len(recordings), 'recording')}: {total(recordings.values())}")
    if workers.scheduler is None:  # workers elsewhere have caches of their own
        cache.check()
        _check_rendering(cases)
    with ExitStack() as stack:
        # A scheduler may not answer, our processes always start: check it before claiming the folder.
        elsewhere = open_workers(workers, stack, progress) if workers.scheduler is not None else None
        store = stack.enter_context(
            open_store(folder, cases, _facts(suite, path, cases, changes), resume, progress.warned)
        )
        start, before_s = time.perf_counter(), store.facts()["seconds"]
        run_tasks = elsewhere or open_workers(workers, stack, progress)
        _run_cases(store, folder, cases, cache, run_tasks, progress, function or run_case)
        _draw_filmstrips(store, folder, cases, cache, run_tasks, progress)
        store.note(seconds=before_s + time.perf_counter() - start)


def _check_rendering(cases: Sequence[Case]) -> None:
    """Raise InputError where a scenario has cameras and this machine cannot render."""
    for case in {case.scenario: case for case in cases if case.bag is None}.values():
        if renderer_of(resolved_scenario(case)) != NO_RENDERER:  # one that renders does for all
            return


def idle_settings(suite: Suite) -> list[str]:
    """Return a sentence for each `set` of a suite's file that changes a tracker that is not run, or no recording."""
    entries = {f"scenarios.{number}.set.": each for number, each in enumerate(suite.scenarios)}
    bags = {f"recordings.{number}.set.": each for number, each in enumerate(suite.recordings)}
    run = {where: each.trackers or suite.trackers for where, each in {**entries, **bags}.items()}
    sentences = unused_changes(format_overrides(suite.set), sorted({*chain(*run.values())}), "set.")
    for where, each in {**entries, **bags}.items():
        sentences += unused_changes(format_overrides(each.set), run[where], where)
    idle = [path for path in suite.set if suite.recordings and not is_of_trackers(path)]
    return sentences + [f"set.{path}: changes the scenarios alone; recordings are tracked as they are" for path in idle]


def _idle_of_command(changes: Sequence[str], cases: Sequence[Case]) -> list[str]:
    """Return a sentence for each `--set` that no case follows: of a tracker that is not run, of a scenario for bags alone."""
    of_scenarios = [each for each in changes if not is_of_trackers(each)]
    if any(case.bag is None for case in cases):
        of_scenarios = []
    bags = [f"--set {each}: changes nothing, as every case is a recording" for each in of_scenarios]
    return [*unused_changes(changes, sorted({case.tracker for case in cases})), *bags]


def idle_changes(cases: Sequence[Case]) -> list[str]:
    """Return a sentence for each pair of variants of a scenario whose cases are made from the same, and give the same."""
    made_from: defaultdict[tuple[str, str], set[tuple[int, str, Provenance]]] = defaultdict(set)
    for case in cases:
        made_from[case.scenario, case.variant].add((case.seed, case.tracker, case.provenance))
    first: dict[tuple[str, frozenset[tuple[int, str, Provenance]]], str] = {}
    sentences = []
    for (scenario, variant), parts in made_from.items():
        same = first.setdefault((scenario, frozenset(parts)), variant)
        if same != variant:
            names = [repr(each) for each in (same, variant) if each]
            does = f"{' and '.join(names)} differ in" if len(names) == 2 else f"{names[0]} changes"
            sentences.append(f"{scenario}: {does} nothing that is simulated or tracked")
    return sentences


def _facts(suite: Suite, path: Path, cases: Sequence[Case], changes: Sequence[str]) -> dict[str, Any]:
    """Collect the facts stored with the results of a run: description, file, code, versions, overrides, requirements."""
    requirements = dict.fromkeys(
        Requirement(case.scenario, json.dumps(case.overrides, ensure_ascii=False), case.tracker, metric, bound)
        for case in cases
        for metric, bound in case.require.items()
    )
    return {
        "suite": suite.name,
        "file": os.path.abspath(path),
        "description": suite.description,
        "reference": suite.reference,
        "code": whole_code(),
        "versions": {name: value for name, value in versions(None).items() if not name.startswith("gl_")},
        "changes": list(changes),
        "tolerances": {name: each.model_dump() for name, each in suite.tolerances.items()},
        "requirements": [asdict(each) for each in requirements],
        "reports": suite.reports,
        "seconds": 0.0,
        "renderers": [],
        "tracker_warnings": {},
        "scenario_warnings": {},
    }


def _run_cases(
    store: ResultStore,
    folder: Path,
    cases: Sequence[Case],
    cache: RecordingCache,
    run_tasks: RunTasks,
    progress: ProgressListener,
    function: Callable[[CaseWork], CaseResult],
) -> None:
    facts = store.facts()
    done = {each.id for each in store.cases() if each.status == DONE}
    ends = _CaseEnds(store, folder, cases, done, facts, progress)
    # The renderer's name is not known here; the key without it distinguishes as much.
    store.note(recipes={case.id: case.recipe for case in cases})
    code, recorded = whole_code(), Counter(people for _, people in {(case.resolved, case.people) for case in cases})
    tasks = [
        Task(
            case.id,
            CaseWork(case, cache, code, same_people=recorded[case.people] > 1),
            case.limit_s,
            shares=case.recipe,
        )
        for case in cases
        if case.id not in done
    ]

    def state(now: State) -> None:
        progress.state(replace(now, done=now.done + len(done)))

    for sentence in _without_page(facts.get("reports", True), cases, done):
        progress.warned(sentence)
    logs = folder / "logs"
    logs.mkdir(exist_ok=True)
    run_tasks(
        tasks, function, TaskListener(lambda task, number: store.started(task.id, number), ends.take, state), logs
    )


class _CaseEnds:
    """Ends of cases as they come: results into the store, files into the case's folder, each warning once."""

    def __init__(
        self,
        store: ResultStore,
        folder: Path,
        cases: Sequence[Case],
        done: Collection[str],
        facts: Mapping[str, Any],
        progress: ProgressListener,
    ) -> None:
        self._store, self._folder, self._progress = store, folder, progress
        self._by_id = {case.id: case for case in cases}
        self._renderers = set(facts["renderers"])
        # of cases that are done again, nothing of before is kept
        held = {text: [each for each in ids if each in done] for text, ids in facts.get("warned_cases", {}).items()}
        self._warned_cases: dict[str, list[str]] = {text: ids for text, ids in held.items() if ids}
        self._of_scenarios = set(facts.get("scenario_warnings", ()))
        self._kinds = {kind_of_warning(text): text for text in self._warned_cases}
        self._warned: set[str] = set()
        self._note_warnings()

    def take(self, end: TaskResult) -> None:
        """Store the result of a case, or that it failed."""
        case, store = self._by_id[end.task.id], self._store
        if end.status == FAILED:
            store.failed(case.id, end.attempts, end.seconds, end.error)
            self._progress.failed(case.id, end.error)
            return
        result: CaseResult = end.value
        self._take_warnings(case, result)
        shutil.rmtree(
            self._folder / "cases" / case.id, ignore_errors=True
        )  # what an earlier state of the case has left
        _write_files(self._folder / "cases" / case.id, result.files)
        write_sums(self._folder / "cases" / case.id)
        recorded = RecordingInfo(result.recording, result.people, result.scatter_m)
        store.finished(case, end.attempts, end.seconds, flatten_metrics(result.metrics), result.incidents, recorded)
        if result.renderer not in self._renderers:
            self._renderers.add(result.renderer)
            store.note(renderers=sorted(self._renderers))

    def _take_warnings(self, case: Case, result: CaseResult) -> None:
        for warning in result.warnings:
            if warning not in self._warned:  # once, for all trackers of a recording
                self._progress.warned(warning)
        self._warned.update(result.warnings)
        for each in (*result.tracker_warnings, *result.scenario_warnings):
            first = self._kinds.setdefault(kind_of_warning(each), each)
            if first not in self._warned_cases:  # once, whatever its number of cases, and whatever numbers it holds
                self._progress.warned(f"{case.id}: {each}")
            self._warned_cases.setdefault(first, []).append(case.id)
            self._of_scenarios.update([first] if each in result.scenario_warnings else [])
        if result.tracker_warnings or result.scenario_warnings:
            self._note_warnings()

    def _note_warnings(self) -> None:
        """Store the warnings of trackers and of scenarios, each with the cases that gave it, and their number."""
        found = {text: len(ids) for text, ids in self._warned_cases.items()}
        self._store.note(
            warned_cases=self._warned_cases,
            tracker_warnings={text: n for text, n in found.items() if text not in self._of_scenarios},
            scenario_warnings={text: n for text, n in found.items() if text in self._of_scenarios},
        )


def _without_page(had_pages: bool, cases: Sequence[Case], done: Collection[str]) -> list[str]:
    """Return a sentence on the finished cases that have no page of their own, though the suite now wants one."""
    lacking = [each for each in cases if each.id in done and each.report and not had_pages]
    said = f"--resume: {counted(len(lacking), 'finished case')} of {len(cases)} have no page, as reports was false"
    return [f"{said}; another folder gives each one"] if lacking else []


def _draw_filmstrips(
    store: ResultStore,
    folder: Path,
    cases: Sequence[Case],
    cache: RecordingCache,
    run_tasks: RunTasks,
    progress: ProgressListener,
) -> None:
    """Draw the worst second of each scenario and variant, and of the cases furthest behind the reference, with its below.

    The worst scenarios come first, `_MAX_FILMSTRIPS` at most; one that cannot be drawn is left out.
    """
    by_id = {case.id: case for case in cases}
    worst_second: dict[str, Incident] = {}
    worst: dict[tuple[str, str], str] = {}  # case of each scenario and variant
    for each in store.cases():
        case = by_id[each.id]
        for incident in store.incidents(each.id)[:1] if case.bag is None else ():  # a bag's room is not known
            if incident.kind == WORST:
                worst_second[each.id] = incident
                so_far = worst.setdefault((case.scenario, case.variant), each.id)
                if incident.severity > worst_second[so_far].severity:
                    worst[case.scenario, case.variant] = each.id
    ranked = sorted(worst.values(), key=lambda case_id: worst_second[case_id].severity, reverse=True)
    chosen = {case_id: worst_second[case_id].t_s for case_id in ranked[:_MAX_FILMSTRIPS]}
    reference = store.facts().get("reference")
    behind = worst_cases(collect_results(store), reference) if reference is not None else []
    of_reference = {
        case.case_id: worst_second[case.case_id].t_s
        for case in behind
        if case.case_id is not None and case.case_id in worst_second
    }
    rivals = {(each.scenario, each.variant, each.seed): each for each in cases if each.tracker == reference}
    tasks = []
    for case_id, t_s in (chosen | of_reference).items():
        case = by_id[case_id]
        beside = rivals[case.scenario, case.variant, case.seed] if case_id in of_reference else None
        tasks.append(Task(f"{case_id}-strip", FilmstripWork(case, cache, t_s, beside), case.limit_s, case.recipe))
    drawn = {}

    def ended(end: TaskResult) -> None:
        case: Case = end.task.work.case
        if end.status == FAILED:
            progress.failed(end.task.id, end.error)
            return
        _write_files(folder / "cases" / case.id, {STRIP: end.value})
        drawn[case.id] = end.task.work.t_s

    run_tasks(tasks, draw_filmstrip, TaskListener(ended=ended), None)
    store.note(
        filmstrips={case_id: t_s for case_id, t_s in drawn.items() if case_id in chosen},
        worst_filmstrips={case_id: t_s for case_id, t_s in drawn.items() if case_id in of_reference},
    )


def _write_files(folder: Path, files: Mapping[str, bytes]) -> None:
    for name, content in files.items():
        write_atomic(folder / name, content)
