"""CHANGELOG.md: the form of Keep a Changelog; commands, options, files and modules that it names are there.

Under Changed, Deprecated and Removed stand the former names too.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

import typer.main
from pydantic import BaseModel

from trackers.presets import PRESETS
from twin.cli import app

ROOT = Path(__file__).parents[1]
TEXT = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
KINDS = ("Added", "Changed", "Deprecated", "Removed", "Fixed", "Security")
HELP = {"-h", "--help"}
PATH = re.compile(r"(?:twin|trackers|scripts|models|tests|docs)/[\w/.-]+|(?:twin|trackers)(?:\.\w+)+")


def named() -> Iterator[tuple[int, str]]:
    """Yield line and content of everything in backticks, but under the headings where former names stand."""
    sections = re.split(r"^(?=###? )", TEXT, flags=re.MULTILINE)
    line = 1
    for section in sections:
        if not section.startswith(("### Changed", "### Deprecated", "### Removed")):
            for found in re.finditer(r"`([^`\n]+(?:\n[^`\n]+)?)`", section):
                yield line + section.count("\n", 0, found.start()), " ".join(found[1].split())
        line += section.count("\n")


def options_of(command: Any) -> set[str]:
    """Return the options of a command and of those below it."""
    below = getattr(command, "commands", {}).values()
    return HELP.union(*((*each.opts, *each.secondary_opts) for each in command.params), *map(options_of, below))


COMMANDS: Any = typer.main.get_command(app)
"""The command of which all others are a part."""


def wrong_command(words: list[str]) -> str | None:
    """Say what a command line has that there is not."""
    command = COMMANDS
    while hasattr(command, "commands") and words and re.fullmatch(r"[a-z-]+", words[0]) and words[0][0] != "-":
        if words[0] not in command.commands:
            return f"there is no command {words[0]}"
        command, words = command.commands[words[0]], words[1:]
    given = {re.split("[=/,]", word)[0] for word in words if re.match("--?[a-z]", word)}
    unknown = given - (options_of(command) | {"--version"})
    return f"there are no options {', '.join(sorted(unknown))}" if unknown else None


def wrong_path(name: str) -> str | None:
    """Say which file, module or name in one is not there."""
    if "/" in name:
        return None if (ROOT / name).exists() else "there is no such file"
    try:
        resolve_name(name)
    except (ImportError, AttributeError) as error:
        return str(error)
    return None


def option_paths(model: type[BaseModel], at: str = "") -> Iterator[str]:
    """Yield the paths of a model's options and groups."""
    for name, info in model.model_fields.items():
        yield f"{at}{name}"
        for kind in (info.annotation, *getattr(info.annotation, "__args__", ())):
            if isinstance(kind, type) and issubclass(kind, BaseModel):
                yield from option_paths(kind, f"{at}{name}.")


def tracker_options() -> tuple[set[str], set[str]]:
    """Return the paths of all options of trackers, and the names of groups of them, former ones too."""
    paths, groups = set[str](), set[str]()
    for target in {preset.target for preset in PRESETS.values()}:
        model = resolve_name(target).Options
        paths |= set(option_paths(model))
        groups |= {path.partition(".")[0] for path in getattr(model, "former_names", {})}
    return paths, groups | {path.partition(".")[0] for path in paths if "." in path}


def test_commands_and_options_that_the_changelog_names_are_there() -> None:
    options = options_of(COMMANDS)
    for line, name in named():
        words = name.split()
        if words[0] == "twin":
            assert (wrong := wrong_command(words[1:])) is None, f"line {line}: {name}: {wrong}"
        elif re.fullmatch(r"--[a-z-]+", words[0]):
            assert words[0] in options, f"line {line}: {name}: no command has this option"


def test_options_of_trackers_that_the_changelog_names_are_there() -> None:
    paths, groups = tracker_options()
    assert len(paths) > 200 and {"track_management", "life"} <= groups
    for line, name in named():
        path = re.match(r"([a-z_]+)(?:\.[a-z_0-9]+)+(?=[:= ]|$)", name)
        if path and path[1] in groups:
            assert path[0] in paths, f"line {line}: {name}: no tracker has this option"


def test_files_and_modules_that_the_changelog_names_are_there() -> None:
    found = [(line, path[0]) for line, name in named() if (path := PATH.match(name))]
    assert len(found) > 20
    for line, path in found:
        assert (wrong := wrong_path(path)) is None, f"line {line}: {path}: {wrong}"


def test_a_wrong_name_is_found() -> None:
    assert wrong_command(["suite", "rum", "NAME"]) and wrong_command(["run", "lab", "--sede", "1"])
    assert wrong_command(["suite", "run", "NAME", "--resume"]) is None is wrong_command(["schema"])
    assert wrong_path("twin.nowhere") and wrong_path("trackers.rig.Rigs") and wrong_path("scripts/nothing")
    assert wrong_path("trackers.rig.Rig") is None is wrong_path("twin.suites.gate.run_gate")


def test_versions_and_kinds_of_change_stand_as_keep_a_changelog_has_them() -> None:
    versions = re.findall(r"^## (.+)$", TEXT, re.MULTILINE)
    assert versions[0] == "Unreleased"
    assert all(re.fullmatch(r"\d+\.\d+\.\d+(?: \(\d{4}-\d\d-\d\d\))?", each) for each in versions[1:])
    for version in re.split(r"^## ", TEXT, flags=re.MULTILINE)[1:]:
        kinds = re.findall(r"^### (.+)$", version, re.MULTILINE)
        assert kinds == [each for each in KINDS if each in kinds], version.partition("\n")[0]
        assert re.search(r"^- ", version, re.MULTILINE)
