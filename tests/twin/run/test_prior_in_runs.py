"""What trackers may know is the same live, from a recording and in a suite; and whose file is not there is told."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import Ended, twin

from trackers.environment import build_environment, load_environment, save_environment
from trackers.errors import InputError
from twin.environment.run import scan_scenario
from twin.environment.scan import TiltingScanner
from twin.run.inputs import TrustedClasses
from twin.run.live import run_scenario
from twin.run.replay import track_recording
from twin.scenario import load_scenario
from twin.scenario.load import dump_scenario
from twin.suites.cache import RecordingCache
from twin.suites.cache_keys import recording_key
from twin.suites.cluster import Workers
from twin.suites.expansion import expand
from twin.suites.result_files import read_store
from twin.suites.run import run_suite
from twin.suites.spec import load_suite

PLUG_IN = """
import json
from pathlib import Path
from typing import Any

from trackers.tracks import Track

class Knows:
    def __init__(self, rig, background, rng):
        here = Path(__file__).with_name("handed.json")
        room = background.environment and [background.environment.room, background.environment.state.size]
        learned = {name: path.read_text() for name, path in background.learned.items()}
        told = json.loads(here.read_text()) if here.exists() else []
        here.write_text(json.dumps([*told, [len(list(background)), room, learned]]))
    def update(self, observation): ...
    def tracks(self): return [Track(1, 0.0, 2.0)]
"""
SCENARIO = """
extends: lab-five-people
name: own
duration_s: 0.3
background_frames: 2
sensors: {fisheye: null}
prior: {environment: ../lab.npz, learned: {heads: heads.txt}}
"""
SUITE = """
name: knowing
seeds: 1
trackers: ["lab_of_knowing:Knows"]
scenarios: [{scenario: own/own.yaml}]
"""
TRACKER = "lab_of_knowing:Knows"
EVERY = TrustedClasses(every=True)


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A coarse environment of the lab."""
    scanner = TiltingScanner(tilt_step_deg=1.0)
    path = tmp_path_factory.mktemp("environment") / "lab.npz"
    cloud, world = scan_scenario(load_scenario("lab-five-people"), noise="off", scanner=scanner)
    save_environment(build_environment(cloud, room="lab", area=world.scene.area), path)
    return path


class House:
    """A folder with a scenario, its files and a tracker that notes what it is handed."""

    def __init__(self, folder: Path, lab: Path) -> None:
        self.folder = folder
        (folder / "own").mkdir()
        (folder / "lab.npz").write_bytes(lab.read_bytes())
        (folder / "own" / "heads.txt").write_text("round")
        self.scenario = folder / "own" / "own.yaml"
        self.scenario.write_text(SCENARIO)
        (folder / "lab_of_knowing.py").write_text(PLUG_IN)
        self.expected = [4, ["lab", load_environment(lab).state.size], {"heads": "round"}]

    def handed(self) -> list:
        """What each tracker made since the last call was handed."""
        path = self.folder / "handed.json"
        told = json.loads(path.read_text()) if path.exists() else []
        path.unlink(missing_ok=True)
        return told

    def record(self, *changes: str) -> Path:
        run_scenario(load_scenario(self.scenario, changes), trackers=[], out=self.folder / "bag", video=False)
        return self.folder / "bag" / "recording.mcap"

    def track(self, bag: Path, **more: Any):
        return track_recording(bag, trackers=[TRACKER], out=self.folder / "tracked", video=False, **more)

    def twin(self, *arguments: str) -> Ended:
        return twin(*arguments, cwd=self.folder)


@pytest.fixture
def house(tmp_path: Path, lab: Path, monkeypatch: pytest.MonkeyPatch) -> House:
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "lab_of_knowing", raising=False)
    return House(tmp_path, lab)


