"""Which cases a suite has, and what of the code and the models a recording depends on."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from trackers.errors import InputError
from twin import models
from twin.suites import cache_keys
from twin.suites.expansion import Case, expand
from twin.suites.run import idle_changes
from twin.suites.spec import load_suite

HEAD = "name: s\ntrackers: [laser-imm]\nseeds: 2\n"


def cases_of(tmp_path: Path, text: str) -> list[Case]:
    path = tmp_path / "s.yaml"
    path.write_text(HEAD + text)
    return expand(*load_suite(path))


SEEDS_EXPECTED = (
    "a list of seeds, as in [0, 1, 2], how many from 0 on, as in 3, or {from: 1000, count: 200} is expected"
)


@pytest.mark.sample(3)
@pytest.mark.parametrize("name", models.names("suites"))
def test_shipped_suites_can_be_run(name: str) -> None:
    suite, path = load_suite(name)
    assert suite.name == name and suite.description
    cases = expand(suite, path)
    assert len({case.id for case in cases}) == len(cases) >= 2
    assert idle_changes(cases) == []


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ("grid: {trackers.sort.gate: [2, 3]}", "'trackers.sort.gate=2' and 'trackers.sort.gate=3' differ in nothing"),
        ("variants: [{}, {sensors.waist.role: waist}]", "'sensors.waist.role=waist' changes nothing"),
        ("grid: {trackers.sort.gate: [2, 3]}, trackers: [laser-imm, sort]", ""),
        ("grid: {people.white.height_m: [1.7, 1.8]}", ""),
    ],
)
def test_a_change_that_changes_nothing_is_told(tmp_path: Path, entry: str, said: str) -> None:
    found = idle_changes(cases_of(tmp_path, f"scenarios: [{{scenario: lab-five-people, {entry}}}]"))
    assert found == [f"lab-five-people: {said} that is simulated or tracked"] * bool(said)


def test_scenarios_times_seeds_times_overrides_times_trackers(tmp_path: Path) -> None:
    cases = cases_of(
        tmp_path,
        """
scenarios:
  - scenario: lab-five-people
    trackers: [laser-imm, laser-fisheye-imm, mine]
    set: {duration_s: 5, trackers.mine: {preset: laser-kalman, camera: false}}
    grid: {people.white.shirt: [red, blue], background_frames: [5, 10]}
    variants: [{}, {people.pink: null}]
  - scenario: lab-five-people
    name: other
    seeds: [7]
    limit_s: 30
""",
    )
    assert len(cases) == 3 * 2 * (2 * 2 * 2) + 1
    assert cases[0].seed == 0 and "seed: 0" in cases[0].resolved and "duration_s: 5" in cases[0].resolved
    assert cases[0].variant == "people.white.shirt=red, background_frames=5"
    assert cases[0].overrides[0] == "duration_s=5"
    assert cases[-1].limit_s == 30 and cases[-1].scenario == "other" and cases[0].limit_s == 600
    assert "trackers: {}" in cases[0].resolved and cases[0].resolved == cases[2].resolved
    assert any(change.startswith("trackers.mine={") for change in cases[0].tracker_changes)
    without_pink = [case for case in cases if "people.pink" in case.variant]
    assert len(without_pink) == 24 and all("pink" not in case.resolved for case in without_pink)


def test_rooms_and_pedestrians_of_a_suite_lie_beside_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "mine.xml").write_text((models.MODELS / "rooms" / "plaza.xml").read_text())
    (tmp_path / "paths.csv").write_text("t,id,x,y\n0.0,1,0.0,1.0\n4.0,1,3.0,1.0\n")
    monkeypatch.chdir("/")
    text = """
scenarios:
  - scenario: plaza-runners
    set: {room: mine.xml, pedestrians.file: paths.csv}
