"""Page of a study for buyers and installers: one HTML file, printable on A4."""

from __future__ import annotations

import re
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from trackers.arrays import Array
from twin.messages import counted
from twin.models import MODELS
from twin.recording.atomic_file import write_atomic
from twin.report.metrics_table import format_number
from twin.report.palette import data_uri, page_template
from twin.scenario import Scenario
from twin.studies.candidate_set import BASELINE
from twin.studies.devices import format_price
from twin.studies.interactive_plan import plan_data, section
from twin.studies.mounting_plan import floor_plan, parts_list
from twin.studies.plots import PlanSensor, heat_map, pareto_plot, plan_sensors, trial_map
from twin.studies.results import StudyResults, describe_placement
from twin.studies.spec import Objective
from twin.studies.trials import Trial
from twin.studies.validation import format_value, moved_sensors
from twin.studies.visibility import cell_size_m, looking_sensors
from twin.studies.worker import EvaluationTask, matched_errors
from twin.suites.cache_keys import whole_code
from twin.suites.metrics import FEWEST

study_template = partial(page_template, "twin.studies", "twin.reproduce")
"""Load a template of study pages, on the base that pages of results share."""
_PLAN_CELLS = 10_000
_MOST_ERROR_SEEDS = 3
_ERROR_CELL_M = 0.5
_FEWEST = 3
_MOST_ROWS = 30
_RACE_CAPTION = (
    "Bars: standard errors over seeds. Candidates with fewer seeds were dropped early, in a race on the same seeds."
)


def write_page(path: Path, results: StudyResults) -> None:
    """Write the page; it takes its name when complete. Raises InputError where it cannot be written."""
    prepared, study, candidate_set = results.prepared, results.prepared.study, results.prepared.candidate_set
    scenario, area = results.scenario_with(results.best.placement), prepared.scene.area
    sensors = plan_sensors(scenario, moved_sensors(study, prepared.scenario, scenario), candidate_set.building)
    devices_m = [np.array(each.xyz) for pose in results.best.placement for each in candidate_set.poses[pose].mounts]
    drawn, scale, width_mm = floor_plan(
        scenario,
        prepared.scenario,
        sensors,
        candidate_set.building,
        area,
        study.constraints,
        devices_m,
        candidate_set.zones,
    )
    objective = results.objective
    content: dict[str, Any] = {
        "study": study,
        "results": results,
        "scenario": scenario,
        "sensors": sensors,
        "drawn_plan": data_uri(drawn),
        "scale": scale,
        "width_mm": round(width_mm, 1),
        "parts": parts_list(results),
        "best": _trial_row(results, results.best),
        "cheaper": _cheaper(results),
        "of": _counted(results),
        "floor_seen": f"{100 * float((results.floor.n_seeing >= study.coverage.at_least).mean()):.1f} %",
        "baseline": _trial_row(results, results.baseline),
        "front": [_trial_row(results, each) for each in results.front],
        "indistinguishable": [
            (_trial_row(results, each), row.text) for each, row in results.indistinguishable[:_MOST_ROWS]
        ],
        "n_indistinguishable": len(results.indistinguishable),
        "has_intervals": len(results.best.seeds) >= FEWEST,
        "fewest_seeds": FEWEST,
        "maps": _maps(results, scenario, sensors),
        "coverage_warnings": [each for each in (results.area_warning, results.saturation) if each],
        "trial_map": _trial_map(results, sensors),
        "objective": objective,
        "validated": study.validated,
        "fewer": [
            (
                _left_out(results, placement),
                f"{value:.4f}",
                format_number(value - _value(results, results.best), 4, sign=True),
            )
            for placement, value in results.one_fewer
        ],
        "folder": path.parent,
        "command": prepared.path.stem if prepared.path.parent == MODELS / "studies" else prepared.path,
        "rejected": _rejections(results),
        "seeds": len(study.held_out.seeds) if study.held_out else 0,
        **section(_plan(results, scenario, path.parent)),
    }
    write_atomic(path, study_template("page.html.j2").render(**content))


def _cheaper(results: StudyResults) -> tuple[str, str, float] | None:
    """Return the sentence on the cheaper placement, the placement, and the `cheapest_within` that recommends it."""
    if (found := results.cheaper) is None:
        return None
    said = found.sentence(results.objective, _value(results, found.trial))
    return said, describe_placement(results, found.trial.placement), found.within


def _value(results: StudyResults, trial: Trial) -> float:
    return trial.value(results.objective, results.prepared.study.scenarios)


