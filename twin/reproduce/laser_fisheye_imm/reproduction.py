"""Reproduction of Bai and Takahashi for `twin reproduce laser-fisheye-imm`, and the content of its page.

The page holds table I, statements about it, occlusions, densities, conditions and film strips.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from trackers.laser_fisheye_imm.options import LaserFisheyeImmOptions
from twin.messages import OnProgress, no_progress
from twin.recording.atomic_file import write_csv
from twin.report.palette import data_uri
from twin.reproduce.laser_fisheye_imm.figure7 import (
    FIRST_SCAN,
    MEAN_MAGNITUDE,
    N_PARTICLE,
    NPE,
    NVE,
    START_SPEED_M_S,
    Curves,
    MonteCarlo,
    curves,
    figure7_results,
    simulate,
)
from twin.reproduce.laser_fisheye_imm.plots import (
    conditions_svg,
    densities_svg,
    errors_svg,
    figure9_svg,
    table_one_svg,
    walk_svg,
)
from twin.reproduce.laser_fisheye_imm.runs import (
    COAST_S,
    COLUMNS,
    FULL,
    IMM,
    KALMAN,
    NAMES,
    SENSOR_SETS,
    LabCondition,
    LabRuns,
    check_suite,
    read_lab,
)
from twin.reproduce.laser_fisheye_imm.table_one import (
    COUNTS,
    LOST,
    RATES,
    ROWS,
    breaks_at,
    cell,
    error_rate,
    lab_results,
    paper_value,
    statements,
    system_value,
    values,
)
from twin.reproduce.laser_fisheye_imm.walk import PERIOD_S, maneuvering_walk
from twin.reproduce.registry import Outputs, Request
from twin.reproduce.results import Interval, format_ranges, format_rows, rows_of, write_reproduction
from twin.reproduce.suite_runs import (
    CaseIncident,
    FilmStrip,
    draw_film_strips,
    load_seeded_suite,
    round_robin,
    run_conditions,
    write_film_strips,
    write_incidents,
)
from twin.suites.cluster import Workers

MOST_PER_CONDITION = 4
"""Greatest number of drawn incidents of the full system per condition; all in the paper's own."""


def choose_incidents(lab: LabRuns) -> list[CaseIncident]:
    """Choose the incidents to draw.

    In the paper's experiment: every incident of the full system, and the first of each kind of each other column. In others:
    at most `MOST_PER_CONDITION` of the full system per condition, alternating over runs and kinds.
    """
    chosen = []
    for place, condition in enumerate(lab.conditions):
        own = [each for each in condition.incidents if each.case.tracker == FULL.tracker]
        chosen += own if place == 0 else round_robin(own)[:MOST_PER_CONDITION]
        for column in COLUMNS[1:] if place == 0 else ():
            kinds: dict[str, CaseIncident] = {}
            for each in condition.incidents:
                if each.case.tracker == column.tracker:
                    kinds.setdefault(each.incident.kind, each)
            chosen += kinds.values()
    return chosen


def lab_content(lab: LabRuns, strips: Sequence[FilmStrip]) -> dict[str, Any]:
    """Collect the variables of the templates of the lab's part."""
    paper = lab.paper_condition
    return {
        "filters": [(filter_, SENSOR_SETS) for filter_ in (IMM, KALMAN)],
        "full": FULL.name,
        "coast_s": COAST_S,
        "paper_condition": _condition(paper, with_paper=True),
        "n_person": paper.n_person,
        "n_scan": lab.n_scan,
        "area": _size(lab),
        "seeds": format_ranges(np.array(paper.seeds)),
        "first_seed": lab.first.seed,
        "statements": list(statements(paper)),
        "densities": _densities(lab) if len(lab.densities) > 1 else None,
        "conditions": [_condition(each, with_paper=False) for each in lab.others],
        "strips": _strips(lab, strips),
        "n_drawn": len(strips),
        "n_incident": sum(len(each.incidents) for each in lab.conditions),
        "most_per_condition": MOST_PER_CONDITION,
        "not_done": lab.not_done,
        "ceiling": _ceiling(lab),
    }


