"""A tracker of the user's own that raises: who, where and at what is said, and the other trackers keep their results."""

from __future__ import annotations

import json
import re
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
from command_line import Ended, twin

from trackers.errors import PlugInError
from twin.recording.tables import read_tracks
from twin.run.live import run_scenario
from twin.run.outcome import RunResult
from twin.scenario import load_scenario

pytestmark = pytest.mark.slow

PLUG_INS = """
import sys
import numpy as np
from trackers.tracks import Track, TrackFrame

class Fine:
    def __init__(self, rig, background, rng):
        self.n = 0
    def update(self, observation):
        self.n += 1
        if self.n == 3:
            self.at_the_third()
    def at_the_third(self): ...
    def tracks(self):
        return [Track(id=1, x=0.0, y=1.5)]

class InUpdate(Fine):
    def at_the_third(self):
        raise ValueError("no such person\\nand more")

class InputInUpdate(Fine):
    def at_the_third(self):
        from trackers.errors import InputError
        raise InputError("I want another scan")

class Leaves(Fine):
    def at_the_third(self):
        sys.exit(3)

class Closes(Fine):
    def at_the_third(self):
        raise GeneratorExit

class NoCircle(Fine):
    def tracks(self):
        return [Track(id=1, x=0.0, y=1.5, radius95_m=-1.0)]

class InSeconds(Fine):
    def update(self, observation):
        return [TrackFrame(observation.t, ())]

class InTracks(Fine):
    def tracks(self):
        return [Track(id=1, x=1 / (self.n - self.n), y=1.5)]

class NoTracks(Fine):
    def tracks(self):
        return None

class Rows(Fine):
    def tracks(self):
        return [(1, 0.0, 1.5)]

class Property(Fine):
    tracks = []

class BadTrack(Fine):
    def tracks(self):
        return [Track(id=1, x=0.0, y=1.5, status="lost")]

class Far(Fine):
    def tracks(self):
        return [Track(id=1, x=0.0, y=1.5, vx=1e300)]

class Numpy(Fine):
    def tracks(self):
        return (Track(id=np.uint8(1), x=np.float32(0), y=np.array(1.5), z=np.int16(1)) for _ in range(1))

class NumpyStamps(Fine):
    def __init__(self, rig, background, rng):
        super().__init__(rig, background, rng)
        self.main = rig.main_sensor
    def update(self, observation):
        if observation.sensor == self.main:
            return [TrackFrame(np.int64(observation.stamp_ns), (Track(id=1, x=0.0, y=1.5),))]

class NoFrames(Fine):
    def update(self, observation):
        return 7

class InFinish(Fine):
    def finish(self):
        raise KeyError("rest")

class InConstructor(Fine):
    def __init__(self, rig, background, rng):
        raise RuntimeError("no network")
"""


@pytest.fixture(autouse=True)
def _plug_ins(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "plug_lab.py").write_text(PLUG_INS)
    (tmp_path / "plug_broken.py").write_text("import a_library_nobody_has\n")
    monkeypatch.syspath_prepend(tmp_path)
    for name in ("plug_lab", "plug_broken"):
        monkeypatch.delitem(sys.modules, name, raising=False)


def run(out: Path, *names: str) -> RunResult:
    scenario = load_scenario("lab-five-people", ["duration_s=0.4"])
    return run_scenario(scenario, trackers=names, out=out, video=False, images=False)


FAULTS = {
    "plug_lab:InUpdate": r"update\(\) raised ValueError: no such person \(plug_lab.py, line 19\) at the LaserScan of "
    r"(waist|knee) stamped 0.\d+ s",
    "plug_lab:InputInUpdate": r"update\(\) raised InputError: I want another scan \(plug_lab.py, line \d+\) at the LaserScan",
    "plug_lab:Leaves": r"update\(\) raised SystemExit: 3 \(plug_lab.py, line \d+\) at the LaserScan of ",
    "plug_lab:Closes": r"update\(\) raised GeneratorExit \(plug_lab.py, line \d+\) at the LaserScan of ",
    "plug_lab:InTracks": r"tracks\(\) raised ZeroDivisionError: division by zero \(plug_lab.py, line \d+\) at the LaserScan",
    "plug_lab:NoTracks": r"tracks\(\) gave None; .* at the LaserScan of ",
    "plug_lab:Rows": r"tracks\(\) gave \(1, 0.0, 1.5\) among them; a list of Track is expected at the LaserScan of ",
    "plug_lab:Property": r"tracks is \[\]; a method that returns a list of Track is expected at the LaserScan of ",
    "plug_lab:BadTrack": r"what it gave: track 1: status 'lost' .* in the frame stamped 0.\d+ s",
    "plug_lab:Far": r"what it gave: 1e\+300 in a table; finite, .* in the frame stamped 0.\d+ s",
    "plug_lab:InSeconds": r"what it gave: frame at 0.\d+ ns after -inf ns; whole stamps must grow",
    "plug_lab:NoFrames": r"what update\(\) gave: frames are 7; .* at the LaserScan of ",
    "plug_lab:InFinish": r"finish\(\) raised KeyError: 'rest' \(plug_lab.py, line \d+\) after the last observation",
    "plug_lab:InConstructor": r"__init__\(\) raised RuntimeError: no network \(plug_lab.py, line \d+\) before the first "
    "observation",
    "plug_broken:Mine": r"the import raised ModuleNotFoundError: No module named 'a_library_nobody_has' \(plug_broken.py, "
    r"line 1\) before the first observation",
}


