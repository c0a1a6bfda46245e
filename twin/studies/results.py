"""Results of a study as tables, as a summary for programs, and on the terminal."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from trackers.errors import InputError
from trackers.user_input.plain_data import parse_json
from trackers.user_input.text_file import read_text
from twin.console import PlainConsole, print_table, print_warning
from twin.messages import counted
from twin.recording.atomic_file import write_csv
from twin.scenario import Scenario
from twin.studies.apply_placement import apply_placement
from twin.studies.candidate_set import BASELINE, Placement
from twin.studies.coverage import PoseCoverage
from twin.studies.devices import format_price
from twin.studies.preflight import PreparedStudy
from twin.studies.search import Result, n_placements
from twin.studies.set_cover import Cover
from twin.studies.spec import Objective
from twin.studies.trials import Trial, losses, placement_id
from twin.studies.validation import CheaperPlacement, PairedDifference, nearly_as_good
from twin.studies.visibility import (
    FloorResolution,
    SensorVisibility,
    floor_resolution,
    looking_sensors,
    saturation_hint,
    visited_cells,
)
from twin.suites.cache import RecordingCache
from twin.suites.metrics import FEWEST

_FLOOR_CELLS = 4000


@dataclass(frozen=True, eq=False)
class StudyResults:
    """Results of a study, with all that its page shows."""

    prepared: PreparedStudy
    coverage: PoseCoverage
    result: Result
    baseline: Trial
    best: Trial
    front: tuple[Trial, ...]
    indistinguishable: tuple[tuple[Trial, PairedDifference], ...]
    held_out: tuple[PairedDifference, ...]
    one_fewer: tuple[tuple[Placement, float], ...]
    displaced: tuple[PairedDifference, ...]
    rank_correlations: tuple[tuple[str, float, int], ...]
    n_evaluated: int
    spent_s: float
    cache: RecordingCache
    warnings: tuple[str, ...] = ()
    """Warnings of the scenarios with their own and the recommended placement, each kind once."""

    @property
    def objective(self) -> Objective:
        """The first objective."""
        return self.prepared.study.objectives[0]

    @property
    def whole(self) -> list[Trial]:
        """The trials that were evaluated on all seeds, without the baseline."""
        n_seed = self.prepared.study.search.replicates[-1] if self.prepared.study.validated else 0
        trials = [each for each in self.result.trials.values() if not each.failure and each is not self.baseline]
        return [each for each in trials if len(each.seeds) >= n_seed]

    @cached_property
    def cheaper(self) -> CheaperPlacement | None:
        """The cheapest trial, or the baseline, nearly as good as the recommended one; None where it is the recommended one."""
        return nearly_as_good(self.prepared.study, self.best, [self.baseline, *self.whole])

    @property
    def best_of_each_count(self) -> tuple[Trial, ...]:
        """The best trial by the first objective of every number of devices that was evaluated whole."""
        study, candidate_set = self.prepared.study, self.prepared.candidate_set
        whole = self.whole
        best: dict[tuple[str, ...], Trial] = {}
        for number in np.argsort(losses(whole, study.objectives, study.scenarios)[:, 0], kind="stable"):
            devices = (candidate_set.poses[each].device for each in whole[number].placement)
            best.setdefault(tuple(sorted(devices)), whole[number])
        return tuple(sorted(best.values(), key=lambda each: each.price))

    @property
    def searched(self) -> str:
        """The number of placements from which the search chose, and its method, in words."""
        study, poses = self.prepared.study, self.prepared.candidate_set.poses
        n_tried = sum(not each.failure for each in self.result.trials.values()) - 1
        how = {
            "exact": "searched exactly by coverage",
            "greedy": "searched greedily by coverage",
            "exhaustive": f"{n_tried} tried, all that keep the constraints",
            "optuna": f"{n_tried} tried",
        }
        ways = counted(n_placements(study, self.prepared.candidate_set), "placement")
        return f"{ways} of {counted(len(poses), 'pose')}, {how[study.search.method]}"

    @cached_property
    def floor(self) -> FloorResolution:
        """The resolution of the recommended placement over the floor of the empty room."""
        scenario, sampled = self.scenario_with(self.best.placement), self.coverage.targets.sampled_worlds[0]
        asked = self.prepared.study.coverage
        looking = {name: SensorVisibility(scenario, name, asked) for name in looking_sensors(scenario)}
        return floor_resolution(scenario, looking, sampled.empty(), self.prepared.scene.area, asked, _FLOOR_CELLS)

    @property
    def area_warning(self) -> str:
        """A warning where no sensor sees an unvisited part of the area; "" otherwise or for cells of the floor."""
        if self.prepared.study.coverage.of != "people":
            return ""
        targets = self.coverage.targets
        visited = visited_cells(targets.sampled_worlds, self.floor.cells)
        return self.floor.unvisited_warning(visited, targets.n)

    @property
    def saturation(self) -> str:
        """A hint where the recommended placement covers all, by which coverage tells it from no other that does; "" otherwise."""
        covers = any(each.kind == "coverage" for each in self.prepared.study.objectives)
        is_all = covers and self.best.coverage is not None and self.best.coverage >= 1
        return saturation_hint(self.prepared.study.coverage, self.coverage.targets.n) if is_all else ""

    def scenario_with(self, placement: Placement) -> Scenario:
        """Return the study's first scenario with a placement applied."""
        poses = [self.prepared.candidate_set.poses[each] for each in placement]
        return apply_placement(self.prepared.study, self.prepared.scenario, poses)


