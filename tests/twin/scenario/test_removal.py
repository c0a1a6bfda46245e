"""null removes what is there, and a word that names nothing is refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from trackers.errors import InputError
from twin.scenario import load_scenario

BASE = """
name: base
room: lab
duration_s: 1
people: {ann: {start: [0, 1.5], script: {kind: stand}}, ben: {}}
sensors:
  knee: {kind: laser, role: knee, rate_hz: 10, mount: {xyz: [0, 0, 0.4], yaw_deg: 90}}
  waist: {kind: laser, role: waist, rate_hz: 10, mount: {xyz: [0, 0, 0.95], yaw_deg: 90}}
"""


@pytest.fixture
def base(tmp_path: Path) -> Path:
    path = tmp_path / "base.yaml"
    path.write_text(BASE)
    return path


@pytest.mark.parametrize(
    ("override", "said"),
    [
        ("sensors.kneee=null", "there is none of this name to remove; did you mean 'knee'? valid here: knee, waist"),
        ("people.p99=null", "there is none of this name to remove; valid here: ann, ben"),
        ("people={p99: null}", "people.p99: there is none of this name to remove"),
        ("faults.f1=", "there is none of this name to remove; valid here: none, as nothing is there"),
        ("trackers.mine=null", "there is none of this name to remove"),
        ("aera=null", "unknown key; did you mean 'area'?"),
        ("sensors.knee.rolee=null", "unknown key; did you mean 'role'?"),
        ("sensors.knee.lens=null", "unknown key"),
        ("sensors.knee.mount.yaw=null", "unknown key; did you mean 'yaw_deg'?"),
    ],
)
def test_null_that_removes_nothing_is_refused(base: Path, tmp_path: Path, override: str, said: str) -> None:
    with pytest.raises(InputError) as caught:
        load_scenario(base, [override])
    assert str(caught.value).startswith(f"--set {override}: ") and said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_null_in_a_file_is_held_to_the_same(base: Path, tmp_path: Path) -> None:
    child = tmp_path / "child.yaml"
    child.write_text("extends: base.yaml\nname: child\nsensors: {kneee: null}\n")
    with pytest.raises(InputError, match=r"^.*child\.yaml: sensors\.kneee: .* did you mean 'knee'\?"):
        load_scenario(child)
    child.write_text(BASE + "faults: {f1: null}\n")
    with pytest.raises(InputError, match=r"child\.yaml: faults\.f1: there is none of this name"):
        load_scenario(child)


def test_null_removes_what_is_there_and_leaves_out_what_may_be(base: Path) -> None:
    scenario = load_scenario(
        base,
        ["sensors.knee=null", "people.ben=null", "area=null", "sensors.waist.role=null", "people.ann.shirt=null",
         "trackers.mine={preset: laser-imm}", "trackers.mine.knee.gap_m=null"],
    )  # fmt: skip
    assert list(scenario.sensors) == ["waist"] and list(scenario.people) == ["ann"]
    assert scenario.sensors["waist"].role is None  # pyright: ignore[reportAttributeAccessIssue]
    assert scenario.trackers["mine"].options == {"knee": {"gap_m": None}}


@pytest.mark.parametrize("override", ["a." * 3000 + "b=1", "x=" + "[" * 3000, "seed=" + "9" * 5000, "x=&a {b: *a}"])
def test_an_override_that_is_only_bad_is_one_short_sentence(base: Path, override: str) -> None:
    with pytest.raises(InputError) as caught:
        load_scenario(base, [override])
    assert str(caught.value).startswith("--set") and "\n" not in str(caught.value)
    assert len(str(caught.value)) < 500


@pytest.mark.parametrize("field", ["room", "extends", "pedestrians.file"])
@pytest.mark.parametrize("name", ["a\0b", "a" * 300])
def test_a_path_that_no_file_can_have_is_one_sentence(tmp_path: Path, field: str, name: str) -> None:
    path = tmp_path / "base.yaml"
    path.write_text(BASE + f"pedestrians: {{file: {name!r}}}\n".replace("\\x00", "\\0").replace("'", '"'))
    if field != "pedestrians.file":
        path.write_text(BASE.replace("room: lab\n", "") + f'{field}: "{name}"\n'.replace("\0", "\\0"))
    with pytest.raises(InputError):
        load_scenario(path)


@pytest.mark.parametrize("field", ["people", "sensors", "housings", "faults", "trackers"])
def test_a_name_that_no_file_can_have_is_refused(base: Path, field: str) -> None:
    with pytest.raises(InputError, match="at most 100 characters"):
        load_scenario(base, [f"{field}.{'a' * 300}={{}}"])
    with pytest.raises(InputError, match="name: String should have at most 100 characters"):
        load_scenario(base, [f"name={'a' * 300}"])


def test_a_path_into_an_item_that_is_a_value_is_refused():
    with pytest.raises(InputError, match=r"--set area.0.1.x=2: area.0.1 is a value, not a mapping; it has no 'x'"):
        load_scenario("lab-five-people", ["area.0.1.x=2"])


@pytest.mark.parametrize(
    ("override", "said"),
    [
        (
            "sensors.knee={rate_hz: 5}",
            "sensors.knee: is replaced as a whole, and has no kind; --set sensors.knee.rate_hz=",
        ),
        (
            "sensors={knee: {rate_hz: 5}}",
            "sensors.knee: is replaced as a whole, and has no kind; --set sensors.knee.rate",
        ),
        (
            "people.ann.script={after_s: 5}",
            "people.ann.script: is replaced as a whole, and has no kind; --set people.ann.",
        ),
    ],
)
def test_a_mapping_that_lacks_the_kind_of_what_it_replaces_is_refused(base: Path, override: str, said: str) -> None:
    with pytest.raises(InputError) as caught:
        load_scenario(base, [override])
    assert str(caught.value).startswith(f"--set {override}: {said}")


def test_a_mapping_that_drops_others_beside_it_is_told_and_one_of_new_names_is_not(
    base: Path, caplog: pytest.LogCaptureFixture
) -> None:
    assert list(load_scenario(base, ["people={ann: {height_m: 1.9}}"]).people) == ["ann"]
    said = "replaces all of people, without ben; --set people.ann.FIELD=VALUE changes one of them"
    assert [each.getMessage() for each in caplog.records] == [f"--set people={{ann: {{height_m: 1.9}}}}: {said}"]
    caplog.clear()
    for whole in (
        "people={eve: {}}",
        "people={}",
        "people={ann: {}}",  # nothing of Ann is changed: only a replacement can be meant
        "people={ann: {}, ben: {height_m: 1.8}}",
        "people.ann={height_m: 2}",
    ):
        load_scenario(base, [whole])
    assert not caplog.records
