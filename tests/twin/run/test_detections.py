"""What a detector saw, as a table for anybody's tracker."""

from __future__ import annotations

import csv
import io
import sys
from pathlib import Path

import numpy as np
import pytest
from command_line import twin

from trackers.errors import InputError, PlugInError
from twin.recording.tables import read_truth
from twin.run.feed import write_detections
from twin.run.live import run_scenario
from twin.scenario import load_scenario


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("detections") / "run"
    scenario = load_scenario("lab-five-people", ["duration_s=1.5", "background_frames=3"])
    run_scenario(scenario, trackers=["laser-imm"], out=out, images=False, video=False)
    return out


def rows_of(recording: Path, tracker: str) -> list[dict[str, str]]:
    file = io.StringIO()
    write_detections(recording, file, tracker=tracker)
    return list(csv.DictReader(io.StringIO(file.getvalue())))


@pytest.mark.parametrize("tracker", ["sort", "laser-imm", "laser-fisheye-kalman"])
def test_rows_are_where_people_are_at_the_moments_that_were_scanned(folder: Path, tracker: str) -> None:
    rows = rows_of(folder / "recording.mcap", tracker)
    assert list(rows[0]) == ["t", "sensors", "role", "x", "y", "variance", "width"]
    assert {(row["sensors"], row["role"]) for row in rows} == {("waist", "waist"), ("knee", "knee")}
    truth = read_truth(folder / "truth.csv")
    moments = {row["t"] for row in rows}
    assert len(moments) == 15  # the last one too, which leaves at the end
    for row in rows:
        now = truth.stamps_ns == round(float(row["t"]) * 1e9)
        off = np.hypot(truth.x[now] - float(row["x"]), truth.y[now] - float(row["y"])).min()
        assert off < 0.6
        assert 0.01 <= float(row["variance"]) <= 0.04 and 0 < float(row["width"]) < 1


def test_the_table_of_one_recording_is_the_same_each_time(folder: Path) -> None:
    assert rows_of(folder / "recording.mcap", "sort") == rows_of(folder / "recording.mcap", "sort")


def test_a_tracker_that_does_not_tell_is_refused_in_one_sentence(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "mute.py").write_text(
        "class Mute:\n"
        "    def __init__(self, rig, background, rng): pass\n"
        "    def update(self, observation): return []\n"
        "    def tracks(self): return []\n"
    )
    bag = folder / "recording.mcap"
    done = twin("detections", bag, "--tracker", "mute:Mute", "--out", "seen.csv", cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1 and "does not tell what its detector sees" in done.stderr
    assert [path.name for path in tmp_path.iterdir() if path.suffix != ".py" and path.name != "__pycache__"] == []


OF_ONES_OWN = """
from trackers.tracks import Detection

class EachScan:
    def __init__(self, rig, background, rng): self.seen = []
    def update(self, observation):
        self.seen = [Detection(observation.stamp_ns, (observation.sensor,), "waist", 1.0, 2.0)]
    def tracks(self): return []
    def detections(self): return self.seen

class Breaks(EachScan):
    def detections(self): return self.seen[0] / 2

class Counts(EachScan):
    discarded = "many"

class LacksFile(EachScan):
    def update(self, observation): open("no-such-model.npz")

class Leaves(EachScan):
    def update(self, observation): raise SystemExit(0)
"""


@pytest.fixture
def of_ones_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "own_detector.py").write_text(OF_ONES_OWN)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "own_detector", raising=False)


@pytest.mark.usefixtures("of_ones_own")
def test_what_was_seen_is_written_once_by_a_tracker_that_holds_nothing_back(folder: Path) -> None:
    rows = rows_of(folder / "recording.mcap", "own_detector:EachScan")
    assert len(rows) == len({(row["t"], row["sensors"]) for row in rows}) == 30


@pytest.mark.usefixtures("of_ones_own")
def test_a_detector_of_ones_own_that_raises_is_told_by_its_method(folder: Path) -> None:
    said = r"own_detector:Breaks: detections\(\) raised TypeError: .* \(own_detector.py, line 12\) at the LaserScan of"
    with pytest.raises(PlugInError, match=said):
        rows_of(folder / "recording.mcap", "own_detector:Breaks")


@pytest.mark.usefixtures("of_ones_own")
@pytest.mark.parametrize(("name", "error"), [("LacksFile", "FileNotFoundError: .*"), ("Leaves", "SystemExit: 0")])
def test_whatever_a_tracker_of_ones_own_raises_is_its_fault(folder: Path, name: str, error: str) -> None:
    with pytest.raises(PlugInError, match=rf"own_detector:{name}: update\(\) raised {error} \(own_detector.py, line"):
        rows_of(folder / "recording.mcap", f"own_detector:{name}")


@pytest.mark.usefixtures("of_ones_own")
def test_a_tracker_that_tells_nonsense_of_itself_is_refused_before_the_first_observation(folder: Path) -> None:
    with pytest.raises(
        InputError, match="^--tracker own_detector:Counts: discarded is 'many'; an int from 0 up is exp"
    ):
        rows_of(folder / "recording.mcap", "own_detector:Counts")


def test_an_unknown_tracker_is_refused(folder: Path) -> None:
    with pytest.raises(InputError, match="unknown"):
        write_detections(folder / "recording.mcap", io.StringIO(), tracker="srot")
