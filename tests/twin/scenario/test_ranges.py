"""A number that no field can mean is refused in a sentence: every numeric field of scenarios and rigs, found by a walk."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from copy import deepcopy
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings, strategies as st
from pydantic import BaseModel
from test_strict_conversion import models_in, scalars

from trackers.configuration import validate
from trackers.errors import InputError
from trackers.rig import Rig
from trackers.user_input.plain_data import parse_yaml
from twin import models
from twin.recording.reader import Recording
from twin.run.live import run_scenario
from twin.scenario import Scenario, load_scenario
from twin.scenario.load import DrawableScenarioFile, dump_scenario

HOSTILE = (math.nan, math.inf, -math.inf, 1e300, -1e300, 10**30, -(10**30), "a word", "12")
SAYS_WHAT_IS_VALID = re.compile(r"(greater|less) than( or equal to)? -?[\d.e+]+|finite number|expected|valid")


def numeric_fields() -> list[tuple[type[BaseModel], str, int]]:
    """Model, key and how deep in lists or mappings, of each field that holds numbers and no texts."""
    seen: set[type[BaseModel]] = set()
    found = []
    for model in (each for schema in (DrawableScenarioFile, Rig) for each in models_in(schema, seen)):
        for name, field in model.model_fields.items():
            held = set(scalars(field.annotation))
            numbers = {depth for kind, depth in held if kind in (int, float)}
            if numbers and not any(kind in (str, object) for kind, _ in held):
                found += [(model, field.alias or name, depth) for depth in sorted(numbers)]
    return found


def spellings(value: Any, depth: int) -> Iterator[Any]:
    """The value as a field of lists or mappings may hold it."""
    if depth == 0:
        yield value
        return
    for inner in spellings(value, depth - 1):
        yield from ([inner] * n for n in range(1, 7))
        yield {"a": inner}


def said(model: type[BaseModel], key: str, value: Any) -> list[str]:
    """What is told of this field."""
    with pytest.raises(InputError) as caught:
        validate(model, {key: value}, "file.yaml")
    return [line for line in str(caught.value).splitlines() if re.match(rf"file\.yaml: {key}\b", line)]


@pytest.mark.parametrize(("model", "key", "depth"), numeric_fields(), ids=lambda each: getattr(each, "__name__", each))
def test_a_number_that_no_field_can_mean_is_refused_with_file_field_value_and_what_is_valid(
    model: type[BaseModel], key: str, depth: int
) -> None:
    for value in (*HOSTILE, *beyond(model, key)):
        lines: list[str] = []
        for spelling in spellings(value, depth):
            lines = said(model, key, spelling)
            assert lines, (value, spelling)
            assert any(SAYS_WHAT_IS_VALID.search(line) for line in lines), lines
        assert depth or any(repr(value) in line for line in lines), lines


def beyond(model: type[BaseModel], key: str) -> list[float]:
    """Numbers just outside the range that a field declares."""
    field = next(each for name, each in model.model_fields.items() if (each.alias or name) == key)
    outside: list[float] = []
    for bound in field.metadata:
        own: dict[str, Any] = {name: getattr(bound, name, None) for name in ("ge", "gt", "le", "lt")}
        outside += [own["ge"] - 1e-3] if own["ge"] is not None else []
        outside += [own["le"] + max(1e-3, 1e-6 * own["le"])] if own["le"] is not None else []
        outside += [float(own[name]) for name in ("gt", "lt") if own[name] is not None]
    return outside


def test_the_walk_finds_fields_and_bounds() -> None:
    found = numeric_fields()
    assert len(found) > 150
    assert sum(len(beyond(model, key)) for model, key, _ in found) > 150


Leaf = tuple[str | int, ...]


def numeric_leaves(content: Any, at: Leaf = ()) -> Iterator[Leaf]:
    """Where numbers stand in a file."""
    items = content.items() if isinstance(content, dict) else enumerate(content) if isinstance(content, list) else ()
    for key, value in items:
        if isinstance(value, int | float) and not isinstance(value, bool):
            yield (*at, key)
        yield from numeric_leaves(value, (*at, key))


@cache
def scenario_files() -> list[tuple[dict[str, Any], Leaf]]:
    """Each number of each shipped scenario, resolved, but one of a kind of field."""
    found = {}
    for name in models.names("scenarios"):
        if name != "drawn":
            content = parse_yaml(dump_scenario(load_scenario(name)), name, "a scenario")
            for leaf in numeric_leaves(content):
                if "options" not in leaf:
                    found.setdefault(
                        (content["name"], *(each for each in leaf if isinstance(each, str))), (content, leaf)
                    )
    return list(found.values())


@pytest.fixture(scope="module")
def rig_file(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    out = tmp_path_factory.mktemp("rig")
    run_scenario(load_scenario("lab-five-people", ["duration_s=0.2"]), trackers=[], out=out, video=False, images=False)
    return parse_yaml(Recording(out / "recording.mcap").rig.dump_yaml(), "rig.yaml", "a rig")


def refused(model: type[BaseModel], content: dict[str, Any], leaf: Leaf, value: Any) -> None:
    spoiled = deepcopy(content)
    inner: Any = spoiled
    for key in leaf[:-1]:
        inner = inner[key]
    inner[leaf[-1]] = value
    with pytest.raises(InputError) as caught:
        validate(model, spoiled, "file.yaml")
    path = ".".join(map(str, leaf))
    lines = [line for line in str(caught.value).splitlines() if line.startswith(f"file.yaml: {path}: ")]
    assert lines, (str(caught.value)[:500], path)
    assert any(repr(value) in line and SAYS_WHAT_IS_VALID.search(line) for line in lines), lines


@settings(max_examples=100, deadline=None)
@given(data=st.data(), value=st.sampled_from(HOSTILE))
def test_every_number_of_a_shipped_scenario(data: st.DataObject, value: Any) -> None:
    content, leaf = data.draw(st.sampled_from(scenario_files()))
    refused(Scenario, content, leaf, value)


def test_every_number_of_a_rig(rig_file: dict[str, Any]) -> None:
    for leaf in numeric_leaves(rig_file):
        for value in HOSTILE:
            refused(Rig, rig_file, leaf, value)


def test_exit_code_2_and_nothing_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from twin.cli import app

    monkeypatch.chdir(tmp_path)
    for value in (".nan", ".inf", "1e300", "twelve"):
        with pytest.raises(InputError, match=r"--set|lab-five-people.*duration_s"):
            app(["render", "lab-five-people", "--set", f"duration_s={value}"], standalone_mode=False)
    assert not list(tmp_path.iterdir())