def test_a_run_its_replay_and_a_suite_hand_over_the_same(house: House, monkeypatch: pytest.MonkeyPatch) -> None:
    scenario = load_scenario(house.scenario)
    assert scenario.prior.environment == str(house.folder / "own" / ".." / "lab.npz")
    result = run_scenario(scenario, trackers=[TRACKER], out=house.folder / "run", video=False)
    assert house.handed() == [house.expected]
    assert "Prior files of the trackers: environment from" in (house.folder / "run" / "report.html").read_text()
    monkeypatch.chdir("/")  # nothing is relative to where one stands
    house.track(result.files["recording"])
    assert house.handed() == [house.expected]
    assert load_scenario(result.files["scenario"]).prior == scenario.prior  # runs again to the same

    (house.folder / "s.yaml").write_text(SUITE)
    loaded, path = load_suite(house.folder / "s.yaml")
    cache = RecordingCache(house.folder / "cache", 10**8)
    run_suite(loaded, path, house.folder / "out", cache, Workers(jobs=1), trusted=EVERY)
    tried, *tracked = house.handed()
    assert tried == [0, *house.expected[1:]]  # before any case, without the empty room
    assert len(tracked) == 2 and tracked == [house.expected] * 2  # the case, and the picture of its worst moment


def test_a_suite_tracks_again_what_has_another_environment_and_renders_nothing_again(house: House) -> None:
    (house.folder / "s.yaml").write_text(SUITE)
    suite = load_suite(house.folder / "s.yaml")
    cache = RecordingCache(house.folder / "cache", 10**8)

    def run() -> int:
        run_suite(*suite, house.folder / "out", cache, Workers(jobs=1), trusted=EVERY, resume=True)
        with read_store(house.folder / "out") as store:
            (case,) = store.cases()
        assert case.status == "done"
        return len([each for each in house.handed() if each[0]])

    assert run() == 2
    (kept,) = (path for path in (house.folder / "cache").rglob("recording.mcap"))
    stamp = kept.stat().st_mtime_ns
    assert run() <= 1  # nothing but the picture
    (house.folder / "own" / "heads.txt").write_text("oval")
    assert run() == 2
    assert [path.stat().st_mtime_ns for path in (house.folder / "cache").rglob("recording.mcap")] == [stamp]


def test_a_recording_is_kept_under_a_name_that_knows_no_environment(house: House) -> None:
    (house.folder / "s.yaml").write_text(
        SUITE.replace(
            "{scenario: own/own.yaml}",
            "{scenario: own/own.yaml, variants: [{prior: null}, {prior.environment: lab.npz}]}",
        )
    )
    without, relative = expand(*load_suite(house.folder / "s.yaml"), trusted=EVERY)
    assert recording_key(without.resolved, "") == recording_key(relative.resolved, "")
    assert without.provenance.prior == "" != relative.provenance.prior
    assert relative.prior.environment == str(house.folder / "lab.npz")  # beside the suite
    assert relative.overrides == ('prior.environment="lab.npz"',)  # its name is the same wherever the suite lies


@pytest.mark.parametrize(
    ("place", "said"),
    [
        ("set: {prior.environment: gone.npz}", "scenarios.0.set.prior.environment: "),
        ("set: {prior: {learned: {x: gone}}}", "scenarios.0.set.prior.learned.x: "),
        ("set: {prior.environment: lab_of_knowing.py}", "scenarios.0.set.prior.environment: "),
        (
            "set: {room: meeting_room, people.white: null}",
            "prior.environment: .*is of the room 'lab'; one of 'meeting_room'",
        ),
    ],
)
def test_a_suite_is_refused_before_it_starts_where_a_file_cannot_be(house: House, place: str, said: str) -> None:
    text = SUITE.replace("{scenario: own/own.yaml}", f"{{scenario: own/own.yaml, {place}}}")
    (house.folder / "s.yaml").write_text(text)
    with pytest.raises(InputError, match=said):
        expand(*load_suite(house.folder / "s.yaml"), trusted=EVERY)
    assert not house.handed()


def test_a_changed_file_does_not_slip_into_a_suite_that_runs(house: House) -> None:
    (house.folder / "s.yaml").write_text(SUITE)
    (case,) = expand(*load_suite(house.folder / "s.yaml"), trusted=EVERY)
    case.check_files()
    (house.folder / "own" / "heads.txt").write_text("oval")
    with pytest.raises(InputError, match=r"heads\.txt: changed after the suite was started"):
        case.check_files()


def test_what_a_bag_names_and_is_elsewhere_is_a_warning(house: House) -> None:
    bag = house.record()
    (house.folder / "lab.npz").unlink()
    result = house.track(bag)
    assert house.handed() == [[4, None, {"heads": "round"}]]
    (warning,) = result.warnings
    assert "prior.environment: there is no file" in warning and "trackers go on without it" in warning


