"""Digests of all inputs of results: scenarios, rooms, prior files, code, models, versions, the renderer."""

from __future__ import annotations

import ast
import hashlib
import json
import os
import sys
import sysconfig
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass
from functools import cache
from glob import glob
from importlib.machinery import PathFinder
from pathlib import Path
from typing import Any

import trackers
import twin
from trackers.errors import InputError
from trackers.presets import PRESETS, available
from trackers.user_input.plain_data import parse_yaml
from twin import version_of
from twin.models import MODELS
from twin.room.files import room_files
from twin.scenario import Scenario

_PACKAGES = {"twin": Path(twin.__file__).parent, "trackers": Path(trackers.__file__).parent}

_SIMULATING = ("twin.world.simulation", "twin.recording.writer")
"""Code that makes a recording; `twin.run.live` only connects the two."""

_MOVING = ("twin.world.world",)
"""Code that moves people, independent of sensors."""

_LIBRARIES = ("mujoco", "numpy", "scipy", "opencv-python-headless", "rosbags")


def recording_key(resolved: str, renderer: str) -> str:
    """Compute the key of the recording of a resolved scenario (YAML, seed included, without trackers)."""
    content = parse_yaml(resolved, "a resolved scenario", "a scenario")
    return _sha256(resolved, renderer, simulation_code(), *_room(content["room"]))[:32]


def people_key(scenario: Scenario) -> str:
    """Compute the key of the motion of a scenario's people: a digest of all its inputs, without sensors."""
    people = scenario.model_dump_json(
        include={"room", "area", "duration_s", "seed", "people", "randomize", "clearance_m"}
    )
    return f"people-{_sha256(people, simulation_code(_MOVING), *_room(scenario.room))[:32]}"


@dataclass(frozen=True)
class Provenance:
    """Digests of all inputs of a case's metrics besides this package's own code ("": none of the kind)."""

    scenario: str
    simulation: str
    room: str
    tracker: str
    prior: str

    @classmethod
    def read(cls, text: str) -> Provenance | None:
        """Read the output of `write`; None for anything else."""
        try:
            digests = json.loads(text)
            if "knowledge" in digests:  # the former name, in older stores
                digests["prior"] = digests.pop("knowledge")
            return cls(**digests)
        except (ValueError, TypeError):
            return None

    def write(self) -> str:
        """Return the digests as JSON."""
        return json.dumps(asdict(self))

    def changed(self, before: Provenance | None) -> list[str]:
        """Name the inputs that differ; all where `before` is unknown."""
        return [name for name, digest in asdict(self).items() if before is None or getattr(before, name) != digest]


@dataclass(frozen=True)
class RecordedInput:
    """Bag of a suite, its rig, the table of its truth (None without one), and a digest of all three."""

    path: Path
    rig: Path | None
    truth: Path | None
    digest: str

    @classmethod
    def of(cls, path: Path, rig: Path | None, truth: Path | None) -> RecordedInput:
        """Digest the files. Raises InputError for an unreadable one."""
        digest = hashlib.sha256()
        for file in (*(sorted(path.rglob("*")) if path.is_dir() else [path]), rig, truth):
            if file is None or file.is_dir():
                digest.update(b"-")
                continue
            try:
                with file.open("rb") as stream:
                    digest.update(hashlib.file_digest(stream, "sha256").digest())
            except OSError as error:
                raise InputError(
                    f"{file}: cannot be read ({error.strerror}); the file of a suite's recording is expected"
                ) from error
        return cls(path, rig, truth, digest.hexdigest()[:32])


def bags_of(folder: Path, recording: str) -> dict[Path, str]:
    """Return the bags of a path or pattern relative to a folder, each with its name.

    That is the name of its file or folder, with those of the folders above that tell it from the others. Raises InputError for
    none.
    """
    bags = [folder / recording]
    if not bags[0].exists():
        bags = sorted(folder / each for each in glob(recording, root_dir=folder, recursive=True))
    if not bags:
        raise InputError(f"recording: no bag is {folder / recording}; a bag, or a pattern of several, is expected")
    parts = []
    for bag in bags:
        *above, last = bag.resolve().parts
        own = [] if last == "recording.mcap" else [last if bag.is_dir() else Path(last).stem]
        parts.append([*above, *own])
    names = [each[-1] for each in parts]
    for depth in range(2, max(map(len, parts))):
        held = Counter(names)
        names = ["-".join(each[-depth:]) if held[name] > 1 else name for each, name in zip(parts, names, strict=True)]
    return dict(zip(bags, names, strict=True))


def digest_of(*parts: str | bytes) -> str:
    """Compute the first 16 hexadecimal digits of a SHA-256 over parts, including their lengths."""
    return _sha256(*parts)[:16]


def provenance_of(
    resolved: str, room: str, trackers: Iterable[tuple[str, Mapping[str, Any]]], prior: str
) -> Provenance:
    """Digest all inputs of a case.

    resolved: the scenario, its seed included; room: `room_digest` of its room; trackers: arguments of `make_tracker`, name
    and options; prior: digest of the files given to trackers.
    """
    tracking = [
        part for name, options in trackers for part in (name, json.dumps(options, sort_keys=True), plug_in_code(name))
    ]
    return Provenance(digest_of(resolved), simulation_code()[:16], room, digest_of(*tracking), prior)