def _value_text(objective: Objective, value: float) -> str:
    name = f"{objective.column} " * (objective.kind == "coverage")
    return name + format_value(objective, value)


def _trial_row(results: StudyResults, trial: Trial) -> dict[str, str]:
    study = results.prepared.study
    metrics = "–" if trial.failure and trial.placement != BASELINE else " · ".join(
        _value_text(each, trial.value(each, study.scenarios))
        for each in study.objectives
        if each.kind != "price" and (trial.seeds or each.kind != "metric")
    )  # fmt: skip
    return {
        "places": describe_placement(results, trial.placement),
        "price": format_price(trial.price),
        "coverage": "–" if trial.coverage is None else f"{100 * trial.coverage:.1f} %",
        "metrics": metrics,
        "seeds": str(len(trial.seeds)),
        "why": trial.failure,
    }


def _counted(results: StudyResults) -> str:
    """Say of what coverage is a share."""
    asked, targets = results.prepared.study.coverage, results.coverage.targets
    if asked.of == "people":
        return f"{targets.n} person-frames"
    n = asked.samples * len(targets.sampled_worlds)
    return (
        f"cells of the floor, people in the way in {counted(n, 'sample')}" if n else "cells of the empty room's floor"
    )


def _rejections(results: StudyResults) -> list[str]:
    """Tell for each device how many poses were considered, how many rejected, by each reason, and how many left."""
    candidate_set, sentences = results.prepared.candidate_set, []
    for name, reasons in candidate_set.rejected.items():
        n_considered, n_rejected = candidate_set.n_considered[name], sum(reasons.values())
        why = f" ({', '.join(f'{count} {reason}' for reason, count in reasons.items())})" if reasons else ""
        sentences.append(
            f"{name}: {counted(n_considered, 'pose')}, {n_rejected} rejected{why}, {n_considered - n_rejected} left"
        )
    return sentences


def _left_out(results: StudyResults, placement: tuple[int, ...]) -> str:
    removed = next(each for each in results.best.placement if each not in placement)
    x, y, z = results.prepared.candidate_set.poses[removed].mounts[0].xyz
    return f"{results.prepared.candidate_set.poses[removed].device} at ({x:g}, {y:g}, {z:g})"


def _plan(results: StudyResults, scenario: Scenario, folder: Path) -> dict[str, Any]:
    """Return the data of the interactive plan, starting from the recommended placement."""
    prepared = results.prepared
    area, building = prepared.scene.area, prepared.candidate_set.building
    names, cell_m = looking_sensors(scenario), cell_size_m(area, _PLAN_CELLS)
    prices, firsts = _prices(results, scenario)
    study = prepared.study
    return plan_data(
        scenario, names, building, area, study.coverage, cell_m, extends="recommended.yaml", folder=folder, prices=prices,
        firsts=firsts, constraints=study.constraints, zones=prepared.candidate_set.zones,
    )  # fmt: skip


def _prices(results: StudyResults, scenario: Scenario) -> tuple[dict[str, float | None], dict[str, str]]:
    """Return the price of each device by the name of its first sensor, None if all are free, and the first of every other."""
    candidate_set, prices, firsts = results.prepared.candidate_set, dict[str, float | None](), dict[str, str]()
    for device_name, device in results.prepared.study.devices.items():
        if device.sensors:
            named = re.compile(rf"{re.escape(device_name)}(-\d+)?")
            mine = [each for each in scenario.sensors if each in device.sensors or named.fullmatch(each)]
            prices |= {each: candidate_set.device_price(device, scenario.sensors[each]) for each in mine}
            continue
        own = device.sensors_in(results.prepared.scenario)
        named = re.compile(rf"{re.escape(own[0])}(-{re.escape(device_name)}-\d+)?")
        price = candidate_set.device_price(device, None)
        for found in filter(None, map(named.fullmatch, scenario.sensors)):
            prices[found[0]] = price
            firsts |= {f"{each}{found[1] or ''}": found[0] for each in own}
    return prices if any(prices.values()) else dict.fromkeys(prices), firsts


def _maps(results: StudyResults, scenario: Scenario, sensors: list[PlanSensor]) -> list[Any]:
    """Draw beams on a body, pixels per metre, and the mean error by place; return captions and pictures."""
    building, area, found = results.prepared.candidate_set.building, results.prepared.scene.area, []
    floor = results.floor
    for scanners, _, sharp, least in floor.best_of_kind(scenario):
        what = (
            "Beams that meet a body, of the best scanner for each place"
            if scanners
            else "Pixels per metre at the greatest of the heights looked for, of the best camera"
        )
        label = "beams on a body" if scanners else "px/m"
        blind = 100 * float((sharp < least).mean())
        caption = f"{what}, empty room; red: fewer than {least:g}, {blind:.1f} % of the area."
        svg = heat_map(floor.cells, sharp, floor.cell_m, sensors, building, area, label=label, least=least)
        found.append((caption, svg))
    return [(caption, data_uri(svg)) for caption, svg in [*found, *_error_map(results, scenario, sensors)]]


