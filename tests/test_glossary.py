"""Words: names and sentences are the field's, not a dialect of ours."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SOURCES = sorted(path for folder in ("twin", "trackers", "scripts") for path in (ROOT / folder).rglob("*.py"))

FIELD_WORDS = {
    "moment": "frame, stamp or sample",
    "look_after": "update or manage",
    "newcomer": "unassigned detection, initiation",
    "stranger": "unassigned detection",
    "told": "a verb of what it does: format, summary, by_id",
    "gone": "deleted, left",
    "begun": "initiated, started",
    "begins": "initiates, starts",
    "worthiest": "max_weight_assignment",
    "deviations": "mahalanobis_distances",
    "absence": "negative information",
    "unseen": "miss_probability, missed",
    "held_back": "fixed-lag smoother",
    "recognised": "re-identified",
    "doubt": "warning, calibration monitor",
    "knowledge": "prior",
    "spoiling": "corruption, fault injection",
    "laid_over": "deep_merge",
    "lone": "single",
    "firm": "the measured quality",
    "barred": "forbidden",
    "half_seen": "partly occluded",
    "claim": "gate",
    "watcher": "camera front end",
    "set_right": "normalize exposure",
    "believed": "assumed, calibration_error",
    "vary": "randomize",
    "cast": "body pool",
    "lair": "lying pose",
    "staged": "precomputed",
    "posed": "pose cache",
    "caveat": "note",
    "promise": "requirement",
    "aftermath": "validation",
    "tracker_at_work": "tracker runner",
    "somebody": "person, track",
    "nobody": "no person, no track",
    "everybody": "all people, all tracks",
    "whoever": "the person or track that",
    "whom": "the person or track that",
}
"""Words that no name of ours holds, each with the field's instead; plurals too."""

ALLOWED = {"_MOMENTS"}  # of a distribution


def names_in(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Yield line and name of everything that a module names itself: definitions, arguments, assigned names, attributes."""
    for node in ast.walk(tree):
        match node:
            case ast.FunctionDef() | ast.AsyncFunctionDef() | ast.ClassDef():
                yield node.lineno, node.name
            case ast.arg():
                yield node.lineno, node.arg
            case ast.Name(ctx=ast.Store()):
                yield node.lineno, node.id
            case ast.Attribute(ctx=ast.Store()):
                yield node.lineno, node.attr


def snake_case(name: str) -> str:
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name).lower()


PATTERN = re.compile(rf"(?:^|_)({'|'.join(FIELD_WORDS)})s?(?=_|$|\d)")


@pytest.mark.parametrize("package", ["twin", "trackers"])
def test_names_are_the_words_of_the_field(package: str) -> None:
    found = []
    for path in SOURCES:
        if path.relative_to(ROOT).parts[0] != package:
            continue
        tree = ast.parse(path.read_text(encoding="utf-8"))
        for line, name in [(1, path.stem), *names_in(tree)]:
            hit = PATTERN.search(snake_case(name))
            if hit and name not in ALLOWED:
                found.append(f"{path.relative_to(ROOT)}:{line}: {name} (the field says {FIELD_WORDS[hit[1]]})")
    assert not found, "\n".join(found)


def test_docstrings_say_what_is_done_or_what_a_thing_is() -> None:
    """No docstring begins with a question word: functions begin with a verb, things with a noun."""
    asked = re.compile(r'"""(?:What|Whether|Where|How|Who|Whom|Whose|Why|When)\b')
    found = [
        f"{path.relative_to(ROOT)}:{number}: {line.strip()}"
        for path in SOURCES
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1)
        if asked.search(line)
    ]
    assert not found, "\n".join(found)