def summarize(results: StudyResults) -> dict[str, Any]:
    """Return the content of summary.json."""
    study, objective = results.prepared.study, results.objective

    def row(trial: Trial) -> dict[str, Any]:
        return {
            "candidate": placement_id(trial.placement),
            "places": describe_placement(results, trial.placement),
            "price": trial.price,
            **({"seeds": len(trial.seeds)} if results.prepared.trackers else {}),
            **{
                each.column: number(trial.value(each, study.scenarios))
                for each in study.objectives
                if not trial.failure
            },
            "coverage": trial.coverage,
            **({"rejected": trial.failure} if trial.failure else {}),
        }

    return {
        "study": study.name,
        "objective": objective.column,
        "searched": results.searched,
        "baseline": row(results.baseline),
        "best": row(results.best),
        **({"nearly_as_good": _cheaper_row(results, row)} if results.cheaper else {}),
        "pareto": [row(each) for each in results.front],
        "best_of_each_count": [row(each) for each in results.best_of_each_count],
        "indistinguishable": [placement_id(each.placement) for each, _ in results.indistinguishable],
        "held_out": [_plain(each) for each in results.held_out],
        "one_fewer": [{"candidate": placement_id(each), objective.column: value} for each, value in results.one_fewer],
        "displaced": [_plain(each) for each in results.displaced],
        "rank_correlations": [
            {"what": what, "rank_correlation": number(rho), "candidates": n} for what, rho, n in results.rank_correlations
        ],
        "proven": [
            {"devices": count, "greedy": _covered(first), "greedy_bound": first.bound, **_proof(first, best)}
            for count, first, best in results.result.proven
        ],
        "warnings": list(results.warnings),
        **({"area_warning": results.area_warning} if results.area_warning else {}),
        **({"saturation": results.saturation} if results.saturation else {}),
        "rejected": results.prepared.candidate_set.rejected,
        "candidates": len(results.result.trials),
        **({"evaluated_in_this_run": results.n_evaluated} if results.prepared.trackers else {}),
        "seconds_of_this_run": round(results.spent_s, 1),
    }  # fmt: skip


def _cheaper_row(results: StudyResults, row: Callable[[Trial], dict[str, Any]]) -> dict[str, Any]:
    found = results.cheaper
    assert found is not None
    said = found.sentence(results.objective, found.trial.value(results.objective, results.prepared.study.scenarios))
    return {**row(found.trial), "sentence": said, "worse_by": found.worse, "cheapest_within": found.within}


def _proof(first: Cover, best: Cover | None) -> dict[str, Any]:
    if best is None:
        return {}
    share = None if not first.complete else first.value / best.value if best.value else 1.0
    return {"exact": _covered(best), "exact_is": best.summary(), "greedy_over_exact": share}


def _covered(cover: Cover) -> float | None:
    """Return the coverage of a set of as many poses as are wanted; None of fewer."""
    return cover.value if cover.complete else None


def _plain(row: Any) -> dict[str, Any]:
    return {key: number(each) if isinstance(each, float) else each for key, each in asdict(row).items()}


def number(value: float | None) -> float | None:
    """Return a number for JSON: None for NaN and infinity."""
    return None if value is None or not np.isfinite(value) else float(value)


def describe_placement(results: StudyResults, placement: Placement) -> str:
    """Describe a placement in one line."""
    candidate_set, study = results.prepared.candidate_set, results.prepared.study
    if placement == BASELINE:
        return "baseline"
    parts = []
    for each in placement:
        pose = candidate_set.poses[each]
        kind = study.devices[pose.device].kinds[pose.kind].name
        for mount in pose.mounts:
            x, y, z = mount.xyz
            tilt = f" tilt {mount.pitch_deg:g}°" if mount.pitch_deg else ""
            parts.append(
                f"{pose.device}{'' if kind == 'as-is' else ' ' + kind} ({x:g} {y:g} {z:g}) yaw {mount.yaw_deg:g}°{tilt}"
            )
    return "; ".join(parts)


