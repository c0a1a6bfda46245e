"""From YAML to a checked scenario: `extends`, overrides, and all errors at once with their paths."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from copy import deepcopy
from functools import cache
from pathlib import Path
from typing import Any

from pydantic import BaseModel, Field

from trackers.configuration import keys_of, validate
from trackers.errors import InputError, valid_names
from trackers.rig import Name, files_within
from trackers.user_input.former_options import checked_current_names, current_path
from trackers.user_input.plain_data import DEEPEST, deep_merge, dump_yaml, parse_yaml_value
from trackers.user_input.text_file import AnyPath, as_path
from twin import models
from twin.drawn.distributions import DrawnPeople, DrawnRoom, DrawnSensors, drawn_fields
from twin.scenario.pedestrians import Pedestrians, people_from
from twin.scenario.person import Person
from twin.scenario.scenario import Scenario
from twin.scenario.sensor_descriptions import SensorDescription

logger = logging.getLogger(__name__)

_LONGEST_CHAIN = 20
"""Greatest number of scenarios that extend each other in turn."""
_MOST_SHOWN = 200
"""Greatest number of characters of an override in an error."""


class ScenarioFile(Scenario):
    """A scenario as a file may hold it, for editors: what is resolved on loading stands beside the rest."""

    name: str = Field(default="", description="name of the scenario; it becomes the name of a folder")
    extends: str | None = Field(default=None, description="the scenario, by name or path, that this one starts from")
    pedestrians: Pedestrians | None = Field(
        default=None, description="recorded pedestrians who come as people, from a file; none: nobody"
    )


class DrawableScenarioFile(ScenarioFile):
    """A scenario as a file may hold it, for editors, with what can be left to be drawn."""

    room: str | DrawnRoom = Field(  # pyright: ignore[reportIncompatibleVariableOverride]
        description="name of a shipped room, path of an MJCF file relative to the scenario, or a room to draw"
    )
    people: dict[Name, Person] | DrawnPeople = Field(  # pyright: ignore[reportIncompatibleVariableOverride]
        description="who is in the room, by name, or people to draw"
    )
    sensors: dict[Name, SensorDescription] | DrawnSensors = Field(  # pyright: ignore[reportIncompatibleVariableOverride]
        description="what watches the room, by name, or a rig to draw"
    )


def load_scenario(
    name: AnyPath, overrides: Sequence[str] = (), *, suites: Sequence[str] = (), folder: AnyPath = Path()
) -> Scenario:
    """Load the scenario of this name (shipped) or path, with overrides like 'sensors.waist.rate_hz=20' applied.

    suites: overrides applied before those, whose paths are relative to `folder`, a suite's.

    `extends: NAME` starts from another scenario: mappings merge, everything else replaces, null removes an entry (among a
    tracker's options it is a value: some may be none).
    A room, people and sensors of `kind: drawn` are drawn with the scenario's seed (`twin.drawn`).
    A room, parent or prior file given by path is relative to the file that names it. Raises InputError, every
    fault on one line.
    """
    overrides, suites = override_texts(overrides, "overrides"), override_texts(suites, "suites")
    path, folder = models.find("scenarios", str(as_path(name, "scenario"))), as_path(folder, "folder")
    content = _read(path, ())
    content = apply_overrides(content, suites)
    _resolve(content, folder, "set: room")
    content = apply_overrides(content, overrides)
    _resolve(content, Path(), "--set room")
    said = " ".join(map(_said, (*suites, *overrides)))
    source = f"{path} with {said}" if said else str(path)
    content = _without_removed(content)
    if drawn_fields(content):
        from twin.drawn.draw_scene import draw_scene  # of no use to other scenarios

        content = draw_scene(content, source, models.kept_room)
    _bring_pedestrians(content, source)
    scenario = validate(Scenario, content, source)
    return scenario if path.parent == models.MODELS / "scenarios" else scenario.of_file(source)


def override_texts(given: object, what: str) -> tuple[str, ...]:
    """Return texts as a tuple, for an iterator too; raises InputError for anything else."""
    found = list(given) if isinstance(given, Iterable) and not isinstance(given, str | Mapping) else [None]
    texts = tuple(each for each in found if isinstance(each, str))
    if len(texts) < len(found):
        raise InputError(f"{what} {given!r}: a list of texts is expected, as ['sensors.waist.rate_hz=20']")
    return texts


def _read(path: Path, children: tuple[Path, ...]) -> dict[str, Any]:
    """Read a scenario file, merged over the scenario that it extends."""
    content = models.read_kind(path, "scenario", "a scenario (room, people, sensors, duration_s)")
    content = checked_current_names(ScenarioFile, content, str(path))
    _resolve(content, path.parent, f"{path}: room")
    parent = content.pop("extends", None)
    if parent is None:
        check_removals(ScenarioFile, {}, content, str(path))
        return content
    if not isinstance(parent, str):
        raise InputError(f"{path}: extends: {parent!r} is not a name; the name or path of one scenario is expected")
    found = models.find("scenarios", parent, path.parent, f"{path}: extends")
    if len(children) == _LONGEST_CHAIN:
        raise InputError(
            f"{path}: extends: {parent!r} is the parent of {_LONGEST_CHAIN} in turn; a shorter chain is expected"
        )
    if found.resolve() in (path.resolve(), *children):
        raise InputError(f"{path}: extends: {parent!r} extends itself in the end; a chain without a circle is expected")
    base = _read(found, (path.resolve(), *children))
    for own in ("name", "description"):  # they tell of the other scenario
        base.pop(own, None)
    check_removals(ScenarioFile, base, content, str(path))
    return deep_merge(base, content)


def _resolve(content: dict[str, Any], folder: Path, asked_by: str) -> None:
    """Make paths of a user's room, pedestrians and prior, relative to `folder`, absolute, so that it runs from anywhere.

    asked_by: field that names the room.
    """
    room = content.get("room")
    if isinstance(room, str):
        found = models.find("rooms", room, folder, asked_by)
        if found.parent != models.MODELS / "rooms":
            content["room"] = str(found.resolve())
    pedestrians = content.get("pedestrians")
    if isinstance(pedestrians, dict) and isinstance(pedestrians.get("file"), str):
        path = folder / pedestrians["file"]
        with suppress(ValueError):  # a NUL in it: reading reports it
            path = path.resolve()
        pedestrians["file"] = str(path)
    if "prior" in content:
        content["prior"] = files_within(content["prior"], folder)


def _bring_pedestrians(content: dict[str, Any], source: str) -> None:
    """Add the people of a file of paths to the scenario's own; the resolved scenario holds their paths itself."""
    if "pedestrians" not in content:
        return
    pedestrians = validate(Pedestrians, content.pop("pedestrians"), f"{source}: pedestrians")
    duration_s = content.get("duration_s")
    if not isinstance(duration_s, int | float) or not duration_s > 0:
        return  # the scenario's own check reports it
    people, warnings = people_from(pedestrians, duration_s, source)
    given = content.get("warnings", [])
    if warnings:
        content["warnings"] = [*(given if isinstance(given, list) else [given]), *warnings]
    own = content.setdefault("people", {})
    if isinstance(own, dict):
        twice = sorted(own.keys() & people.keys())
        if twice:
            raise InputError(
                f"{source}: pedestrians.prefix: {twice[0]!r} is one of the people already; another prefix is expected"
            )
        content["people"] = own | people


def _without_removed(content: dict[str, Any]) -> dict[str, Any]:
    """Return the content without null entries; options of trackers are left to the trackers."""
    kept = without_null(content)
    if isinstance(trackers := content.get("trackers"), dict):
        kept["trackers"] = {name: choice for name, choice in trackers.items() if choice is not None}
    return kept


def without_null(content: Any) -> Any:
    """Return the content without null entries, at any depth of mappings."""
    if isinstance(content, dict):
        return {key: without_null(value) for key, value in content.items() if value is not None}
    return content


def apply_overrides(content: dict[str, Any], overrides: Sequence[str]) -> dict[str, Any]:
    """Apply 'path.to.field=value' overrides to the content in order. Raises InputError for one that is malformed."""
    changed = deepcopy(content)
    for override in overrides:
        _apply(changed, override)
    return changed


def _said(override: str) -> str:
    """Return an override for errors, cut to `_MOST_SHOWN` characters."""
    return f"--set {override}" if len(override) <= _MOST_SHOWN else f"--set {override[:_MOST_SHOWN]}..."


def _apply(content: dict[str, Any], override: str) -> None:
    """Set one 'path.to.field=value' in place; the value is YAML."""
    path, equals, text = override.partition("=")
    parts = path.strip().split(".")
    if not equals or not all(parts):
        raise InputError(
            f"{_said(override)}: is not of the form path.to.field=value, for example sensors.waist.rate_hz=20"
        )
    if len(parts) > DEEPEST:
        raise InputError(f"--set: a path of {len(parts)} steps leads nowhere; at most {DEEPEST} are expected")
    parts = current_path(ScenarioFile, parts, _said(override))
    value = parse_yaml_value(text, _said(override))
    here: Any = content
    for depth, part in enumerate(parts[:-1]):
        if isinstance(here, list):
            here = here[_index(here, part, override)]
        elif isinstance(here, dict):
            if not isinstance(here.get(part), dict | list):
                here[part] = {}
            here = here[part]
        else:
            raise _valued(override, parts[:depth], part)
    if isinstance(here, list):
        here[_index(here, parts[-1], override)] = value
    elif not isinstance(here, dict):
        raise _valued(override, parts[:-1], parts[-1])
    else:
        check_removals(ScenarioFile, here, {parts[-1]: value}, _said(override), tuple(parts[:-1]))
        _check_replaced(here.get(parts[-1]), value, tuple(parts), _said(override))
        here[parts[-1]] = value


def _check_replaced(held: Any, value: Any, at: tuple[str, ...], source: str) -> None:
    """Raise InputError where a mapping replaces another that has a `kind`, and has none: it cannot be meant to.

    Warn where a mapping of names changes some of those there and drops the others; empty ones change nothing, so that only a
    replacement can be meant. at: the path of both; source: as for `check_removals`.
    """
    if not (isinstance(held, Mapping) and isinstance(value, Mapping) and value):
        return
    for key in held.keys() & value.keys():
        _check_replaced(held[key], value[key], (*at, str(key)), source)
    path, first = ".".join(at), next(iter(value))
    one = f"{path}.{first}" + (".FIELD=VALUE" if isinstance(value[first], Mapping) else "=VALUE")
    if "kind" in held and "kind" not in value:
        raise InputError(f"{source}: {path}: is replaced as a whole, and has no kind; --set {one} changes one field")
    dropped = [str(key) for key in held if key not in value]
    changed = [key for key in held.keys() & value.keys() if value[key] != {}]
    if dropped and changed and keys_of(ScenarioFile, at) is None:
        _warn(f"{source}: replaces all of {path}, without {', '.join(dropped)}; --set {one} changes one of them")


@cache
def _warn(sentence: str) -> None:
    """Warn, once: a suite loads a scenario for each of its cases."""
    logger.warning("%s", sentence)


def _valued(override: str, path: list[str], part: str) -> InputError:
    """Return the error for a path into a value that is no mapping, such as a list's item."""
    return InputError(f"{_said(override)}: {'.'.join(path)} is a value, not a mapping; it has no {part!r}")


def _index(items: list[Any], part: str, override: str) -> int:
    if not (part.isascii() and part.isdecimal()) or len(part) > 9 or int(part) >= len(items):
        raise InputError(f"{_said(override)}: {part!r} is not one of the list's places 0 to {len(items) - 1}")
    return int(part)


def check_scenario(scenario: object) -> None:
    """Raise InputError for what is no Scenario, and for a copy (`model_copy`) with fields or values that are not valid."""
    if not isinstance(scenario, Scenario):
        raise InputError(f"{scenario!r} is no Scenario; twin.load_scenario makes one of a name or file")
    source = f"scenario {vars(scenario).get('name')!r}"
    for name in sorted(vars(scenario).keys() - Scenario.model_fields.keys()):
        raise InputError(
            f"{source}: {name}: unknown key; {valid_names(name, Scenario.model_fields, start='valid here:')}"
        )
    validate(Scenario, scenario.model_dump(mode="json", exclude_none=True, warnings=False), source)


def dump_scenario(scenario: Scenario) -> str:
    """Write the resolved scenario as YAML that runs again to the same bits."""
    content = scenario.model_dump(mode="json", exclude_none=True)
    return dump_yaml(content)


def check_removals(
    model: type[BaseModel],
    base: Mapping[Any, Any],
    change: Mapping[Any, Any],
    source: str,
    at: tuple[str, ...] = (),
) -> None:
    """Raise InputError where a null in `change` removes nothing from `base` and is no optional field.

    at: the path of both in the model; source: start of the sentence. A tracker's options are left to the tracker.
    """
    if at[:1] == ("trackers",) and len(at) > 1:
        return
    for key, value in change.items():
        held = base.get(key)
        if isinstance(value, Mapping):
            check_removals(model, held if isinstance(held, Mapping) else {}, value, source, (*at, str(key)))
        elif value is None and key not in base:
            fields = keys_of(model, at, change.get("kind", base.get("kind")))
            if fields is None or key not in fields:
                raise InputError(f"{source}: {'.'.join((*at, str(key)))}: {_nothing(str(key), base, fields)}")


def _nothing(key: str, base: Mapping[Any, Any], fields: frozenset[str] | None) -> str:
    there = sorted(map(str, base if fields is None else fields))
    what = "there is none of this name to remove" if fields is None else "unknown key"
    return f"{what}; {valid_names(key, there, start='valid here:', none='none, as nothing is there')}"
