"""A tracker that follows nobody, although something moves before the sensors, says so."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.twin.recording.recorded import MS, a_scan, write_ros2_bag
from twin.recording.ros.ros_messages import encode
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


def test_of_a_bag_that_shows_nothing_it_is_told_and_whether_people_were_there(tmp_path: Path) -> None:
    ranges_m = np.full(31, 4.0, dtype=np.float32)
    scans = [encode(replace(a_scan(k * 100 * MS), ranges_m=ranges_m)) for k in range(40)]
    write_ros2_bag(tmp_path / "bag", [("/scan", e.msgtype, e.observation.stamp_ns, e.data) for e in scans])
    truth = tmp_path / "truth.csv"
    truth.write_text("t,id,x,y\n" + "".join(f"{0.1 * k:.1f},1,1.0,1.0\n" for k in range(40)))
    for people, said in ((None, "whether anybody was there is not known"), (truth, "people were there")):
        told: list[str] = []
        track_recording(
            tmp_path / "bag", trackers=["sort", "laser-legs"], truth_path=people, out=tmp_path / "out", video=False,
            on_warning=told.append,
        )  # fmt: skip
        silent = [warning for warning in told if "reports no track in any of 40 frames, and detects some" in warning]
        assert [warning.partition(":")[0] for warning in silent] == ["sort", "laser-legs"]
        assert all(warning.endswith(said) for warning in silent)
