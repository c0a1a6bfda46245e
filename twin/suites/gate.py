"""Suite as a gate: run, compare with the baseline, write results for people and programs.

A baseline is one JSON file of results to be committed, one line per seed.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import Any

from pydantic import Field

from trackers.configuration import Strict, validate
from trackers.errors import InputError, valid_names
from trackers.plain_data import parse_json
from trackers.text_file import read_text
from twin.console import print_paths
from twin.models import cache_folder
from twin.recording.atomic_file import check_writable, write_atomic
from twin.run.inputs import NONE_TRUSTED, TrustedClasses
from twin.suites.cache import RecordingCache, cache_limit_bytes
from twin.suites.cluster import Workers
from twin.suites.comparison import Comparison, SuiteOutcome, compare, tolerances_of
from twin.suites.dask_runner import suite_progress
from twin.suites.expansion import Case
from twin.suites.exports import write_junit, write_summary
from twin.suites.metrics import GATED, GATED_SENSOR_METRICS, allowed_by_default
from twin.suites.page import write_comparison_page, write_page
from twin.suites.result_tables import (
    markdown_comparison,
    markdown_table,
    markdown_verdict,
    print_comparison,
    print_requirements,
    print_results,
)
from twin.suites.results import Group, GroupKey, Results, collect_results, pooled
from twin.suites.run import run_suite
from twin.suites.spec import Suite, load_suite
from twin.suites.store import OverridesText, ResultStore
from twin.suites.store_files import RESULTS_FILE, read_store

_NOTHING_COMPARED = "nothing could be compared; the same scenarios, changes, trackers and seeds are expected in both"
_EXPECTED = "a baseline that `twin suite run --update-baseline` has written"


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
    content = parse_json(read_text(path, _EXPECTED), str(path), _EXPECTED)
    if not isinstance(content, dict) or "groups" not in content:
        raise InputError(f"{path}: is no baseline, as it has no groups; {_EXPECTED} is expected")
    if "cases" in content:
        raise InputError(f"{path}: is the summary of a run, and no baseline; {_EXPECTED} is expected")
    held = validate(_Baseline, content, str(path))
    return Results(
        suite=held.suite,
        versions=held.versions,
        renderers=tuple(held.renderers),
        groups={GroupKey(each.scenario, each.overrides, each.tracker): each.group() for each in held.groups},
        sensors={GroupKey(each.scenario, each.overrides, each.sensor): each.group() for each in held.sensors},
    )


def write_baseline(path: Path, results: Results) -> None:
    """Write the compared metrics; raises InputError where some are missing or the file cannot be written."""
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


def read_results(path: Path) -> Results:
    """Read the results of a suite's folder, its results.sqlite or a baseline. Raises InputError for anything else."""
    if path.suffix == ".json":
        return read_baseline(path)
    with read_store(_folder(path)) as store:
        return collect_results(store)


def _folder(path: Path) -> Path:
    return path.parent if path.name == RESULTS_FILE else path


def run_gate(
    name: str,
    out: Path | None,
    workers: Workers,
    *,
    resume: bool = False,
    baseline: Path | None = None,
    update_baseline: bool = False,
    seed_offset: int = 0,
    changes: Sequence[str] = (),
    limits: bool = True,
    trusted: TrustedClasses = NONE_TRUSTED,
) -> bool:
    """Run a suite and return True if no case failed, all requirements are met and nothing is worse than the baseline.

    Writes results.sqlite, summary.json, report.html and junit.xml to `out` (default: out/suite-<name>). Raises InputError
    for bad input, where possible before the first case.
    """
    suite, path = load_suite(name)
    suite = suite.with_seed_offset(seed_offset)
    folder = out if out is not None else Path("out") / f"suite-{suite.name}"
    if baseline is not None and update_baseline:
        check_writable(baseline)
    before = _baseline_of(suite, baseline, update_baseline)
    cache = RecordingCache(cache_folder(), cache_limit_bytes())
    with suite_progress() as progress, _resume_hint():
        run_suite(
            suite,
            path,
            folder,
            cache,
            workers,
            changes=changes,
            trusted=trusted,
            resume=resume,
            progress=progress,
            limits=limits,
            check=partial(_check_comparable, before, f"--baseline {baseline}"),
        )
    with read_store(folder) as store:
        outcome = SuiteOutcome.of(folder, store, before)
        if baseline is not None and before is not None:
            store.note(baseline=str(baseline.resolve()))
        _print(outcome)
        files = {"results": store.path, "summary": folder / "summary.json"}
        files |= {"junit": folder / "junit.xml", "report": folder / "report.html"}
        write_summary(files["summary"], outcome)
        write_junit(files["junit"], outcome)
        write_page(files["report"], outcome)
        print_paths(files)
        results, comparison = outcome.results, outcome.comparison
        if comparison is not None:
            _check_compared(comparison, f"--baseline {baseline}")
        if baseline is not None and update_baseline and not results.failed:
            write_baseline(baseline, results)
            print_paths({"baseline": baseline})
    return not results.failed and not outcome.violated and (comparison is None or not comparison.worse)


