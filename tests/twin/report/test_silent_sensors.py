"""A sensor that has stopped reporting is drawn as silent, not with what it saw last."""

from __future__ import annotations

from pathlib import Path
from typing import cast

import cv2
import numpy as np
import pytest

from trackers.observations import NS_PER_S, LaserScan
from twin.report.birdseye import Site
from twin.report.floor_panel import SILENT_FILL, PreviewFrame
from twin.report.preview import PreviewWriter
from twin.report.sensor_stills import SilenceMonitor
from twin.run.feed import Preview
from twin.run.live import run_scenario
from twin.scenario import load_scenario
from twin.view import write_view
from twin.world.simulation import Simulation

SMALL = ["background_frames=1", "trackers=null", "sensors.fisheye.size=[64, 64]"]
MUTE = "faults.mute={sensor: [waist, fisheye], kind: dropout, from_s: 0.5}"


def scan(sensor: str, t: float) -> LaserScan:
    return LaserScan(sensor, round(t * NS_PER_S), np.ones(3, np.float32), 0.0, 0.1, 0.05, 8.0)


def heard(*sensors: str, **times: list[float]) -> SilenceMonitor:
    silence = SilenceMonitor(sensors)
    for t, name in sorted((t, name) for name, own in times.items() for t in own):
        silence.add(scan(name, t))
    return silence


def every(period_s: float, until_s: float) -> list[float]:
    return [round(k * period_s, 6) for k in range(round(until_s / period_s) + 1)]


@pytest.mark.parametrize(("until_s", "silent"), [(1.5, set()), (1.6, {"knee"})])
def test_silent_is_who_says_nothing_for_half_a_second(until_s: float, silent: set[str]) -> None:
    assert heard("waist", "knee", waist=every(0.1, until_s), knee=every(0.1, 1.0)).silent() == silent


def test_a_slow_sensor_is_silent_after_three_of_its_gaps() -> None:
    assert heard("waist", "knee", waist=every(0.1, 5.0), knee=every(1.0, 2.0)).silent() == set()
    assert heard("waist", "knee", waist=every(0.1, 5.1), knee=every(1.0, 2.0)).silent() == {"knee"}


def test_a_sensor_never_heard_is_silent_after_a_second() -> None:
    assert heard("waist", "knee", waist=every(0.1, 1.0)).silent() == set()
    assert heard("waist", "knee", waist=every(0.1, 1.1)).silent() == {"knee"}
    assert heard("waist").silent() == set()
    assert heard("waist", waist=[0.0, 0.1]).silent(now_ns=NS_PER_S) == {"waist"}


def test_a_sensor_whose_clock_is_off_is_not_silent() -> None:
    silence = SilenceMonitor(["waist", "knee"])
    for t in every(0.1, 3.0):
        silence.add(scan("waist", t))
        silence.add(scan("knee", t - 5.0))
    assert silence.silent() == set()


class Watched:
    """A preview's writer that keeps whose scans were drawn and who was labelled silent, by stamp [s]."""

    def __init__(self) -> None:
        self.drawn: dict[float, tuple[list[str], list[str]]] = {}

    def frame(self, stamp_ns: int, frame: PreviewFrame) -> None:
        self.drawn[stamp_ns / NS_PER_S] = (sorted(frame.newest), sorted(frame.silent))


def test_a_preview_does_not_draw_the_last_scan_of_a_silent_scanner_on_and_on() -> None:
    writer = Watched()
    changes = ["faults.mute={sensor: knee, kind: dropout, from_s: 0.5}", "duration_s=1.3", *SMALL]
    with Simulation(load_scenario("lab-five-people", changes), images=False) as simulation:
        shown = Preview(cast("PreviewWriter", writer), simulation.rig)
        for observation in simulation:
            shown.observe(observation)
            shown.draw_untracked(observation)
        shown.finish()
    assert writer.drawn[0.4] == (["knee", "waist"], [])
    assert writer.drawn[1.2] == (["waist"], ["knee"])


def labels(picture: np.ndarray) -> int:
    """Count the pixels of the colour behind the label of a silent sensor."""
    return int((np.abs(picture.astype(int) - SILENT_FILL).max(axis=-1) <= 12).sum())


def test_the_label_stands_in_the_picture_and_the_camera_s_last_one_is_dimmed(tmp_path: Path) -> None:
    with Simulation(load_scenario("lab-five-people", [*SMALL, "duration_s=0.1"])) as simulation:
        looks = simulation.look(0)
        rig = simulation.rig
    pictures = []
    for silent in ([], ["waist", "fisheye"]):
        with PreviewWriter(tmp_path / "v.mp4", Site(rig), fps=10) as writer:
            writer.frame(0, PreviewFrame({name: looks[name] for name in ("fisheye", "knee")}, silent=silent))
            jpeg = np.frombuffer(writer.still(95), np.uint8)
            pictures.append(np.asarray(cv2.imdecode(jpeg, cv2.IMREAD_COLOR_RGB)))
    seeing, mute = pictures
    assert labels(seeing) < 20
    assert labels(mute[:, :596]) > 300  # on the camera's picture
    assert labels(mute[:, 596:]) > 600  # two on the plan
    assert mute[200:500, 100:500].mean() < 0.5 * seeing[200:500, 100:500].mean()


def test_a_view_shows_nothing_of_a_silent_sensor(tmp_path: Path) -> None:
    scenario = load_scenario("lab-five-people", [MUTE, *SMALL, "sensors.knee.dropout=1", "duration_s=2"])
    with Simulation(scenario) as simulation:
        assert set(simulation.look(0)) == {"waist", "fisheye"}
        assert set(simulation.look(NS_PER_S)) == set()
    write_view(scenario, 1.0, tmp_path / "view.png")
    sheet = np.asarray(cv2.imread(str(tmp_path / "view.png")))[..., ::-1]
    assert labels(sheet) > 4 * 300  # three on the plan, one on each scanner's tile


def test_the_report_s_plan_marks_a_sensor_that_reported_nothing(tmp_path: Path) -> None:
    changes = ["faults.mute={sensor: waist, kind: dropout}", "duration_s=0.3", *SMALL]
    scenario = load_scenario("lab-five-people", changes)
    run = run_scenario(scenario, trackers=["laser-imm"], out=tmp_path / "out", video=False, images=False)
    page = run.files["report"].read_text()
    assert '"sensor silent"' in page and "waist: silent" in page and "knee: silent" not in page
