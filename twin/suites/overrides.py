"""Overrides of a suite's scenarios, and the source of each in the user's files."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass

from twin.suites.spec import Overrides, Suite, SuiteScenario


@dataclass(frozen=True)
class Variant:
    """One scenario of a suite with one combination of its overrides.

    number: the entry's index under `scenarios`; listed: field that lists the trackers; overrides: all of the suite's file,
    as applied; own: those that distinguish it from the entry's other variants; changes: 'path=value' texts of the command
    line, applied last; sources: fields of the suite's file with their overrides, of two of one path the last counts.
    """

    number: int
    entry: SuiteScenario
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
            if (reached := _deeper(path, field)) is not None:
                return f"--set {text}: {reached}"
        for path in reversed(self.overrides):
            if (reached := _deeper(path, field)) is not None:
                where = next(where for where, changes in reversed(self.sources) if path in changes)
                return f"{where}.{reached}"
        return None


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
            number,
            entry,
            trackers=entry.trackers or suite.trackers,
            listed=f"{here}.trackers" if entry.trackers else "trackers",
            overrides={**suite.set, **entry.set, **own},
            own=own,
            changes=tuple(changes),
            sources=sources,
        )


def format_overrides(changes: Overrides) -> tuple[str, ...]:
    """Format overrides as 'path=value', the value as JSON, which is YAML too."""
    return tuple(f"{path}={json.dumps(value, ensure_ascii=False)}" for path, value in changes.items())


def _deeper(path: str, field: str) -> str | None:
    """Return the longer of two paths where one contains the other, else None."""
    if field == path or field.startswith(f"{path}."):
        return field
    return path if path.startswith(f"{field}.") else None
