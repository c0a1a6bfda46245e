"""Inputs of a run: the trackers, and of a recording its scenario and the trackers' prior files, with overrides applied.

A file must not name code to import. `module:Class` is accepted from the command line, from Python and from installed entry
points. In a scenario, a suite or a bag it may be another person's text, and importing it would run their code. The same
holds for a Dask scheduler, named by a tracker's option `scheduler`: its owner sends it code, and receives data.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from pydantic import Field

from trackers.configuration import Strict, validate
from trackers.errors import InputError, valid_names
from trackers.presets import available
from trackers.rig import NO_PRIOR, PriorFiles, Rig, files_within, missing_file
from trackers.user_input.plain_data import parse_yaml
from trackers.user_input.text_file import AnyPath, is_file
from twin.scenario import Scenario, TrackerChoice
from twin.scenario.load import apply_overrides, without_null
from twin.scenario.run_size import check_size

if TYPE_CHECKING:
    from twin.recording.reader import Recording

SCHEDULER = "scheduler"
"""Tracker option that holds a Dask scheduler address."""


@dataclass(frozen=True)
class TrustedClasses:
    """Classes (`module:Class`) and schedulers that may be used although a file names them."""

    named: frozenset[str] = frozenset()
    every: bool = False

    def has(self, target: str) -> bool:
        """Return True where `target` may be imported, or used."""
        return self.every or target in self.named


NONE_TRUSTED = TrustedClasses()

_TRACKER, _SET, _ALLOW = "--tracker module:Class", "--set trackers.NAME.preset=module:Class", "--allow-plugins"
RUN, TRACK, SUITE, STUDY = (_TRACKER, _SET, _ALLOW), (_TRACKER, _SET), (_SET, _ALLOW), (_ALLOW,)
"""Options by which each command accepts a class."""


@dataclass(frozen=True)
class ChosenTracker:
    """Tracker to make: its name, its preset or class for `make_tracker`, the options to change."""

    name: str
    target: str
    options: Mapping[str, Any] = field(default_factory=dict)


def typed_classes(changes: Sequence[str]) -> frozenset[str]:
    """Return the classes named by 'trackers.NAME.preset=module:Class' texts of a command line."""
    presets = (choice.get("preset") for choice in changed_trackers(changes).values() if isinstance(choice, dict))
    return frozenset(preset for preset in presets if isinstance(preset, str) and ":" in preset)


def typed_schedulers(changes: Sequence[str]) -> frozenset[str]:
    """Return the Dask schedulers named by 'trackers.NAME.scheduler=ADDRESS' texts of a command line."""
    addresses = (choice.get(SCHEDULER) for choice in changed_trackers(changes).values() if isinstance(choice, dict))
    return frozenset(address for address in addresses if isinstance(address, str))


def changed_trackers(changes: Sequence[str]) -> dict[str, Any]:
    """Parse the changes in 'trackers.NAME...=value' texts, by the tracker's name; raises InputError for a malformed one."""
    changed = apply_overrides({}, [change for change in changes if change.strip().startswith("trackers")])
    trackers = changed.get("trackers")
    return trackers if isinstance(trackers, dict) else {}


def unused_changes(changes: Sequence[str], run: Collection[str], where: str = "--set ") -> list[str]:
    """Return a sentence for each tracker that `--set`, or another `where`, changes though it is not among those that run."""
    return [
        f"{where}trackers.{name}: changes nothing, as {name} is not run, but {', '.join(run) or 'no tracker'}"
        for name in changed_trackers(changes)
        if name not in run
    ]


def import_from_here(typed: Iterable[str], *, files_trusted: bool = False) -> None:
    """Make classes importable from the current folder, as with `python`, if one of these names is a class.

    For names typed on a command line, and with `files_trusted` (--allow-plugins) for those in files: otherwise a file could
    choose imports from its own folder.
    """
    if files_trusted or any(":" in name for name in typed):
        sys.path.append(os.getcwd())  # last: the folder's content replaces nothing installed


def listed(trackers: Sequence[str]) -> list[str]:
    """Return names of trackers as a list; raises InputError for a text, whose letters would be names, and for no names."""
    if isinstance(trackers, str):
        raise InputError(f"trackers {trackers!r}: a list of names is expected, as [{trackers!r}]")
    names = list(trackers)
    for each in names:
        if isinstance(each, type):
            raise InputError(
                f"trackers: {each!r} is a class; its name as '{each.__module__}:{each.__name__}' is expected"
            )
        if not isinstance(each, str):
            raise InputError(f"trackers: {each!r} is no name; a text is expected, as 'sort' or 'module:Class'")
    return names


def check_choices(truth: str, **switches: object) -> None:
    """Raise InputError for another part of the truth than runs keep, and for a switch that is neither True nor False."""
    if truth not in ("all", "positions"):
        raise InputError(f"truth {truth!r}: 'all' or 'positions' is expected")
    for name, value in switches.items():
        if not isinstance(value, bool):
            raise InputError(f"{name} {value!r}: True or False is expected")


