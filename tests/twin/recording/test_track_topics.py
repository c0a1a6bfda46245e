"""Tracks in a bag: as rows for programs, as markers for the eye; and nothing else in it changes."""

from __future__ import annotations

import json
import re
from math import nan
from pathlib import Path

import pytest

from trackers.errors import InputError
from trackers.presets import PRESETS
from trackers.tracks import Status, Track, TrackFrame
from twin.recording.bags.bag import open_bag
from twin.recording.reader import Recording
from twin.recording.ros.message_types import TYPESTORE
from twin.recording.ros.ros_messages import STRING
from twin.recording.tables import TRACK_COLUMNS, read_tracks
from twin.recording.track_topics import TrackTopics, encode_tracks, track_topics, tracker_names
from twin.recording.truth_messages import MARKER_ARRAY
from twin.run.live import run_scenario
from twin.run.replay import track_recording
from twin.scenario import load_scenario

TRACKERS = ["laser-imm", "laser-kalman"]
TOPICS = {"/tracks/laser_imm", "/tracks/laser_imm/markers", "/tracks/laser_kalman", "/tracks/laser_kalman/markers"}


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """The same run with two trackers and with none."""
    folder = tmp_path_factory.mktemp("runs")
    scenario = load_scenario("lab-five-people", ["duration_s=1.5", "background_frames=3"])
    for name, trackers in (("tracked", TRACKERS), ("plain", [])):
        run_scenario(scenario, trackers=trackers, out=folder / name, video=False, images=False)
    return folder / "tracked", folder / "plain"


def messages(path: Path) -> list[tuple[str, int, bytes]]:
    with open_bag(path) as bag:
        return [(each.topic, log_time_ns, bytes(data)) for each, log_time_ns, data in bag.raw_messages(bag.connections)]


def rows(path: Path, topic: str) -> list[dict]:
    with open_bag(path) as bag:
        return [row for _, _, message in bag.messages([topic]) for row in json.loads(message.data)]


def test_a_bag_holds_the_rows_of_the_table(runs: tuple[Path, Path]) -> None:
    tracked, _ = runs
    assert Recording(tracked / "recording.mcap").topics.keys() >= TOPICS
    table = read_tracks(tracked / "tracks" / "laser-imm.csv")
    found = rows(tracked / "recording.mcap", "/tracks/laser_imm")
    assert len(found) == len(table.id) > 20
    assert list(found[0]) == list(TRACK_COLUMNS)
    assert [(row["id"], row["x"], row["vy"], row["status"]) for row in found] == list(
        zip(table.id.tolist(), table.x.tolist(), table.vy.tolist(), table.status.tolist(), strict=True)
    )
    assert {row["head_x"] for row in found} == {None}
    with open_bag(tracked / "recording.mcap") as bag:
        stamps = [log_time_ns for _, log_time_ns, _ in bag.messages(["/tracks/laser_imm"])]
    assert stamps == table.frame_stamps_ns.tolist()  # a frame without anybody too


def test_the_eye_sees_each_track_where_it_is(runs: tuple[Path, Path]) -> None:
    path = runs[0] / "recording.mcap"
    with open_bag(path) as bag:
        *_, (_, stamp_ns, last) = bag.messages(["/tracks/laser_imm/markers"])
    seen = [row for row in rows(path, "/tracks/laser_imm") if round(row["t"] * 1e9) == stamp_ns]
    bodies = {marker.id: marker.pose.position for marker in last.markers if marker.ns == "tracks"}
    assert {id_: (at.x, at.y) for id_, at in bodies.items()} == {row["id"]: (row["x"], row["y"]) for row in seen}
    assert {marker.text for marker in last.markers if marker.ns == "ids"} == {f"#{row['id']}" for row in seen}


def test_sensors_and_truth_are_to_the_bit_those_of_a_run_without_trackers(runs: tuple[Path, Path]) -> None:
    with_tracks, plain = (messages(folder / "recording.mcap") for folder in runs)
    assert [each for each in with_tracks if each[0] not in TOPICS] == plain


