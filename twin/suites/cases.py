"""The cases of a suite: every scenario with every override, seed and tracker, checked before the first one runs."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from pydantic import JsonValue

from trackers.errors import InputError
from trackers.presets import PRESETS, available
from twin.scenario import Scenario, load_scenario
from twin.scenario.load import dump_scenario
from twin.scenario.model import TrackerChoice
from twin.suites.description import Changes, Suite, SuiteScenario, find_scenario
from twin.tracking import file_name

NO_CAMERA = ("laser", "floor")
"""The kinds of sensor that need no renderer."""


@dataclass(frozen=True)
class Case:
    """One scenario as resolved, recorded with one seed, and one tracker on it.

    overrides: 'path=value' texts, all of them; variant: those that tell it from the suite's other cases of the scenario;
    image_based: whether what the tracker says may depend on the renderer.
    """

    id: str
    scenario: str
    variant: str
    overrides: tuple[str, ...]
    seed: int
    tracker: str
    limit_s: float
    image_based: bool
    resolved: str  # YAML, without trackers: what is simulated
    tracker_changes: tuple[str, ...]  # 'trackers.NAME=...' for those that the scenario defines


def expand(suite: Suite, path: Path, changes: Sequence[str] = ()) -> list[Case]:
    """The cases, those of one recording one after the other.

    changes: 'path=value' texts for every case, which keeps its id all the same, so that two runs can be compared.
    Raises InputError, a line a fault, for scenarios, overrides and trackers that cannot be, and for cases given twice.
    """
    cases: dict[str, Case] = {}
    faults: dict[str, None] = {}
    for entry in suite.scenarios:
        try:
            found = list(_of_entry(suite, entry, path, changes))
        except InputError as error:
            faults[str(error)] = None
            continue
        for case in found:
            if case.id in cases:
                faults[
                    f"{path}: scenarios: {_title(case)}, seed {case.seed}, {case.tracker} is there twice; a name of its "
                    "own for each entry is expected"
                ] = None
            cases[case.id] = case
    if faults:
        raise InputError("\n".join(faults))
    return list(cases.values())


def _of_entry(suite: Suite, entry: SuiteScenario, path: Path, changes: Sequence[str]) -> Iterator[Case]:
    scenario_path = find_scenario(entry, path)
    fixed = {**suite.set, **entry.set}
    if "seed" in fixed or any("seed" in each for each in entry.combinations()):
        raise InputError(f"{path}: scenarios: {entry.scenario}: seed is set; `seeds:` beside it is expected")
    for variant in entry.combinations():
        overrides = _texts({**fixed, **variant})
        scenario = load_scenario(scenario_path, [*overrides, *changes])
        trackers = entry.trackers or suite.trackers
        _check_trackers(trackers, scenario, path)
        for seed in entry.seeds or suite.seeds:
            seeded = scenario.model_copy(update={"seed": seed, "trackers": {}})
            resolved = dump_scenario(seeded)
            for tracker in trackers:
                label = entry.name or scenario.name
                yield Case(
                    id=_case_id(label, overrides, seed, tracker),
                    scenario=label,
                    variant=", ".join(_short(text) for text in _texts(variant)),
                    overrides=overrides,
                    seed=seed,
                    tracker=tracker,
                    limit_s=entry.limit_s or suite.limit_s,
                    image_based=_uses_images(scenario, tracker),
                    resolved=resolved,
                    tracker_changes=_texts(
                        {f"trackers.{name}": _options(choice) for name, choice in scenario.trackers.items()}
                    ),
                )


def _options(choice: TrackerChoice) -> JsonValue:
    return choice.model_dump(mode="json", exclude_none=True)


def _texts(changes: Changes) -> tuple[str, ...]:
    """Changes as 'path=value', the value as JSON, which is YAML too."""
    return tuple(f"{path}={json.dumps(value, ensure_ascii=False)}" for path, value in changes.items())


def _short(text: str, longest: int = 60) -> str:
    text = text.replace('"', "")
    return text if len(text) <= longest else text[: longest - 1] + "…"


def _title(case: Case) -> str:
    return f"{case.scenario} ({case.variant})" if case.variant else case.scenario


def _case_id(label: str, overrides: tuple[str, ...], seed: int, tracker: str) -> str:
    """A name for files and rows that is the same wherever and whenever the case is run."""
    digest = hashlib.sha256(json.dumps([label, overrides, seed, tracker]).encode()).hexdigest()[:8]
    return f"{label}-{seed}-{re.sub(r'[^A-Za-z0-9._-]', '-', file_name(tracker))}-{digest}"


def _check_trackers(names: tuple[str, ...], scenario: Scenario, path: Path) -> None:
    for name in names:
        choice = scenario.trackers.get(name)
        target = (choice.preset if choice is not None else None) or name
        if target not in available() and ":" not in target:
            raise InputError(
                f"{path}: trackers: there is no tracker {target!r}; valid are {', '.join(available())}, module:Class, or "
                f"one that the scenario {scenario.name} defines"
            )


def _uses_images(scenario: Scenario, name: str) -> bool:
    """Whether there is a camera and the tracker, as far as we can know, uses it."""
    if all(sensor.kind in NO_CAMERA for sensor in scenario.sensors.values()):
        return False
    choice = scenario.trackers.get(name, TrackerChoice())
    preset = PRESETS.get(choice.preset or name)
    options = {**(preset.options if preset else {}), **choice.options}
    return options.get("camera") is not False