def write_table(path: Path, trials: Sequence[Trial], results: StudyResults) -> None:
    """Write one row per trial: placement, price, coverage, mean and standard error of each metric, seeds, rejection."""
    study = results.prepared.study
    names = sorted(
        {
            (tracker, metric)
            for each in trials
            for row in each.metrics.values()
            for tracker in row
            for metric in row[tracker]
        }
    )
    names = [each for each in names if not each[1].startswith("ms_per_frame")]
    columns = ["candidate", "places", "price", "coverage", "coverage_worst", "replicates", "rejected"]
    headings = [f"{tracker}: {metric}" for tracker, metric in names]
    wanted = [each.column for each in study.objectives if each.kind == "metric" and each.column not in headings]
    rows = [[*columns, *wanted, *(text for each in headings for text in (each, f"{each} (standard error)"))]]
    for trial in trials:
        place = placement_id(trial.placement), describe_placement(results, trial.placement)
        row = [*place, f"{trial.price:g}"]
        row += ["" if each is None else f"{each:.6f}" for each in (trial.coverage, trial.coverage_worst)]
        row += [str(len(trial.seeds)) if results.prepared.trackers else "", trial.failure]
        for each in study.objectives:
            if each.column in wanted:
                row.append("" if trial.failure or not trial.seeds else f"{trial.value(each, study.scenarios):.6f}")
        for tracker, metric in names:
            values = [each[tracker][metric] for each in trial.metrics.values() if tracker in each]
            known = np.array([each for each in values if each is not None], dtype=float)
            error = known.std(ddof=1) / np.sqrt(len(known)) if len(known) > 1 else np.nan
            row += [f"{known.mean():.6f}" if len(known) else "", f"{error:.6f}" if np.isfinite(error) else ""]
        rows.append(row)
    write_csv(path, rows)


_FORMER_KEYS = {
    "own": "baseline",
    "alike": "indistinguishable",
    "misplaced": "displaced",
    "moved_by": "rank_correlations",
    "refused": "rejected",
}
"""Present key of each field that a summary named otherwise before 0.2."""
_EXPECTED = "a folder that `twin study run` has finished"


def print_summary(folder: Path) -> None:
    """Print the summary of a study; raises InputError for a folder without one."""
    path = folder / "summary.json"
    content = parse_json(read_text(path, _EXPECTED), str(path), _EXPECTED)
    console = PlainConsole()
    try:
        _print(console, {_FORMER_KEYS.get(str(key), str(key)): value for key, value in content.items()})
    except (AttributeError, KeyError, TypeError) as error:
        raise InputError(f"{path}: lacks {error}; {_EXPECTED} is expected") from error


def _print(console: Console, found: dict[str, Any]) -> None:
    objective = found["objective"]
    covers = objective == "coverage"
    rows_of = found["baseline"], found["best"], *found["pareto"], *found.get("best_of_each_count", ())
    shown = {each["candidate"]: each for each in rows_of}
    tracks = any(each.get("seeds") for each in shown.values())
    heads = ["placement", objective, *([] if covers else ["coverage"]), "price", *(["seeds"] if tracks else [])]
    rows: list[list[str]] = []
    for each in shown.values():
        mark = "recommended: " if each["candidate"] == found["best"]["candidate"] else ""
        values = [
            _text(each.get(objective)),
            *([] if covers else [_text(each["coverage"])]),
            format_price(each["price"]),
        ]
        rows.append([mark + each["places"], *values, *([str(each["seeds"])] if tracks else [])])
    searched = found.get("searched") or f"{found['candidates'] - 1} placements beside the baseline"
    print_table(heads, rows, title=f"{found['study']}: {searched}")
    if near := found.get("nearly_as_good"):
        console.print(
            f"nearly as good: {near['sentence']}: {near['places']}; cheapest_within: {near['cheapest_within']:g} recommends it"
        )
    for row in found["held_out"]:
        console.print(f"held out, {row['what']}: {_text(row['other'])} -> {_text(row['ours'])}, {_interval(row)}")
    for row in found["proven"]:
        devices = ", ".join(f"{count} {name}" for name, count in row["devices"].items())
        found_by = (
            f"{_text(row['exact'])} by exact search ({row['exact_is']}), {_text(row['greedy'])} by greedy search"
            if "exact" in row
            else f"{_text(row['greedy'])} by greedy search, no placement has more than {_text(row['greedy_bound'])}"
        )
        console.print(f"coverage of {devices}: {found_by}")
    for row in found["displaced"]:
        console.print(f"displaced by {row['what']}: {_interval(row)}")
    for name in ("area_warning", "saturation"):
        if warning := found.get(name):
            print_warning(warning)
    if found["indistinguishable"]:
        few = "" if found["best"].get("seeds", 0) >= FEWEST else f": fewer than {FEWEST} seeds give no interval"
        console.print(f"placements not distinguishable from the best: {len(found['indistinguishable'])}{few}")


def _text(value: float | None) -> str:
    return "–" if value is None else f"{value:.4f}"


def _interval(row: dict[str, Any]) -> str:
    found = row["difference"]
    if found is None:
        return "no difference could be worked out"
    interval = "" if found["low"] is None else f" [{found['low']:+.4f}, {found['high']:+.4f}]"
    return f"{found['mean']:+.4f}{interval} over {found['n']} seeds"
