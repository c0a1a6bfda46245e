"""Files of results: that of a run, a new one, an earlier one to resume, or any for reading; and baselines.

A baseline is one JSON file of results to be committed, one line per seed.
"""

from __future__ import annotations

import json
import os
import re
import sqlite3
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from pydantic import Field

from trackers.configuration import Strict, validate
from trackers.errors import InputError
from trackers.user_input.plain_data import parse_json
from trackers.user_input.text_file import read_text
from twin.messages import counted
from twin.recording.atomic_file import write_atomic
from twin.run.out_folder import check_others, locked_folder
from twin.suites.cache import fault_of
from twin.suites.expansion import Case, with_variant
from twin.suites.metrics import GATED, GATED_SENSOR_METRICS, PERSON_FRAMES
from twin.suites.results import Group, GroupKey, Results, collect_results
from twin.suites.store import EXPECTED, OverridesText, ResultStore, StoredCase, fault_of_file

RESULTS_FILE = "results.sqlite"
_WRITTEN = ("summary.json", "report.html", "junit.xml", "cases", "logs")

REPORT, CASE_METRICS = "report.html", "metrics.json"
"""Files of a case."""

_WITH_NUMBER = re.compile(r"[\w-]*\d[\w.-]*")
"""A number, or a name that holds one, as those of drawn people."""

_OF_SUITE = ("description", "reference", "tolerances", "requirements")
"""Facts by which results are judged: those of the present suite hold."""


def kind_of_warning(text: str) -> str:
    """Return a warning without the numbers in it, by which cases that differ in a seed are warned of once."""
    return _WITH_NUMBER.sub("#", text)


def case_page(folder: Path, case_id: str, names: Sequence[str] = (REPORT, CASE_METRICS)) -> Path:
    """Return the first of these files that a case of the run in `folder` has, else the last: its report, if it has one."""
    paths = [folder / "cases" / case_id / name for name in names]
    return next((each for each in paths if each.is_file()), paths[-1])


@contextmanager
def open_store(
    folder: Path,
    cases: Sequence[Case],
    facts: Mapping[str, Any],
    resume: bool,
    warn: Callable[[str], object] = lambda warning: None,
) -> Iterator[ResultStore]:
    """Open the results in `folder` for writing, locked during the block.

    A new file holds the cases and `facts`; `resume` continues an earlier one. Cases whose inputs changed (scenario, room,
    tracker, prior files), or whose files did, are run again, with a warning to `warn`. Raises InputError where another process
    writes, where results exist without `resume`, and where they are of other cases, or of another suite, other changes or
    other code.
    """
    path = folder / RESULTS_FILE
    with locked_folder(folder):
        exists = path.exists()
        if exists and not resume:
            raise InputError(
                f"--out {folder}: holds the results of an earlier run; --resume to do the rest of it, or another folder, "
                "is expected"
            )
        check_others(folder, _WRITTEN, RESULTS_FILE)
        with _connected(path) as connection:
            store = ResultStore(connection, path)
            if exists and _is_defined(connection, path):
                with _sound(path):
                    _check_whole(connection, path)
                    _check_same(store, cases, facts)
                    damaged = {each.id for each in cases if fault_of(folder / "cases" / each.id)}
                    changed = store.resume(cases, damaged)
                store.note(**{name: facts[name] for name in _OF_SUITE if name in facts})
                if changed:
                    warn(rerun_warning(changed, len(cases)))
            else:
                with _sound(path):
                    store.create(cases)
                store.note(**facts)
            yield store


@contextmanager
def read_store(folder: Path) -> Iterator[ResultStore]:
    """Open the results in `folder` for reading, also during a run. Raises InputError where there are none."""
    path = folder / RESULTS_FILE
    if not path.is_file():
        raise InputError(f"{folder}: has no {RESULTS_FILE}; a folder that `twin suite run` has written is expected")
    is_ours = os.access(path, os.W_OK) and os.access(folder, os.W_OK)
    with _sound(path), (_connected if is_ours else _read_alone)(path) as connection:
        yield ResultStore(connection, path)


