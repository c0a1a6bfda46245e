"""What the README shows works as it stands there."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from trackers.rig import Rig
from twin.scenario import load_scenario
from twin.simulation import Simulation

README = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", README, re.DOTALL)


def test_the_python_example_runs(capsys: pytest.CaptureFixture[str]) -> None:
    (example,) = blocks("python")
    assert len([line for line in example.splitlines() if line.strip()]) <= 10
    exec(compile(example, "README.md", "exec"), {})
    assert "'mota'" in capsys.readouterr().out


def test_the_scenario_loads_and_starts(tmp_path: Path) -> None:
    scenario, _ = blocks("yaml")
    path = tmp_path / "two-people.yaml"
    path.write_text(scenario)
    with Simulation(load_scenario(path, ["duration_s=0.3"])) as simulation:
        assert len(list(simulation)) == 6


def test_the_rig_loads() -> None:
    _, rig = blocks("yaml")
    assert Rig.parse(rig, "README.md").main_sensor == "low"
