"""Everything `twin reproduce laser-vision-learning` leaves behind."""

from __future__ import annotations

import base64
import csv
import shlex
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from twin.recording.atomic_file import open_atomic
from twin.reproduce.laser_vision_learning.choosing import CHOICE, SEED, choices
from twin.reproduce.laser_vision_learning.conditions import SYSTEMS, Condition, HallRuns
from twin.reproduce.laser_vision_learning.merges import merges_of, moments_of
from twin.reproduce.laser_vision_learning.plots import densities_svg, figure11_svg
from twin.reproduce.laser_vision_learning.runs import check_suite, read_hall
from twin.reproduce.laser_vision_learning.tables import (
    ABLATION,
    CHANGED,
    DENSITY,
    PLACE,
    TABLE_ONE,
    TABLE_TWO,
    cost_fit,
    hall_results,
)
from twin.reproduce.moments import Strip, draw_strips, write_strips
from twin.reproduce.page import rows_of, write_page, write_plots
from twin.reproduce.registry import Asked, Found, OnProgress
from twin.reproduce.results import Result, write_results
from twin.reproduce.suite_runs import read_runs, run_in, suite_of, tell_failure
from twin.suites.cluster import Workers
from twin.suites.worker import resolved_scenario


def reproduce(folder: Path, asked: Asked, on_progress: OnProgress | None = None) -> Found:
    """Run the suite and write results, plots, strips and page into `folder`.

    Raises InputError for a suite that cannot be, for a folder that holds another reproduction's runs (or the same one's,
    without `resume`), for conditions with fewer than two whole runs, and where a file cannot be written.
    """
    suite, path = suite_of(asked.suite or asked.name, asked.seed_range)
    check_suite(suite, path)
    place = Workers(asked.jobs)
    cache = run_in(folder, suite, path, place, asked.resume, on_progress)
    hall = read_hall(read_runs(suite, path, folder, cache))
    names = {name: SYSTEMS.get(name, name) for name in hall.busy.cases}
    moments = moments_of(hall.busy, merges_of(hall.busy))
    strips = draw_strips(moments, names, cache, place, on_progress, lambda what: tell_failure("strip", what))
    command = asked.command + (f" --suite {shlex.quote(asked.suite)}" if asked.suite else "")
    pictures = any(
        sensor.kind == "camera" for sensor in resolved_scenario(next(iter(hall.busy.cases.values()))).sensors.values()
    )
    chosen = choices(cache, on_progress) if pictures else []
    return write_all(folder, hall, strips, chosen, command)


def write_all(folder: Path, hall: HallRuns, strips: Sequence[Strip], chosen: Sequence[Result], command: str) -> Found:
    """Write what was found: results, table of runs, plots, strips, page. Raises InputError as files do."""
    results = [*hall_results(hall), *chosen]
    conditions = hall.conditions
    drawn = {"figure11": figure11_svg(hall.hall, conditions["hall"])}
    if hall.densities:
        drawn["densities"] = densities_svg([conditions["busy"], *hall.densities])
    paths = {"results": folder / "results.json", "runs": folder / "runs.csv"}
    paths |= {name: folder / f"{name}.svg" for name in drawn} | {"page": folder / "report.html"}
    write_results(paths["results"], results)
    _write_runs(paths["runs"], hall)
    write_strips(folder / "strips", strips)
    write_plots(folder, drawn)
    write_page(
        paths["page"],
        "laser_vision_learning/page.html.j2",
        command,
        drawn,
        rows=rows_of([each for each in results if each.where == PLACE]),
        tables=[_grid(results, TABLE_ONE), _grid(results, TABLE_TWO)],
        beyond={where: grid for where in (CHANGED, DENSITY, ABLATION, CHOICE) if (grid := _grid(results, where))},
        busy=_facts(conditions["busy"]),
        hall=_facts(conditions["hall"]),
        fits=_fits(hall),
        merges=merges_of(hall.busy)[:1],
        strips=[(each, "data:image/jpeg;base64," + base64.b64encode(each.picture).decode()) for each in strips],
        not_done=hall.not_done,
        n_decided=chosen[0].runs if chosen else 0,
        choice_seed=SEED,
    )
    return results, paths


def _facts(condition: Condition) -> dict[str, object]:
    place = condition.place
    return {
        "runs": len(condition.seeds),
        "seeds": f"{condition.seeds[0]} to {condition.seeds[-1]}",
        "frames": int(place.frames.sum()),
        "merges": int(place.merges.sum()),
    }


def _fits(hall: HallRuns) -> list[tuple[str, str]]:
    """By system, the line through the time per frame of all runs, in words."""
    every = [each for each in hall.conditions.values() if each is not hall.ablation]
    told = []
    for tracker in hall.conditions["hall"].trackers:
        fit = cost_fit(every, tracker)
        if fit is not None:
            base, a_person, a_close, explained = fit
            text = f"{base:.2f} ms {a_person:+.3f} ms a person {a_close:+.3f} ms a person who interacts"
            text = text.replace("+", "+ ").replace("-", "− ")
            told.append((SYSTEMS.get(tracker, tracker), f"{text}; explains {100 * explained:.0f} % of the variance"))
    return told


def _grid(results: Sequence[Result], where: str) -> dict[str, object] | None:
    """Results of one kind as a table: a row a figure of a condition, a column a tracker; of the many ablations turned."""
    own = [replace(each, row=each.row.removeprefix("ablation, ")) for each in results if each.where == where]
    if not own:
        return None
    found = {
        (result.row, result.column): (ours, spread, "" if result.paper is None else paper)
        for result, paper, ours, spread in rows_of(own)
    }
    rows, columns = (list(dict.fromkeys(names)) for names in zip(*found, strict=True))
    if where == ABLATION:
        return {"columns": rows, "rows": [(each, [found.get((row, each)) for row in rows]) for each in columns]}
    return {"columns": columns, "rows": [(row, [found.get((row, column)) for column in columns]) for row in rows]}


def _write_runs(path: Path, hall: HallRuns) -> None:
    """Write every run as a row: condition, seed, tracker, and its figures."""
    figures = (
        "accuracy", "failures.person_frames", "failures.missed", "failures.false_location", "failures.identity_wrong",
        "disposal.correlated.total", "disposal.correlated.disposed", "disposal.merge_split.total",
        "disposal.merge_split.disposed", "mota", "idf1", "hota", "ms_per_frame.mean", "ms_per_frame.p95",
    )  # fmt: skip
    with open_atomic(path) as stream:
        rows = csv.writer(stream, lineterminator="\n")
        rows.writerow(("condition", "seed", "tracker", *figures))
        for condition in hall.conditions.values():
            for tracker in condition.trackers:
                for place, seed in enumerate(condition.seeds):
                    own = (f"{condition.figures[tracker][name][place]:g}" for name in figures)
                    rows.writerow((condition.name, seed, tracker, *own))
