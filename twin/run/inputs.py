"""Inputs of a replay besides its observations: the bag's scenario, the trackers, their prior files, with overrides applied."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

from pydantic import Field

from trackers.configuration import Strict, validate
from trackers.errors import InputError
from trackers.plain_data import parse_yaml
from trackers.rig import NO_PRIOR, PriorFiles, files_within, missing_file
from trackers.text_file import AnyPath, is_file
from twin.recording.reader import Recording
from twin.run.chosen_trackers import (
    TRACK,
    ChosenTracker,
    TrustedClasses,
    changed_trackers,
    choose,
    typed_classes,
    typed_schedulers,
)
from twin.scenario import Scenario, TrackerChoice
from twin.scenario.load import apply_overrides, without_null
from twin.scenario.run_size import check_size


def environment_change(path: Path | None) -> list[str]:
    """Convert `--environment FILE` to an override; raises InputError where there is no such file."""
    if path is None:
        return []
    if not is_file(path):
        raise InputError(f"--environment {path}: there is no such file; one that `twin environment` wrote is expected")
    return [f"prior.environment={json.dumps(str(path), ensure_ascii=False)}"]


def scenario_of(bag: Recording) -> Scenario | None:
    """Read the scenario carried in a twin's bag; raises InputError for one that is none, or larger than the limits."""
    if bag.scenario_yaml is None:
        return None
    source = f"{bag.path}, topic /scenario"
    scenario = validate(Scenario, parse_yaml(bag.scenario_yaml, source, "a resolved scenario"), source)
    check_size(scenario, source=source)
    return scenario


def files_for(
    bag: Recording, scenario: Scenario | None, rig_path: AnyPath | None, changes: Sequence[str]
) -> tuple[PriorFiles, list[str]]:
    """Return the prior files for a recording's trackers, absolute and existing, and warnings.

    Those of the user's rig.yaml, else of the bag, relative to its folder, with the overrides ('prior.environment=FILE',
    relative to the current folder) applied. A file that the bag alone names may be on another machine: a warning. Raises
    InputError for a missing file that the user names.
    """
    of_the_rig = rig_path is not None and bag.rig.prior != NO_PRIOR
    named = bag.rig.prior if of_the_rig else _carried(bag, scenario).within(bag.path.parent)
    files = _changed(named, changes)
    missing = files.missing()
    for field, path in missing.items():
        if named.paths().get(field) != path:
            raise InputError(f"--set {missing_file(f'prior.{field}', path)}")
        if of_the_rig:
            raise InputError(f"{rig_path}: {missing_file(f'prior.{field}', path)}")
    warnings = [
        f"{bag.path}: prior.{field}: there is no file {path} here; trackers go on without it"
        for field, path in missing.items()
    ]
    return files.without(missing), warnings


def _carried(bag: Recording, scenario: Scenario | None) -> PriorFiles:
    """Return the prior files that the bag itself names."""
    return scenario.prior if scenario is not None and bag.rig.prior == NO_PRIOR else bag.rig.prior


def _changed(named: PriorFiles, changes: Sequence[str]) -> PriorFiles:
    held: dict[str, Any] = {"prior": named.model_dump(exclude_none=True)}
    content = apply_overrides(held, [change for change in changes if change.strip().startswith(("prior", "knowledge"))])
    return validate(_Changeable, files_within(without_null(content), Path()), "--set").prior or NO_PRIOR


def chosen_trackers(
    bag: Recording, scenario: Scenario | None, names: Sequence[str], changes: Sequence[str]
) -> list[ChosenTracker]:
    """Return the trackers called `names`, as the bag's scenario defines them, with overrides; raises InputError for bad ones."""
    source = "--set" if scenario is None else f"{bag.path}, topic /scenario"
    trusted = TrustedClasses(typed_classes(changes) | typed_schedulers(changes))
    return choose(names, _defined(scenario, names, changes), source, trusted, TRACK)


def _defined(scenario: Scenario | None, names: Sequence[str], changes: Sequence[str]) -> dict[str, TrackerChoice]:
    """Return the trackers asked for that the bag's scenario defines, with overrides."""
    asked = {*names, *changed_trackers(changes)}
    content = {
        "trackers": {
            name: choice.model_dump(exclude_none=True) for name, choice in scenario.trackers.items() if name in asked
        }
        if scenario is not None
        else {}
    }
    return validate(_Changeable, apply_overrides(content, changes), "--set").trackers


class _Changeable(Strict):
    """Fields of a recording that `--set` may change: the trackers and their prior files."""

    former_names: ClassVar[Mapping[str, str]] = {"knowledge": "prior"}

    trackers: dict[str, TrackerChoice] = Field(default_factory=dict)
    prior: PriorFiles | None = None
