"""Options: what setting one of them changes, and what stays."""

from __future__ import annotations

from functools import cache, partial
from math import isfinite
from types import NoneType, UnionType
from typing import Annotated, Any, ClassVar, Literal, get_args

import numpy as np
import pytest
import synthetic_home
import synthetic_meeting
from hypothesis import given, settings, strategies as st
from pydantic import BaseModel, Field, ValidationError
from synthetic_room import rig

import trackers.presets
from trackers.configuration import Strict, validate
from trackers.errors import InputError, valid_names
from trackers.presets import PRESETS, Preset, make_tracker
from trackers.rgbd_head.options import Start
from trackers.user_input.plain_data import deep_merge

Path = tuple[str, ...]
ANYWHERE = st.floats(-1e6, 1e6)
st.register_type_strategy(
    Start, st.builds(Start, at_s=st.floats(0, 1e6), place=st.tuples(ANYWHERE, ANYWHERE, ANYWHERE), yaw_deg=ANYWHERE)
)  # hypothesis does not know that its numbers are finite


def leaves(model: BaseModel, above: Path = ()) -> dict[Path, Any]:
    """Every option that is not a mapping of options itself, by its path."""
    found = {}
    for name, value in model:
        found |= leaves(value, (*above, name)) if isinstance(value, BaseModel) else {(*above, name): value}
    return found


@cache
def options_of(preset: str) -> Any:
    on = synthetic_home.rig() if "floor" in preset else synthetic_meeting.rig() if "rgbd" in preset else rig()
    return make_tracker(preset, on).options  # pyright: ignore[reportAttributeAccessIssue]


def nested(path: Path, value: Any) -> dict[str, Any]:
    for name in reversed(path):
        value = {name: value}
    return value


def valid_values(options: BaseModel, path: Path) -> st.SearchStrategy[Any]:
    """What the leaf's type and bounds, and its siblings, allow."""
    for name in path[:-1]:
        options = getattr(options, name)
    info = type(options).model_fields[path[-1]]
    members = get_args(info.annotation) if isinstance(info.annotation, UnionType) else (info.annotation,)
    members = [each for each in members if not (isinstance(each, type) and issubclass(each, BaseModel))]  # no leaf
    kinds = [each if each is NoneType else Annotated[each, Field(), *info.metadata] for each in members]
    return st.one_of(*map(st.from_type, kinds)).filter(_is_finite).filter(partial(_fits, options, path[-1]))


def _is_finite(value: Any) -> bool:
    return all(map(_is_finite, value)) if isinstance(value, tuple) else not isinstance(value, float) or isfinite(value)


def _fits(siblings: BaseModel, name: str, value: Any) -> bool:
    try:
        type(siblings).model_validate(dict(siblings) | {name: value})
    except ValidationError:
        return False
    return True


EVERY_OPTION = [(preset, path) for preset in PRESETS for path in leaves(options_of(preset))]


_OF_NUMPY = {bool: np.bool_, int: np.int64, float: np.float64, str: np.str_}


@pytest.mark.parametrize("kinds", [{}, _OF_NUMPY], ids=["python", "numpy"])
@settings(max_examples=200, deadline=None)
@given(st.data())
def test_setting_one_option_of_a_preset_changes_that_one_alone(kinds: dict[type, type], data: st.DataObject) -> None:
    preset, path = data.draw(st.sampled_from(EVERY_OPTION))
    before = options_of(preset)
    value = data.draw(valid_values(before, path))
    given_value = kinds.get(type(value), lambda same: same)(value)
    given_options = deep_merge(PRESETS[preset].options, nested(path, given_value))
    after = leaves(validate(type(before), given_options, "options"))
    assert after == leaves(before) | {path: value} and type(after[path]).__module__ != "numpy"


@pytest.mark.parametrize(
    ("preset", "path"),
    [
        (preset, path)
        for preset, path in EVERY_OPTION
        if preset in ("laser-fisheye-imm", "camera-floor-particle", "rgbd-head") and len(path) > 1
    ],
)
def test_a_nested_option_set_to_what_it_is_changes_nothing(preset: str, path: Path) -> None:
    before = options_of(preset)
    again = validate(type(before), nested(path, leaves(before)[path]), "options")
    assert again == before


