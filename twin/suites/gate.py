"""A run of a suite as a gate: run, judge against the baseline, write what people and programs read of it."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from trackers.errors import InputError
from twin.console import print_paths
from twin.models import cache_folder
from twin.run.inputs import NONE_TRUSTED, TrustedClasses
from twin.suites.baseline import read_baseline, read_results, write_baseline
from twin.suites.cache import RecordingCache, cache_limit_bytes
from twin.suites.cluster import Workers
from twin.suites.comparison import Comparison, compare
from twin.suites.exports import write_junit, write_summary
from twin.suites.metrics import allowed_by_default
from twin.suites.page import write_comparison_page, write_page
from twin.suites.progress import suite_progress
from twin.suites.results import RequirementCheck, Results, check_requirements, collect_results
from twin.suites.run import run_suite, tolerances_of
from twin.suites.spec import Suite, load_suite
from twin.suites.store import ResultStore
from twin.suites.store_files import read_store
from twin.suites.tables import markdown_comparison, markdown_table, print_comparison, print_requirements, print_results


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
    """Run a suite and return whether all went well: no case failed, requirements are met, nothing is worse than the baseline.

    Leaves results.sqlite, summary.json, report.html and junit.xml in `out` (default: out/suite-<name>). Raises
    InputError for bad input, before the first case where that can be.
    """
    suite, path = load_suite(name)
    suite = suite.with_seed_offset(seed_offset)
    folder = out if out is not None else Path("out") / f"suite-{suite.name}"
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
        )
    with read_store(folder) as store:
        results = collect_results(store)
        comparison = None
        if before is not None:
            comparison = compare(before, results, tolerances_of(store.facts()))
            store.note(baseline=str(baseline.resolve()) if baseline is not None else None)
        requirements = check_requirements(store.facts(), results)
        print_results(results, store.facts().get("reference"))
        if comparison is not None:
            print_comparison(comparison, results, store, folder, shown=("worse",))
        print_requirements(requirements)
        files = _write(folder, store, results, comparison, requirements, before)
        print_paths(files)
        if comparison is not None:
            _check_compared(comparison, f"--baseline {baseline}")
        if baseline is not None and update_baseline and not results.failed:
            write_baseline(baseline, results)
            print_paths({"baseline": baseline})
    kept = not any(each.violated for each in requirements)
    return not results.failed and kept and (comparison is None or not comparison.worse)


def _baseline_of(suite: Suite, baseline: Path | None, update: bool) -> Results | None:
    """Read the results to compare with; None where there are none. Raises InputError for those of another suite."""
    if baseline is None or (update and not baseline.exists()):
        return None
    before = read_baseline(baseline)
    if before.suite != suite.name:
        raise InputError(f"--baseline {baseline}: is of the suite {before.suite!r}; one of {suite.name!r} is expected")
    return None if update else before


@contextmanager
def _resume_hint() -> Iterator[None]:
    try:
        yield
    except KeyboardInterrupt:
        print("the cases that are done are kept; --resume does the rest", file=sys.stderr)
        raise


def show_markdown(folder: Path) -> None:
    """Print the means of a run, finished or not, as a table in Markdown."""
    with read_store(folder) as store:
        print(markdown_table(collect_results(store)))


def show_results(folder: Path) -> None:
    """Print the table of a run, finished or not, and write its page; against its baseline, where it had one."""
    with read_store(folder) as store:
        results, facts = collect_results(store), store.facts()
        print_results(results, store.facts().get("reference"))
        requirements = check_requirements(facts, results)
        before = comparison = None
        baseline = Path(facts["baseline"]) if facts.get("baseline") else None
        if baseline is not None and baseline.is_file():
            before = read_baseline(baseline)
            comparison = compare(before, results, tolerances_of(facts))
            print_comparison(comparison, results, store, folder, shown=("worse",))
        print_requirements(requirements)
        page = folder / "report.html"
        write_page(page, store, results, comparison, folder, before, requirements)
        print_paths({"results": store.path, "report": page})


def _check_compared(comparison: Comparison, what: str) -> None:
    """Raise InputError where no metric could be compared."""
    if not comparison.changes:
        raise InputError(
            f"{what}: nothing could be compared; the same scenarios, changes, trackers and seeds are expected in both"
        )


def compare_results(before: Path, now: Path, out: Path | None, *, markdown: bool = False) -> bool:
    """Print what is worse and better in `now`, write a page where asked; return whether nothing is worse.

    `markdown`: print a table in Markdown instead.
    """
    old, new = read_results(before), read_results(now)
    if not set(old.groups) & set(new.groups):
        raise InputError(
            f"{before} and {now} have no scenario and tracker in common; two runs of one suite are expected"
        )
    if now.suffix == ".json":
        comparison = compare(old, new, allowed_by_default, str(before))
        _check_compared(comparison, f"{now} against {before}")
        if markdown:
            print(markdown_comparison(comparison))
        else:
            print_comparison(comparison, new, None, now)
        if out is not None:
            write_comparison_page(out, comparison, old, new, f"{now} against {before}")
    else:
        with read_store(now) as store:
            comparison = compare(old, new, tolerances_of(store.facts()), str(before))
            _check_compared(comparison, f"{now} against {before}")
            if markdown:
                print(markdown_comparison(comparison))
            else:
                print_comparison(comparison, new, store, now)
            if out is not None:
                write_comparison_page(out, comparison, old, new, f"{now} against {before}", (store, now))
    if out is not None and not markdown:
        print_paths({"page": out})
    return not comparison.worse


def _write(
    folder: Path,
    store: ResultStore,
    results: Results,
    comparison: Comparison | None,
    requirements: Sequence[RequirementCheck],
    before: Results | None,
) -> dict[str, Path]:
    files = {
        "results": store.path,
        "summary": folder / "summary.json",
        "junit": folder / "junit.xml",
        "report": folder / "report.html",
    }
    write_summary(files["summary"], store, results, comparison, requirements)
    write_junit(files["junit"], results.suite, store.cases(), comparison, requirements)
    write_page(files["report"], store, results, comparison, folder, before, requirements)
    return files
