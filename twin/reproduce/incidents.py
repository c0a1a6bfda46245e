"""Incidents of a suite's runs: film strips of misidentifications and losses, and a table of all."""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from twin.recording.atomic_file import atomic_path, open_atomic
from twin.reproduce.suite_runs import SUITE_FOLDER, condition_name
from twin.suites.cache import RecordingCache
from twin.suites.cache_keys import recording_key
from twin.suites.cluster import Workers
from twin.suites.dask_runner import open_workers
from twin.suites.expansion import Case
from twin.suites.filmstrip import FilmstripWork, draw_filmstrip
from twin.suites.progress import ProgressListener
from twin.suites.tasks import State, Task, TaskListener, TaskResult
from twin.suites.worker import Incident

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
    on_progress: Callable[[str, float, float], None] | None = None,
    on_failure: Callable[[str], object] = lambda message: None,
) -> list[FilmStrip]:
    """Draw the incidents in order; failures are reported and left out. names: labels of trackers."""
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
            on_failure(f"{end.task.work.case.id} at {end.task.work.t_s:.1f} s: no strip: {end.error}")

    def state(now: State) -> None:
        if on_progress is not None:
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
            report=f"{SUITE_FOLDER}/cases/{each.case.id}/report.html",
            picture=pictures[task.id],
        )
        for task, each in zip(tasks, incidents, strict=True)
        if task.id in pictures
    ]


def write_film_strips(folder: Path, strips: Sequence[FilmStrip]) -> None:
    """Write the pictures under descriptive names; raises InputError where they cannot be written."""
    for strip in strips:
        name = f"{strip.condition}-{strip.seed}-{strip.column}-{strip.t_s:.1f}s-{strip.kind}"
        with atomic_path(folder / f"{re.sub('[^A-Za-z0-9.]+', '-', name)}.jpg") as partial:
            partial.write_bytes(strip.picture)


def write_incidents(path: Path, incidents: Iterable[CaseIncident], names: Mapping[str, str]) -> None:
    """Write every misidentification and loss as a row: condition, seed, column, t_s, kind, what, report.

    names: labels of trackers. At most 20 events of a case, switches included.
    """
    with open_atomic(path) as stream:
        rows = csv.writer(stream, lineterminator="\n")
        rows.writerow(("condition", "seed", "column", "t_s", "kind", "what", "report"))
        for each in incidents:
            case, incident = each.case, each.incident
            report = f"{SUITE_FOLDER}/cases/{case.id}/report.html"
            who = condition_name(case), case.seed, names[case.tracker]
            rows.writerow((*who, f"{incident.t_s:.2f}", incident.kind, incident.what, report))