def test_a_tracker_gets_the_siblings_of_what_is_set_as_its_preset_has_them(monkeypatch: pytest.MonkeyPatch) -> None:
    target = PRESETS["laser-imm"].target
    usual = make_tracker("laser-imm", rig()).options  # pyright: ignore[reportAttributeAccessIssue]
    narrow = Preset(target, "", options={"camera": False, "knee": {"jump_m": 0.06}, "legs": {"gate_m": 0.6}})
    monkeypatch.setattr(trackers.presets, "PRESETS", {"narrow": narrow})
    options = make_tracker("narrow", rig(), options={"knee": {"min_samples": 5}}).options  # pyright: ignore[reportAttributeAccessIssue]
    assert (options.knee.min_samples, options.knee.jump_m, options.knee.half_depth_m) == (
        5,
        0.06,
        usual.knee.half_depth_m,
    )
    assert options.legs.gate_m == 0.6


class _Inner(Strict):
    first: int = 1
    second: int = 2


class _Middle(Strict):
    inner: _Inner = _Inner(first=10)
    beside: int = 0


class _Outer(Strict):
    middle: _Middle = _Middle(inner=_Inner(first=100), beside=5)
    maybe: _Inner | None = _Inner(second=20)


def test_the_outermost_owner_s_defaults_count() -> None:
    changed = validate(_Outer, {"middle": {"inner": {"second": 3}}, "maybe": {"first": 7}}, "options")
    assert changed.middle == _Middle(inner=_Inner(first=100, second=3), beside=5)
    assert changed.maybe == _Inner(first=7, second=20)
    assert validate(_Outer, {"maybe": None}, "options").maybe is None


class Wheel(Strict):
    former_names: ClassVar = {"width_m": "radius_m"}

    kind: Literal["wheel"] = "wheel"
    radius_m: float = 1.0
    grip: float = 1.0


class Skid(Strict):
    former_names: ClassVar = {"width_m": "length_m"}

    kind: Literal["skid"] = "skid"
    length_m: float = 1.0


class Cart(Strict):
    former_names: ClassVar = {"rolls_on": "wheel", "all": "parts"}

    wheel: Wheel = Wheel(radius_m=2.0, grip=3.0)
    parts: tuple[Annotated[Wheel | Skid, Field(discriminator="kind")], ...] = ()
    named: dict[str, Wheel] = Field(default={})


def test_former_names_are_read_at_every_depth_and_each_is_told_with_its_path(caplog: pytest.LogCaptureFixture) -> None:
    former = {
        "rolls_on": {"width_m": 5},
        "all": [{"kind": "skid", "width_m": 6}, {"kind": "wheel", "width_m": 7}],
        "named": {"width_m": {"width_m": 8}},
    }
    cart = validate(Cart, former, "cart-of-this-test.yaml")
    assert cart == Cart(
        wheel=Wheel(radius_m=5, grip=3),
        parts=(Skid(length_m=6), Wheel(radius_m=7)),
        named={"width_m": Wheel(radius_m=8)},
    )
    told = [record.getMessage() for record in caplog.records]
    paths = ("rolls_on", "rolls_on.width_m", "all", "all.0.width_m", "all.1.width_m", "named.width_m.width_m")
    assert len(told) == len(paths)
    for path, line in zip(paths, told, strict=True):
        assert line.startswith(f"cart-of-this-test.yaml: {path}: is now called")
    assert "'length_m'" in told[3] and "'radius_m'" in told[4]


def test_former_names_are_read_where_a_model_is_made_without_a_file() -> None:
    assert Cart.model_validate({"rolls_on": {"width_m": 5}}).wheel == Wheel(radius_m=5, grip=3)


@pytest.mark.parametrize("content", [{"wheel": {}, "rolls_on": {}}, {"wheel": {"width_m": 1, "radius_m": 1}}])
def test_a_field_with_both_its_names_is_refused(content: dict[str, Any]) -> None:
    with pytest.raises(InputError, match=r"^cart\.yaml: .*is the former name of .*give one of them"):
        validate(Cart, content, "cart.yaml")


class _Gate(Strict):
    gate_m: float = 1.0


class _Tracker(Strict):
    former_names: ClassVar = {"life.radius_m": "gate.gate_m", "life.hits": "track.hits", "life": "track"}
    fixed_values: ClassVar = {"gate.shape": "circle", "reach": (1.0, 2.0)}

    gate: _Gate = _Gate()
    track: dict[str, int] = Field(default_factory=dict)