"""
    case = cases_of(tmp_path, text)[0]
    assert f"room: {tmp_path / 'mine.xml'}" in case.resolved and "walker-1" in case.resolved
    assert case.overrides == ('room="mine.xml"', 'pedestrians.file="paths.csv"')
    with pytest.raises(InputError, match=r"s.yaml: scenarios.0: set: room: there is no room 'your.xml'"):
        cases_of(tmp_path, text.replace("mine.xml", "your.xml"))


def test_ids_stay_the_same_whatever_else_is_in_the_suite(tmp_path: Path) -> None:
    one = cases_of(tmp_path, "scenarios: [{scenario: lab-five-people}]")
    two = cases_of(
        tmp_path, "scenarios: [{scenario: lab-five-people, name: first}, {scenario: lab-five-people, seeds: [1, 0]}]"
    )
    assert {case.id for case in one} <= {case.id for case in two}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("scenarios: [{scenario: lab}]", r"s.yaml: scenarios.0.scenario: there is no scenario 'lab': it is a room; "),
        ("scenarios: [{scenario: lab-five-people, seed: 1}]", r"scenarios.0.seed: unknown key; did you mean 'seeds'"),
        ("scenarios: []", r"scenarios: a list of scenarios, as in .* is expected \(got \[\]\)$"),
        ("scenarios: [{scenario: lab-five-people, seeds: 0}]", r"scenarios.0.seeds: "),
        (
            "scenarios: [{scenario: lab-five-people, trackers: [none]}]",
            r"there is no tracker 'none'; valid are .*laser-",
        ),
        ("scenarios: [{scenario: lab-five-people, set: {people.white.shirt: mauve}}]", r"no shirt colour 'mauve'"),
        (
            "scenarios: [{scenario: lab-five-people, grid: {seed: [1, 2]}}]",
            r"scenarios.0.grid.seed: seed is set; `seeds:` beside it",
        ),
        ("scenarios: [{scenario: lab-five-people}, {scenario: lab-five-people}]", r"seed 0, laser-imm is there twice"),
        (
            "scenarios: [{scenario: lab-five-people, seeds: 5}, {scenario: lab-five-people, seeds: 5}]",
            r"scenarios.1: lab-five-people, seed 0, laser-imm is there twice, as are 4 more of its cases; a name [^\n]*\Z",
        ),
        (
            "scenarios: [{scenario: lab-five-people, grid: {duration_s: [2, 3]}, variants: [{}, {duration_s: 2}]}]",
            r"lab-five-people \(duration_s=2\), seed 0, laser-imm is there twice, as are",
        ),
        (
            "scenarios: [{scenario: lab-five-people}]\ntolerances: {mata: {absolute: 1}}",
            r"no metric 'mata'; did you mean 'mota'\? valid are mota",
        ),
    ],
)
def test_bad_suites_are_told_with_the_field(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        cases_of(tmp_path, text)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("seeds: [a]", "seeds.0: a seed, a whole number from 0 up, is expected (got 'a')"),
        ("seeds: [0, -1]", "seeds.1: a seed, a whole number from 0 up, is expected (got -1)"),
        ("seeds: {}", f"seeds: {SEEDS_EXPECTED} (got {{}})"),
        ("seeds: [3, 0, 3]", "seeds: 3 stands twice; each once is expected (got [3, 0, 3])"),
        ("trackers: [sort, sort]", "trackers: \"sort\" stands twice; each once is expected (got ['sort', 'sort'])"),
        (
            "scenarios: [{scenario: lab-five-people, grid: {duration_s: [2, 2]}}]",
            "scenarios.0.grid.duration_s: 2 stands twice; each once is expected (got [2, 2])",
        ),
        (
            "scenarios: [{scenario: lab-five-people, variants: [{duration_s: 2}, {}, {duration_s: 2}]}]",
            'scenarios.0.variants: {"duration_s": 2} stands twice; each once is expected '
            "(got [{'duration_s': 2}, {}, {'duration_s': 2}])",
        ),
        (
            "scenarios: [{scenario: lab-five-people, require: {laser-imm: {hota: 0.97}}}]",
            'scenarios.0.require.laser-imm.hota: a bound as in ">= 0.97" or "<= 0.97" is expected; equality is "== 0.97" '
            "(got 0.97)",
        ),
        ("seeds: 1000000000000", "seeds: how many seeds there are from 0 on; 1 to 100000 is valid (got 1000000000000)"),
        ("trackers: 3", "trackers: a list of trackers' names, as in [laser-imm], is expected (got 3)"),
        (
            "trackers: laser-imm",
            "trackers: a list of trackers' names, as in [laser-imm], is expected (got 'laser-imm')",
        ),
        (
            "trackers: [[a]]",
            "trackers.0: the name of a tracker, as laser-imm, or module:Class (options stand in "
            "set: {trackers: {NAME: {…}}}), is expected (got ['a'])",
        ),
        (
            "scenarios: lab",
            "scenarios: a list of scenarios, as in [{scenario: lab-five-people}], is expected (got 'lab')",
        ),
        (
            "scenarios: [plaza-runners]",
            "scenarios.0: a mapping, as {scenario: plaza-runners}, is expected (got 'plaza-runners')",
        ),
        ("limit_s: [1]", "limit_s: a time above 0, up to 86400 s, is expected (got [1])"),
        ("name: a b", "name: a name of letters, digits, '-' and '_', a letter first, is expected (got 'a b')"),
        ("tolerances: {mota: 1}", "tolerances.mota: a mapping, as in {absolute: 0.01}, is expected (got 1)"),
        (
            "scenarios: [{scenario: lab-five-people, sceanrio: x}]",
            "scenarios.0.sceanrio: unknown key; did you mean 'scenario'? valid here: grid, limit_s, name, require, scenario, "
            "seeds, set, trackers, variants",
        ),
        (
            "scenarios: [{scenario: lab-five-people, seeds: {a: 1}}]",
            f"scenarios.0.seeds: {SEEDS_EXPECTED} (got {{'a': 1}})",
        ),
        (
            "scenarios: [{scenario: lab-five-people, grid: {duration_s: 5}}]",
            "scenarios.0.grid.duration_s: a list of values to try, as in [5, 10], is expected (got 5)",
        ),
        (
            "scenarios: [{scenario: lab-five-people, variants: {}}]",
            "scenarios.0.variants: a list of mappings, as in [{}, {duration_s: 5}], is expected (got {})",
        ),
        (
            "scenarios: [{scenario: lab-five-people, set: [duration_s=5]}]",
            "scenarios.0.set: a mapping of fields' paths to values, as in {duration_s: 10}, is expected (got ['duration_s=5'])",
        ),
    ],
)
def test_a_wrong_list_or_mapping_is_told_in_one_sentence_with_what_is_expected(
    tmp_path: Path, text: str, said: str
) -> None:
    content = {"name": "s", "trackers": ["laser-imm"], "scenarios": [{"scenario": "lab-five-people"}]}
    path = tmp_path / "s.yaml"
    path.write_text(yaml.safe_dump({**content, **yaml.safe_load(text)}))
    with pytest.raises(InputError) as told:
        load_suite(path)
    assert str(told.value) == f"{path}: {said}"


def test_the_code_that_records_is_all_that_is_loaded_to_record_and_no_tracker() -> None:
    code = (
        "import sys\nfrom pathlib import Path\nimport twin.world.simulation, twin.recording.writer\n"
        "ours = [m for n, m in sys.modules.items() if n.split('.')[0] in ('twin', 'trackers') and m.__file__]\n"
        "print('\\n'.join(str(Path(m.__file__)) for m in ours))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = {Path(line) for line in done.stdout.splitlines() if line}
    found = cache_keys._with_imports(cache_keys._SIMULATING, cache_keys._file_of)
    roots = {package / "__init__.py" for package in cache_keys._PACKAGES.values()}
    assert loaded - roots <= found
    assert {"fisheye.py", "laser.py", "render.py"} <= {path.name for path in found}  # loaded when a sensor is made
    parts = {f"{path.parent.name}/{path.name}" for path in found}
    assert "sensors/laser.py" in parts
    judging = {"trackers/laser_fisheye_imm.py", "trackers/presets.py", "report/page.py", "evaluate/summary.py"}
    assert not (judging | {"evaluate/clear.py", "suites/dask_runner.py"}) & parts


def test_the_key_of_a_recording_follows_scenario_seed_renderer_and_room(tmp_path: Path) -> None:
    room = tmp_path / "room.xml"
    room.write_text('<mujoco><asset><mesh file="chair.obj"/></asset></mujoco>')
    (tmp_path / "chair.obj").write_text("v 0 0 0")
    resolved = f"room: {room}\nseed: 1\n"
    key = cache_keys.recording_key(resolved, "llvmpipe")
    assert key == cache_keys.recording_key(resolved, "llvmpipe")
    assert key != cache_keys.recording_key(resolved, "NVIDIA")
    assert key != cache_keys.recording_key(resolved.replace("1", "2"), "llvmpipe")
    (tmp_path / "chair.obj").write_text("v 0 0 1")
    changed = cache_keys.recording_key(resolved, "llvmpipe")
    assert changed != key
    room.write_text(room.read_text() + " ")
    assert cache_keys.recording_key(resolved, "llvmpipe") not in (key, changed)
