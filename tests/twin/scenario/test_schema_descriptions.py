"""Editors show what every field of a scenario, a suite and a rig means, and what it is when left out."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import pytest
from pydantic import BaseModel

from trackers.rig import Rig
from twin.scenario.load import DrawableScenarioFile
from twin.scenario.person import Person, wardrobe
from twin.suites.spec import Suite

FILES = (DrawableScenarioFile, Suite, Rig)


def properties(described: type[BaseModel]) -> Iterator[tuple[str, dict[str, Any], bool]]:
    """Every property in the schema of a file, as 'Model.field', its schema, and whether it must be given."""
    schema = described.model_json_schema()
    for name, model in {described.__name__: schema, **schema.get("$defs", {})}.items():
        for field, of_field in model.get("properties", {}).items():
            yield f"{name}.{field}", of_field, field in model.get("required", ())


@pytest.mark.parametrize("described", FILES)
def test_every_field_says_what_it_means(described: type[BaseModel]) -> None:
    silent = [name for name, schema, _ in properties(described) if not schema.get("description", "").strip()]
    assert not silent


@pytest.mark.parametrize("described", FILES)
def test_every_field_that_may_be_left_out_says_what_it_is_then(described: type[BaseModel]) -> None:
    silent = [name for name, schema, required in properties(described) if not required and "default" not in schema]
    assert not silent


UNITS = {
    "_m_s": "[m/s]", "_s": "[s]", "_m": "[m]", "_deg": "[deg]", "_rad": "[rad]", "_n": "[N]", "_px": "[px]", "_hz": "[Hz]",
}  # fmt: skip


@pytest.mark.parametrize("described", FILES)
def test_a_field_with_a_unit_in_its_name_has_it_in_its_description(described: type[BaseModel]) -> None:
    silent = []
    for name, schema, _ in properties(described):
        unit = next((unit for end, unit in UNITS.items() if name.endswith(end) and "_per_" not in name), "")
        if unit not in schema["description"]:
            silent.append(name)
    assert not silent


def test_a_choice_that_the_wardrobe_makes_is_listed_whole() -> None:
    fields = Person.model_json_schema()["properties"]
    for choice, names in wardrobe().choices.items():
        told = re.findall(r"[a-z]+", fields[choice]["description"].split(":")[1])
        assert set(told) - {"or"} == set(names), choice
