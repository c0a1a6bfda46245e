"""Declarative models (rooms, scenarios, suites, studies): their folder, names and files, in a checkout or a wheel."""

from __future__ import annotations

import os
import re
from functools import cache
from pathlib import Path
from typing import Any

from trackers.errors import InputError, valid_names
from trackers.user_input.plain_data import deep_merge, parse_yaml
from trackers.user_input.text_file import as_path, is_file, read_text

_PACKAGE = Path(__file__).parent
MODELS = _PACKAGE / "models" if (_PACKAGE / "models").is_dir() else _PACKAGE.parent / "models"

_SUFFIX = {"rooms": ".xml", "scenarios": ".yaml", "suites": ".yaml", "studies": ".yaml"}
_ONE = {"studies": "study"}


def names(folder: str) -> list[str]:
    """List the shipped models in 'rooms', 'scenarios', 'suites' or 'studies', by name, sorted."""
    return sorted(path.stem for path in (MODELS / folder).glob(f"*{_SUFFIX[folder]}"))


def find(folder: str, name: str, relative_to: Path | None = None, asked_by: str = "") -> Path:
    """Find the file of a shipped model by name, or of a user's own by path (relative to `relative_to`).

    `asked_by`: prefix of the error, such as a file and field. Raises InputError listing the shipped models.
    """
    suffix = _SUFFIX[folder]
    shipped = MODELS / folder / f"{name}{suffix}"
    if "/" not in name and is_file(shipped):
        return shipped
    path = (relative_to or Path()) / name
    if is_file(path):
        return path
    start, kind = f"{asked_by}: " if asked_by else "", _kind(folder)
    if os.path.isdir(path):  # False too for a path that cannot be, too long or with a NUL in it
        inside = sorted(str(Path(name) / each.name) for each in path.glob(f"*{suffix}"))
        raise InputError(
            f"{start}{name!r} is a folder; the path of a {suffix} file is expected{', as ' * bool(inside)}{', '.join(inside[:3])}"
        )
    others = [_kind(each) for each in _SUFFIX if each != folder and name in names(each)]
    what = f"no file is {path.absolute()}" if name.endswith(suffix) else f"it is a {others[0]}" if others else ""
    raise InputError(
        f"{start}there is no {kind} {name!r}{': ' * bool(what)}{what}; "
        f"{valid_names(name, names(folder), f' or the path of a {suffix} file')}"
    )


def _kind(folder: str) -> str:
    return _ONE.get(folder, folder[:-1])


_SIGNS = {
    "study": ("objectives", "devices", "search"),
    "suite": ("scenarios", "recordings"),
    "scenario": ("room", "people", "sensors", "duration_s", "extends"),
}
_RUN_BY = {"study": "twin study run", "suite": "twin suite run", "scenario": "twin run"}


def read_kind(path: Path, kind: str, expected: str) -> dict[str, Any]:
    """Read the YAML file of a scenario, suite or study; `expected`: what it holds.

    Raises InputError where its fields are those of another kind, naming the command that runs it.
    """
    content = parse_yaml(read_text(path, expected), str(path), expected)
    found = [each for each, fields in _SIGNS.items() if any(field in content for field in fields)]
    if found and (kind not in found or (kind == "suite" and all(each in content for each in _SIGNS["study"]))):
        raise InputError(f"{path}: is a {found[0]}, which `{_RUN_BY[found[0]]}` runs; a {kind} is expected")
    return content


def cache_folder() -> Path:
    """Return $ROOMTWIN_CACHE, else roomtwin in $XDG_CACHE_HOME (which counts if absolute), else ~/.cache/roomtwin.

    Raises InputError for a user without a home folder.
    """
    # platformdirs would replace one line of this, and on macOS names another folder than the documented one
    named = os.environ.get("ROOMTWIN_CACHE")
    if named:
        return as_path(named, "ROOMTWIN_CACHE")
    home = os.environ.get("XDG_CACHE_HOME", "")
    try:
        return (Path(home) if os.path.isabs(home) else Path.home() / ".cache") / "roomtwin"
    except RuntimeError as error:
        raise InputError(
            f"ROOMTWIN_CACHE: is not set, and this user ({os.getuid()}) has no home folder; ROOMTWIN_CACHE naming a folder "
            "that can be written is expected"
        ) from error


