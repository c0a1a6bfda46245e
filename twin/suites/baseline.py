"""Read and write a baseline: the results to compare with, in one JSON file to be committed, one line per seed."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pydantic import Field

from trackers.configuration import Strict, validate
from trackers.errors import InputError
from trackers.plain_data import parse_json
from trackers.text_file import read_text
from twin.recording.atomic_file import open_atomic
from twin.suites.metrics import GATED, GATED_SENSOR_METRICS
from twin.suites.results import Group, GroupKey, Results
from twin.suites.store_files import RESULTS_FILE, read_store

_EXPECTED = "a baseline that `twin suite run --update-baseline` has written"


class _Held(Strict):
    """A group as the file holds it; what files of before the digests were kept lack is unknown."""

    scenario: str
    variant: str
    overrides: str
    seeds: dict[int, dict[str, float | None]]
    recordings: dict[int, str] = Field(default_factory=dict)
    recipes: dict[int, str] = Field(default_factory=dict)
    people: dict[int, str] = Field(default_factory=dict)

    def group(self) -> Group:
        return Group(self.variant, self.seeds, recordings=self.recordings, recipes=self.recipes, people=self.people)


class _HeldTracker(_Held):
    tracker: str


class _HeldSensor(_Held):
    sensor: str


class _Baseline(Strict):
    suite: str
    versions: dict[str, str | None]
    renderers: list[str] = Field(default_factory=list)
    groups: list[_HeldTracker]
    sensors: list[_HeldSensor] = Field(default_factory=list)


def read_baseline(path: Path) -> Results:
    """Read the results in a baseline. Raises InputError for any other file."""
    content = parse_json(read_text(path, _EXPECTED), str(path), _EXPECTED)
    held = validate(_Baseline, content, str(path))
    return Results(
        suite=held.suite,
        versions=held.versions,
        renderers=tuple(held.renderers),
        groups={GroupKey(each.scenario, each.overrides, each.tracker): each.group() for each in held.groups},
        sensors={GroupKey(each.scenario, each.overrides, each.sensor): each.group() for each in held.sensors},
    )


def write_baseline(path: Path, results: Results) -> None:
    """Write the figures that are compared; raises InputError where some are missing or the file cannot be written."""
    if results.failed or results.unfinished:
        raise InputError(
            f"{path}: not written: {len(results.failed)} cases failed and {results.unfinished} are not finished; "
            "a whole run is expected of a baseline"
        )
    head: Mapping[str, Any] = {
        "suite": results.suite,
        "versions": dict(results.versions),
        "renderers": list(results.renderers),
    }
    text = json.dumps(head, ensure_ascii=False, indent=2)[:-2]
    groups = _lines(results.groups, "tracker", tuple(GATED))
    sensors = _lines(results.sensors, "sensor", tuple(GATED_SENSOR_METRICS))
    with open_atomic(path) as stream:
        stream.write(f'{text},\n  "groups": [\n{groups}\n  ],\n  "sensors": [\n{sensors}\n  ]\n}}\n')


def _lines(groups: Mapping[GroupKey, Group], whose: str, metrics: Sequence[str]) -> str:
    """Format the groups as JSON, one line per seed; `whose`: "tracker" or "sensor"."""
    return ",\n".join(_text(key, group, whose, metrics) for key, group in groups.items())


def _text(key: GroupKey, group: Group, whose: str, metrics: Sequence[str]) -> str:
    seeds = ",\n".join(
        f"      {json.dumps(str(seed))}: {json.dumps({name: figures.get(name) for name in metrics})}"
        for seed, figures in sorted(group.seeds.items())
    )
    about = {
        "scenario": key.scenario,
        "variant": group.variant,
        "overrides": key.overrides,
        whose: key.tracker,
        "recordings": {str(seed): digest for seed, digest in sorted(group.recordings.items())},
        "recipes": {str(seed): digest for seed, digest in sorted(group.recipes.items())},
        "people": {str(seed): digest for seed, digest in sorted(group.people.items())},
    }
    return f'    {json.dumps(about, ensure_ascii=False)[:-1]}, "seeds": {{\n{seeds}}}}}'


def read_results(path: Path) -> Results:
    """Read the results of a suite's folder, its results.sqlite or a baseline. Raises InputError for anything else."""
    from twin.suites.results import collect_results

    folder = path.parent if path.name == RESULTS_FILE else path
    if path.suffix == ".json":
        return read_baseline(path)
    with read_store(folder) as store:
        return collect_results(store)