def test_every_fault_names_class_method_line_and_observation_and_the_others_keep_their_results(tmp_path: Path) -> None:
    result = run(tmp_path / "out", *FAULTS, "plug_lab:Fine", "laser-imm")
    assert len(result.failures) == len(FAULTS)
    for said, (name, expected) in zip(result.failures, FAULTS.items(), strict=True):
        start, _, rest = said.partition(": ")
        assert start == name and "\n" not in said
        assert re.match(expected, rest), rest
    assert result.metrics is not None and list(result.metrics["trackers"]) == ["plug_lab:Fine", "laser-imm"]
    tables = sorted(path.name for path in (tmp_path / "out" / "tracks").iterdir())
    assert tables == ["laser-imm.csv", "plug_lab-Fine.csv"]
    page = (tmp_path / "out" / "report.html").read_text()
    assert page.count("A tracker failed and has no results") == len(FAULTS)
    alone = run(tmp_path / "alone", "laser-imm").metrics
    assert alone is not None
    for metrics in (alone, result.metrics):
        del metrics["trackers"]["laser-imm"]["ms_per_frame"]
    assert alone["trackers"]["laser-imm"] == result.metrics["trackers"]["laser-imm"]


@pytest.mark.parametrize("name", ["plug_lab:InUpdate", "plug_lab:InConstructor", "plug_lab:InFinish"])
def test_a_run_whose_every_tracker_failed_ends_and_leaves_nothing(name: str, tmp_path: Path) -> None:
    with pytest.raises(PlugInError, match=name):
        run(tmp_path / "out", name)
    assert not [path for path in tmp_path.glob("out/**/*") if path.is_file()]


def test_a_script_is_warned_of_each_plug_in_that_failed(tmp_path: Path) -> None:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        result = run(tmp_path / "out", "plug_lab:InUpdate", "plug_lab:NoCircle", "plug_lab:Fine")
    said = [str(each.message) for each in caught]
    assert [each for each in said if each.startswith("no results of ")] == [
        f"no results of {each}" for each in result.failures
    ]
    assert [Path(each.filename) for each in caught if str(each.message).startswith("no res")] == [Path(__file__)] * 2
    assert "radius95_m is -1.0; above 0 m, or NaN, is expected in the frame stamped 0." in result.failures[1]


def test_numbers_of_numpy_are_numbers(tmp_path: Path) -> None:
    names = ("Fine", "Numpy", "NumpyStamps")
    result = run(tmp_path / "out", *(f"plug_lab:{name}" for name in names))
    assert result.failures == () and result.metrics is not None
    fine, *others = (read_tracks(tmp_path / "out" / "tracks" / f"plug_lab-{name}.csv") for name in names)
    for own in others:
        for column in ("frame_stamps_ns", "stamps_ns", "id", "x", "y"):
            np.testing.assert_array_equal(getattr(own, column), getattr(fine, column))


def test_the_command_says_it_in_a_sentence_with_exit_code_1(tmp_path: Path) -> None:
    def run_with(*names: str) -> Ended:
        arguments = ["run", "lab-five-people", "--duration", "0.4", "--no-images", "--no-video", "--out", "out"]
        return twin(*arguments, *(part for name in names for part in ("--tracker", name)), cwd=tmp_path)

    done = run_with("plug_lab:InUpdate", "laser-imm")
    assert done.returncode == 1 and "Traceback" not in done.stderr and "fault of ours" not in done.stderr
    assert done.stderr.count("twin: plug_lab:InUpdate: update() raised ValueError: no such person") == 1
    assert list(json.loads((tmp_path / "out" / "metrics.json").read_text())["trackers"]) == ["laser-imm"]
    done = run_with("plug_lab:InUpdate")
    assert done.returncode == 1 and not done.stdout and "Traceback" not in done.stderr
    assert "\ntwin: plug_lab:InUpdate: update() raised" in done.stderr  # after what it says it will make