def room_digest(name: str) -> str:
    """Digest a user's own room with every file that it reads; "" for a shipped one (see `simulation_code`)."""
    contents = list(_room(name))
    return digest_of(*contents) if contents else ""


def plug_in_code(name: str) -> str:
    """Digest the source of a user's own tracker and of its imports that are not installed; "" for a preset.

    Nothing is imported: a class not yet imported by this process has the digest "" too.
    """
    if name in PRESETS:
        return ""
    installed = available().get(name)
    module = (installed.target if installed else name).partition(":")[0]
    if module not in sys.modules:
        return ""
    return digest_of(*(part for path in sorted(_own_sources(module)) for part in (path.name, path.read_bytes())))


@cache
def simulation_code(modules: tuple[str, ...] = _SIMULATING) -> str:
    """Digest every module that takes part in a recording, the models, and the libraries' versions.

    Changes of trackers, metrics and reports leave recordings valid.
    """
    files = sorted([*_with_imports(modules, _file_of), *_files(MODELS / "people"), *_files(MODELS / "rooms")])
    content = (part for path in files for part in (path.name, path.read_bytes()))
    return _sha256(*content, *(f"{library} {version_of(library)}" for library in _LIBRARIES))


@cache
def whole_code() -> str:
    """Digest both packages, learned files included: results of one suite must come from one state of the code."""
    return digest_of(
        *(
            part
            for package in _PACKAGES.values()
            for path in sorted([*package.rglob("*.py"), *package.rglob("*.npz")])
            for part in (path.relative_to(package).as_posix(), path.read_bytes())
        )
    )


def _sha256(*parts: str | bytes) -> str:
    """Compute the SHA-256 over parts, including their lengths."""
    digest = hashlib.sha256()
    for part in parts:
        content = part.encode() if isinstance(part, str) else part
        digest.update(len(content).to_bytes(8, "little"))
        digest.update(content)
    return digest.hexdigest()


def _files(folder: Path) -> Iterator[Path]:
    return (path for path in folder.rglob("*") if path.is_file())


def _room(name: str) -> Iterator[bytes]:
    """Yield the contents of a user's own room: its file and every file named in it."""
    path = Path(name)
    if not path.is_file():  # a shipped one, among the models
        return
    for part, content in room_files(path).items():
        yield os.path.relpath(part.resolve(), path.parent.resolve()).encode()
        yield content


def _own_sources(module: str) -> set[Path]:
    """Find the files of a loaded module and of its imports, loaded or not: a function may import at its first call.

    Of installed packages only its own.
    """
    installed = [Path(sysconfig.get_path(name)).resolve() for name in ("stdlib", "platstdlib", "purelib", "platlib")]

    def own_file(name: str) -> Path | None:
        package = name.partition(".")[0]
        file = None if package in _PACKAGES else _source_of(name)
        if file is None:
            return None
        path = Path(file).resolve()
        is_others = package != module.partition(".")[0] and any(path.is_relative_to(folder) for folder in installed)
        return path if path.suffix == ".py" and not is_others else None

    return _with_imports([module], own_file)


def _source_of(name: str) -> str | None:
    """Find the file of a module without importing it; None for one without, or that is not there."""
    if (loaded := sys.modules.get(name)) is not None:
        return getattr(loaded, "__file__", None)
    places, spec = None, None
    for part in name.split("."):
        spec = PathFinder.find_spec(part, places)
        if spec is None:
            return None
        places = spec.submodule_search_locations or ()
    return spec.origin if spec is not None else None


def _with_imports(names: Iterable[str], file_of: Callable[[str], Path | None]) -> set[Path]:
    """Find the files of these modules and of all that they import, at any depth, of which `file_of` has a file."""
    waiting, found = list(names), set()
    while waiting:
        name = waiting.pop()
        path = file_of(name)
        if path is None or path in found:
            continue
        found.add(path)
        if "." in name:
            waiting.append(name.rpartition(".")[0])  # a package is loaded before what is in it
        if path.parent in _PACKAGES.values() and path.name == "__init__.py":
            continue  # its names are loaded one by one, each imported from its own module
        waiting += _imported(path.read_bytes(), name if path.name == "__init__.py" else name.rpartition(".")[0])
    return found


@cache
def _imported(source: bytes, package: str) -> list[str]:
    """List what a module of a package imports, at its start or in its functions: modules, and names that may be modules."""
    imported: list[str] = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            imported += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = package.rsplit(".", node.level - 1)[0] if node.level else ""
            start = ".".join(part for part in (base, node.module) if part)
            imported += [start, *(f"{start}.{alias.name}" for alias in node.names)]
    return imported


def _file_of(module: str) -> Path | None:
    """Find the file of a module of `twin` or `trackers`; None for any other name."""
    package, *rest = module.split(".")
    if package not in _PACKAGES:
        return None
    path = _PACKAGES[package].joinpath(*rest)
    for candidate in (path / "__init__.py", path.with_suffix(".py") if rest else path / "__init__.py"):
        if candidate.is_file():
            return candidate
    return None
