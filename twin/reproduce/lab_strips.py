"""The moments behind the counts: a strip of images and scans around misidentifications and losses, and a list of all."""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from twin.recording.whole_file import whole_file, whole_path
from twin.reproduce.lab_conditions import COLUMNS, FULL, LabRuns, SeenMoment
from twin.reproduce.lab_runs import condition_name
from twin.suites.cache import RecordingCache
from twin.suites.fingerprint import recording_key
from twin.suites.run import Place, Watcher, open_place
from twin.suites.strips import StripWork, draw_strip
from twin.suites.tasks import Ended, Listener, State, Task

MOST_A_CONDITION = 4
"""So many moments of the full system are drawn in each condition, the paper's own excepted: there it is every one."""
_LIMIT_S = 300.0


@dataclass(frozen=True)
class Strip:
    """A drawn moment: `picture` is a JPEG."""

    condition: str
    column: str
    seed: int
    t_s: float
    what: str
    kind: str
    report: str  # relative to the reproduction's folder
    picture: bytes


def chosen_moments(lab: LabRuns) -> list[SeenMoment]:
    """What is drawn: every moment of the full system at the paper's experiment, and the first of each kind of each other
    column there; beyond it at most `MOST_A_CONDITION` of the full system a condition, of every run and kind by turns.
    """
    chosen = []
    for place, condition in enumerate(lab.conditions):
        own = [each for each in condition.moments if each.case.tracker == FULL.tracker]
        chosen += own if place == 0 else _by_turns(own)[:MOST_A_CONDITION]
        for column in COLUMNS[1:] if place == 0 else ():
            kinds: dict[str, SeenMoment] = {}
            for each in condition.moments:
                if each.case.tracker == column.tracker:
                    kinds.setdefault(each.moment.kind, each)
            chosen += kinds.values()
    return chosen


def _by_turns(moments: Sequence[SeenMoment]) -> list[SeenMoment]:
    """The first of each kind of every run, then the second ones and so on; the order is kept otherwise."""
    rank: dict[tuple[int, str], int] = {}
    ranked = []
    for each in moments:
        key = (each.case.seed, each.moment.kind)
        rank[key] = rank.get(key, 0) + 1
        ranked.append((rank[key], each))
    return [each for _, each in sorted(ranked, key=lambda pair: pair[0])]


def draw_strips(
    moments: Sequence[SeenMoment],
    suite_folder: str,
    cache: RecordingCache,
    place: Place,
    on_progress: Callable[[str, float, float], None] | None = None,
    on_failure: Callable[[str], object] = lambda message: None,
) -> list[Strip]:
    """Draw the moments in order; one that cannot be drawn is told of and left out."""
    tasks = [
        Task(
            f"strip-{number}",
            StripWork(each.case, cache, each.moment.t_s),
            _LIMIT_S,
            recording_key(each.case.resolved, ""),
        )
        for number, each in enumerate(moments)
    ]
    pictures: dict[str, bytes] = {}

    def ended(end: Ended) -> None:
        if end.status == "done":
            pictures[end.task.id] = end.value
        else:
            on_failure(f"{end.task.work.case.id} at {end.task.work.t_s:.1f} s: no strip: {end.error}")

    def state(now: State) -> None:
        if on_progress is not None:
            on_progress("strips", now.done + now.failed, len(tasks))

    if tasks:
        with ExitStack() as stack:
            open_place(place, stack, Watcher())(tasks, draw_strip, Listener(ended=ended, state=state), None)
    names = {each.tracker: each.name for each in COLUMNS}
    return [
        Strip(
            condition=condition_name(each.case),
            column=names[each.case.tracker],
            seed=each.case.seed,
            t_s=each.moment.t_s,
            what=each.moment.what,
            kind=each.moment.kind,
            report=f"{suite_folder}/cases/{each.case.id}/report.html",
            picture=pictures[task.id],
        )
        for task, each in zip(tasks, moments, strict=True)
        if task.id in pictures
    ]


def write_strips(folder: Path, strips: Sequence[Strip]) -> None:
    """Write the pictures under names that say what they show; raises InputError where they cannot be written."""
    for strip in strips:
        said = f"{strip.condition}-{strip.seed}-{strip.column}-{strip.t_s:.1f}s-{strip.kind}"
        with whole_path(folder / f"{re.sub('[^A-Za-z0-9.]+', '-', said)}.jpg") as partial:
            partial.write_bytes(strip.picture)


def write_moments(path: Path, lab: LabRuns, suite_folder: str) -> None:
    """Write every misidentification and loss as a row: condition, seed, column, t_s, kind, what, report.

    Of a case with more than 20 events, switches included, the first 20 are there.
    """
    names = {each.tracker: each.name for each in COLUMNS}
    with whole_file(path) as stream:
        rows = csv.writer(stream, lineterminator="\n")
        rows.writerow(("condition", "seed", "column", "t_s", "kind", "what", "report"))
        for condition in lab.conditions:
            for each in condition.moments:
                report = f"{suite_folder}/cases/{each.case.id}/report.html"
                moment, column = each.moment, names[each.case.tracker]
                rows.writerow(
                    (condition.name, each.case.seed, column, f"{moment.t_s:.2f}", moment.kind, moment.what, report)
                )


def write_runs(path: Path, lab: LabRuns) -> None:
    """Write every run as a row: condition, seed, column, people, person_minutes, long_occlusions, and its figures."""
    figures = ("misidentifications", "lost_tracks", "id_switches", "mota", "idf1", "motp_m")
    with whole_file(path) as stream:
        rows = csv.writer(stream, lineterminator="\n")
        rows.writerow(("condition", "seed", "column", "people", "person_minutes", "long_occlusions", *figures))
        for condition in lab.conditions:
            for column in COLUMNS:
                found = condition.figures[column.tracker]
                for place, seed in enumerate(condition.seeds):
                    hidden = sum(each.seed == seed for each in condition.hidden)
                    minutes = f"{condition.person_minutes[place]:.4f}"
                    own = (f"{found[name][place]:g}" for name in figures)
                    rows.writerow((condition.name, seed, column.name, condition.n_person, minutes, hidden, *own))