def _print(outcome: SuiteOutcome) -> None:
    """Print the means of a run, what is worse than its baseline, and the requirements that are not met."""
    print_results(outcome.results, outcome.store.facts().get("reference"))
    if outcome.comparison is not None:
        print_comparison(outcome.comparison, outcome.results, (outcome.store, outcome.folder), shown=("worse",))
    print_requirements(outcome.requirements)


def _baseline_of(suite: Suite, baseline: Path | None, update: bool) -> Results | None:
    """Read the results to compare with; None without any. Raises InputError for those of another suite."""
    if baseline is None or (update and not baseline.exists()):
        return None
    before = read_baseline(baseline)
    if before.suite != suite.name:
        raise InputError(f"--baseline {baseline}: is of the suite {before.suite!r}; one of {suite.name!r} is expected")
    return None if update else before


def _check_comparable(before: Results | None, source: str, cases: Sequence[Case]) -> None:
    """Raise InputError if no case is one of the results to compare with, whatever its tracker."""
    if before is None:
        return
    held = {(key.scenario, key.overrides, seed) for key, group in before.groups.items() for seed in group.seeds}
    if not any((case.scenario, json.dumps(case.overrides, ensure_ascii=False), case.seed) in held for case in cases):
        raise InputError(f"{source}: {_NOTHING_COMPARED}")


@contextmanager
def _resume_hint() -> Iterator[None]:
    try:
        yield
    except KeyboardInterrupt:
        print("the cases that are done are kept; --resume does the rest", file=sys.stderr)
        raise


def show_markdown(folder: Path) -> None:
    """Print the verdict and the means of a run, finished or not, in Markdown."""
    with read_store(folder) as store:
        outcome = SuiteOutcome.of(folder, store, _held_baseline(store))
        print(markdown_verdict(outcome.results, outcome.comparison, outcome.requirements))
        print()
        print(markdown_table(outcome.results))


def show_pooled(folders: Sequence[Path], reference: str | None) -> None:
    """Print the tables of several runs as of one, compared with `reference` (None: that of the first run's suite)."""
    runs = []
    for folder in folders:
        with read_store(folder) as store:
            runs.append((str(folder), collect_results(store)))
            reference = reference or store.facts().get("reference")
    results = pooled(runs)
    _check_reference(results, reference)
    print_results(results, reference)


def _check_reference(results: Results, reference: str | None) -> None:
    trackers = sorted({key.tracker for key in results.groups})
    if reference is not None and reference not in trackers:
        raise InputError(f"--reference {reference!r} is none of the trackers; {valid_names(reference, trackers)}")


def show_results(folder: Path) -> None:
    """Print the table of a run, finished or not, and write its page, compared with its baseline if it had one."""
    with read_store(folder) as store:
        outcome = SuiteOutcome.of(folder, store, _held_baseline(store))
        _print(outcome)
        page = folder / "report.html"
        write_page(page, outcome)
        print_paths({"results": store.path, "report": page})


def _held_baseline(store: ResultStore) -> Results | None:
    """Read the baseline that a run was compared with; None where there is none any more."""
    baseline = store.facts().get("baseline")
    return read_baseline(Path(baseline)) if baseline and Path(baseline).is_file() else None


def _check_compared(comparison: Comparison, what: str) -> None:
    """Raise InputError where no metric could be compared."""
    if not comparison.changes:
        raise InputError(f"{what}: {_NOTHING_COMPARED}")


def compare_results(before: Path, now: Path, out: Path | None, *, markdown: bool = False) -> bool:
    """Print worse and better metrics of `now`, write a page if asked; return whether nothing is worse.

    `markdown`: print a table in Markdown instead. Raises InputError for runs without a case in common.
    """
    if out is not None and out.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"--out {out}: is not the name of a page; a name ending in .html is expected")
    old, new = read_results(before), read_results(now)
    if not set(old.groups) & set(new.groups):
        raise InputError(
            f"{before} and {now} have no scenario and tracker in common; two runs of one suite are expected"
        )
    title = f"{now} against {before}"
    with ExitStack() as stack:
        run = None if now.suffix == ".json" else (stack.enter_context(read_store(_folder(now))), _folder(now))
        comparison = compare(
            old, new, allowed_by_default if run is None else tolerances_of(run[0].facts()), str(before)
        )
        _check_compared(comparison, title)
        if markdown:
            print(markdown_comparison(comparison))
        else:
            print_comparison(comparison, new, run, page="the page of --out FILE.html" if out is None else str(out))
        if out is not None:
            write_comparison_page(out, comparison, old, new, title, run)
    if out is not None and not markdown:
        print_paths({"page": out})
    return not comparison.worse