def test_replaying_a_bag_with_tracks_ignores_them(runs: tuple[Path, Path], tmp_path: Path) -> None:
    track_recording(runs[0] / "recording.mcap", trackers=["laser-imm"], out=tmp_path, video=False)
    again = (tmp_path / "tracks" / "laser-imm.csv").read_bytes()
    assert again == (runs[0] / "tracks" / "laser-imm.csv").read_bytes()


def test_tracking_adds_tracks_to_a_copy(runs: tuple[Path, Path], tmp_path: Path) -> None:
    tracked, plain = (folder / "recording.mcap" for folder in runs)
    before, copy = plain.read_bytes(), tmp_path / "copy.mcap"
    result = track_recording(plain, trackers=TRACKERS, out=tmp_path / "out", video=False, bag_copy=copy)
    assert result.files["bag"] == copy
    assert plain.read_bytes() == before
    assert sorted(messages(copy)) == sorted(messages(tracked))
    twice = tmp_path / "twice.mcap"
    track_recording(copy, trackers=["laser-imm"], out=tmp_path / "out", video=False, bag_copy=twice)
    assert sorted(messages(twice)) == sorted(messages(copy))


def test_a_copy_that_cannot_be_is_refused_before_anything_is_written(runs: tuple[Path, Path], tmp_path: Path) -> None:
    plain = runs[1] / "recording.mcap"
    (tmp_path / "other.mcap").write_bytes(plain.read_bytes())
    refused = (plain, "is the recording itself"), (tmp_path / "copy.bag", r"ending in \.mcap")
    for target, words in (
        *refused,
        (tmp_path / "other.mcap", "is there already, and no copy with tracks; the name of"),
    ):
        with pytest.raises(InputError, match=words):
            track_recording(plain, trackers=["laser-imm"], out=tmp_path / "none", video=False, bag_copy=target)
    assert not (tmp_path / "none").exists()


def test_topics_are_names_that_ros_takes() -> None:
    names = ["laser-imm", "laser_imm", "my_lab.tracker:Mine", "2nd"]
    topics = track_topics(names)
    assert list(topics) == names
    assert len(set(topics.values())) == len(names)
    assert all(re.fullmatch(r"/tracks/[A-Za-z_]\w*", topic) for topic in topics.values())


def test_a_topic_of_a_known_tracker_has_its_name_again() -> None:
    """So that what is exported of a bag and of the folder beside it has one name."""
    assert tracker_names(track_topics(list(PRESETS)).values()) == {t: n for n, t in track_topics(list(PRESETS)).items()}
    assert tracker_names(["/tracks/mine"]) == {"/tracks/mine": "mine"}


def test_what_is_not_estimated_is_null() -> None:
    frame = TrackFrame(1_500_000_000, (Track(3, 0.5, 1.0, vx=nan, status="coasting"),))
    (row,) = json.loads(TYPESTORE.deserialize_cdr(encode_tracks(frame), STRING).data)
    assert (row["t"], row["id"], row["x"], row["vx"], row["status"]) == (1.5, 3, 0.5, None, "coasting")


def test_who_coasts_is_drawn_fainter() -> None:
    class Kept:
        def __init__(self) -> None:
            self.markers: list = []

        def connect(self, topic: str, msgtype: str) -> None: ...

        def write(self, topic: str, log_time_ns: int, data: bytes) -> None:
            if topic.endswith("/markers"):
                self.markers.append(TYPESTORE.deserialize_cdr(data, MARKER_ARRAY).markers)

    bag = Kept()
    tracks = TrackTopics(bag, ["mine"])  # pyright: ignore[reportArgumentType]
    statuses: tuple[Status, ...] = ("confirmed", "coasting", "confirmed")
    for stamp_ns, status in enumerate(statuses):
        tracks.write("mine", TrackFrame(stamp_ns, (Track(1, 0.0, 0.0, status=status),)))
    opacities = [markers[0].color.a for markers in bag.markers]
    assert opacities[0] == opacities[2] == pytest.approx(2 * opacities[1])