def is_kept_room(room: str) -> bool:
    """Return whether a scenario's room is a drawn one from the cache."""
    return Path(room).parent == cache_folder() / "rooms"


def kept_room(name: str, mjcf: str) -> str:
    """Keep a drawn room's MJCF file in the cache, named by its content; return its path.

    Raises InputError if it cannot be written.
    """
    path = cache_folder() / "rooms" / f"{name}.xml"
    partial = path.with_name(f".{path.name}.{os.getpid()}.partial")
    try:
        if not is_file(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            partial.write_text(mjcf, encoding="utf-8")
            os.replace(partial, path)
    except OSError as error:
        raise InputError(
            f"{path}: cannot be written ({error.strerror}); ROOMTWIN_CACHE with a folder that can be is expected"
        ) from error
    return str(path)


SENSOR_KINDS = {
    "laser": "planar range scanner: any field of view, resolution, noise",
    "fisheye": "fisheye camera: equidistant or Kannala–Brandt, any coefficients",
    "camera": "pinhole camera: any focal length and size, Brown–Conrady distortion, motion blur",
    "stereo": "stereo RGB-D camera: colour and depth by matching two views, or ideal, or with noise on the disparity",
    "floor": "pressure floor: a grid of force-sensing resistors, any pitch and size, 8 bits",
}
"""Kinds of sensor of a scenario, with one line on each."""

FAULTS = {
    "dropout": "any sensor: observations are lost with a probability; 1: it is silent",
    "freeze": "any sensor: the last values again and again, under new stamps",
    "delay": "any sensor: observations arrive later, by a time and a jitter",
    "clock": "any sensor: stamps off by an offset and a drift",
    "occlusion": "camera: a blob on the lens covers or blurs part of the picture",
    "blocked_sector": "scanner: something right before it takes the beams between two bearings",
    "dead_beams": "scanner: beams that report nothing",
    "dead_cells": "floor: elements, rows or columns that always read the same",
}
"""Kinds of fault of a scenario, with one line on each."""

_DESCRIPTION = re.compile(r"^description:.*?(?=^\w|\Z)", re.MULTILINE | re.DOTALL)
"""The field of this name at the outermost level of a YAML file."""


def load_yaml(name: str) -> dict[str, Any]:
    """Load a shipped YAML file by its path below `MODELS`."""
    return parse_yaml(read_text(MODELS / name, "a shipped file"), name, "a mapping")


def scenario_sensors(name: str) -> list[str]:
    """Name the sensors of a shipped scenario; 'drawn' where every seed draws its own."""
    sensors = _scenario_sensors(name)
    return ["drawn"] if "kind" in sensors else [each for each, content in sensors.items() if content is not None]


@cache
def _scenario_sensors(name: str) -> dict[str, Any]:
    content = load_yaml(f"scenarios/{name}.yaml")
    parent = content.get("extends")
    return deep_merge({} if parent is None else _scenario_sensors(parent), content.get("sensors") or {})


def first_description(folder: str, name: str) -> str:
    """Read the description of a shipped scenario, suite or study, or the first sentence of a room's file, as one line."""
    if folder == "rooms":
        comment = read_text(find(folder, name), "a room").partition("<!--")[2].partition("-->")[0]
        return re.split(r"(?<=\.)\s", " ".join(comment.split()), maxsplit=1)[0]
    text = read_text(MODELS / folder / f"{name}{_SUFFIX[folder]}", "a shipped file")
    alone = _DESCRIPTION.search(text)  # parsed alone: `twin list` shows dozens
    content = parse_yaml(alone[0], name, "a mapping") if alone else {}
    return " ".join(str(content.get("description", "")).split())
