"""What a recording depends on besides its scenario: the code that simulates, the models, the versions, the renderer."""

from __future__ import annotations

import ast
import hashlib
import os
from collections.abc import Iterable, Iterator
from functools import cache
from importlib.metadata import version
from pathlib import Path

import yaml

import trackers
import twin
from twin.models import MODELS
from twin.room.files import room_files
from twin.scenario import Scenario

_PACKAGES = {"twin": Path(twin.__file__).parent, "trackers": Path(trackers.__file__).parent}
_SIMULATING = ("twin.world.simulation", "twin.recording.writer")
"""What makes a recording; `twin.run.live` only passes on what the first gives to the second."""
_MOVING = ("twin.world.staged",)
"""What moves people, whatever sensors look at them."""
_LIBRARIES = ("mujoco", "numpy", "scipy", "opencv-python-headless", "rosbags")


def recording_key(resolved: str, renderer: str) -> str:
    """The name under which the recording of a resolved scenario (YAML, seed included, without trackers) is kept."""
    content = yaml.load(resolved, getattr(yaml, "CSafeLoader", yaml.SafeLoader))
    digest = hashlib.sha256()
    for part in (resolved, renderer, simulation_code(), *_room(content["room"])):
        _add(digest, part.encode() if isinstance(part, str) else part)
    return digest.hexdigest()[:32]


def people_key(scenario: Scenario) -> str:
    """The name under which the motion of a scenario's people is kept: of whatever they depend on, sensors left out."""
    digest = hashlib.sha256()
    people = scenario.model_dump_json(include={"room", "area", "duration_s", "seed", "people", "vary"})
    for part in (people, simulation_code(_MOVING), *_room(scenario.room)):
        _add(digest, part.encode() if isinstance(part, str) else part)
    return f"people-{digest.hexdigest()[:32]}"


@cache
def simulation_code(modules: tuple[str, ...] = _SIMULATING) -> str:
    """A digest of every module that takes part in a recording, of the models, and of the libraries' versions.

    Trackers, metrics and reports are no part of it: changing them leaves every recording as it is.
    """
    digest = hashlib.sha256()
    for path in sorted([*_modules(modules), *_files(MODELS / "people"), *_files(MODELS / "rooms")]):
        _add(digest, path.name.encode())
        _add(digest, path.read_bytes())
    for library in _LIBRARIES:
        _add(digest, f"{library} {version(library)}".encode())
    return digest.hexdigest()


@cache
def whole_code() -> str:
    """A digest of both packages: results of one suite must not come from two states of the code."""
    digest = hashlib.sha256()
    for package in _PACKAGES.values():
        for path in sorted(package.rglob("*.py")):
            _add(digest, path.relative_to(package).as_posix().encode())
            _add(digest, path.read_bytes())
    return digest.hexdigest()[:16]


def _add(digest: hashlib._Hash, content: bytes) -> None:
    digest.update(len(content).to_bytes(8, "little"))
    digest.update(content)


def _files(folder: Path) -> Iterator[Path]:
    return (path for path in folder.rglob("*") if path.is_file())


def _room(name: str) -> Iterator[bytes]:
    """A room of the user's own: its file, and every file that it names."""
    path = Path(name)
    if not path.is_file():  # a shipped one, among the models
        return
    for part, content in room_files(path).items():
        yield os.path.relpath(part.resolve(), path.parent.resolve()).encode()
        yield content


def _modules(names: Iterable[str]) -> set[Path]:
    """The files of these modules and of all that they import from the two packages, at whatever depth."""
    waiting, found = list(names), set()
    while waiting:
        name = waiting.pop()
        path = _file_of(name)
        if path is None or path in found:
            continue
        found.add(path)
        if "." in name:
            waiting.append(name.rpartition(".")[0])  # a package is loaded before what is in it
        if path.parent in _PACKAGES.values() and path.name == "__init__.py":
            continue  # its names are loaded one by one; those that are used are imported from where they are
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                waiting += [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
                waiting += [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
    return found


def _file_of(module: str) -> Path | None:
    """The file of a module of ours; None for other people's and for a name that is no module."""
    package, *rest = module.split(".")
    if package not in _PACKAGES:
        return None
    path = _PACKAGES[package].joinpath(*rest)
    for candidate in (path / "__init__.py", path.with_suffix(".py") if rest else path / "__init__.py"):
        if candidate.is_file():
            return candidate
    return None
