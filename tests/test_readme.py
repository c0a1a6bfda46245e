"""What the README shows works as it stands there."""

from __future__ import annotations

import re
from pathlib import Path

import cv2
import numpy as np
import pytest
from readme.__main__ import MOMENT_CHANGES, MOMENT_SCENARIO

from trackers.check import check_tracker
from trackers.presets import make_tracker
from trackers.rig import Rig
from twin.models import SENSOR_KINDS
from twin.recording.situation_table import SITUATION_COLUMNS
from twin.recording.tables import TRUTH_COLUMNS
from twin.recording.truth_tables import BOX_COLUMNS, FEET_COLUMNS, PEOPLE_COLUMNS, RAY_COLUMNS
from twin.run.live import run_scenario
from twin.run.replay import track_recording
from twin.scenario import load_scenario
from twin.studies.preflight import prepare
from twin.suites.expansion import expand
from twin.suites.spec import load_suite
from twin.world.simulation import Simulation

pytestmark = pytest.mark.slow

README = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", README, re.DOTALL)


def test_the_python_example_runs(capsys: pytest.CaptureFixture[str]) -> None:
    example, _ = blocks("python")
    assert len([line for line in example.splitlines() if line.strip()]) <= 10
    exec(compile(example, "README.md", "exec"), {})
    assert "'mota'" in capsys.readouterr().out


