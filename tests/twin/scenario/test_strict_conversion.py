"""Every field of every schema takes what is written for what it looks like: no number is a boolean, none a text."""

from __future__ import annotations

import importlib
import types
from collections.abc import Iterator, Mapping
from enum import Enum
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin

import pytest
import yaml
from pydantic import BaseModel, JsonValue, ValidationError
from typing_extensions import TypeAliasType

from trackers.configuration import Strict
from trackers.errors import InputError
from trackers.presets import PRESETS
from trackers.rig import Rig
from trackers.user_input.plain_data import dump_yaml, parse_yaml, parse_yaml_value
from twin.scenario import load_scenario
from twin.scenario.load import DrawableScenarioFile, ScenarioFile
from twin.studies.spec import Study
from twin.suites.spec import Suite

TEXTS = ("on", "yes", "no", "off", "010", "1_000", "0x10", "0o17", "12:30:00", "2024-01-01", "1e", "'5'", "'true'")
BOOLEANS = ("true", "False", "TRUE")
NUMBERS = ("1", "0", "-7", "1e3", ".5", "5.", "1.5", "+2")
ODD = {str: TEXTS, bool: BOOLEANS, float: NUMBERS}


def models_in(kind: Any, seen: set[type[BaseModel]]) -> Iterator[type[BaseModel]]:
    """The models that a type is made of, at any depth."""
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        if kind not in seen:
            seen.add(kind)
            yield kind
            for field in kind.model_fields.values():
                yield from models_in(field.annotation, seen)
        return
    if isinstance(kind, TypeAliasType):
        return
    for part in get_args(kind) if get_origin(kind) is not Literal else ():
        yield from models_in(part, seen)


def scalars(kind: Any) -> Iterator[tuple[type, int]]:
    """Each scalar that a field may hold, and how many lists or mappings it stands in; object: anything."""
    origin = get_origin(kind)
    if kind is JsonValue or kind is Any or isinstance(kind, TypeAliasType | TypeVar):
        yield from ((object, depth) for depth in range(4))
    elif origin is Annotated:
        yield from scalars(get_args(kind)[0])
    elif origin in (Union, types.UnionType):
        for part in get_args(kind):
            yield from scalars(part)
    elif origin is Literal:
        yield from ((type(each), 0) for each in get_args(kind))
    elif origin in (tuple, list, frozenset, set):
        for part in get_args(kind):
            if part is not Ellipsis:
                yield from ((each, depth + 1) for each, depth in scalars(part))
    elif origin in (dict, Mapping):
        yield from ((each, depth + 1) for each, depth in scalars(get_args(kind)[1]))
    elif isinstance(kind, type) and issubclass(kind, Enum | Path):
        yield str, 0
    elif isinstance(kind, type) and not issubclass(kind, BaseModel | type(None)):
        yield kind, 0


def options_of_trackers() -> list[type[BaseModel]]:
    """The options of every class of trackers that has a preset."""
    for preset in PRESETS.values():
        importlib.import_module(preset.target.partition(":")[0])
    found, more = [], [Strict]
    while more:
        model = more.pop()
        more += model.__subclasses__()
        found += [model] if model.__module__.startswith("trackers.") and model.__name__.endswith("Options") else []
    return sorted(found, key=lambda each: (each.__module__, each.__name__))


def fields() -> list[tuple[type[BaseModel], str]]:
    seen: set[type[BaseModel]] = set()
    schemas = (ScenarioFile, DrawableScenarioFile, Suite, Study, Rig, *options_of_trackers())
    models = [model for schema in schemas for model in models_in(schema, seen)]
    return [(model, name) for model in models for name in model.model_fields]


def takes(kinds: set[type], word: type) -> bool:
    """Whether a field of these scalars has a use for a value of this type."""
    return object in kinds or bool(kinds & ({int, float} if word is float else {word}))


@pytest.mark.parametrize(("model", "name"), fields(), ids=lambda each: getattr(each, "__name__", each))
def test_a_field_takes_no_value_of_another_type(model: type[BaseModel], name: str) -> None:
    field = model.model_fields[name]
    alias = field.alias or name
    found = list(scalars(field.annotation))
    for depth in range(2):
        kinds = {kind for kind, at in found if at == depth}
        if not kinds or any(kind is object for kind, _ in found):
            continue
        for word, spellings in ODD.items():
            if takes(kinds, word) or any(takes({kind}, word) for kind, _ in found):
                continue
            for spelling in spellings:
                value = f"[{spelling}]" if depth else spelling
                content = parse_yaml(f"{alias}: {value}", "", "")
                with pytest.raises(ValidationError) as refused:
                    model.model_validate(content)
                assert any(fault["loc"] and fault["loc"][0] == alias for fault in refused.value.errors()), spelling


def test_the_walk_finds_numbers_booleans_and_texts_of_every_schema() -> None:
    found = [(model, name, set(scalars(model.model_fields[name].annotation))) for model, name in fields()]
    count = {kind: sum((kind, 0) in each for _, _, each in found) for kind in (bool, int, float, str)}
    assert len({model for model, _, _ in found}) > 60 and count[float] > 150 and count[int] > 20 and count[bool] > 5, (
        count
    )


