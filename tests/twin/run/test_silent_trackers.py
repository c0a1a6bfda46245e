"""A tracker that follows nobody, although something moves before the sensors, says so."""

from __future__ import annotations

from pathlib import Path

import pytest

from twin.run.live import run_scenario
from twin.run.replay import track_recording
from twin.scenario import load_scenario

NEVER = [f"trackers.laser-imm.track_management.{each}" for each in ("confirm_s=1000", "confirm_samples=null")]


@pytest.mark.parametrize("people", ["{ann: {}, ben: {}}", "{}"])
def test_it_is_told_where_people_are_and_only_there(people: str, tmp_path: Path) -> None:
    scenario = load_scenario("lab-five-people", [f"people={people}", "duration_s=3", *NEVER])
    told: list[str] = []
    run = run_scenario(
        scenario,
        trackers=["laser-imm", "sort"],
        out=tmp_path / "run",
        video=False,
        images=False,
        on_warning=told.append,
    )
    again: list[str] = []
    track_recording(
        run.files["recording"], trackers=["laser-imm"], changes=NEVER, out=tmp_path / "again", video=False,
        on_warning=again.append,
    )  # fmt: skip
    for warnings in (told, again):
        silent = [warning for warning in warnings if "reports no track" in warning]
        assert len(silent) == (0 if people == "{}" else 1)
        assert all("laser-imm" in warning and "of 30 frames" in warning for warning in silent)
