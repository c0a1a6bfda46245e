"""The scenario's description of a person: defaults that work, errors that teach."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError

from twin.people.appearance import appearance_of
from twin.scenario.people import Person, Walk, Wander
from twin.scenario.wardrobe import wardrobe

PAPER_SHIRTS = ("white", "black", "pink", "blue", "purple")


def test_everything_has_a_default():
    assert isinstance(Person().script, Wander)


@pytest.mark.parametrize("shirt", [*PAPER_SHIRTS, "red", "green", "grey", "yellow", "orange", "#12aBcd"])
def test_shirts_by_name_or_number(shirt):
    assert Person(shirt=shirt).shirt == shirt


def test_the_papers_shirts_differ():
    colours = np.array([wardrobe().rgb("shirt", name) for name in PAPER_SHIRTS])
    apart = np.linalg.norm(colours[:, None] - colours, axis=-1) + 9 * np.eye(len(colours))
    assert apart.min() > 0.25


@pytest.mark.parametrize(
    ("fields", "expected"),
    [
        ({"shirt": "mauve"}, "no shirt colour 'mauve'; valid are white, black"),
        ({"shirt": "#12345"}, "or '#rrggbb'"),
        ({"trousers": "velvet"}, "no trousers colour 'velvet'"),
        ({"hair_style": "mohawk"}, "'short', 'long', 'bun' or 'bald'"),
        ({"height_m": -1.7}, "greater than or equal to 1"),
        ({"height_m": 2.5}, "less than or equal to 2.1"),
        ({"height": 1.7}, "Extra inputs"),
        ({"heading_deg": float("nan")}, "finite"),
        ({"start": [1, float("inf")]}, "finite"),
        ({"script": {"kind": "fly"}}, "'wander', 'stand', 'walk'"),
        ({"script": {"kind": "walk", "waypoints": []}}, "at least 1"),
        ({"script": {"kind": "walk", "waypoints": [[0, 1]], "speed_m_s": 3.0}}, "less than or equal to 2.5"),
        ({"script": {"kind": "wander", "speed_m_s": [1.2, 0.4]}}, "the smaller number first"),
        ({"script": {"kind": "wander", "stop_s": [-1, 0.4]}}, "the smaller number first"),
        ({"script": {"kind": "wander", "stop_share": 1.5}}, "less than or equal to 1"),
    ],
)
def test_what_is_wrong_is_said_with_what_would_be_right(fields, expected):
    with pytest.raises(ValidationError) as error:
        Person.model_validate(fields)
    assert expected in str(error.value)


def test_scripts_are_told_apart_by_kind():
    person = Person.model_validate({"script": {"kind": "walk", "waypoints": [[0, 1], [1, 2]], "repeat": True}})
    assert person.script == Walk(waypoints=((0, 1), (1, 2)), repeat=True)


def test_naming_one_garment_changes_no_other():
    plain = appearance_of(Person(), np.random.default_rng(4))
    dressed = appearance_of(Person(shirt="pink"), np.random.default_rng(4))
    assert dressed.shirt == wardrobe().rgb("shirt", "pink")
    for name in ("height_m", "build", "trousers", "shoes", "skin", "hair", "hair_style", "long_sleeves"):
        assert getattr(plain, name) == getattr(dressed, name)


def test_drawn_looks_are_adults_of_many_kinds():
    drawn = [appearance_of(Person(), np.random.default_rng(seed)) for seed in range(40)]
    assert all(1.5 <= looks.height_m <= 1.9 for looks in drawn)
    assert len({looks.skin for looks in drawn}) >= 4
    assert {looks.hair_style for looks in drawn} == {"short", "long", "bun", "bald"}