def test_the_tracker_keeps_the_contract_and_runs_on_the_lab_with_jitter(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, example = blocks("python")
    (tmp_path / "tracker_of_the_readme.py").write_text(example)
    monkeypatch.syspath_prepend(tmp_path)
    (command,) = re.findall(r"`twin run (\S+) --tracker my_lab.tracker:Mine --set (\S+)`", README)
    scenario = load_scenario(command[0], [command[1], "sensors.knee.jitter_s=0.2", "duration_s=3"])
    name = "tracker_of_the_readme:Mine"

    with Simulation(scenario, images=False) as simulation:
        rig, room, observations = simulation.rig, simulation.background(), list(simulation)
    stamps = [each.stamp_ns for each in observations if each.sensor == rig.main_sensor]
    assert stamps != sorted(stamps)
    assert check_tracker(lambda *given: make_tracker(name, *given), rig, observations, room) == []

    run = run_scenario(scenario, trackers=[name], out=tmp_path / "run", video=False, images=False)
    assert run.metrics is not None
    figures = run.metrics["trackers"][name]
    assert figures["mota"] > 0.2  # it finds people, and numbers them anew in every scan
    again = track_recording(run.files["recording"], trackers=[name], out=tmp_path / "again", video=False)
    assert again.files[f"tracks {name}"].read_bytes() == run.files[f"tracks {name}"].read_bytes()
    assert "observations came too late" not in run.files["report"].read_text()


def test_the_scenario_loads_and_starts(tmp_path: Path) -> None:
    scenario, *_ = blocks("yaml")
    path = tmp_path / "two-people.yaml"
    path.write_text(scenario)
    with Simulation(load_scenario(path, ["duration_s=0.3"])) as simulation:
        assert len(list(simulation)) == 6


def test_the_rig_loads() -> None:
    *_, rig, _ = blocks("yaml")
    assert Rig.parse(rig, "README.md").main_sensor == "low"


def test_the_study_is_ready_to_run(tmp_path: Path) -> None:
    *_, study = blocks("yaml")
    (tmp_path / "two-scanners.yaml").write_text(study)
    assert prepare(tmp_path / "two-scanners.yaml").candidate_set.poses


def test_the_people_do_what_is_shown(tmp_path: Path) -> None:
    _, people, *_ = blocks("yaml")
    path = tmp_path / "shown.yaml"
    path.write_text("extends: home-three-people\nname: shown\n" + people + "  cleo: null\n")
    with Simulation(load_scenario(path, ["duration_s=0.3"]), images=False) as simulation:
        assert len(list(simulation)) == 9


def test_the_sensors_faults_and_lights_are_as_shown(tmp_path: Path) -> None:
    *_, sensors, _, _ = blocks("yaml")
    path = tmp_path / "shown.yaml"
    others = "  waist: null\n  knee: null\n  fisheye: null\n  floor: null\n"
    shown = sensors.replace("sensors:\n", "sensors:\n" + others)
    path.write_text("extends: home-three-people\nname: shown\ntrackers: {laser-fisheye-imm: null}\n" + shown)
    with Simulation(load_scenario(path, ["duration_s=0.3"])) as simulation:
        assert sorted({each.sensor for each in simulation}) == ["camera", "depth"]
        true, believed = simulation.true_rig.sensors["depth"], simulation.rig.sensors["depth"]
        assert believed.room_from_sensor.xyz[0] - true.room_from_sensor.xyz[0] == pytest.approx(0.02)


def test_the_pedestrians_are_read_as_shown(tmp_path: Path) -> None:
    _, _, pedestrians, *_ = blocks("yaml")
    rows = [f"{15 * 300 + 6 * k} 1 {0.5 * k} 0 1.0" for k in range(5)]
    (tmp_path / "eth.txt").write_text("\n".join(["0 2 0 0 0", "6 2 0 0 0", *rows]))
    low = "{kind: laser, rate_hz: 10, mount: {xyz: [0, 0, 0.4]}}"
    (tmp_path / "shown.yaml").write_text(
        f"name: shown\nduration_s: 2\npeople: {{}}\nsensors: {{low: {low}}}\n{pedestrians}"
    )
    assert list(load_scenario(tmp_path / "shown.yaml").people) == ["walker-1"]


@pytest.mark.parametrize(
    ("table", "columns"),
    [
        ("truth_people.csv", PEOPLE_COLUMNS),
        ("truth.csv", (*TRUTH_COLUMNS, "visible_SENSOR")),
        ("truth_feet.csv", (*FEET_COLUMNS, "cells_FLOOR")),
        ("truth_boxes.csv", BOX_COLUMNS),
        ("truth_rays.csv", RAY_COLUMNS),
        ("truth_situations.csv", SITUATION_COLUMNS),
    ],
)
def test_every_column_of_the_truth_is_explained_in_its_order(table: str, columns: tuple[str, ...]) -> None:
    (explained,) = re.findall(rf"^\| `{re.escape(table)}` \|[^|]+\|(.*)\|$", README, re.MULTILINE)
    assert tuple(re.findall(r"`(\w+)`", explained)) == columns


def test_the_pictures_at_the_top_are_there_and_small() -> None:
    root = Path(__file__).parents[1]
    shown = [root / path for path in re.findall(r"^!\[[^]]+\]\(([^)]+)\)$", README, re.MULTILINE)]
    assert [path.name for path in shown] == ["moment.webp", "walk.webp"]
    assert sum(path.stat().st_size for path in shown) <= 2_000_000
    done, walk = cv2.imdecodeanimation(np.fromfile(shown[1], dtype=np.uint8))
    assert done and 4000 <= int(np.sum(walk.durations)) <= 6000


def test_the_first_picture_is_drawn_of_every_kind_of_sensor() -> None:
    scenario = load_scenario(MOMENT_SCENARIO, list(MOMENT_CHANGES))
    assert {each.kind for each in scenario.sensors.values()} == set(SENSOR_KINDS)
    assert {each.role for each in scenario.sensors.values() if each.kind == "laser"} == {"waist", "knee"}


def test_the_comparison_has_a_row_for_every_scenario_and_tracker_of_the_suite_baseline() -> None:
    rows, scenario = [], ""
    for named, tracker in re.findall(
        r"^\| ([\w-]*) \| `([\w-]+)` \|(?: \**−?\d+\.\d+\** \|){6}$", README, re.MULTILINE
    ):
        scenario = named or scenario
        rows.append((scenario, tracker))
    assert rows == list(dict.fromkeys((case.scenario, case.tracker) for case in expand(*load_suite("baseline"))))
