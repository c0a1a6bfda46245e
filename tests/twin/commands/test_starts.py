"""`twin new`: what it writes runs as it is; `twin list`, `twin check`, `twin view ROOM`, and a foreign package `trackers`."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import command_line
import cv2
import pytest
from typer.testing import CliRunner

import twin
from trackers.errors import InputError, PlugInError
from trackers.paper_rules import bibtex
from trackers.presets import available
from twin.__main__ import other_trackers
from twin.cli import app
from twin.commands.info import checked_file
from twin.studies.spec import Study
from twin.suites.expansion import expand
from twin.suites.spec import load_suite


def _twin(*arguments: str, code: int = 0) -> str:
    result = CliRunner().invoke(app, list(arguments))
    assert result.exit_code == code, (result.output, result.exception)
    return result.output


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    return tmp_path


def test_new_room_and_scenario_run(here: Path) -> None:
    _twin("new", "room", "--out", "office.xml")
    _twin("view", "office.xml", "--out", "office.png")
    assert cv2.imread("office.png").std() > 20
    _twin("new", "scenario", "--out", "mine")
    text = Path("mine/scenario.yaml").read_text().replace("room: lab ", "room: ../office.xml ").replace("0.95]", "0.9]")
    Path("mine/own.yaml").write_text(
        re.sub(
            r"start: .*|waypoints: \[\[1.5, 2.0\], \[-1.5, 1.0\]\]",
            lambda m: "start: [-1, 0]" if m[0][0] == "s" else "waypoints: [[1, 1]]",
            text,
        )
    )
    _twin("run", "mine/own.yaml", "--tracker", "sort", "--duration", "1", "--no-video", "--out", "out")


def test_new_tracker_keeps_the_contract(here: Path) -> None:
    _twin("new", "tracker", "--out", "my_first.py")
    said = _twin("check", "--tracker", "my_first:Mine")
    assert (
        "keeps the contract" in said and ": plain run, second run, no observations, scans that meet nothing, " in said
    )


def test_check_says_what_a_tracker_breaks(here: Path) -> None:
    Path("broken_one.py").write_text(
        "class Mine:\n    def __init__(self, rig, background, rng): ...\n    def update(self, observation): ...\n"
    )
    assert "has not both update(observation) and tracks()" in _twin("check", "--tracker", "broken_one:Mine", code=1)


NO_TRACKERS = {
    "def __init__(self): ...": "has the methods of neither; a tracker, a class made as Class.rig, background, rng,",
    "def update(self, observation): ...": r"a class made as Mine.rig, background, rng, \*\*options. is expected",
}


@pytest.mark.parametrize("number", range(len(NO_TRACKERS)))
def test_check_says_what_a_class_must_take_and_have(here: Path, number: int) -> None:
    body, said = list(NO_TRACKERS.items())[number]
    Path(f"no_tracker_{number}.py").write_text(f"class Mine:\n    {body}\n")
    with pytest.raises(InputError, match=said):
        CliRunner().invoke(app, ["check", f"no_tracker_{number}:Mine"], catch_exceptions=False)
    Path(f"no_sensor_{number}.py").write_text("def make(rig, background, rng): ...\n")
    with pytest.raises(InputError, match=r"returns a sensor .* is expected; a tracker, .*, is checked by --tracker"):
        CliRunner().invoke(app, ["check", f"no_sensor_{number}:make"], catch_exceptions=False)


def test_list_of_scenarios_names_their_sensors() -> None:
    for line in _twin("list", "scenarios").splitlines()[1:]:
        name, sensors = line.split()[0], line.removesuffix(".").rpartition("Sensors: ")[2]
        assert sensors == "drawn" if name.startswith("drawn") else ", ".join(twin.load_scenario(name).sensors)
    assert "Sensors:" not in _twin("list")  # which is to be fast


def test_check_of_a_room_tells_its_area_and_corners(here: Path) -> None:
    """An L of 3 m x 1 m and 1 m x 2 m, not the box around it."""
    area = '<custom><numeric name="walkable_area" data="0 0 3 0 3 1 1 1 1 3 0 3"/></custom>'
    floor = (
        '<worldbody><light pos="0 0 5"/><geom name="floor" type="box" pos="1.5 1.5 -.05" size="2 2 .05"/></worldbody>'
    )
    Path("l.xml").write_text(f"<mujoco>{area}{floor}</mujoco>")
    assert "l.xml: a valid room; 5 m² to walk (6 corners, 3 m x 3 m over all); " in _twin("check", "l.xml")
    table = '<geom name="table" type="box" pos="2.5 1 .4" size=".5 .5 .4"/>'  # half of it within
    Path("l.xml").write_text(f"<mujoco>{area}{floor.replace('</worldbody>', f'{table}</worldbody>')}</mujoco>")
    assert "l.xml: a valid room; 4.5 m² to walk, without the furniture in 5 m² (6 corners" in _twin("check", "l.xml")


@pytest.mark.parametrize("kind", ["room", "scenario", "suite", "study"])
def test_check_knows_the_kind_of_a_file(here: Path, kind: str) -> None:
    out = {"room": "mine.xml", "scenario": "mine"}.get(kind, "mine.yaml")
    _twin("new", kind, "--out", out)
    file = "mine/scenario.yaml" if kind == "scenario" else out
    assert _twin("check", file).startswith(f"{file}: a valid {kind}; ")
    Path(file).write_text(Path(file).read_text().replace("<worldbody>", "<world>").replace("name:", "nam:", 1))
    assert isinstance(CliRunner().invoke(app, ["check", file]).exception, InputError)


def test_check_reports_every_one_of_several_files(here: Path) -> None:
    _twin("new", "study", "--out", "good.yaml")
    Path("bad.yaml").write_text(Path("good.yaml").read_text().replace("name:", "nam:", 1))
    result = CliRunner().invoke(app, ["check", "bad.yaml", "good.yaml", "nothing"])
    assert result.exit_code == 2 and "good.yaml: a valid study; " in result.stdout
    for name in ("bad.yaml", "nothing"):
        assert f"twin: {name}: " in result.stderr


@pytest.mark.parametrize(
    ("room", "xyz"), [("lab", "[0, 99, 1]"), ("lab", "[0, 0, 9]"), ("meeting_room", "[50, 50, 1]")]
)
@pytest.mark.parametrize("lens", ["{kind: laser, ", "{kind: fisheye, lens: equidistant_185, "])
def test_check_refuses_what_a_run_would_refuse(here: Path, room: str, xyz: str, lens: str) -> None:
    sensors = f"sensors: {{high: {lens}rate_hz: 5, mount: {{xyz: {xyz}}}}}}}"
    Path("s.yaml").write_text(f"name: s\nroom: {room}\nduration_s: 1\npeople: {{}}\n{sensors}\n")
    for command in (["check", "s.yaml"], ["run", "s.yaml", "--tracker", "sort"]):
        error = CliRunner().invoke(app, command).exception
        assert isinstance(error, InputError)
        assert "sensors.high.mount.xyz" in str(error)


@pytest.mark.parametrize(
    ("trackers", "said"),
    [
        ("{mine: {preset: srot}}", r"trackers.mine: there is no tracker 'srot'; did you mean 'sort'\?"),
        ("{sort: {coast: 3}}", "s.yaml: tracker sort: coast: unknown key"),
        ("{rgbd-head: {}}", "s.yaml: tracker rgbd-head: none of the rig's sensors"),
    ],
)
def test_check_refuses_a_tracker_that_a_run_would_refuse(here: Path, trackers: str, said: str) -> None:
    sensors = "sensors: {low: {kind: laser, rate_hz: 5, mount: {xyz: [0, 0, 0.9]}}}"
    scenario = f"name: s\nroom: lab\nduration_s: 1\npeople: {{}}\n{sensors}\n"
    Path("s.yaml").write_text(scenario + f"trackers: {trackers}\n")
    with pytest.raises(InputError, match=said):
        CliRunner().invoke(app, ["check", "s.yaml"], catch_exceptions=False)
    Path("s.yaml").write_text(scenario + "trackers: {mine: {preset: sort}, own: {preset: 'no_such:Class'}}\n")
    assert _twin("check", "s.yaml").startswith("s.yaml: a valid scenario; ")


def test_check_takes_half_a_scenario_for_one(here: Path) -> None:
    Path("s.yaml").write_text("name: s\nroom: lab\n")
    with pytest.raises(InputError, match="s.yaml: duration_s: is missing"):
        CliRunner().invoke(app, ["check", "s.yaml"], catch_exceptions=False)


@pytest.mark.parametrize("above_m", [1.0, 1.5])
def test_check_refuses_a_room_in_which_nobody_can_stand(here: Path, above_m: float) -> None:
    slab = '<geom name="{}" type="box" pos="0 0 {}" size="3 3 .05"/>'
    bodies = '<light pos="0 0 5"/>' + slab.format("floor", -0.05)
    for more, is_valid in (("", True), (slab.format("ceiling", above_m), False)):
        Path("r.xml").write_text(f"<mujoco><worldbody>{bodies}{more}</worldbody></mujoco>")
        error = CliRunner().invoke(app, ["check", "r.xml"]).exception
        assert (error is None) == is_valid
    assert str(error).startswith("r.xml: area: furniture leaves no place to stand; ")


def test_check_of_a_rig(here: Path) -> None:
    sensor = "sensors: {low: {kind: laser, topic: /scan, room_from_sensor: {xyz: [0, 0, HEIGHT], rpy: [0, 0, 0]}}}"
    Path("rig.yaml").write_text(sensor.replace("HEIGHT", "0.4"))
    assert _twin("check", "rig.yaml") == "rig.yaml: a valid rig; sensors: low\n"
    for wrong in (sensor.replace("HEIGHT", "low"), "unrelated: 1", "- 1"):
        Path("rig.yaml").write_text(wrong)
        assert isinstance(CliRunner().invoke(app, ["check", "rig.yaml"]).exception, InputError)


def test_check_of_a_sensor(here: Path) -> None:
    Path("own_sensor.py").write_text(
        "from twin.scenario import load_scenario\n"
        "from twin.scenario.sensor_descriptions import build_sensor\n"
        "def make():\n"
        "    return build_sensor('waist', load_scenario('lab-five-people').sensors['waist'], lambda: None)\n"
    )
    assert "keeps the contract of a sensor" in _twin("check", "--sensor", "own_sensor:make")


def test_new_suite_and_study_are_ones(here: Path) -> None:
    _twin("new", "suite", "--out", "gate.yaml")
    suite, path = load_suite(here / "gate.yaml")
    assert len(expand(suite, path)) == suite.n_case == 12
    _twin("new", "study", "--out", "places.yaml")
    from trackers.user_input.plain_data import parse_yaml

    study = Study.model_validate(parse_yaml(Path("places.yaml").read_text(), "places.yaml", "a study"))
    assert study.name == "places"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["new", "tracker", "--out", "my-own.py"], "the name of a Python module"),
        (["new", "tracker", "--out", "numpy.py"], "numpy is a word or a module of Python's, or installed"),
        (["new", "tracker", "--out", "class.py"], "class is a word or a module of Python's"),
        (["new", "room", "--out", "room.yaml"], "ending in .xml"),
        (["new", "scenario", "--out", "office.yaml"], "is a folder's, into which scenario.yaml is written; office is"),
        (["view", "lab", "--at", "3"], "lab is a room"),
        (["view", "lab", "--to", "0"], "lab is a room"),
        (["list", "robots"], "valid are scenarios, rooms"),
        (["check", "--tracker", "a:B", "--sensor", "c:d"], "one of the three"),
        (["check", "nothing"], "no such file or name"),
        (["check", "own:make"], "No module named 'own'"),
    ],
)
def test_what_cannot_be_is_refused(here: Path, arguments: list[str], said: str) -> None:
    result = CliRunner().invoke(app, arguments)
    assert isinstance(result.exception, InputError)
    assert said in str(result.exception)
    assert list(here.iterdir()) == []


def test_everything_that_is_listed_is_described() -> None:
    for line in _twin("list").splitlines():
        if line.startswith("  "):
            assert len(line.split(maxsplit=1)) == 2, line


def test_bibtex_names_each_paper_once() -> None:
    entries = bibtex(each.citation for each in available().values())
    keys = re.findall(r"@misc\{([\w-]+),", entries)
    assert len(keys) == len(set(keys)) >= 5
    assert entries.count("{") == entries.count("}")


def test_version_is_that_of_the_distribution() -> None:
    assert _twin("--version").split() == ["roomtwin", twin.__version__]


def test_a_library_without_a_record_of_its_version_is_no_fault() -> None:
    assert twin.version_of("no-such-distribution") == "unknown"


def test_another_package_called_trackers_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert other_trackers() is None
    import trackers

    monkeypatch.delattr(trackers, "DISTRIBUTION")
    assert "that of roomtwin is expected" in str(other_trackers())
    with pytest.raises(ImportError, match="that of roomtwin is expected"):
        _ = twin.load_scenario


@pytest.mark.parametrize("group", ["new", "suite", "study"])
def test_a_group_of_commands_alone_prints_its_help(here: Path, group: str) -> None:
    assert "Commands:" in _twin(group)


def test_new_tells_the_path_and_the_next_command(here: Path) -> None:
    for kind, option, file, following in [
        ("scenario", "mine", "mine/scenario.yaml", "twin run mine/scenario.yaml"),
        ("room", "a room.xml", "a room.xml", "twin view 'a room.xml'"),
        ("tracker", "mine.py", "mine.py", "twin check mine:Mine"),
        ("tracker", "sub/own.py", "sub/own.py", "cd sub && twin check own:Mine"),
        ("suite", "suite.yaml", "suite.yaml", "twin suite run suite.yaml"),
        ("study", "study.yaml", "study.yaml", "twin study run study.yaml"),
    ]:
        said = [line.split(maxsplit=1) for line in _twin("new", kind, "--out", option).splitlines()]
        assert said == [[kind, file], ["next", following]]
        assert following.split(" && ")[-1] in Path(file).read_text("utf-8")
    said = _twin("new", "scenario", "--drawn", "--seed", "1", "--out", "drawn").splitlines()
    assert [line.split(maxsplit=1)[0] for line in said] == ["scenario", "room", "next"]
    assert said[-1].endswith("twin run drawn/scenario.yaml")


@pytest.mark.parametrize(
    ("line", "said"),
    [
        (
            "walls: {height_m: [0.95, 0.95], off_m: 0.1, every_m: 1e-9}",
            r"has 2\.\d+e\+10 poses; at most 200000 are expected",
        ),
        (
            "walls: {height_m: [0.95, 0.95], off_m: 0.1, every_m: 1e-320}",
            "poses; at most 200000 are expected, by larger steps",
        ),
        (
            "walls: {height_m: [0.95, 0.95], off_m: 100, every_m: 1}",
            "there is no pose in the room; a smaller off_m, or larger",
        ),
        ("ceiling: {every_m: 0.00001}", "poses; at most 200000"),
        ("box: {x_m: [-3, 3], y_m: [-3, 3], z_m: [0, 2], every_m: 0.0001}", "poses; at most 200000"),
    ],
)
def test_a_study_of_too_many_poses_is_refused_before_they_are_made(here: Path, line: str, said: str) -> None:
    _twin("new", "study", "--out", "mine.yaml")
    text = re.sub("walls: .*", line, Path("mine.yaml").read_text())
    Path("mine.yaml").write_text(text)
    error = CliRunner().invoke(app, ["check", "mine.yaml"]).exception
    assert isinstance(error, InputError)
    assert re.search(f"mine.yaml: devices.scanner: .*{said}", str(error)), error


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (
            "new scenario X",
            "extra argument(s) (X); `twin new scenario [OPTIONS]` is expected, and --out names what is written",
        ),
        (
            "run lab-five-people duration_s=1",
            "extra argument(s) (duration_s=1); `twin run [OPTIONS] scenario` is expected, and --set duration_s=1 changes a field",
        ),
        ("new rig", "Missing argument 'recording'; `twin new rig [OPTIONS] recording` is expected"),
        ("evaluate a b c", "extra argument(s) (c); `twin evaluate [OPTIONS] truth tracks` is expected"),
    ],
)
def test_arguments_too_many_or_too_few_are_told_with_the_usage(arguments: str, said: str) -> None:
    done = command_line.twin(*arguments.split())
    assert done.returncode == 2 and done.stderr.startswith("twin: ")
    assert done.stderr.endswith(f"{said}\n")


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("mine", "'mine' is a folder; the path of a .yaml file is expected, as mine/scenario.yaml"),
        ("smoke", "there is no scenario 'smoke': it is a suite; valid are "),
        ("other/mine.yaml", "there is no scenario 'other/mine.yaml': no file is {here}/other/mine.yaml; valid are "),
        ("lab-5", "there is no scenario 'lab-5'; valid are "),
    ],
)
def test_what_is_no_scenario_is_told_with_what_it_is(here: Path, name: str, said: str) -> None:
    _twin("new", "scenario", "--out", "mine")
    error = CliRunner().invoke(app, ["run", name, "--tracker", "sort"]).exception
    assert isinstance(error, InputError) and str(error).startswith(said.format(here=Path.cwd()))


BROKEN_SENSORS = """
from trackers.rig import LaserSensor, Pose
class NoObserve:
    name, instants_s = "door", (0.0,)
    def rig_sensor(self):
        return LaserSensor(kind="laser", topic="/s", role="waist", room_from_sensor=Pose(xyz=(0, 0, 1), rpy=(0, 0, 0)))