def _ceiling(lab: LabRuns) -> dict[str, Any]:
    """Compute the MOTA and IDF1 of a faultless tracker that reports people only once confirmed."""
    confirm_s = LaserFisheyeImmOptions().track_management.confirm_s
    missed = round(confirm_s * lab.scan_rate_hz)
    return {
        "confirm_s": confirm_s,
        "missed": missed,
        "mota": 1 - missed / lab.n_scan,
        "idf1": 2 * (lab.n_scan - missed) / (2 * lab.n_scan - missed),
    }


def _size(lab: LabRuns) -> str:
    across, deep = np.ptp(lab.area, axis=0)
    return f"{across:g} m × {deep:g} m"


def _condition(condition: LabCondition, with_paper: bool) -> dict[str, Any]:
    """Build a condition's table, a row per metric, a cell per column; and its occlusions."""
    return {
        "name": condition.name,
        "overrides": condition.overrides,
        "n_run": len(condition.seeds),
        "n_person": condition.n_person,
        "rows": [
            (row, [_cell(condition, column, row, with_paper) for column in COLUMNS])
            for row in ROWS
            if row in COUNTS or not np.isnan(values(condition, FULL.tracker, row)).all()
        ],
        "long_occlusions": condition.long_occlusions,
        "n_lost_occluded": sum(each.lost for each in condition.long_occlusions),
        "n_lost": int(values(condition, FULL.tracker, LOST).sum()),
    }


def _cell(condition: LabCondition, column: Any, row: str, with_paper: bool) -> dict[str, Any]:
    found = values(condition, column.tracker, row)
    if np.isnan(found).all():
        return {"mean": "–", "interval": "", "most": "", "paper": None, "others": []}
    paper = paper_value(column, row) if with_paper else None
    decimals = 2 if row in COUNTS else 3
    unit = " m" if row in RATES and RATES[row][1] == "m" else ""
    middle = cell(condition, column.tracker, row)
    low, high = np.nanmin(found), np.nanmax(found)
    systems = ("its rules here", column.paper_tracker), (column.baseline, column.baseline)
    others = [(name, system_value(condition, tracker, row)) for name, tracker in systems]
    return {
        "others": [f"{name} {each.value:.{decimals}f}{unit}" for name, each in others if each is not None],
        "mean": f"{middle.value:.{decimals}f}{unit}",
        "interval": _interval(middle, decimals),
        "most": f"{low:.0f}–{high:.0f} a run, {found.sum():.0f} in all" if row in COUNTS else f"{low:.3f}–{high:.3f}",
        "paper": None if paper is None else f"{paper:g}",
    }


def _interval(found: Interval, decimals: int) -> str:
    return f"{found.low:.{decimals}f} to {found.high:.{decimals}f}".replace("-", "−")


def _densities(lab: LabRuns) -> dict[str, Any]:
    rows = []
    for each in lab.densities:
        rates = [error_rate(each, column) for column in COLUMNS]
        minutes = float(each.person_minutes.sum())
        rows.append(
            {
                "n_person": each.n_person,
                "per_m2": f"{each.n_person / lab.area_m2:.2f}",
                "n_run": len(each.seeds),
                "minutes": f"{minutes:.0f}",
                "long_occlusions": f"{len(each.long_occlusions) / minutes:.2f}",
                "cells": [(f"{rate.value:.2f}", _interval(rate, 2), rate.low > 0) for rate in rates],
                "n_lost": int(values(each, FULL.tracker, LOST).sum()),
                "n_lost_occluded": sum(hidden.lost for hidden in each.long_occlusions),
            }
        )
    broken = [breaks_at(lab.densities, column) for column in COLUMNS]
    return {
        "rows": rows,
        "most": lab.densities[-1].n_person,
        "breaks": [
            None if each is None else f"{each.n_person} people, {each.n_person / lab.area_m2:.2f}/m²" for each in broken
        ],
        "full_breaks": None
        if broken[0] is None
        else f"{broken[0].n_person} people ({broken[0].n_person / lab.area_m2:.2f}/m²)",
    }


def _strips(lab: LabRuns, strips: Sequence[FilmStrip]) -> list[dict[str, Any]]:
    sections = []
    for condition in lab.conditions:
        own = [each for each in strips if each.condition == condition.name]
        n_full = sum(each.case.tracker == FULL.tracker for each in condition.incidents)
        if own or n_full:
            sections.append(
                {
                    "condition": condition.name,
                    "n_full": n_full,
                    "n_full_drawn": sum(each.column == FULL.name for each in own),
                    "pictures": [(each, data_uri(each.picture)) for each in own],
                }
            )
    return sections


