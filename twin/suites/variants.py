"""Variants of a suite's entries: the overrides of each case, and the field of the suite that gave each of them."""

from __future__ import annotations

import json
import re
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from trackers.errors import InputError
from trackers.rig import files_within
from twin.suites.spec import Overrides, Suite


@dataclass(frozen=True)
class Variant:
    """One scenario or recording of a suite with one combination of its overrides.

    field: that names the scenario or the bag; listed: field that lists the trackers; overrides: all of the suite's file, as
    applied; own: those that distinguish it from the entry's other variants; changes: 'path=value' texts of the command line,
    applied last; sources: fields of the suite's file with their overrides, of two of one path the last counts.
    """

    field: str
    trackers: tuple[str, ...]
    listed: str
    overrides: Overrides
    own: Overrides
    changes: tuple[str, ...]
    sources: tuple[tuple[str, Collection[str]], ...]

    def written(self, field: str) -> str | None:
        """Find the source of a field's last override: a path in the suite, or '--set path=value: path'.

        None where only the scenario's own file can have set it.
        """
        for text in reversed(self.changes):
            path = text.partition("=")[0].strip()
            if (reached := deeper(path, field)) is not None:
                return f"--set {text}: {reached}"
        for path in reversed(self.overrides):
            if (reached := deeper(path, field)) is not None:
                where = next(where for where, changes in reversed(self.sources) if path in changes)
                return f"{where}.{reached}"
        return None

    def title(self) -> str:
        """Format the settings that distinguish this variant from the others of its entry, short."""
        return ", ".join(_short(text) for text in format_overrides(self.own))

    def followed(self, folder: Path) -> tuple[str, ...]:
        """Return all 'path=value' texts for the trackers of a recording; the suite's own files are relative to `folder`."""
        own = {
            path: value if path.startswith("trackers") else files_within(value, folder)
            for path, value in self.overrides.items()
        }
        return (*format_overrides(own), *self.changes)


_LONGEST = 60


def _short(text: str) -> str:
    text = text.replace('"', "")
    return text if len(text) <= _LONGEST else text[: _LONGEST - 1] + "…"


def variants(suite: Suite, number: int, changes: Sequence[str] = ()) -> Iterator[Variant]:
    """Yield the variants of one entry of the suite, in order."""
    entry, here = suite.scenarios[number], f"scenarios.{number}"
    combinations = entry.combinations()
    per_variant = len(combinations) // len(entry.variants)
    for place, own in enumerate(combinations):
        which = place // per_variant
        sources = (
            ("set", suite.set),
            (f"{here}.set", entry.set),
            (f"{here}.grid", entry.grid),
            (f"{here}.variants.{which}", entry.variants[which]),
        )
        yield Variant(
            f"{here}.scenario",
            trackers=entry.trackers or suite.trackers,
            listed=f"{here}.trackers" if entry.trackers else "trackers",
            overrides={**suite.set, **entry.set, **own},
            own=own,
            changes=tuple(changes),
            sources=sources,
        )


def recorded_variant(suite: Suite, number: int, changes: Sequence[str] = ()) -> Variant:
    """Return the entry `number` of `recordings` with what its trackers follow of each `set` and of the command line.

    Raises InputError for what changes nothing of a recording: in its own `set`, and in the suite's where it has no scenarios.
    """
    entry, here = suite.recordings[number], f"recordings.{number}"
    followed: list[Overrides] = []
    for where, given in (("set", suite.set), (f"{here}.set", entry.set)):
        idle = [path for path in given if not is_of_trackers(path)]
        if idle and not (suite.scenarios and where == "set"):
            raise InputError(
                f"{where}.{idle[0]}: changes nothing of a recording; trackers.NAME.OPTION or prior.… is expected"
            )
        followed.append({path: value for path, value in given.items() if path not in idle})
    return Variant(
        f"{here}.recording",
        trackers=entry.trackers or suite.trackers,
        listed=f"{here}.trackers" if entry.trackers else "trackers",
        overrides=followed[0] | followed[1],
        own={},
        changes=tuple(change for change in changes if is_of_trackers(change)),
        sources=(("set", suite.set), (f"{here}.set", entry.set)),
    )


def is_of_trackers(change: str) -> bool:
    """Return whether 'path' or 'path=value' changes trackers or their prior files, and so what comes of a recording too."""
    return re.split(r"[.=]", change.strip(), maxsplit=1)[0].strip() in ("trackers", "prior", "knowledge")


def format_overrides(changes: Overrides) -> tuple[str, ...]:
    """Format overrides as 'path=value', the value as JSON, which is YAML too."""
    return tuple(f"{path}={json.dumps(value, ensure_ascii=False)}" for path, value in changes.items())


def deeper(path: str, field: str) -> str | None:
    """Return the longer of two paths where one contains the other, else None."""
    if field == path or field.startswith(f"{path}."):
        return field
    return path if path.startswith(f"{field}.") else None


def place_of(variant: Variant, file: Path, field: str) -> str:
    """Locate a field in the user's input: in the suite, on the command line, or else in the file of the scenario or bag."""
    if not field:
        return variant.field.rpartition(".")[0]
    return variant.written(field) or f"{variant.field}: {file}: {field}"
