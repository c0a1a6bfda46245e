"""Which moments of the lab's runs are drawn, and every run as a row."""

from __future__ import annotations

import csv
from pathlib import Path

from twin.recording.atomic_file import open_atomic
from twin.reproduce.laser_fisheye_imm.conditions import COLUMNS, FULL, LabRuns
from twin.reproduce.moments import SeenMoment, by_turns

MOST_A_CONDITION = 4
"""So many moments of the full system are drawn in each condition, the paper's own excepted: there it is every one."""


def chosen_moments(lab: LabRuns) -> list[SeenMoment]:
    """What is drawn: every moment of the full system at the paper's experiment, and the first of each kind of each other
    column there; beyond it at most `MOST_A_CONDITION` of the full system a condition, of every run and kind by turns.
    """
    chosen = []
    for place, condition in enumerate(lab.conditions):
        own = [each for each in condition.moments if each.case.tracker == FULL.tracker]
        chosen += own if place == 0 else by_turns(own)[:MOST_A_CONDITION]
        for column in COLUMNS[1:] if place == 0 else ():
            kinds: dict[str, SeenMoment] = {}
            for each in condition.moments:
                if each.case.tracker == column.tracker:
                    kinds.setdefault(each.moment.kind, each)
            chosen += kinds.values()
    return chosen


def write_runs(path: Path, lab: LabRuns) -> None:
    """Write every run as a row: condition, seed, column, people, person_minutes, long_occlusions, and its figures."""
    figures = ("misidentifications", "lost_tracks", "id_switches", "mota", "idf1", "motp_m")
    with open_atomic(path) as stream:
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
