"""JUnit XML for CI systems: one test per case, and one per group of compared metrics.

junitparser is not used: it would still need every attribute set and control characters removed.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from twin.recording.atomic_file import atomic_path, write_atomic
from twin.suites.comparison import Change, Comparison, SuiteOutcome, describe_change
from twin.suites.metrics import GATED
from twin.suites.results import GroupKey, RequirementCheck, mean_over_seeds
from twin.suites.store import DONE, FAILED

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
        changes = outcome.comparison.changes
        judged = ((each.key, each.variant, describe_change(each) if each.worse else None) for each in changes)
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