def test_options_that_moved_between_groups_are_read_at_their_former_paths(caplog: pytest.LogCaptureFixture) -> None:
    given = {"life": {"radius_m": 2.0, "hits": 3, "coast": 4}, "gate": {"shape": "circle"}, "reach": [1.0, 2.0]}
    made = validate(_Tracker, given, "moved.yaml")
    assert (made.gate.gate_m, made.track) == (2.0, {"hits": 3, "coast": 4})
    said = [record.getMessage() for record in caplog.records]
    assert any("moved.yaml: life.radius_m" in each and "'gate.gate_m'" in each for each in said)
    assert any("moved.yaml: gate.shape: is no option any more" in each for each in said)
    assert given["life"] == {"radius_m": 2.0, "hits": 3, "coast": 4}


class _Flat(Strict):
    former_names: ClassVar = {"gate_m": "gate.gate_m"}

    gate: _Gate = _Gate()


def test_an_option_that_moved_into_a_group_is_read_at_its_former_name() -> None:
    assert validate(_Flat, {"gate_m": 2.0}, "flat.yaml").gate.gate_m == 2.0


def test_a_moved_option_given_twice_and_a_fixed_one_of_another_value_are_refused() -> None:
    for content, words in (
        ({"life": {"radius_m": 2.0}, "gate": {"gate_m": 1.0}}, ["life.radius_m", "gate.gate_m", "one of them"]),
        ({"gate": {"shape": "square"}}, ["gate.shape", "'circle'", "'square'"]),
        ({"reach": None}, ["reach", "None"]),
    ):
        with pytest.raises(InputError) as raised:
            validate(_Tracker, content, "x.yaml")
        assert all(word in str(raised.value) for word in [*words, "x.yaml"])


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ("wasit", "did you mean 'waist'? valid are waist, Knee or a file"),
        ("KNEE", "did you mean 'Knee'? valid are waist, Knee or a file"),
        (7, "valid are waist, Knee or a file"),
    ],
)
def test_the_nearest_valid_name_comes_first(given: object, said: str) -> None:
    assert valid_names(given, ["waist", "Knee"], " or a file") == said
    assert valid_names(given, [], none="none, as there is no sensor") == "valid are none, as there is no sensor"


class _Fog(Strict):
    kind: Literal["fog"]
    at_s: float = 0.0


class _Dark(Strict):
    kind: Literal["dark"]


class _Kinds(Strict):
    faults: dict[str, Annotated[_Fog | _Dark, Field(discriminator="kind")]]


def test_a_mapping_without_a_kind_is_told_with_those_beside_it() -> None:
    content = {"faults": {"fog": {"at_s": 1}, "smoke": {"kind": "dark"}}}
    with pytest.raises(
        InputError, match=r"faults\.fog\.kind: is missing; one of fog, dark is expected; there are smoke"
    ):
        validate(_Kinds, content, "x.yaml")


class _Named(Strict):
    name: str = Field(description="name of the thing")


def test_a_missing_field_is_told_with_what_it_is() -> None:
    with pytest.raises(InputError, match=r"x\.yaml: name: is missing \(name of the thing\)$"):
        validate(_Named, {}, "x.yaml")


class _Limited(Strict):
    above: Annotated[float, Field(gt=0, lt=1)] = 0.5
    count: Annotated[int, Field(ge=1, le=5)] = 1
    choice: Literal["x", "y"] = "x"
    pair: Annotated[tuple[int, ...], Field(min_length=2, max_length=3)] = (1, 2)
    named: Annotated[dict[str, int], Field(default_factory=dict, min_length=1)]
    text: Annotated[str, Field(min_length=1)] = "a"


@pytest.mark.parametrize(
    ("field", "value", "said"),
    [
        ("above", 0, "a number greater than 0 is expected (got 0)"),
        ("above", 1, "a number less than 1 is expected (got 1)"),
        ("count", 0, "a number greater than or equal to 1 is expected (got 0)"),
        ("count", 6, "a number less than or equal to 5 is expected (got 6)"),
        ("choice", "z", "'x' or 'y' is expected (got 'z')"),
        ("pair", [1], "a length of 2 or more is expected (got [1])"),
        ("pair", [1, 2, 3, 4], "a length of 3 or less is expected (got [1, 2, 3, 4])"),
        ("named", {}, "a length of 1 or more is expected"),
        ("text", "", "a text that is not empty is expected (got '')"),
    ],
)
def test_a_value_beyond_a_limit_is_told_with_what_is_expected(field: str, value: object, said: str) -> None:
    with pytest.raises(InputError) as told:
        validate(_Limited, {field: value}, "f.yaml")
    assert str(told.value) == f"f.yaml: {field}: {said}"