def test_what_a_bag_names_is_relative_to_where_the_bag_lies(house: House) -> None:
    loaded = load_scenario(house.scenario)
    files = loaded.prior.model_copy(update={"environment": "../lab.npz", "learned": {}})
    run_scenario(loaded.model_copy(update={"prior": files}), trackers=[], out=house.folder / "bag", video=False)
    house.track(house.folder / "bag" / "recording.mcap")
    assert house.handed() == [[4, house.expected[1], {}]]


def test_the_users_rig_file_goes_before_the_bag_and_must_be_right(house: House) -> None:
    bag = house.record("prior=null")
    rig = house.folder / "rig.yaml"
    sensors = (
        "sensors: {waist: {kind: laser, topic: /waist/scan, role: waist, room_from_sensor: {xyz: [0, 0, 0.95]}}}\n"
    )
    rig.write_text(f"{sensors}room: lab\nprior: {{environment: lab.npz}}\n")
    house.track(bag, rig_path=rig)
    assert house.handed() == [[2, house.expected[1], {}]]
    rig.write_text(f"{sensors}prior: {{environment: gone.npz}}\n")
    with pytest.raises(InputError, match=r"rig\.yaml: prior\.environment: there is no file .*gone\.npz; one that"):
        house.track(bag, rig_path=rig)
    rig.write_text(f"{sensors}room: attic\nprior: {{environment: lab.npz}}\n")
    with pytest.raises(InputError, match=r"is of the room 'lab'; one of 'attic' is expected"):
        house.track(bag, rig_path=rig)
    assert not house.handed()


def test_what_is_set_for_a_recording_goes_before_all(house: House) -> None:
    bag = house.record()
    house.track(bag, changes=["prior.environment=null"])
    assert house.handed() == [[4, None, {"heads": "round"}]]
    with pytest.raises(InputError, match=r"^--set prior\.learned\.hands: there is no file .*gone; what a tracker has"):
        house.track(bag, changes=["prior.learned.hands=gone"])
    with pytest.raises(InputError, match=r"prior\.enviroment: unknown key"):
        house.track(bag, changes=["prior.enviroment=x"])


def test_a_scenario_whose_file_is_not_there_records_but_does_not_track(house: House) -> None:
    (house.folder / "lab.npz").unlink()
    assert house.record().exists()
    with pytest.raises(InputError, match=r"^.*own\.yaml: prior\.environment: there is no file .*lab\.npz; one that"):
        run_scenario(load_scenario(house.scenario), trackers=[TRACKER], out=house.folder / "run", video=False)
    assert not (house.folder / "run").exists() and not house.handed()


def test_environment_on_the_command_line(house: House) -> None:
    bare = house.scenario.with_name("bare.yaml")
    bare.write_text(f"extends: {house.scenario.name}\nname: bare\nprior: {{environment: null}}\n")
    scenario = [str(bare), "--tracker", TRACKER, "--no-video"]
    done = house.twin("run", *scenario, "--environment", "lab.npz", "--out", "run")
    assert done.returncode == 0, done.stderr
    assert house.handed() == [house.expected]
    (house.folder / "other.npz").write_bytes((house.folder / "lab.npz").read_bytes())
    (house.folder / "lab.npz").unlink()
    track = ["track", "run/recording.mcap", "--tracker", TRACKER, "--no-video", "--out", "tracked"]
    done = house.twin(*track, "--environment", "other.npz")
    assert done.returncode == 0 and "there is no file" not in done.stderr
    assert house.handed() == [house.expected]
    page = (house.folder / "tracked" / "report.html").read_text()
    assert f"Prior files of the trackers: environment from {house.folder / 'other.npz'}, learned.heads from" in page
    np.savez(house.folder / "none.npz", a=[1])
    for given, said, command in (
        ("gone.npz", "--environment gone.npz: there is no such file", ["run", *scenario, "--out", "other"]),
        ("none.npz", "none.npz: format is missing", track),
    ):
        done = house.twin(*command, "--environment", given)
        assert done.returncode == 2 and said in done.stderr, done.stderr
        lines = [line for line in done.stderr.splitlines() if line.startswith("twin: ") and "planned" not in line]
        assert len(lines) == 1
    assert not (house.folder / "other").exists() and not house.handed()


def test_a_scenario_that_names_no_file_is_written_as_ever() -> None:
    assert "prior" not in dump_scenario(load_scenario("lab-five-people"))