def _error_map(results: StudyResults, scenario: Scenario, sensors: list[PlanSensor]) -> list[tuple[str, str]]:
    """Draw the mean distance of tracks from people by place, with caption, for the validated tracker if there is one.

    None where too few tracks are near people anywhere.
    """
    prepared, study = results.prepared, results.prepared.study
    tracker, area = study.validated[0].tracker if study.validated else None, prepared.scene.area
    if tracker is None:
        return []
    seeds = (study.held_out.seeds if study.held_out is not None else study.seeds)[:_MOST_ERROR_SEEDS]
    code = whole_code()
    work = [
        EvaluationTask(
            scenario.model_copy(update={"seed": seed, "trackers": {}}), prepared.trackers, results.cache, code
        )
        for seed in seeds
    ]
    rows = np.concatenate([matched_errors(each, tracker) for each in work])
    low = area.min(axis=0)
    cell = np.floor((rows[:, :2] - low) / _ERROR_CELL_M).astype(int)
    places, group, count = np.unique(cell, axis=0, return_inverse=True, return_counts=True)
    mean = np.bincount(group.ravel(), rows[:, 2]) / count
    often = count >= _FEWEST
    if not often.any():
        return []
    caption = f"Mean distance of {tracker}'s tracks from people, by place, over {len(seeds)} seeds."
    middles = low + (places[often] + 0.5) * _ERROR_CELL_M
    most = float(np.quantile(mean[often], 0.98))
    building = prepared.candidate_set.building
    return [(caption, heat_map(middles, mean[often], _ERROR_CELL_M, sensors, building, area, label="m", most=most))]


def _trial_map(results: StudyResults, sensors: list[PlanSensor]) -> tuple[str, str] | None:
    """Draw all trials, caption first: the first objective over the second or the price, or by place where prices are equal.

    None with too few trials.
    """
    study, candidate_set = results.prepared.study, results.prepared.candidate_set
    trials = [
        each
        for each in results.result.trials.values()
        if (not each.failure or each is results.baseline) and (each.seeds or results.objective.kind != "metric")
    ]
    if len(trials) < 3:
        return None
    first = np.array([_value(results, each) for each in trials])
    others = study.objectives[1:]
    across = np.array([each.value(others[0], study.scenarios) if others else each.price for each in trials])
    if np.ptp(across) == 0:
        order = np.argsort(first if results.objective.more_is_better else -first)
        places = [candidate_set.positions[number][:1, :2] for each in order for number in trials[each].placement]
        values = [first[each] for each in order for _ in trials[each].placement]
        drawn = trial_map(
            np.concatenate(places), np.array(values), _baseline_places(results), sensors, candidate_set.building,
            results.prepared.scene.area, results.objective.column,
        )  # fmt: skip
        text = "Devices of every candidate, by its worth; circled: recommended; crosses: the baseline."
        return text, data_uri(drawn)
    svg = pareto_plot(
        np.column_stack([across, first]),
        np.array([each in results.front for each in trials]),
        trials.index(results.baseline),
        trials.index(results.best),
        (others[0].column if others else "price", results.objective.column),
        np.array([_standard_error(results, each) for each in trials]),
    )
    is_cover = study.search.method in ("exact", "greedy")
    caption = "The baseline, and the best found of each number of devices." if is_cover else "Every placement tried."
    return _RACE_CAPTION if study.validated else caption, data_uri(svg)


def _baseline_places(results: StudyResults) -> Array:
    """Return the positions of the devices that the study moves, (n, 2) [m]."""
    own = results.prepared.scenario
    moved = moved_sensors(results.prepared.study, own, results.scenario_with(results.best.placement))
    here = plan_sensors(own, [name for name in moved if name in own.sensors], results.prepared.candidate_set.building)
    return np.array([(each.x, each.y) for each in here]).reshape(-1, 2)


def _standard_error(results: StudyResults, trial: Trial) -> float:
    if results.objective.kind != "metric" or len(trial.seeds) < 2:
        return 0.0
    values = trial.values_by_seed(results.objective, results.prepared.study.scenarios, trial.seeds)
    return float(values.std(ddof=1) / np.sqrt(len(values)))
