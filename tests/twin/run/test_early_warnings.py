"""Whoever starts a run is told which sensors a tracker makes no use of, a faulty one among them, and what the tracker doubts."""

from __future__ import annotations

from pathlib import Path

import pytest
from command_line import twin

from trackers.sort import Sort
from twin.environment.run import write_environment
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


class Doubting(Sort):
    """Finds on the way that something is wrong."""

    warnings: tuple[str, ...] = ("doubts the rig",)

    def update(self, observation):
        self.warnings = ("doubts the rig", "doubts the room")
        return super().update(observation)


def test_what_a_tracker_doubts_is_told_at_first_and_on_the_way(ran: tuple[Told, Path], tmp_path: Path) -> None:
    told, name = Told(), "test_early_warnings:Doubting"
    doubts = (f"{name}: doubts the rig", f"{name}: doubts the room")
    result = track_recording(ran[1] / "recording.mcap", trackers=[name], **told.keywords(tmp_path))
    assert told.told[0] == doubts[0] and told.told.index(doubts[1]) > told.told.index("tracking")
    assert result.tracker_warnings == doubts and set(doubts) <= set(result.warnings)
    page = (tmp_path / "report.html").read_text()
    assert all(doubt in page for doubt in doubts)


SMALL = [f"sensors.stereo_{k}.size=[160, 120]" for k in (1, 2, 3, 4)] + ["duration_s=0.3", "background_frames=2"]
LACKS = "rgbd-head: goes without the room's environment (`twin environment` makes one)"


def test_heads_without_an_environment_are_warned_of_live_and_again(tmp_path: Path) -> None:
    live, again = Told(), Told()
    run_scenario(load_scenario("head-trap", SMALL), trackers=["rgbd-head"], **live.keywords(tmp_path / "a"))
    track_recording(tmp_path / "a" / "recording.mcap", trackers=["rgbd-head"], **again.keywords(tmp_path / "b"))
    assert LACKS in live.told and LACKS in again.told


@pytest.mark.slow
def test_a_camera_that_hangs_otherwise_than_believed_is_named_where_the_room_is_known(tmp_path: Path) -> None:
    told, room = Told(), tmp_path / "room.npz"
    write_environment(load_scenario("head-trap"), [(0.3, -0.3), (-1.2, 0.6)], out=room)
    # in full size: stereo of 160 x 120 is too coarse for 6 degrees to show
    off = ["sensors.stereo_2.calibration_error={rpy_deg: [0, 0, 6]}", f"prior.environment={room}", *SMALL[-2:]]
    off += ["sensors.stereo_4=null"]
    run_scenario(load_scenario("head-trap", off), trackers=["rgbd-head"], **told.keywords(tmp_path / "a"))
    said = "sees fits the environment better when turned by 5° or more than as the rig has it"
    assert [each for each in told.told if "stereo_" in each] == [
        f"rgbd-head: the empty room that stereo_2 {said}; its pictures are not used any more"
    ]


def test_a_coarse_and_a_tilted_scanner_are_told_live_again_in_checks_and_with_detections_but_not_where_unused(
    tmp_path: Path,
) -> None:
    changes = ["duration_s=0.4", "background_frames=2", "sensors.fisheye=null", "sensors.waist.resolution_deg=6"]
    scenario = load_scenario("lab-five-people", [*changes, "sensors.knee.mount.pitch_deg=30"])
    said = ("waist: shows people in", "knee: shows people in")
    live, again, unused = Told(), Told(), Told()
    result = run_scenario(scenario, trackers=["laser-imm"], **live.keywords(tmp_path / "a"))
    bag = tmp_path / "a" / "recording.mcap"
    track_recording(bag, trackers=["laser-imm"], **again.keywords(tmp_path / "b"))
    track_recording(bag, trackers=["waist-fisheye-imm"], changes=WAIST_ONLY, **unused.keywords(tmp_path / "c"))
    for told in (live, again):
        warned = [each for each in told.told if each.startswith(said)]
        assert ["its beams are 6° apart" in each for each in warned] == [True, False]
        assert ["it is tilted by 30°" in each for each in warned] == [False, True]
    assert set(warned) <= set(result.warnings)
    assert all(f"{each}." in (tmp_path / "a" / "report.html").read_text() for each in warned)
    assert [each for each in unused.told if each.startswith(said)] == warned[:1]

    checked = twin("check", str(tmp_path / "a" / "scenario.yaml")).stderr.splitlines()
    assert [each.split(": ")[2] for each in checked] == ["waist", "knee"]
    assert ["its beams are 6° apart" in each for each in checked] == [True, False]
    table = twin("detections", str(bag), "--tracker", "laser-imm", "--out", str(tmp_path / "detections.csv"))
    assert [f"twin: warning: {each}" for each in warned] == table.stderr.splitlines()[-2:]


WAIST_ONLY = ["trackers.waist-fisheye-imm.camera=false"]