@contextmanager
def _read_alone(path: Path) -> Iterator[sqlite3.Connection]:
    """Open a file in a read-only folder, where sqlite could not read otherwise; no process writes it meanwhile."""
    if (waiting := path.with_name(f"{RESULTS_FILE}-wal")).exists() and waiting.stat().st_size:
        raise InputError(
            f"{path}: is read-only, and holds what a run has not finished writing; a file and a folder that this user may "
            "write are expected"
        )
    connection = sqlite3.connect(f"{path.absolute().as_uri()}?immutable=1", uri=True)
    try:
        yield connection
    finally:
        connection.close()


def rerun_warning(changed: Mapping[str, Sequence[str]], n_all: int) -> str:
    """Format the warning that cases are run again because of changed inputs."""
    what = " and ".join(dict.fromkeys(part for parts in changed.values() for part in parts))
    first, *more = changed
    on = f" ({first} and {len(more)} more)" if more else f" ({first})"
    return f"--resume: {len(changed)} of {n_all} results are done again{on}: {what} changed since"


def _is_defined(connection: sqlite3.Connection, path: Path) -> bool:
    """Return whether the file has all tables; a run killed at its start leaves one without."""
    with _sound(path):
        query = "SELECT 1 FROM sqlite_master WHERE name = 'moments_of_case'"
        return connection.execute(query).fetchone() is not None


def _check_whole(connection: sqlite3.Connection, path: Path) -> None:
    """Raise InputError where any page of the file is damaged, also one read only at the end of the run."""
    found = connection.execute("PRAGMA quick_check(1)").fetchone()[0]
    if found != "ok":
        raise InputError(f"{path}: is damaged ({' '.join(found.split())}); {EXPECTED}, or another folder, is expected")


@contextmanager
def _sound(path: Path) -> Iterator[None]:
    try:
        yield
    except sqlite3.OperationalError as error:
        if fault := fault_of_file(error):
            raise InputError(f"{path}: {fault}") from error
        raise InputError(f"{path}: is no file of results ({error}); {EXPECTED} is expected") from error
    except sqlite3.DatabaseError as error:
        raise InputError(f"{path}: is no file of results ({error}); {EXPECTED} is expected") from error


def _check_same(store: ResultStore, cases: Sequence[Case], facts: Mapping[str, Any]) -> None:
    held = store.facts()
    where = f"--resume: {store.path}"
    if held.get("suite") != facts.get("suite"):
        raise InputError(
            f"{where}: holds the suite {held.get('suite')!r}, not {facts.get('suite')!r}; the same suite, or another folder, is "
            "expected"
        )
    there, asked = {each.id: each for each in store.cases()}, {each.id: each for each in cases}
    missing = [each for name, each in asked.items() if name not in there]
    left_out = [each for name, each in there.items() if name not in asked]
    if missing or left_out:
        lacks = [f"lacks {_named(missing)}"] if missing else []
        lacks += [f"has {_named(left_out)} besides"] if left_out else []
        raise InputError(
            f"{where}: was made of other cases of the suite {held.get('suite')!r}: it {' and '.join(lacks)}; the suite as it "
            "was, or another folder, is expected"
        )
    if held.get("changes") != facts.get("changes"):
        raise InputError(f"{where}: was run with --set {held.get('changes')}; the same, or another folder, is expected")
    if held.get("code") != facts.get("code"):
        raise InputError(
            f"{where}: was made by other code, and results of two versions must not mix; another folder is expected "
            "(recordings that are still good are not made again)"
        )


def _named(cases: Sequence[Case | StoredCase]) -> str:
    """Name the first of some cases, by what a suite's file says of it, and count the others."""
    first, *more = cases
    one = ", ".join((with_variant(first.scenario, first.variant), f"seed {first.seed}", first.tracker))
    return f"{one}, and {counted(len(more), 'more case')}" if more else one


@contextmanager
def _connected(path: Path) -> Iterator[sqlite3.Connection]:
    connection = sqlite3.connect(path, timeout=30)
    try:
        with _sound(path):
            connection.execute("PRAGMA journal_mode = WAL")
            connection.execute("PRAGMA synchronous = NORMAL")
        yield connection
    finally:
        connection.close()


