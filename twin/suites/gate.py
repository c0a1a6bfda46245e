"""Suite as a gate: run, compare with the baseline, write results for people and programs.

junitparser is not used for `junit.xml`: it would still need every attribute set and control characters removed.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Sequence
from contextlib import ExitStack
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from trackers.errors import InputError, valid_names
from twin.console import print_paths
from twin.messages import printable
from twin.models import cache_folder
from twin.recording.atomic_file import atomic_path, check_writable, write_atomic
from twin.run.inputs import NONE_TRUSTED, TrustedClasses
from twin.suites.cache import RecordingCache, cache_limit_bytes
from twin.suites.cluster import Workers
from twin.suites.comparison import Change, Comparison, SuiteOutcome, compare, verdict_line
from twin.suites.dask_runner import suite_progress
from twin.suites.filmstrip import describe_change
from twin.suites.metrics import GATED, allowed_by_default, mean_over_seeds, tolerances_of
from twin.suites.page import write_comparison_page, write_page
from twin.suites.result_files import (
    NOTHING_COMPARED,
    baseline_of,
    check_comparable,
    held_baseline,
    read_results,
    read_store,
    run_folder,
    write_baseline,
)
from twin.suites.result_tables import (
    markdown_comparison,
    markdown_table,
    markdown_verdict,
    print_comparison,
    print_requirements,
    print_results,
)
from twin.suites.results import (
    GroupKey,
    RequirementCheck,
    collect_results,
    pooled,
)
from twin.suites.run import run_suite
from twin.suites.spec import load_suite
from twin.suites.store import DONE, FAILED


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
    before = baseline_of(suite.name, baseline, update_baseline)
    cache = RecordingCache(cache_folder(), cache_limit_bytes())
    with suite_progress() as progress:
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
            check=partial(check_comparable, before, f"--baseline {baseline}"),
        )
    with read_store(folder) as store:
        outcome = SuiteOutcome.of(folder, store, before, baseline)
        if baseline is not None and before is not None:
            store.note(baseline=str(baseline.resolve()))
        _print(outcome)
        files = {"results": store.path, "summary": folder / "summary.json"}
        files |= {"junit": folder / "junit.xml", "report": folder / "report.html"}
        write_summary(files["summary"], outcome)
        write_junit(files["junit"], outcome)
        write_page(files["report"], outcome)
        print_paths(files)
        if outcome.comparison is not None:
            _check_compared(outcome.comparison, f"--baseline {baseline}")
        wrote = ""
        if baseline is not None and update_baseline and not outcome.results.failed:
            write_baseline(baseline, outcome.results)
            wrote = str(baseline)
        print(printable(outcome.verdict(wrote)))
    return outcome.passed


def _print(outcome: SuiteOutcome) -> None:
    """Print the means of a run, what is worse than its baseline, and the requirements that are not met."""
    print_results(outcome.results, outcome.store.facts().get("reference"))
    if outcome.comparison is not None:
        print_comparison(outcome.comparison, outcome.results, (outcome.store, outcome.folder), shown=("worse",))
    print_requirements(outcome.requirements)


def show_markdown(folder: Path) -> None:
    """Print the verdict and the means of a run, finished or not, in Markdown."""
    with read_store(folder) as store:
        outcome = SuiteOutcome.of(folder, store, held_baseline(store))
        print(markdown_verdict(outcome), markdown_table(outcome.results), sep="\n\n")


def show_pooled(folders: Sequence[Path], reference: str | None) -> None:
    """Print the tables of several runs as of one, compared with `reference` (None: that of the first run's suite)."""
    runs = []
    for folder in folders:
        with read_store(folder) as store:
            runs.append((str(folder), collect_results(store)))
            reference = reference or store.facts().get("reference")
    results = pooled(runs)
    trackers = sorted({key.tracker for key in results.groups})
    if reference is not None and reference not in trackers:
        raise InputError(f"--reference {reference!r} is none of the trackers; {valid_names(reference, trackers)}")
    print_results(results, reference)


def show_results(folder: Path) -> None:
    """Print the table of a run, finished or not, and write its page, compared with its baseline if it had one."""
    with read_store(folder) as store:
        outcome = SuiteOutcome.of(folder, store, held_baseline(store))
        _print(outcome)
        page = folder / "report.html"
        write_page(page, outcome)
        print_paths({"results": store.path, "report": page})
        print(printable(outcome.verdict()))


def _check_compared(comparison: Comparison, what: str) -> None:
    """Raise InputError where no metric could be compared."""
    if not comparison.changes:
        raise InputError(f"{what}: {NOTHING_COMPARED}")


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
        run = None if now.suffix == ".json" else (stack.enter_context(read_store(run_folder(now))), run_folder(now))
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
    if not markdown:
        print(printable(verdict_line(str(before), comparison, not comparison.worse)))
    return not comparison.worse


_NOT_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def write_junit(path: Path, outcome: SuiteOutcome) -> None:
    """Write `junit.xml`; raises InputError where it cannot be written."""
    suite, cases = outcome.results.suite, outcome.store.cases()
    root = ElementTree.Element("testsuites", name=suite)
    runs = ElementTree.SubElement(
        root,
        "testsuite",
        name=suite,
        tests=str(len(cases)),
        failures="0",
        errors=str(sum(case.status == FAILED for case in cases)),
        skipped=str(sum(case.status not in (DONE, FAILED) for case in cases)),
        time=f"{sum(case.seconds or 0.0 for case in cases):.3f}",
    )
    for case in cases:
        test = ElementTree.SubElement(
            runs,
            "testcase",
            classname=f"{suite}.{case.scenario}",
            name=_clean(", ".join(part for part in (case.variant, f"seed {case.seed}", case.tracker) if part)),
            time=f"{case.seconds or 0.0:.3f}",
        )
        if case.status == FAILED:
            error = case.error or ""
            element = ElementTree.SubElement(test, "error", message=_clean(error.splitlines()[0] if error else ""))
            element.text = _clean(error)
        elif case.status != DONE:
            ElementTree.SubElement(test, "skipped", message="not finished")
    if outcome.comparison is not None:
        changes, worse = outcome.comparison.changes, {id(each) for each in outcome.comparison.worse}
        judged = ((each.key, each.variant, describe_change(each) if id(each) in worse else None) for each in changes)
        _add_groups(root, suite, "against the baseline", judged)
    if outcome.requirements:
        checks = outcome.requirements
        judged = ((each.key, each.variant, each.sentence() if each.violated else None) for each in checks)
        _add_groups(root, suite, "against its requirements", judged)
    ElementTree.indent(root)
    with atomic_path(path) as partial:
        ElementTree.ElementTree(root).write(partial, encoding="utf-8", xml_declaration=True)


def _add_groups(
    root: ElementTree.Element, suite: str, what: str, judged: Iterable[tuple[GroupKey, str, str | None]]
) -> None:
    """Add one test per group, by key and variant; it fails with the sentences on its metrics' faults."""
    groups: dict[tuple[str, str, str], list[str]] = {}
    for key, variant, wrong in judged:
        lines = groups.setdefault((key.scenario, variant, key.tracker), [])
        lines += [] if wrong is None else [wrong]
    element = ElementTree.SubElement(
        root,
        "testsuite",
        name=f"{suite} {what}",
        tests=str(len(groups)),
        failures=str(sum(bool(lines) for lines in groups.values())),
        errors="0",
    )
    for (scenario, variant, tracker), lines in groups.items():
        name = ", ".join(part for part in (variant, tracker) if part)
        test = ElementTree.SubElement(element, "testcase", classname=f"{suite}.{scenario}", name=_clean(name), time="0")
        if lines:
            ElementTree.SubElement(test, "failure", message=_clean("; ".join(lines))).text = _clean("\n".join(lines))


def _clean(text: str) -> str:
    """Remove the characters that XML cannot hold."""
    return _NOT_XML.sub("�", text)


def write_summary(path: Path, outcome: SuiteOutcome) -> None:
    """Write the means over seeds with their 95 % intervals, failures, and changes; raises InputError as a file does."""
    results, facts, cases = outcome.results, outcome.store.facts(), outcome.store.cases()
    document: dict[str, Any] = {
        "suite": results.suite,
        "cases": {
            "total": len(cases),
            "done": sum(len(group.seeds) for group in results.groups.values()),
            "failed": len(results.failed),
            "unfinished": results.unfinished,
        },
        "seconds": facts["seconds"],
        "versions": dict(results.versions),
        "renderers": list(results.renderers),
        "tracker_warnings": dict(results.tracker_warnings),
        "scenario_warnings": dict(results.scenario_warnings),
        "groups": [
            {
                "scenario": key.scenario,
                "variant": group.variant,
                "overrides": json.loads(key.overrides),
                "tracker": key.tracker,
                "seeds": sorted(group.seeds),
                "metrics": {
                    metric: asdict(mean) for metric in GATED if (mean := mean_over_seeds(group.values(metric)))
                },
            }
            for key, group in results.groups.items()
        ],
        "failed": [{"case_id": case.id, "attempts": case.attempts, "error": case.error} for case in results.failed],
    }
    if outcome.comparison is not None:
        document["comparison"] = _comparison_row(outcome.comparison)
    if outcome.requirements:
        document["requirements"] = [
            {**_who(each), "metric": each.metric, "bound": each.bound, "mean": each.mean, "met": not each.violated}
            for each in outcome.requirements
        ]
    _add_former_names(document)
    write_atomic(path, json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) + "\n")