def figure7_content(runs: MonteCarlo, found: Sequence[Curves]) -> dict[str, Any]:
    """Collect the page's content on figure 7 and the walk of figure 6."""
    return {
        "n_run": len(runs.seeds),
        "seeds": f"{runs.seeds.start} to {runs.seeds[-1]}",
        "n_scan": len(runs.walk),
        "period_s": PERIOD_S,
        "top_speed": float(runs.walk.speed.max()),
        "maneuvers": [
            f"{maneuver.kind} {maneuver.start_t / PERIOD_S:.0f}–{maneuver.end_t / PERIOD_S:.0f}"
            for maneuver in runs.walk.maneuvers
        ],
        "behind": [(curves.name, format_ranges(runs.scans[~curves.lowest()[0]])) for curves in found],
        "reading": MEAN_MAGNITUDE,
        "n_particle": N_PARTICLE,
        "first_scan": FIRST_SCAN,
        "start_speed": START_SPEED_M_S,
    }


N_RUN = 100
"""Monte-Carlo runs of figure 7, as in the paper."""


def reproduce(folder: Path, request: Request, on_progress: OnProgress = no_progress) -> Outputs:
    """Run figure 7 and the suite and write results, plots, film strips and page into `folder`.

    Raises InputError for an invalid suite, for a folder with another reproduction's runs (or the same one's, without
    `resume`), for conditions with fewer than two complete runs, and where a file cannot be written.
    """
    suite, path = load_seeded_suite(request)
    check_suite(suite, path)
    found = run_conditions(folder, suite, path, request, on_progress, list(NAMES))
    lab = read_lab(found)
    runs = simulate(maneuvering_walk(), range(request.seed, request.seed + (request.runs or N_RUN)), on_progress)
    strips = draw_film_strips(choose_incidents(lab), NAMES, found.cache, Workers(request.jobs), on_progress)
    return write_all(folder, runs, lab, strips, request.command)


def write_all(folder: Path, runs: MonteCarlo, lab: LabRuns, strips: list[FilmStrip], command: str) -> Outputs:
    """Write results, tables of runs and incidents, plots, film strips and page. Raises InputError where a file cannot
    be written.
    """
    found = curves(runs)
    results = [*figure7_results(runs), *lab_results(lab)]
    drawn = {
        "figure6": walk_svg(runs.walk),
        "figure7": errors_svg(runs.walk, runs.scans, found),
        "figure9": figure9_svg(lab.first, lab.area),
        "table1": table_one_svg(lab.paper_condition),
    }
    if len(lab.densities) > 1:
        drawn["densities"] = densities_svg(lab.densities, lab.area_m2)
    if lab.others:
        drawn["conditions"] = conditions_svg([lab.paper_condition, *lab.others])
    paths = {"runs": folder / "runs.csv", "incidents": folder / "incidents.csv"}
    write_runs(paths["runs"], lab)
    write_incidents(paths["incidents"], (each for condition in lab.conditions for each in condition.incidents), NAMES)
    write_film_strips(folder / "strips", strips)
    paths |= write_reproduction(
        folder,
        command,
        "laser_fisheye_imm/page.html.j2",
        results,
        drawn,
        figure7_rows=format_rows(rows_of(results, NPE, NVE)),
        lab_rows=format_rows([each for each in results if each.where not in (NPE, NVE)]),
        figure7=figure7_content(runs, found),
        lab=lab_content(lab, strips),
    )
    return results, paths


def write_runs(path: Path, lab: LabRuns) -> None:
    """Write every run as a row: condition, seed, column, people, person_minutes, long_occlusions, and its metrics."""
    metrics = ("misidentifications", "lost_tracks", "id_switches", "mota", "idf1", "motp_m")
    heads = ("condition", "seed", "column", "people", "person_minutes", "long_occlusions", *metrics)
    rows: list[tuple[object, ...]] = [heads]
    for condition in lab.conditions:
        for column in COLUMNS:
            found = condition.metrics[column.tracker]
            for place, seed in enumerate(condition.seeds):
                hidden = sum(each.seed == seed for each in condition.long_occlusions)
                minutes = f"{condition.person_minutes[place]:.4f}"
                own = (f"{found[name][place]:g}" for name in metrics)
                rows.append((condition.name, seed, column.name, condition.n_person, minutes, hidden, *own))
    write_csv(path, rows)