NOTHING_COMPARED = "nothing could be compared; the same scenarios, changes, trackers and seeds are expected in both"
_BASELINE_EXPECTED = "a baseline that `twin suite run --update-baseline` has written"


class _StoredGroup(Strict):
    """Group as stored in the file; older files lack the digests."""

    scenario: str
    variant: str
    overrides: OverridesText
    seeds: dict[int, dict[str, float | None]]
    recordings: dict[int, str] = Field(default_factory=dict)
    recipes: dict[int, str] = Field(default_factory=dict)
    people: dict[int, str] = Field(default_factory=dict)

    def group(self) -> Group:
        return Group(self.variant, self.seeds, recordings=self.recordings, recipes=self.recipes, people=self.people)


class _StoredTracker(_StoredGroup):
    tracker: str


class _StoredSensor(_StoredGroup):
    sensor: str


class _Baseline(Strict):
    suite: str
    versions: dict[str, str | None]
    renderers: list[str] = Field(default_factory=list)
    groups: list[_StoredTracker]
    sensors: list[_StoredSensor] = Field(default_factory=list)


def read_baseline(path: Path) -> Results:
    """Read the results in a baseline. Raises InputError for any other file."""
    content = parse_json(read_text(path, _BASELINE_EXPECTED), str(path), _BASELINE_EXPECTED)
    if not isinstance(content, dict) or "groups" not in content:
        raise InputError(f"{path}: is no baseline, as it has no groups; {_BASELINE_EXPECTED} is expected")
    if "cases" in content:
        raise InputError(f"{path}: is the summary of a run, and no baseline; {_BASELINE_EXPECTED} is expected")
    held = validate(_Baseline, content, str(path))
    return Results(
        suite=held.suite,
        versions=held.versions,
        renderers=tuple(held.renderers),
        groups={GroupKey(each.scenario, each.overrides, each.tracker): each.group() for each in held.groups},
        sensors={GroupKey(each.scenario, each.overrides, each.sensor): each.group() for each in held.sensors},
    )


def write_baseline(path: Path, results: Results) -> None:
    """Write compared metrics and person-frames; raises InputError where some are missing or the file cannot be written."""
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
    groups = _lines(results.groups, "tracker", (*GATED, PERSON_FRAMES))
    sensors = _lines(results.sensors, "sensor", tuple(GATED_SENSOR_METRICS))
    write_atomic(path, f'{text},\n  "groups": [\n{groups}\n  ],\n  "sensors": [\n{sensors}\n  ]\n}}\n')


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


def baseline_of(suite: str, baseline: Path | None, update: bool) -> Results | None:
    """Read the results to compare with; None without any. Raises InputError for those of another suite."""
    if baseline is None or (update and not baseline.exists()):
        return None
    before = read_baseline(baseline)
    if before.suite != suite:
        raise InputError(f"--baseline {baseline}: is of the suite {before.suite!r}; one of {suite!r} is expected")
    return None if update else before


def held_baseline(store: ResultStore) -> Results | None:
    """Read the baseline that a run was compared with; None where there is none any more."""
    baseline = store.facts().get("baseline")
    return read_baseline(Path(baseline)) if baseline and Path(baseline).is_file() else None


def check_comparable(before: Results | None, source: str, cases: Sequence[Case]) -> None:
    """Raise InputError if no case is one of the results to compare with, whatever its tracker."""
    if before is None:
        return
    held = {(key.scenario, key.overrides, seed) for key, group in before.groups.items() for seed in group.seeds}
    if not any((case.scenario, json.dumps(case.overrides, ensure_ascii=False), case.seed) in held for case in cases):
        raise InputError(f"{source}: {NOTHING_COMPARED}")


def read_results(path: Path) -> Results:
    """Read the results of a suite's folder, its results.sqlite or a baseline. Raises InputError for anything else."""
    if path.suffix == ".json":
        return read_baseline(path)
    with read_store(run_folder(path)) as store:
        return collect_results(store)


def run_folder(path: Path) -> Path:
    """Return the folder of results that are given by it or by their file in it."""
    return path.parent if path.name == RESULTS_FILE else path
