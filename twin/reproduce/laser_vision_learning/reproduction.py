"""Reproduction of Song et al. for `twin reproduce laser-vision-learning`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from trackers.observations import NS_PER_S
from twin.evaluate.accuracy import AFTER_S
from twin.messages import OnProgress, no_progress
from twin.recording.atomic_file import write_csv
from twin.report.palette import data_uri
from twin.reproduce.laser_vision_learning.plots import densities_svg, figure11_svg
from twin.reproduce.laser_vision_learning.results import (
    ABLATION,
    CHANGED,
    DENSITY,
    PLACE,
    TABLE_GROUPS,
    TABLE_ONE,
    TABLE_TWO,
    cost_fit,
    hall_results,
)
from twin.reproduce.laser_vision_learning.runs import (
    FUSED,
    SYSTEMS,
    HallCondition,
    HallRun,
    HallRuns,
    check_suite,
    read_hall,
)
from twin.reproduce.laser_vision_learning.splits import CHOICE, SEED, compare_choices
from twin.reproduce.registry import Outputs, Request
from twin.reproduce.results import ResultRow, format_rows, rows_of, write_reproduction
from twin.reproduce.suite_runs import (
    CaseIncident,
    FilmStrip,
    draw_film_strips,
    load_seeded_suite,
    run_conditions,
    write_film_strips,
)
from twin.suites.cluster import Workers
from twin.suites.worker import Incident, resolved_scenario


def reproduce(folder: Path, request: Request, on_progress: OnProgress = no_progress) -> Outputs:
    """Run the suite and write results, plots, film strips and page into `folder`.

    Raises InputError for an invalid suite, for a folder with another reproduction's runs (or the same one's, without
    `resume`), for conditions with fewer than two complete runs, and where a file cannot be written.
    """
    suite, path = load_seeded_suite(request)
    check_suite(suite, path)
    runs = run_conditions(folder, suite, path, request, on_progress)
    hall = read_hall(runs)
    names = {name: SYSTEMS.get(name, name) for name in hall.busy.cases}
    incidents = merge_incidents(hall.busy, rank_merges(hall.busy))
    strips = draw_film_strips(incidents, names, runs.cache, Workers(request.jobs), on_progress)
    pictures = any(
        sensor.kind == "camera" for sensor in resolved_scenario(next(iter(hall.busy.cases.values()))).sensors.values()
    )
    chosen = compare_choices(runs.cache, on_progress) if pictures else []
    return write_all(folder, hall, strips, chosen, request.command)


def write_all(
    folder: Path, hall: HallRuns, strips: Sequence[FilmStrip], chosen: Sequence[ResultRow], command: str
) -> Outputs:
    """Write results, table of runs, plots, film strips and page. Raises InputError where a file cannot be written."""
    results = [*hall_results(hall), *chosen]
    conditions = hall.conditions
    drawn = {"figure11": figure11_svg(hall.hall, conditions["hall"])}
    if hall.densities:
        drawn["densities"] = densities_svg([conditions["busy"], *hall.densities])
    paths = {"runs": folder / "runs.csv"}
    _write_runs(paths["runs"], hall)
    write_film_strips(folder / "strips", strips)
    paths |= write_reproduction(
        folder,
        command,
        "laser_vision_learning/page.html.j2",
        results,
        drawn,
        rows=format_rows(rows_of(results, PLACE)),
        groups=format_rows(rows_of(results, TABLE_GROUPS)),
        tables=[_grid(results, TABLE_ONE), _grid(results, TABLE_TWO)],
        beyond={where: grid for where in (CHANGED, DENSITY, ABLATION, CHOICE) if (grid := _grid(results, where))},
        busy=_facts(conditions["busy"]),
        hall=_facts(conditions["hall"]),
        fits=_fits(hall),
        merges=rank_merges(hall.busy)[:1],
        strips=[(each, data_uri(each.picture)) for each in strips],
        not_done=hall.not_done,
        n_decided=chosen[0].runs if chosen else 0,
        choice_seed=SEED,
    )
    return results, paths


def _facts(condition: HallCondition) -> dict[str, object]:
    place = condition.place
    return {
        "runs": len(condition.seeds),
        "seeds": f"{condition.seeds[0]} to {condition.seeds[-1]}",
        "frames": int(place.frames.sum()),
        "merges": int(place.merges.sum()),
    }


def _fits(hall: HallRuns) -> list[tuple[str, str]]:
    """Describe the linear fit of the time per frame over all runs, by system."""
    every = [each for each in hall.conditions.values() if each is not hall.ablation]
    texts = []
    for tracker in hall.conditions["hall"].trackers:
        fit = cost_fit(every, tracker)
        if fit is not None:
            base, a_person, a_close, explained = fit
            text = f"{base:.2f} ms {a_person:+.3f} ms a person {a_close:+.3f} ms a person who interacts"
            text = text.replace("+", "+ ").replace("-", "− ")
            texts.append((SYSTEMS.get(tracker, tracker), f"{text}; explains {100 * explained:.0f} % of the variance"))
    return texts


def _grid(results: Sequence[ResultRow], where: str) -> dict[str, object] | None:
    """Pivot results of one kind: one row per metric of a condition, one column per tracker; ablations are transposed."""
    own = [replace(each, row=each.row.removeprefix("ablation, ")) for each in rows_of(results, where)]
    if not own:
        return None
    found = {
        (result.row, result.column): (ours, spread, "" if result.paper is None else paper)
        for result, paper, ours, spread in format_rows(own)
    }
    rows, columns = (list(dict.fromkeys(names)) for names in zip(*found, strict=True))
    if where == ABLATION:
        return {"columns": rows, "rows": [(each, [found.get((row, each)) for row in rows]) for each in columns]}
    return {"columns": columns, "rows": [(row, [found.get((row, column)) for column in columns]) for row in rows]}


def _write_runs(path: Path, hall: HallRuns) -> None:
    """Write every run as a row: condition, seed, tracker, and its metrics."""
    metrics = (
        "accuracy", "failures.person_frames", "failures.missed", "failures.false_location", "failures.identity_wrong",
        "disposal.correlated.total", "disposal.correlated.disposed", "disposal.merge_split.total",
        "disposal.merge_split.disposed", "mota", "idf1", "hota", "ms_per_frame.mean", "ms_per_frame.p95",
    )  # fmt: skip
    rows: list[tuple[object, ...]] = [("condition", "seed", "tracker", *metrics)]
    for condition in hall.conditions.values():
        for tracker in condition.trackers:
            for place, seed in enumerate(condition.seeds):
                own = (f"{condition.metrics[tracker][name][place]:g}" for name in metrics)
                rows.append((condition.name, seed, tracker, *own))
    write_csv(path, rows)


MOST_DRAWN = 4
_LEAST_S = 0.5


@dataclass(frozen=True)
class Merge:
    """Merge seen by the rig: its two people, and the systems that disposed of it."""

    start_s: float
    end_s: float
    people: tuple[str, str]
    disposed: tuple[str, ...]

    @property
    def description(self) -> str:
        """People, start and end in words."""
        return f"{self.people[0]} and {self.people[1]}, merged from {self.start_s:.1f} to {self.end_s:.1f} s"


def rank_merges(run: HallRun) -> list[Merge]:
    """Rank the merges of a run that last half a second and are judged for every system.

    First those that the fused system disposes of and most others do not, then the longest.
    """
    table = run.situations.select("merged_rig")
    found = []
    for row in range(len(table)):
        start_ns, end_ns = int(table.start_ns[row]), int(table.end_ns[row])
        pair = int(table.first_id[row]), int(table.second_id[row])
        if not table.complete[row] or end_ns - start_ns < _LEAST_S * NS_PER_S:
            continue
        verdicts = {name: _right(run, name, pair, start_ns, end_ns) for name in run.evaluations}
        if None in verdicts.values():
            continue
        names = run.names[pair[0]], run.names[pair[1]]
        kept = tuple(name for name, right in verdicts.items() if right)
        found.append(Merge(start_ns / NS_PER_S, end_ns / NS_PER_S, names, kept))
    return sorted(found, key=lambda each: (FUSED not in each.disposed, len(each.disposed), each.start_s - each.end_s))


def merge_incidents(run: HallRun, merges: list[Merge]) -> list[CaseIncident]:
    """Convert merges to incidents at their middles: the first for every system, the next ones for the first system."""
    incidents = []
    for number, merge in enumerate(merges[:MOST_DRAWN]):
        for name, case in run.cases.items():
            if number == 0 or name == next(iter(run.cases)):
                verdict = "disposed of" if name in merge.disposed else "not disposed of"
                what = f"{merge.description}: {verdict}"
                incidents.append(
                    CaseIncident(case, Incident((merge.start_s + merge.end_s) / 2, "merge", what, float(number)))
                )
    return incidents


def _right(run: HallRun, name: str, pair: tuple[int, int], start_ns: int, end_ns: int) -> bool | None:
    """Return whether a system disposed of a merge; None if it was not judged."""
    people, stamps_ns = run.evaluations[name].people, run.evaluations[name].stamps_ns
    late_ns = end_ns + round(AFTER_S * NS_PER_S)
    if not np.isin(pair, people.person_ids).all() or late_ns > stamps_ns[-1]:
        return None
    rows = np.searchsorted(people.person_ids, pair)
    window = (stamps_ns >= start_ns) & (stamps_ns < late_ns) & people.judged[rows].all(axis=0)
    if not (window & (stamps_ns < end_ns)).any():
        return None
    return bool(people.right[rows][:, window].all())
