"""JUnit XML, which every CI system reads: a test a case, and a test a group of figures that was compared.

Not by junitparser, which would still need every attribute set and control characters taken out.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from xml.etree import ElementTree

from twin.recording.whole_file import whole_path
from twin.suites.comparison import Change, Comparison
from twin.suites.evidence import ALPHA
from twin.suites.figures import figure_named, written
from twin.suites.promises import Kept
from twin.suites.results import GroupKey
from twin.suites.stored import DONE, FAILED, StoredCase

_NOT_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def write_junit(
    path: Path,
    suite: str,
    cases: Sequence[StoredCase],
    comparison: Comparison | None,
    promises: Sequence[Kept] = (),
) -> None:
    """Write `junit.xml`; raises InputError where it cannot be written."""
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
    if comparison is not None:
        _add_groups(
            root,
            suite,
            "against the baseline",
            ((each.key, each.variant, sentence(each) if each.worse else None) for each in comparison.changes),
        )
    if promises:
        _add_groups(
            root,
            suite,
            "against what it promises",
            ((each.key, each.variant, each.sentence() if each.broken else None) for each in promises),
        )
    ElementTree.indent(root)
    with whole_path(path) as partial:
        ElementTree.ElementTree(root).write(partial, encoding="utf-8", xml_declaration=True)


def _add_groups(
    root: ElementTree.Element, suite: str, what: str, judged: Iterable[tuple[GroupKey, str, str | None]]
) -> None:
    """A test for each group, by key and variant, that fails with the sentences of what is wrong with its figures."""
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


def sentence(change: Change) -> str:
    """What changed, in words: "MOTP 0.067 m → 0.091 m (+0.024 m, allowed 0.004 m)"."""
    name = figure_named(change.metric).name
    was = written(change.metric, change.before)
    if change.now is None:
        return f"{name} {was} → no longer measured"
    now, by = written(change.metric, change.now), written(change.metric, change.change, sign=True)
    return f"{name} {was} → {now} ({by}, allowed {written(change.metric, change.allowed)}, {evidence(change)})"


def evidence(change: Change) -> str:
    """Why a change counts: how likely chance makes one so large, and the seed of a case that fell beyond any noise."""
    if change.now is None:
        return "gone"
    p = min(change.p, change.p_better)
    told = [f"seed {change.fallen} fell"] if change.fallen is not None else []
    return ", ".join([*told, *([f"p {p:.3f}"] if p <= ALPHA or not told else [])])


def _clean(text: str) -> str:
    """Without the characters that XML has no way to write."""
    return _NOT_XML.sub("�", text)