@pytest.mark.parametrize("word", TEXTS[:-2])
def test_a_word_that_yaml_1_1_reads_as_something_else_is_a_text(word: str) -> None:
    assert parse_yaml(f"a: {word}\n{word}: 1\n", "", "") == {"a": word, word: 1}
    assert parse_yaml_value(word, "--set x") == word


@pytest.mark.parametrize("word", BOOLEANS + NUMBERS)
def test_a_word_that_is_a_boolean_or_a_number_is_one(word: str) -> None:
    value = parse_yaml_value(word, "--set x")
    assert isinstance(value, bool) == (word in BOOLEANS)
    assert value == (word.lower() == "true" if word in BOOLEANS else float(word))


@pytest.mark.parametrize(
    "word", [*TEXTS, *BOOLEANS, *NUMBERS, "~", "null", "#fff", "", "=", "<<", "-", "n", "a: b", "é"]
)
def test_a_text_is_written_so_that_every_reader_has_the_same_text(word: str) -> None:
    text = dump_yaml({"a": word, word: [word]})
    assert parse_yaml(text, "", "") == yaml.safe_load(text) == {"a": word, word: [word]}


SCENARIO = (
    "name: two\nroom: lab\nduration_s: 2\npeople: {ann: {script: {kind: wander}}}\n"
    "sensors: {low: {kind: laser, rate_hz: 10, mount: {xyz: [0, 0, 0.4]}}}\n"
)


def refused(tmp_path: Path, text: str, *overrides: str) -> str:
    (tmp_path / "s.yaml").write_text(text)
    with pytest.raises(InputError) as caught:
        load_scenario(tmp_path / "s.yaml", overrides)
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize("word", ["on", "yes", "010", "0x10", "1_000", "12:30:00", "true"])
def test_a_number_is_expected_is_said(tmp_path: Path, word: str) -> None:
    said = f"duration_s: a number is expected (got {True if word == 'true' else word!r})"
    assert said in refused(tmp_path, SCENARIO.replace("duration_s: 2", f"duration_s: {word}"))
    assert said in refused(tmp_path, SCENARIO, f"duration_s={word}")


def test_a_person_may_be_called_no(tmp_path: Path) -> None:
    (tmp_path / "s.yaml").write_text(SCENARIO.replace("ann", "no"))
    assert list(load_scenario(tmp_path / "s.yaml").people) == ["no"]


@pytest.mark.parametrize("colour", ["#151517", "#fff", "#11223344"])
def test_a_bare_colour_is_a_comment_in_a_file_and_a_text_on_the_command_line(tmp_path: Path, colour: str) -> None:
    for value in (
        f" {colour}",
        f"\t{colour}",
        f" {colour} # dark",
        f"\n    - {colour}",
        f" [{colour}]",
        f" {{b: {colour}}}",
    ):
        with pytest.raises(InputError) as caught:
            parse_yaml(f"hair:{value}\n", "s.yaml", "a scenario")
        assert f"{colour} without quotes is a comment and says nothing: write '{colour}' in quotes" in str(caught.value)
    for value in (f" '{colour}'", f" dark {colour}", f"  # {colour}\n  b: 1", f" x # {colour}"):
        parse_yaml(f"hair:{value}\n", "s.yaml", "a scenario")
    assert parse_yaml_value(colour, "--set hair") == colour
    in_list = parse_yaml_value(f"[{colour}, 'room #101', \"x, #fff\", {{hair: {colour}}}, {colour}]", "--set hair")
    assert in_list == [colour, "room #101", "x, #fff", {"hair": colour}, colour]


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("true", "the name True: a text is expected; in quotes it is one"),
        ("3", "the name 3: a text is expected; in quotes it is one"),
        ("a.b", "the name 'a.b': a name of letters a to z, digits, '-' and '_', a letter first, is expected"),
        ("'true'", ""),
        ("on", ""),
    ],
)
@pytest.mark.parametrize("field", ["people", "sensors"])
def test_a_name_that_yaml_reads_as_no_text_is_told_where_it_stands(
    field: str, name: str, said: str, tmp_path: Path
) -> None:
    laser = "{kind: laser, rate_hz: 10, mount: {xyz: [0, 0, 0.95]}}"
    names = {"people": "ann", "sensors": "low"} | {field: name}
    path = tmp_path / "odd.yaml"
    people, sensors = f"{{{names['people']}: {{}}}}", f"{{{names['sensors']}: {laser}}}"
    path.write_text(f"name: odd\nroom: lab\nduration_s: 1\npeople: {people}\nsensors: {sensors}\n")
    if said:
        with pytest.raises(InputError) as caught:
            load_scenario(path)
        assert str(caught.value) == f"{path}: {field}: {said}"
    else:
        assert list(getattr(load_scenario(path), field)) == [name.strip("'")]


def test_options_of_a_class_stand_under_a_name_of_its_own() -> None:
    changes = ["trackers={mine: {preset: 'my_lab:Mine', gate_m: 1}}"]
    assert load_scenario("lab-five-people", changes).trackers["mine"].preset == "my_lab:Mine"
    for change in ("trackers={'my_lab:Mine': {gate_m: 1}}", "trackers.my_lab:Mine.gate_m=1"):
        with pytest.raises(InputError, match=r"trackers: options of my_lab:Mine stand under .*preset: 'my_lab:Mine'"):
            load_scenario("lab-five-people", [change])
