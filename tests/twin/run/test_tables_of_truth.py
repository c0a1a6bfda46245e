"""`twin track --truth`: a recording evaluated against a table of its user's."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from command_line import twin

from trackers.area import Area, Pose
from trackers.errors import InputError
from trackers.tracks import Track, TrackFrame
from twin.evaluate.continuity import track_counts
from twin.recording.reader import Recording
from twin.recording.tables import read_truth, track_table
from twin.recording.truth_tables import on_clock_of, truth_frames
from twin.run.live import run_scenario
from twin.run.replay import track_recording
from twin.scenario import load_scenario


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of three seconds, and labels of it: every third stamp of the scanner, names for ids, no other column."""
    folder = tmp_path_factory.mktemp("walk")
    scenario = load_scenario("lab-five-people", ["duration_s=3", "sensors.fisheye=null"])
    run_scenario(scenario, trackers=["laser-imm"], out=folder, images=False, video=False)
    with (folder / "truth.csv").open() as stream:
        rows = [row for row in csv.DictReader(stream) if row["id"]]
    stamps = sorted({row["t"] for row in rows}, key=float)[::3]
    lines = [f"person {row['id']},{row['y']},{row['x']},{row['t']}" for row in rows if row["t"] in stamps]
    (folder / "labels.csv").write_text("\n".join(["id,y,x,t", *lines]))
    return folder


def test_labels_judge_like_the_truth_and_the_command_says_how_many_frames(walk: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    arguments = ["--tracker", "laser-imm", "--no-video", "--out", str(out)]
    done = twin("track", str(walk / "recording.mcap"), "--truth", str(walk / "labels.csv"), *arguments)
    assert done.returncode == 0, done.stderr
    assert "laser-imm: 2" in done.stderr and "frames judged" in done.stderr
    assert f"--truth {walk / 'labels.csv'}" in (out / "report.html").read_text()
    people = json.loads((out / "recording.json").read_text())["people"]
    assert people == {str(number): f"person {number}" for number in range(1, 6)}
    own = twin("evaluate", str(walk / "truth.csv"), str(out / "tracks/laser-imm.csv"))
    with_labels = twin("evaluate", str(walk / "labels.csv"), str(out / "tracks/laser-imm.csv"))
    assert own.returncode == with_labels.returncode == 0


def test_labels_of_another_time_are_refused_before_anything_is_written(walk: Path, tmp_path: Path) -> None:
    late = tmp_path / "late.csv"
    late.write_text("t,id,x,y\n900,1,0,1\n900.1,1,0,1\n")
    done = twin("track", str(walk / "recording.mcap"), "--truth", str(late), "--out", str(tmp_path / "out"))
    assert done.returncode == 2
    assert "late.csv: t is from 900.000 to 900.100 s" in done.stderr and "0 to 3.0" in done.stderr
    assert not (tmp_path / "out").exists()


def test_t_counts_from_the_start_or_is_the_stamp_itself(tmp_path: Path) -> None:
    path, start_ns = tmp_path / "labels.csv", 1_700_000_000_000_000_000
    path.write_text("t,id,x,y\n0.5,1,0,1\n1.5,1,0,1\n")
    table = read_truth(path)
    assert on_clock_of(table, start_ns, 3.0, "bag") is table
    stamped = replace(table, frame_stamps_ns=table.frame_stamps_ns + start_ns, stamps_ns=table.stamps_ns + start_ns)
    np.testing.assert_array_equal(on_clock_of(stamped, start_ns, 3.0, "bag").stamps_ns, table.stamps_ns)
    with pytest.raises(InputError, match=r"bag goes from 0 to 0\.300 s"):
        on_clock_of(table, start_ns, 0.3, "bag")
    for hours, told in ((1, "1 h before that"), (-9.5, "9.5 h after that"), (20, None), (0.1, None)):
        stamps = {name: getattr(stamped, name) + round(hours * 3600e9) for name in ("frame_stamps_ns", "stamps_ns")}
        with pytest.raises(InputError, match="on the recording's clock") as refused:
            on_clock_of(replace(stamped, **stamps), start_ns, 3.0, "bag")
        assert ("as in another time zone" in str(refused.value)) == (told is not None)
        assert (told or "") in str(refused.value)


def test_a_table_of_stamps_is_evaluated_by_the_stamp_at_which_the_tracks_begin(tmp_path: Path) -> None:
    (tmp_path / "tracks").mkdir()
    tracks, labels = tmp_path / "tracks/mine.csv", tmp_path / "labels.csv"
    tracks.write_text("t,id,x,y\n0.5,1,0,1\n1.5,1,0,1\n")
    labels.write_text("t,id,x,y\n1700000000.5,ann,0,1\n1700000001.5,ann,0,1\n")
    alone = twin("evaluate", labels, tracks)
    assert alone.returncode == 2 and "the same clock" in alone.stderr
    (tmp_path / "recording.json").write_text('{"start_stamp_ns": 1700000000000000000}')
    done = twin("evaluate", labels, tracks)
    assert done.returncode == 0 and json.loads(done.stdout)["mota"] == 1, done.stderr
    (tmp_path / "recording.json").write_text('{"start_stamp_ns": "now"}')
    refused = twin("evaluate", labels, tracks)
    assert refused.returncode == 2 and "recording.json: start_stamp_ns: is 'now'" in refused.stderr


def test_people_outside_the_tracked_area_are_not_owed(tmp_path: Path) -> None:
    path = tmp_path / "labels.csv"
    path.write_text("t,id,x,y\n0,1,0.5,0.5\n0,2,5,5\n1,1,0.5,0.5\n")
    square = Area(np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]]))
    assert read_truth(path, area=square).in_area.tolist() == [True, False, True]
    assert read_truth(path).in_area.all()
    first, second = truth_frames(read_truth(path, area=square))
    assert [(each.id, each.x, each.in_area) for each in first.people] == [(1, 0.5, True), (2, 5.0, False)]
    assert len(second.people) == 1