class Raises(NoObserve):
    def observe(self, *given):
        raise RuntimeError("dark")
class Leaves(NoObserve):
    def observe(self, *given):
        raise SystemExit(3)
class GivesNone(NoObserve):
    def observe(self, *given):
        return None
class GivesPair(NoObserve):
    def observe(self, *given):
        return 1, 2
def none():
    return None
def fails():
    return 1 / 0
"""


@pytest.mark.parametrize(
    ("make", "said"),
    [
        ("NoObserve", "NoObserve has no observe; a sensor has name, instants_s, observe, rig_sensor"),
        ("Raises", "raised RuntimeError: dark (broken_sensors.py, line 9)"),
        ("Leaves", "raised SystemExit: 3 (broken_sensors.py, line 12)"),
        ("GivesNone", "observe() gave NoneType; a Reading and the state for the next call are expected"),
        ("GivesPair", "observe() gave tuple of int, int; a Reading and the state"),
        ("none", "NoneType has no name, instants_s, observe, rig_sensor; a sensor has"),
        ("fails", "making it raised ZeroDivisionError: division by zero (broken_sensors.py, line 22)"),
    ],
)
def test_check_names_what_is_broken_in_a_sensor(here: Path, make: str, said: str) -> None:
    Path("broken_sensors.py").write_text(BROKEN_SENSORS)
    assert f"broken_sensors:{make}: {said}" in _twin("check", "--sensor", f"broken_sensors:{make}", code=1)


@pytest.mark.parametrize(("number", "code"), list(enumerate(["1 / 0", "class Mine(:", "import sys; sys.exit(4)"])))
@pytest.mark.parametrize("option", [(), ("--sensor",)])
def test_a_module_that_raises_when_imported_is_its_author_s_fault(
    here: Path, number: int, code: str, option: tuple[str, ...]
) -> None:
    name = f"raising_{number}{len(option)}"  # no module twice
    Path(f"{name}.py").write_text(code)
    error = CliRunner().invoke(app, ["check", *option, f"{name}:Mine"]).exception
    assert isinstance(error, PlugInError) and f"{name}:Mine: the import raised " in str(error)


def test_a_scenario_is_checked_with_further_seeds_where_they_make_a_difference(tmp_path: Path) -> None:
    people = "people: {ann: {start: [-2.2, 1.6], script: {kind: stand}}}\n"
    sensors = "sensors: {one: {kind: laser, rate_hz: 10, mount: {xyz: [0, 0, 0.95]}}}\n"
    plain = tmp_path / "plain.yaml"
    plain.write_text("name: plain\nroom: meeting_room\nduration_s: 1\n" + people + sensors)
    moved = tmp_path / "moved.yaml"
    moved.write_text(plain.read_text() + "randomize: {start_m: 0.2}\n")
    later = tmp_path / "later.yaml"
    later.write_text(plain.read_text() + "randomize: {speed: 0.1}\n")
    assert "seeds" not in checked_file("scenario", str(plain))
    assert checked_file("scenario", str(later)).endswith("; checked with seeds 0 to 9, others may differ")
    with pytest.raises(
        InputError, match=r"moved.yaml: people.ann.start: with seed 4, and 1 more of 10 seeds, .* 'plant'"
    ):
        checked_file("scenario", str(moved))
