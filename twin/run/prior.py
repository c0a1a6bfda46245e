"""Which files hold what trackers are handed beside observations: as scenario, rig or bag name them, changed by the user."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

from pydantic import Field

from trackers.configuration import Strict, validate
from trackers.errors import InputError
from trackers.rig import NO_PRIOR, PriorFiles, files_within, missing_file
from trackers.text_file import AnyPath, is_file
from twin.recording.reader import Recording
from twin.scenario import Scenario
from twin.scenario.load import apply_overrides, without_null


def environment_change(path: Path | None) -> list[str]:
    """`--environment FILE` as the override that it is short for; raises InputError where there is no such file."""
    if path is None:
        return []
    if not is_file(path):
        raise InputError(f"--environment {path}: there is no such file; one that `twin environment` wrote is expected")
    return [f"prior.environment={json.dumps(str(path), ensure_ascii=False)}"]


def files_for(
    bag: Recording, scenario: Scenario | None, rig_path: AnyPath | None, changes: Sequence[str]
) -> tuple[PriorFiles, list[str]]:
    """The files for the trackers of a recording, absolute and there, and what warns.

    Those of the user's rig.yaml, else of the bag, relative to where it lies, with the overrides ('prior.environment=FILE',
    relative to the current folder) applied. What a bag alone names may be on another machine: a warning. Raises InputError
    for what the user names and is not there.
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


def notes_of(files: PriorFiles) -> list[str]:
    """What a reader must know of the files that trackers were handed."""
    told = ", ".join(f"{field} from {path}" for field, path in files.paths().items())
    return [f"Trackers were handed: {told}."] if told else []


def _carried(bag: Recording, scenario: Scenario | None) -> PriorFiles:
    """What the bag itself names."""
    return scenario.prior if scenario is not None and bag.rig.prior == NO_PRIOR else bag.rig.prior


def _changed(named: PriorFiles, changes: Sequence[str]) -> PriorFiles:
    held: dict[str, Any] = {"prior": named.model_dump(exclude_none=True)}
    content = apply_overrides(held, [change for change in changes if change.strip().startswith(("prior", "knowledge"))])
    return validate(_Changed, files_within(without_null(content), Path()), "--set").prior


class _Changed(Strict):
    former_names: ClassVar[Mapping[str, str]] = {"knowledge": "prior"}

    prior: PriorFiles = Field(default=NO_PRIOR)
