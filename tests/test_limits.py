"""Every budget of memory, disk or time is refused by one rule, which `--no-limits` lifts."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from trackers.errors import InputError, text_near_bound
from trackers.user_input import text_file
from trackers.user_input.plain_data import parse_yaml
from trackers.user_input.text_file import read_text

ROOT = Path(__file__).parents[1]
MODULES = sorted([*(ROOT / "trackers").rglob("*.py"), *(ROOT / "twin").rglob("*.py")])
RULES = ("check_limit", "refuse_unless_lifted", "are_limits_lifted")
BUDGET = re.compile(r"_?(MOST|LARGEST|LONGEST|BIGGEST|MAX)_\w+")
NO_BUDGETS = {
    "LONGEST_LOOK_S": "what a sensor looks past the end of a run, where nobody moves any more",
    "MOST_DEEP": "elements nested deeper overflow the stacks of the XML library and of MuJoCo",
    "MOST_LAMPS": "OpenGL's pipeline has eight lights",
    "LARGEST_BUFFER_PX": "MuJoCo has no larger buffer",
    "MOST_TILT_DEG": "the range of a field",
    "MOST_CELLS": "the range of a field",
    "_MOST_SEEDS": "the range of a field",
    "_MAX_STAMP_S": "64 bits of nanoseconds hold no more",
    "MAX_INT64": "64 bits hold no more",
    "MOST_STAMPS_NS": "64 bits of nanoseconds hold no more, less what is added to stamps",
    "_MOST_GROUPS": "a number of 32 bits has no more groups of three",
    "MAX_TANGENT": "a ray beyond it is seen by no lens",
    "MAX_FIELD_OF_VIEW_DEG": "the range of a field",
    "LONGEST_NUMBER": "no number that somebody wrote is longer",
    "_MOST_ANGLE_RAD": "more than one turn is degrees",
    "_MOST_MM": "a millimetre more does not fit 16 bits",
    "_LONGEST_LIST_BYTES": "a longer list is none of ours",
    "_LONGEST_CHAIN": "a chain of files, each named in the one before, is read by recursion",
    "_LONGEST_TEXT": "names of rooms and formats; nothing is made of them",
}
"""Bounds that no memory lifts, each with what it comes from."""


def budgets_refused() -> Iterator[tuple[Path, str, bool]]:
    """Module, constant, and whether the rule is asked, of each `if` over a bound whose block raises or asks the rule."""
    for path in MODULES:
        source = path.read_text(encoding="utf-8")
        if not BUDGET.search(source):
            continue
        for node in ast.walk(ast.parse(source)):
            if not isinstance(node, ast.If):
                continue
            bounds = {
                each.id for each in ast.walk(node.test) if isinstance(each, ast.Name) and BUDGET.fullmatch(each.id)
            }
            inside = [each for part in (node.test, *node.body) for each in ast.walk(part)]
            asked = any(isinstance(each, ast.Name) and each.id in (*RULES, "refuse") for each in inside)
            if asked or any(isinstance(each, ast.Raise) for each in node.body):
                yield from ((path, bound, asked) for bound in bounds)


def test_every_budget_is_refused_by_the_rule() -> None:
    found = list(budgets_refused())
    assert len([asked for *_, asked in found if asked]) >= 8  # the walk finds them
    wrong = [
        f"{path.relative_to(ROOT)}: {bound}" for path, bound, asked in found if not asked and bound not in NO_BUDGETS
    ]
    assert not wrong, f"refused without trackers.user_input.text_file: {wrong}"
    unused = set(NO_BUDGETS) - {bound for _, bound, asked in found if not asked}
    assert not unused, f"named here, found nowhere: {unused}"


BOUND = re.compile(r"at (least|most)|or (less|more)|up to|(less|more) than|below|above|within|longer|shorter|exceed")
NO_VALUES = {
    "np.radians(angle_rad)": "what the value would be in another unit",
    "fold_deg": "where the picture folds, beside the bound that follows from it",
}
"""Numbers in refusals that are no values beside a bound, each with what they are."""


def rounded_beside_bounds() -> Iterator[tuple[Path, str]]:
    """Module and number of each refusal that names a bound and writes a number with fixed digits."""
    for path in MODULES:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            for text in ast.walk(node) if isinstance(node, ast.Raise) else ():
                if not isinstance(text, ast.JoinedStr):
                    continue
                words = "".join(str(each.value) for each in text.values if isinstance(each, ast.Constant))
                for each in text.values if BOUND.search(words) else ():
                    spec = (
                        ast.unparse(each.format_spec)
                        if isinstance(each, ast.FormattedValue) and each.format_spec
                        else ""
                    )
                    if re.search(r"\.\d+[fg]", spec):
                        yield path, ast.unparse(each.value)


def test_no_refusal_rounds_a_value_onto_its_bound() -> None:
    found = list(rounded_beside_bounds())
    wrong = [f"{path.relative_to(ROOT)}: {number}" for path, number in found if number not in NO_VALUES]
    assert not wrong, f"to be written by trackers.errors.text_near_bound: {wrong}"
    assert set(NO_VALUES) == {number for _, number in found}


def test_a_value_near_a_bound_is_written_on_its_side_of_it_and_briefly_elsewhere() -> None:
    rng = np.random.default_rng(0)
    for bound in (0.0, 0.35, 0.5, 12.0, 60.0, 100.0, 1e-3, *(float(f"{each:g}") for each in rng.uniform(0, 1e3, 50))):
        for off in (*-(10.0 ** rng.uniform(-12, 2, 8)), *10.0 ** rng.uniform(-12, 2, 8), 0.0):
            value = bound + off
            for spec in (".0f", ".1f", ".2f", ".3g", ".6g"):
                text = text_near_bound(value, bound, spec)
                assert (float(text) > bound) == (value > bound) and (float(text) < bound) == (value < bound)
    assert text_near_bound(0.3, 0.35) == "0.30" and text_near_bound(0.3481, 0.35) == "0.348"


def test_only_the_rule_says_how_limits_are_lifted() -> None:
    said = {path.relative_to(ROOT).as_posix() for path in MODULES if "--no-limits" in path.read_text(encoding="utf-8")}
    assert said == {"trackers/user_input/text_file.py", "trackers/user_input/plain_data.py", "twin/command_options.py"}


def test_the_rule_is_lifted_by_the_variable_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    text_file.check_limit(3, 3, "it holds")
    with pytest.raises(InputError, match="^it holds 4 things; at most 3, or --no-limits, is expected$"):
        text_file.check_limit(4, 3, "it holds", "things")
    monkeypatch.setenv(text_file.NO_LIMITS, "1")
    text_file.check_limit(4, 3, "it holds", "things")
    text_file.refuse_unless_lifted("it is large", "less")


def test_texts_are_lifted_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "long.txt"
    path.write_text("x" * 2000)
    monkeypatch.setattr("trackers.user_input.plain_data.MOST_VALUES", 5)
    many = "a: [1, 2, 3, 4, 5, 6]"
    for read in (lambda: read_text(path, "a text", 1000), lambda: parse_yaml(many, "a.yaml", "numbers")):
        with pytest.raises(InputError, match="--no-limits"):
            read()
    monkeypatch.setenv(text_file.NO_LIMITS, "1")
    assert len(read_text(path, "a text", 1000)) == 2000
    assert parse_yaml(many, "a.yaml", "numbers") == {"a": [1, 2, 3, 4, 5, 6]}
