"""Whoever starts a run is told at once which sensors a tracker makes no use of, and that the faulty one is among them."""

from __future__ import annotations

from pathlib import Path

import pytest

from twin.run.live import run_scenario
from twin.run.replay import track_recording
from twin.scenario import load_scenario

FAULTS = [
    "faults.coat={sensor: waist, kind: blocked_sector, bearings_deg: [0, 20], at_m: 0.2}",
    "faults.thumb={sensor: [fisheye, waist], kind: delay, delay_s: 0.05}",
]
TOLD = "laser-imm: makes no use of fisheye, floor; among them with a fault, which shows in no track: fisheye (thumb)"


class Told:
    """What is told, in order."""

    def __init__(self) -> None:
        self.told: list[str] = []

    def progress(self, what: str, done: float, total: float) -> None:
        self.told.append(what)

    def keywords(self, out: Path) -> dict:
        return {"out": out, "video": False, "on_progress": self.progress, "on_warning": self.told.append}


@pytest.fixture(scope="module")
def ran(tmp_path_factory: pytest.TempPathFactory) -> tuple[Told, Path]:
    folder = tmp_path_factory.mktemp("ran") / "out"
    floor = "sensors.floor={kind: floor, rows: 4, columns: 4, mount: {xyz: [-1, 1, 0]}}"
    small = ["duration_s=0.4", "background_frames=2", "sensors.fisheye.size=[64, 64]", floor]
    told = Told()
    scenario = load_scenario("lab-five-people", [*small, *FAULTS])
    result = run_scenario(scenario, trackers=["laser-imm", "laser-fisheye-imm"], **told.keywords(folder))
    assert TOLD in result.warnings
    return told, folder


def test_a_run_tells_before_it_starts(ran: tuple[Told, Path]) -> None:
    told = ran[0].told
    assert told[:2] == [TOLD, "laser-fisheye-imm: makes no use of floor"]
    assert set(told[2:]) == {"simulating and tracking", "evaluating and reporting"}


def test_the_report_says_it_too(ran: tuple[Told, Path]) -> None:
    assert f"{TOLD}." in (ran[1] / "report.html").read_text()


def test_tracking_a_recording_tells_it_of_the_faults_in_the_bag(ran: tuple[Told, Path], tmp_path: Path) -> None:
    told = Told()
    track_recording(ran[1] / "recording.mcap", trackers=["laser-imm"], **told.keywords(tmp_path))
    assert told.told[0] == TOLD
    assert "tracking" in told.told[1]
