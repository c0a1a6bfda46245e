"""A run that keeps positions alone: the same people and tracks, and nothing that costs more."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest

from twin.recording.reader import Recording
from twin.run.live import run_scenario
from twin.run.replay import track_recording
from twin.scenario import load_scenario


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open() as stream:
        return list(csv.DictReader(stream))


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    scenario = load_scenario("lab-five-people", ["duration_s=1", "background=none"])
    made = {name: tmp_path_factory.mktemp(name) / "out" for name in ("all", "positions")}
    for name, out in made.items():
        run_scenario(scenario, trackers=["sort"], out=out, video=False, images=False, truth=name)  # pyright: ignore[reportArgumentType]
    return made


def test_people_and_tracks_are_the_same(folders: dict[str, Path]):
    whole, kept = (rows_of(folders[name] / "truth.csv") for name in ("all", "positions"))
    assert kept == [{name: value for name, value in row.items() if not name.startswith("visible")} for row in whole]
    assert len(kept) == 50
    tracks = [(folders[name] / "tracks" / "sort.csv").read_bytes() for name in ("all", "positions")]
    assert tracks[0] == tracks[1]


def test_nothing_else_of_the_truth_is_left(folders: dict[str, Path]):
    out = folders["positions"]
    assert sorted(each.name for each in out.glob("truth*")) == ["truth.csv", "truth_people.csv"]
    frames = list(Recording(out / "recording.mcap").truth())
    assert [len(frame.people) for frame in frames] == 10 * [5]
    assert not any(person.visible or person.feet for frame in frames for person in frame.people)


@pytest.mark.parametrize("held", [1, 7])
def test_a_recording_is_the_same_however_much_is_held_before_it_is_tracked(
    folders: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, held: int
):
    monkeypatch.setattr("twin.run.live.IN_A_ROW", held)
    scenario = load_scenario("lab-five-people", ["duration_s=1", "background=none"])
    run_scenario(scenario, trackers=["sort"], out=tmp_path / "out", video=False, images=False)
    for name in ("recording.mcap", "truth.csv", "truth_rays.csv", "truth_situations.csv", "tracks/sort.csv"):
        assert (tmp_path / "out" / name).read_bytes() == (folders["all"] / name).read_bytes(), name


def test_metrics_that_need_more_are_unknown(folders: dict[str, Path]):
    whole, kept = (
        json.loads((folders[name] / "metrics.json").read_text())["trackers"]["sort"] for name in ("all", "positions")
    )
    assert whole["disposal"] is not None
    assert kept["disposal"] is None
    assert kept["mota"] == whole["mota"]


def test_a_replay_knows_no_more(folders: dict[str, Path], tmp_path: Path):
    out = folders["positions"]
    track_recording(out / "recording.mcap", trackers=["sort"], out=tmp_path / "out", video=False)
    metrics, live = (json.loads((each / "metrics.json").read_text()) for each in (tmp_path / "out", out))
    assert metrics["trackers"]["sort"]["disposal"] is None
    assert metrics["trackers"]["sort"]["mota"] == live["trackers"]["sort"]["mota"]
