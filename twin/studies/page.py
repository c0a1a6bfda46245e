"""The page of a study, for somebody with a drill and for somebody who pays: one HTML file, printable on A4."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined

from trackers.arrays import Array
from twin.models import MODELS
from twin.recording.whole_file import whole_file
from twin.reproduce.page import source_of
from twin.scenario.floor import FloorDescription
from twin.studies.aftermath import moved_sensors
from twin.studies.drawings import Mounted, heat_map, is_scanner, mounted, pareto, plan, tried
from twin.studies.layout import OWN
from twin.studies.scoring import Score, errors_by_place
from twin.studies.seen import Eye, floor_cells
from twin.studies.trial import Trial
from twin.suites.cache_keys import whole_code

if TYPE_CHECKING:
    from twin.studies.run import Answers

_HEAT_CELLS = 4000
_MOST_ERROR_SEEDS = 3
_ERROR_CELL_M = 0.5
_FEWEST = 3
_MOST_ALIKE = 30


def write_page(path: Path, answers: Answers) -> None:
    """Write the page; it takes its name when it is whole. Raises InputError where it cannot be written."""
    prepared, study, layout = answers.prepared, answers.prepared.study, answers.prepared.layout
    scenario, area = answers.placed(answers.best.candidate), prepared.scene.area
    sensors = mounted(scenario, moved_sensors(study, prepared.scenario, scenario), layout.building)
    drawn, scale, width_mm = plan(scenario, prepared.scenario, sensors, layout.building, area)
    objective = answers.objective
    content: dict[str, Any] = {
        "study": study,
        "answers": answers,
        "scenario": scenario,
        "sensors": sensors,
        "plan": source_of(drawn),
        "scale": scale,
        "width_mm": round(width_mm, 1),
        "parts": _parts(answers),
        "best": _told(answers, answers.best),
        "own": _told(answers, answers.own),
        "front": [_told(answers, each) for each in answers.front],
        "alike": [(_told(answers, each), row.told) for each, row in answers.alike[:_MOST_ALIKE]],
        "n_alike": len(answers.alike),
        "maps": _maps(answers, scenario, sensors),
        "tried": _tried(answers, sensors),
        "objective": objective,
        "judged": study.judged,
        "fewer": [
            (
                _left_out(answers, candidate),
                f"{value:.4f}",
                f"{value - _value(answers, answers.best):+.4f}".replace("-", "−"),
            )
            for candidate, value in answers.fewer
        ],
        "command": prepared.path.stem if prepared.path.parent == MODELS / "studies" else prepared.path,
        "n_tried": sum(not each.why for each in answers.result.trials.values()),
        "against": _against(answers),
        "seeds": len(study.held_out.seeds) if study.held_out else 0,
    }
    with whole_file(path) as stream:
        stream.write(environment().get_template("page.html.j2").render(**content))


def _value(answers: Answers, trial: Trial) -> float:
    return trial.value(answers.objective, answers.prepared.study.scenarios)


def _told(answers: Answers, trial: Trial) -> dict[str, str]:
    from twin.studies.answers import places_of

    study = answers.prepared.study
    figures = "–" if trial.why and trial.candidate != OWN else " · ".join(
        f"{each.column} {trial.value(each, study.scenarios):.4g}"
        for each in study.objectives
        if each.kind != "price" and (trial.seeds or each.kind != "metric")
    )  # fmt: skip
    return {
        "places": places_of(answers, trial.candidate),
        "price": f"{trial.price:g}",
        "coverage": "–" if trial.coverage is None else f"{100 * trial.coverage:.1f} %",
        "figures": figures,
        "seeds": str(len(trial.seeds)),
        "why": trial.why,
    }


def _parts(answers: Answers) -> list[tuple[str, str, str, str]]:
    """What is to be bought: device and kind, how many, the price of one without its cable, and metres of cable."""
    from twin.studies.prepare import described

    layout, study, rows = answers.prepared.layout, answers.prepared.study, []
    for name, move in study.move.items():
        for number, kind in enumerate(move.kinds):
            mine = [
                layout.options[each]
                for each in answers.best.candidate
                if layout.options[each].device == name and layout.options[each].kind == number
            ]
            if mine:
                each = kind.price if kind.price is not None else move.price
                what = f"{name}: {described(move, answers.prepared.scenario)}" + (
                    "" if kind.name == "as-is" else f", {kind.name}"
                )
                cable = sum(option.cable_m * len(option.mounts) for option in mine)
                rows.append(
                    (
                        what,
                        str(sum(len(option.mounts) for option in mine)),
                        f"{each:g}",
                        f"{cable:.1f} m" if cable else "–",
                    )
                )
    return rows


def _against(answers: Answers) -> list[tuple[str, int, dict[str, int]]]:
    """By device, how many places there were, and why how many of them are none."""
    layout = answers.prepared.layout
    return [(name, layout.tried[name], reasons) for name, reasons in layout.refused.items()]


def _left_out(answers: Answers, candidate: tuple[int, ...]) -> str:
    gone = next(each for each in answers.best.candidate if each not in candidate)
    x, y, z = answers.prepared.layout.options[gone].mounts[0].xyz
    return f"{answers.prepared.layout.options[gone].device} at ({x:g}, {y:g}, {z:g})"


def _maps(answers: Answers, scenario: Any, sensors: list[Mounted]) -> list[tuple[str, str]]:
    """Beams on a body, pixels a metre, and the mean error by place, each with what it shows."""
    prepared, study = answers.prepared, answers.prepared.study
    area, building = prepared.scene.area, prepared.layout.building
    cell_m = max(0.05, float(np.sqrt(np.prod(np.ptp(area, axis=0)) / _HEAT_CELLS)))
    cells = floor_cells(area, cell_m)
    crowd = answers.seen.rows.crowds[0]
    found = []
    names = [name for name, each in scenario.sensors.items() if not isinstance(each, FloorDescription)]
    for scanners, label, least, what in (
        (
            True,
            "beams on a body",
            float(study.coverage.beams),
            "Beams that meet a body, of the best scanner for each place",
        ),
        (
            False,
            "px/m",
            study.coverage.px_per_m,
            "Pixels a metre at the greatest of the heights looked for, of the best camera",
        ),
    ):
        mine = [name for name in names if is_scanner(scenario, name) == scanners]
        if mine:
            sharp = np.max(
                [Eye(scenario, name, study.coverage).resolution(crowd.empty(), cells)[-1] for name in mine], axis=0
            )
            blind = 100 * float((sharp < least).mean())
            caption = f"{what}, empty room; red: fewer than {least:g}, {blind:.1f} % of the area."
            found.append((caption, heat_map(cells, sharp, cell_m, sensors, building, area, label=label, least=least)))
    tracker = study.judged[0].tracker if study.judged else None
    if tracker is not None:
        seeds = (study.held_out.seeds if study.held_out is not None else study.seeds)[:_MOST_ERROR_SEEDS]
        cache = answers.cache
        work = [
            Score(scenario.model_copy(update={"seed": seed, "trackers": {}}), prepared.trackers, cache, whole_code())
            for seed in seeds
        ]
        rows = np.concatenate([errors_by_place(each, tracker) for each in work])
        low = area.min(axis=0)
        cell = np.floor((rows[:, :2] - low) / _ERROR_CELL_M).astype(int)
        places, group, count = np.unique(cell, axis=0, return_inverse=True, return_counts=True)
        mean = np.bincount(group.ravel(), rows[:, 2]) / count
        often = count >= _FEWEST
        caption = f"Mean distance of {tracker}'s tracks from people, by place, over {len(seeds)} seeds."
        middles = low + (places[often] + 0.5) * _ERROR_CELL_M
        drawn = heat_map(
            middles,
            mean[often],
            _ERROR_CELL_M,
            sensors,
            building,
            area,
            label="m",
            most=float(np.quantile(mean[often], 0.98)),
        )
        found.append((caption, drawn))
    return [(caption, source_of(svg)) for caption, svg in found]


def _tried(answers: Answers, sensors: list[Mounted]) -> tuple[str, str] | None:
    """What was tried, its caption first: the first objective over the second or the price, or by place where all cost the same.

    None where hardly anything was tried.
    """
    study, layout = answers.prepared.study, answers.prepared.layout
    trials = [
        each
        for each in answers.result.trials.values()
        if (not each.why or each is answers.own) and (each.seeds or answers.objective.kind != "metric")
    ]
    if len(trials) < 3:
        return None
    first = np.array([_value(answers, each) for each in trials])
    others = study.objectives[1:]
    across = np.array([each.value(others[0], study.scenarios) if others else each.price for each in trials])
    if np.ptp(across) == 0:
        order = np.argsort(first if answers.objective.more_is_better else -first)
        places = [layout.positions[number][:1, :2] for each in order for number in trials[each].candidate]
        values = [first[each] for each in order for _ in trials[each].candidate]
        drawn = tried(
            np.concatenate(places), np.array(values), _own_places(answers), sensors, layout.building,
            answers.prepared.scene.area, answers.objective.column,
        )  # fmt: skip
        told = "Devices of every candidate, by its worth; circled: recommended; crosses: the scenario's own."
        return told, source_of(drawn)
    svg = pareto(
        np.column_stack([across, first]),
        np.array([each in answers.front for each in trials]),
        trials.index(answers.own),
        trials.index(answers.best),
        (others[0].column if others else "price", answers.objective.column),
        np.array([_standard_error(answers, each) for each in trials]),
    )
    told = (
        "Bars: standard errors over seeds. Candidates with fewer seeds were dropped early, in a race on the same seeds."
    )
    return told, source_of(svg)


def _own_places(answers: Answers) -> Array:
    """Where the scenario's own devices are, (n, 2) [m], those that are moved."""
    own = answers.prepared.scenario
    moved = moved_sensors(answers.prepared.study, own, answers.placed(answers.best.candidate))
    here = mounted(own, [name for name in moved if name in own.sensors], answers.prepared.layout.building)
    return np.array([(each.x, each.y) for each in here]).reshape(-1, 2)


def _standard_error(answers: Answers, trial: Trial) -> float:
    if answers.objective.kind != "metric" or len(trial.seeds) < 2:
        return 0.0
    values = trial.by_seed(answers.objective, answers.prepared.study.scenarios, trial.seeds)
    return float(values.std(ddof=1) / np.sqrt(len(values)))


@cache
def environment() -> Environment:
    """What the pages of studies are made with, on the base that pages of results share."""
    return Environment(
        loader=ChoiceLoader([PackageLoader("twin.studies", "."), PackageLoader("twin.reproduce", ".")]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