def choose(
    names: Sequence[str],
    defined: Mapping[str, TrackerChoice],
    source: str,
    trusted: TrustedClasses = NONE_TRUSTED,
    ways: Sequence[str] = RUN,
) -> list[ChosenTracker]:
    """Return the trackers named by the user, as `source` (a scenario or a bag) defines them.

    ways: options by which the command accepts a class, for the error's sentence; a study (STUDY) gives the names itself.
    Raises InputError for one named twice, for a definition of a missing tracker or under an existing tracker's name, and for
    an untrusted class behind one of `names`. Nothing is imported.
    """
    if len(set(names)) < len(names):
        raise InputError(f"--tracker {' --tracker '.join(names)}: one is named twice; each name once is expected")
    known = available()
    for name, choice in defined.items():
        target = choice.preset or name
        if name in known and target != name:
            raise InputError(redefined(f"{source}: trackers.{name}.preset", name, target))
        if name not in names and target not in known and ":" not in target:
            raise InputError(
                f"{source}: trackers.{name}: there is no tracker {target!r}; "
                f"{valid_names(target, known, ', module:Class, or a preset: next to the options')}"
            )
    chosen = []
    for name in names:
        choice = defined.get(name, TrackerChoice())
        if choice.preset is not None and ":" in choice.preset and not trusted.has(choice.preset):
            raise InputError(not_trusted(f"{source}: trackers.{name}.preset", choice.preset, ways))
        if ways is STUDY and ":" in name and not trusted.has(name):
            raise InputError(not_trusted(f"{source}: trackers", name, ways))
        if is_untrusted_scheduler(choice, trusted):
            raise InputError(not_asked(f"{source}: trackers.{name}.{SCHEDULER}", choice, ways))
        chosen.append(ChosenTracker(name, choice.preset or name, choice.options))
    return chosen


def redefined(where: str, name: str, target: str) -> str:
    """Format the error of a definition of `target` under the `name` of another tracker, written at `where`."""
    return (
        f"{where}: {target!r} would go by the name of another tracker, {name}; a name of its own is expected, and options "
        "alone under this one"
    )


def not_trusted(where: str, target: str, ways: Sequence[str]) -> str:
    """Format the error of an untrusted class in a file, written at `where`; `ways` as for `choose`."""
    typed = " or ".join(way for way in ways if way != _ALLOW)
    also = f", or the class on the command line ({typed})" if typed else ""
    trusting = f", or {_ALLOW} for a file that you trust" if _ALLOW in ways else ""
    return f"{where}: {target!r} is a class, and a file names no code to run; a preset's name is expected here{also}{trusting}"


def is_untrusted_scheduler(choice: TrackerChoice, trusted: TrustedClasses) -> bool:
    """Return True where a tracker's options name a scheduler that is not trusted."""
    address = choice.options.get(SCHEDULER)
    return address is not None and not trusted.has(str(address))


def not_asked(where: str, choice: TrackerChoice, ways: Sequence[str]) -> str:
    """Format the error of an untrusted scheduler in a file, written at `where`; `ways` as for `choose`."""
    trusting = f", or {_ALLOW} for a file that you trust" if _ALLOW in ways else ""
    return (
        f"{where}: {choice.options[SCHEDULER]!r} is a Dask scheduler, which runs code here and is sent some, and a file names "
        f"none; its address on the command line (--set trackers.NAME.scheduler=ADDRESS) is expected{trusting}"
    )


def environment_change(path: Path | None) -> list[str]:
    """Convert `--environment FILE` to an override; raises InputError for a missing file."""
    if path is None:
        return []
    if not is_file(path):
        raise InputError(f"--environment {path}: there is no such file; one that `twin environment` wrote is expected")
    return [f"prior.environment={json.dumps(str(path), ensure_ascii=False)}"]


def scenario_of(bag: Recording) -> Scenario | None:
    """Read the scenario in a twin's bag; raises InputError for an invalid one, or one larger than the limits."""
    if bag.scenario_yaml is None:
        return None
    source = f"{bag.path}, topic /scenario"
    scenario = validate(Scenario, parse_yaml(bag.scenario_yaml, source, "a resolved scenario"), source)
    check_size(scenario, source=source)
    return scenario


def files_for(
    bag: Recording, scenario: Scenario | None, rig: Rig | AnyPath | None, changes: Sequence[str]
) -> tuple[PriorFiles, list[str]]:
    """Return the prior files for a recording's trackers, absolute and existing, and warnings.

    From the user's rig.yaml, else from the bag, relative to its folder, with the overrides ('prior.environment=FILE',
    relative to the current folder) applied. A missing file named only by the bag may be on another machine: a warning.
    Raises InputError for a missing file named by the user.
    """
    of_the_rig = rig is not None and bag.rig.prior != NO_PRIOR
    named = bag.rig.prior if of_the_rig else _carried(bag, scenario).within(bag.path.parent)
    files = _changed(named, changes)
    missing = files.missing()
    for name, path in missing.items():
        if named.paths().get(name) != path:
            raise InputError(f"--set {missing_file(f'prior.{name}', path)}")
        if of_the_rig:
            raise InputError(f"{'the rig' if isinstance(rig, Rig) else rig}: {missing_file(f'prior.{name}', path)}")
    warnings = [
        f"{bag.path}: prior.{name}: there is no file {path} here; trackers go on without it"
        for name, path in missing.items()
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
    """Return the trackers called `names`, as in the bag's scenario, with overrides; raises InputError for invalid ones."""
    source = "--set" if scenario is None else f"{bag.path}, topic /scenario"
    trusted = TrustedClasses(typed_classes(changes) | typed_schedulers(changes))
    return choose(names, defined_trackers(scenario, names, changes), source, trusted, TRACK)


def defined_trackers(
    scenario: Scenario | None, names: Sequence[str], changes: Sequence[str]
) -> dict[str, TrackerChoice]:
    """Return the requested trackers defined by the bag's scenario, with overrides; raises InputError for invalid ones."""
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