def _add_former_names(document: dict[str, Any]) -> None:
    """Repeat renamed entries under their names of release 0.1; goes with release 0.3."""
    document["doubts"] = document["tracker_warnings"]
    for group in document["groups"]:
        group["figures"] = group["metrics"]
    if "requirements" in document:
        document["promises"] = [{**each, "kept": each["met"]} for each in document["requirements"]]


def _comparison_row(comparison: Comparison) -> dict[str, Any]:
    return {
        "worse": [_row(change) for change in comparison.worse],
        "better": [_row(change) for change in comparison.better],
        "warnings": list(comparison.warnings),
        "identical": comparison.identical,
        "smallest_loss_noticed": {
            each.metric: {
                "everywhere": each.everywhere[1],
                "of_tracker": dict(each.of_tracker),
                "in_scenario": each.in_scenario[1],
                "in_scenario_least": each.in_scenario[0],
                "in_case": each.in_case[1],
                "in_case_least": each.in_case[0],
            }
            for each in comparison.detectable
        },
    }


def _row(change: Change) -> dict[str, Any]:
    same = {name: getattr(change, name) for name in ("metric", "before", "now", "allowed", "p", "p_better")}
    collapse = None if change.collapse is None else asdict(change.collapse)
    fallen_seed = None if change.collapse is None else change.collapse.seed
    return {**_who(change), **same, "fallen_seed": fallen_seed, "collapse": collapse, "seeds": change.n_seed}


def _who(each: Change | RequirementCheck) -> dict[str, str]:
    return {"scenario": each.key.scenario, "variant": each.variant, "tracker": each.key.tracker}