def test_tracks_are_counted_without_any_truth() -> None:
    frames = [TrackFrame(0, ()), *(TrackFrame(k * 10**8, (Track(1, 0, 0), Track(2, 1, 0))) for k in (1, 2))]
    frames.append(TrackFrame(3 * 10**8, (Track(1, 0, 0, status="coasting"),)))
    assert track_counts(track_table(frames)) == {
        "frames": 4,
        "track_count": 2,
        "tracks_per_frame": 1.25,
        "most_per_frame": 2,
        "duration_s": {"median": pytest.approx(0.15), "longest": pytest.approx(0.2)},
        "coasting": 0.2,
    }
    empty = track_counts(track_table([TrackFrame(0, ())]))
    assert empty["track_count"] == 0 and empty["duration_s"]["longest"] is None and empty["tracks_per_frame"] == 0


def test_tracks_in_the_place_of_truth_are_told(tmp_path: Path) -> None:
    table = tmp_path / "tracks.csv"
    table.write_text("t,id,x,y,status\n0.0,1,0.5,0.5,confirmed\n0.1,1,0.6,0.5,coasting\n")
    assert any(
        "is read as truth and holds tracks by its column status; unless that is meant" in note
        for note in read_truth(table).notes
    )


def test_tracks_of_a_robot_near_nobody_of_the_truth_are_told_with_the_frame_in_which_they_leave(tmp_path: Path) -> None:
    scenario = load_scenario("robot-follows-outdoors", ["duration_s=2"])
    run_scenario(scenario, trackers=[], out=tmp_path, images=False, video=False, truth="positions")
    bag, labels = tmp_path / "recording.mcap", tmp_path / "truth.csv"
    own = Recording(bag).rig
    (base,) = own.odometry()
    moved = own.sensors[base].model_copy(update={"room_from_sensor": Pose()})
    (tmp_path / "rig.yaml").write_text(own.model_copy(update={"sensors": own.sensors | {base: moved}}).dump_yaml())
    tracked = partial(track_recording, bag, trackers=["laser-legs"], truth_path=labels, video=False, report=False)
    told, well = [], []
    tracked(rig_path=tmp_path / "rig.yaml", out=tmp_path / "out", on_warning=told.append)
    tracked(out=tmp_path / "well", on_warning=well.append)
    said = f"{base}: tracks leave in the frame of its odometry; "
    assert [each.startswith(said) for each in told].count(True) == 1
    assert not any(each.startswith(said) for each in well)
