"""Every shipped scenario runs as it is, with what it says of trackers or the default."""

from __future__ import annotations

from pathlib import Path

import pytest

from twin import models
from twin.run.live import run_scenario
from twin.scenario import load_scenario

pytestmark = pytest.mark.slow

SHORT_S = 0.3


@pytest.mark.sample(5)
@pytest.mark.parametrize("name", models.names("scenarios"))
def test_a_shipped_scenario_runs_as_it_is(name: str, tmp_path: Path) -> None:
    scenario = load_scenario(name, [f"duration_s={SHORT_S}", "background_frames=3"])
    result = run_scenario(scenario, out=tmp_path / "out")
    assert all(path.stat().st_size for path in result.files.values())
    lasers = any(sensor.kind == "laser" for sensor in scenario.sensors.values())
    untracked = [warning for warning in result.warnings if warning.startswith("recorded without a tracker")]
    assert (result.metrics is not None) == lasers
    assert len(untracked) == (0 if lasers else 1)
