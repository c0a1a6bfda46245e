"""A robot's bag as drivers write it: clocks that are set, drift, start at 1970 or say nothing; scanners that name no limit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest
from numpy.typing import NDArray
from recorded import MS, a_scan, write_ros2_bag

from trackers.arrival_order import LATE
from trackers.errors import InputError
from trackers.rig import LaserSensor, Rig
from trackers.tracks import Track, TrackFrame
from twin.recording.losses import dropped_by, lines
from twin.recording.reader import Recording
from twin.recording.ros.message_types import TYPESTORE
from twin.recording.ros.ros_messages import LASER_SCAN, encode, time_message
from twin.recording.tables import read_tracks, read_truth
from twin.recording.track_topics import copy_with_tracks
from twin.run.replay import track_recording

NS_PER_S = 10**9
NS_PER_DAY = 86_400 * NS_PER_S
EPOCH_NS = 1_700_000_000 * NS_PER_S
N = 80
REGULAR = [k * 100 * MS for k in range(N)]
RIG = Rig(
    sensors={"waist": LaserSensor(topic="/high", role="waist"), "knee": LaserSensor(topic="/low", role="knee")},
)
RNG = np.random.default_rng(5)
JITTER = RNG.integers(0, 20 * MS, N).tolist()
SOME = set(RNG.choice(N, 12, replace=False).tolist()) | {0}
Said = Callable[[int], int]
"""What a message's header says, by its number."""


def true(k: int) -> int:
    return EPOCH_NS + REGULAR[k]


def a_bag(folder, waist: Said = true, knee: Said = true, logged: Said | dict[str, Said] = true, n: int = N, **changes):
    """Scans of two scanners with these stamps in their headers, by default all right; log times: by topic, or of both."""
    messages = []
    for topic, said in (("/high", waist), ("/low", knee)):
        for k in range(n):
            message: Any = TYPESTORE.deserialize_cdr(encode(a_scan(REGULAR[k], seed=len(topic))).data, LASER_SCAN)
            header = replace(message.header, stamp=time_message(said(k)))
            log_ns = (logged[topic] if isinstance(logged, dict) else logged)(k)
            messages.append((topic, LASER_SCAN, log_ns, replace(message, header=header, **changes)))
    write_ros2_bag(folder / "bag", sorted(messages, key=lambda message: message[2]))
    return folder / "bag"


def stamps_of(recording: Recording) -> dict[str, list[int]]:
    found: dict[str, list[int]] = {}
    for each in recording.observations():
        found.setdefault(each.sensor, []).append(each.stamp_ns)
    return found


WRONG: dict[str, Said] = {
    "set back by 6 s": lambda k: true(k) - 6 * NS_PER_S * (k > 30),
    "set back by .65 s": lambda k: true(k) - 650 * MS * (k > 50),
    "set back by an hour": lambda k: true(k) - 3600 * NS_PER_S * (k > 60),
    "set ahead by 2 s": lambda k: true(k) + 2 * NS_PER_S * (k > 50),
    "set ahead by 30 days": lambda k: true(k) + 30 * NS_PER_DAY * (k > 60),
    "set from 1970": lambda k: true(k) - EPOCH_NS * (k < 10),
    "set ahead and back": lambda k: true(k) + 40 * NS_PER_S * (20 < k < 30),
    "one stamp of 0": lambda k: true(k) * (k > 0),
    "some stamps of 0": lambda k: true(k) * (k not in SOME),
    "most stamps of 0": lambda k: true(k) * (k % 4 == 0),
    "no stamp": lambda k: 0,
    "one stamp for all": lambda k: EPOCH_NS - 77 * NS_PER_S,
    "whole seconds": lambda k: true(k) // NS_PER_S * NS_PER_S,
    "microseconds as nanoseconds": lambda k: true(k) - true(k) % NS_PER_S + true(k) % NS_PER_S // 1000,
    "one stamp far ahead": lambda k: true(k) + NS_PER_DAY * (k == 33),
}


@pytest.mark.parametrize("wrong", WRONG)
@pytest.mark.parametrize("both", [True, False], ids=["both", "one"])
def test_stamps_are_set_right_by_the_log_times_and_that_is_told(tmp_path, wrong, both):
    said = WRONG[wrong]
    recording = Recording(a_bag(tmp_path, said, said if both else true), RIG)
    found = stamps_of(recording)
    for name in ("waist", "knee"):
        np.testing.assert_allclose(np.array(found[name]), REGULAR, rtol=0, atol=1 * MS)
        assert any(line.startswith(f"{name}: ") for line in lines(recording.losses)) == (both or name == "waist")
    assert recording.start_ns == pytest.approx(EPOCH_NS, abs=NS_PER_DAY)
    n_jump = (2 if wrong == "set ahead and back" else 1) if both and wrong.startswith("set") else 0
    assert len(recording.jumps_ns) == n_jump
    for jump_ns in recording.jumps_ns:
        assert abs(said(round(jump_ns / REGULAR[1])) - said(round(jump_ns / REGULAR[1]) - 1)) > 200 * MS
    assert any("trackers restart" in line for line in lines(recording.losses)) == (n_jump > 0)


@pytest.mark.parametrize("off_s", [-1.7e9, -3600, -2, 0.8, 5, 1e7])
def test_another_clock_is_moved_onto_that_of_the_others_and_the_offset_is_told(tmp_path, off_s):
    bag = a_bag(tmp_path, knee=lambda k: true(k) + round(off_s * NS_PER_S))
    recording = Recording(bag, RIG)
    np.testing.assert_allclose(stamps_of(recording)["knee"], REGULAR, rtol=0, atol=1 * MS)
    (line,) = lines(recording.losses)
    assert f"`time_offset_s: {-off_s:.3f}` for knee in rig.yaml" in line
    stated = {"knee": RIG.sensors["knee"].model_copy(update={"time_offset_s": -off_s})}
    again = Recording(bag, Rig(sensors=RIG.sensors | stated))
    assert lines(again.losses) == []
    np.testing.assert_allclose(stamps_of(again)["knee"], REGULAR, rtol=0, atol=1 * MS)


@pytest.mark.parametrize("off_s", [-0.4, 0.45])
def test_the_offset_that_is_told_where_trackers_would_not_wait_is_the_whole(tmp_path, off_s):
    recording = Recording(a_bag(tmp_path, knee=lambda k: true(k) + round(off_s * NS_PER_S)), RIG)
    assert lines(recording.losses) == [] and recording.ahead_s == pytest.approx({"knee": off_s, "waist": -off_s})
    (loss,) = dropped_by("sort", {("knee", LATE): N}, {"knee": N}, recording.ahead_s)
    assert f"`time_offset_s: {-off_s:.3f}` for knee in rig.yaml" in loss.remedy


@pytest.mark.parametrize("count", [8, 10, 12, 15, 25])
def test_messages_that_are_held_up_are_of_no_other_clock(tmp_path, count):
    held = {
        "/high": true,
        "/low": lambda k: true(min(k // count * count + count - 1, N - 1)) + 70 * MS,
    }  # so many at once
    recording = Recording(a_bag(tmp_path, logged=held), RIG)
    assert {name: sorted(each) for name, each in stamps_of(recording).items()} == dict.fromkeys(RIG.sensors, REGULAR)
    assert not any("another clock" in line for line in lines(recording.losses))
    (loss,) = dropped_by("sort", {("knee", LATE): N}, {"knee": N}, recording.ahead_s)
    assert "see what holds the messages up" in loss.remedy


@pytest.mark.parametrize("ppm", [-50_000, 30_000])
def test_a_clock_that_drifts_is_set_right(tmp_path, ppm):
    recording = Recording(a_bag(tmp_path, knee=lambda k: true(k) + REGULAR[k] * ppm // 1_000_000), RIG)
    np.testing.assert_allclose(stamps_of(recording)["knee"], REGULAR, rtol=0, atol=1 * MS)
    (line,) = lines(recording.losses)
    assert line.startswith(f"knee: {N} of {N} messages were stamped by a clock that ")
    assert f"{'gains' if ppm > 0 else 'loses'} {abs(ppm) / 1000:.3g} ms per second" in line


@pytest.mark.parametrize("pace", [0.01, 0.25, 1, 1.5, 40])
def test_another_pace_of_all_stamps_than_of_the_log_is_told_and_they_are_kept(tmp_path, pace):
    def said(k: int) -> int:
        return EPOCH_NS + round(pace * REGULAR[k])

    recording = Recording(a_bag(tmp_path, said, said), RIG)
    assert stamps_of(recording)["knee"] == [round(pace * ns) for ns in REGULAR]
    assert [f"pass {pace:.3g} s" in line for line in lines(recording.losses)] == [True] * (pace != 1)


LOST_LOGS: dict[str, Said] = {"all the same": lambda k: EPOCH_NS, "written later": lambda k: EPOCH_NS + k * MS}


@pytest.mark.parametrize("logged", LOST_LOGS.values(), ids=LOST_LOGS.keys())
@pytest.mark.parametrize("wrong", ["set back by 6 s", "set back by .65 s", "set back by an hour"])
def test_a_clock_that_was_set_back_goes_on_by_its_rhythm_where_log_times_do_not_tell(tmp_path, wrong, logged):
    recording = Recording(a_bag(tmp_path, WRONG[wrong], WRONG[wrong], logged), RIG)
    found = stamps_of(recording)
    for name in ("waist", "knee"):
        np.testing.assert_allclose(np.array(found[name]), REGULAR, rtol=0, atol=1 * MS)
        assert any(line.startswith(f"{name}: ") and "by its own rhythm" in line for line in lines(recording.losses))
    assert len(recording.jumps_ns) == 1


@pytest.mark.parametrize("logged", LOST_LOGS.values(), ids=LOST_LOGS.keys())
def test_a_message_that_came_late_sets_no_clock_back(tmp_path, logged):
    order = [k for k in range(N) if k not in (20, 50)] + [20, 50]  # in the file: two that came at the very end
    recording = Recording(a_bag(tmp_path, lambda k: true(order[k]), lambda k: true(order[k]), logged), RIG)
    assert {name: sorted(stamps) for name, stamps in stamps_of(recording).items()} == dict.fromkeys(
        RIG.sensors, REGULAR
    )
    assert recording.jumps_ns == ()


@pytest.mark.parametrize("by_s", [0.7, 3, 5])
def test_stamps_that_are_right_stay_so_where_the_clock_of_the_recorder_alone_was_set_back(tmp_path, by_s):
    def logged(k: int) -> int:
        return true(k) - round(by_s * NS_PER_S) * (k >= 50)

    messages = []
    for k in range(N):  # in the order in which they came, which the file keeps
        for topic in ("/high", "/low"):
            message: Any = TYPESTORE.deserialize_cdr(encode(a_scan(REGULAR[k], seed=len(topic))).data, LASER_SCAN)
            header = replace(message.header, stamp=time_message(true(k)))
            messages.append((topic, LASER_SCAN, logged(k), replace(message, header=header)))
    write_ros2_bag(tmp_path / "bag", messages)
    recording = Recording(tmp_path / "bag", RIG)
    assert stamps_of(recording) == dict.fromkeys(RIG.sensors, REGULAR)
    assert sum("a recorder whose clock was set back by" in line for line in lines(recording.losses)) == 2
    assert recording.jumps_ns == ()


def in_bursts(n: int) -> Said:
    """Log times of messages that a network hands on n at a time, a microsecond apart."""
    return lambda k: EPOCH_NS + (k // n + 1) * n * 100 * MS + k % n * 1000


RIGHT: dict[str, tuple[Said, Said]] = {
    "on one clock": (true, true),
    "since the robot was switched on": (lambda k: REGULAR[k], true),
    "logged with jitter": (true, lambda k: true(k) + JITTER[k]),
    "logged 0.2 s late": (true, lambda k: true(k) + 200 * MS),
    "a recorder that stalls": (true, lambda k: max(true(k), true(40) + k * MS) if 20 < k <= 40 else true(k) + 200 * MS),
    "simulated time": (lambda k: REGULAR[k], lambda k: EPOCH_NS + REGULAR[k] * 5 // 4),
    **{f"logged {n} at a time": (true, in_bursts(n)) for n in (2, 3, 7, 16, 20, 27, 40)},
    "log times written later": (true, lambda k: EPOCH_NS + NS_PER_DAY + k * MS),
    "log times all the same": (true, lambda k: EPOCH_NS),
    "a clock of the recorder that is a day off": (true, lambda k: true(k) + NS_PER_DAY),
}


TOLD = {
    "simulated time": "pass 0.8 s in each second of the log times",
    "log times all the same": "in an order that says nothing of when they came",  # one topic after the other
}


@pytest.mark.parametrize("name", RIGHT)
def test_stamps_that_are_right_keep_each_bit(tmp_path, name):
    said, logged = RIGHT[name]
    recording = Recording(a_bag(tmp_path, said, said, logged), RIG)
    assert [TOLD.get(name, "") in line for line in lines(recording.losses)] == [True] * (name in TOLD)
    assert recording.start_ns == said(0)
    assert {name: sorted(stamps) for name, stamps in stamps_of(recording).items()} == dict.fromkeys(
        RIG.sensors, REGULAR
    )


@pytest.mark.parametrize("regular", [True, False], ids=["each topic at its pace", "at random"])
def test_observations_of_a_bag_with_shuffled_log_times_come_in_the_order_of_their_stamps(tmp_path, regular):
    rng = np.random.default_rng(3)
    places = {"/high": rng.permutation(N), "/low": rng.permutation(N)}
    messages = []
    for topic, place in places.items():
        for k in range(N):
            message: Any = TYPESTORE.deserialize_cdr(encode(a_scan(REGULAR[k], seed=len(topic))).data, LASER_SCAN)
            header = replace(message.header, stamp=time_message(true(k)))
            logged = EPOCH_NS + 100 * MS * int(place[k]) + (0 if regular else int(rng.integers(0, 99 * MS)))
            messages.append((topic, LASER_SCAN, logged, replace(message, header=header)))
    write_ros2_bag(tmp_path / "bag", sorted(messages, key=lambda message: message[2]))
    recording = Recording(tmp_path / "bag", RIG)
    assert [each.stamp_ns for each in recording.observations()] == [ns for ns in REGULAR for _ in RIG.sensors]
    assert ["in an order that says nothing" in line for line in lines(recording.losses)] == [True]


@pytest.mark.timeout(60)
@pytest.mark.parametrize("said", [WRONG["set ahead by 30 days"], WRONG["set from 1970"], WRONG["one stamp of 0"]])
def test_time_goes_on_in_the_tables_where_a_clock_was_set(tmp_path, said):
    told: list[str] = []
    bag = a_bag(tmp_path, said, said)
    (tmp_path / "rig.yaml").write_text(RIG.dump_yaml())
    result = track_recording(
        bag,
        trackers=["laser-imm"],
        rig_path=tmp_path / "rig.yaml",
        out=tmp_path / "out",
        video=False,
        on_warning=told.append,
    )
    stamps = read_tracks(result.files["tracks laser-imm"]).frame_stamps_ns
    assert all(0 < later - earlier < NS_PER_S for earlier, later in pairwise(stamps.tolist()))
    assert any(line.startswith("waist: ") for line in told)
    assert any("trackers restart there" in line for line in told) == (said is not WRONG["one stamp of 0"])
    assert any(line in result.files["report"].read_text().replace("&#39;", "'") for line in told)


def drawn(folder: Path, range_max: float) -> tuple[list[int], NDArray[np.int16]]:
    """The stamps that were tracked, and every eighth picture of the preview, of scanners that name this limit."""
    folder.mkdir(exist_ok=True)
    bag = a_bag(folder, n=N // 2, range_max=range_max)
    (folder / "rig.yaml").write_text(RIG.dump_yaml())
    result = track_recording(bag, trackers=["laser-imm"], rig_path=folder / "rig.yaml", out=folder / "out")
    with av.open(str(result.files["preview"])) as container:
        pictures = [frame.to_ndarray(format="gray") for k, frame in enumerate(container.decode(video=0)) if k % 8 == 0]
    stamps = read_tracks(result.files["tracks laser-imm"]).frame_stamps_ns.tolist()
    return stamps, np.array(pictures, dtype=np.int16)


@pytest.fixture(scope="module")
def with_a_limit(tmp_path_factory) -> tuple[list[int], NDArray[np.int16]]:
    return drawn(tmp_path_factory.mktemp("limit"), 100.0)


@pytest.mark.parametrize("range_max", [1e6, np.inf])
def test_a_scanner_without_a_limit_is_tracked_and_drawn_as_one_that_sees_as_far(tmp_path, range_max, with_a_limit):
    expected_stamps, expected = with_a_limit
    stamps, pictures = drawn(tmp_path, range_max)
    assert stamps == expected_stamps and len(stamps) == N // 2
    assert pictures.shape == expected.shape
    assert (np.abs(pictures - expected) > 24).mean() < 0.01  # edges, where the compression differs
    assert (np.abs(pictures[1:] - pictures[:-1]) > 24).mean() > 0.02  # which other scans would not pass for


def test_a_scanner_whose_beams_are_nowhere_is_refused_with_bag_and_topic(tmp_path):
    bag = a_bag(tmp_path, angle_increment=0.0)
    (tmp_path / "rig.yaml").write_text(RIG.dump_yaml())
    with pytest.raises(InputError, match=r"bag: topic /high: scan of 'waist': angle_increment is 0 rad"):
        track_recording(bag, trackers=["laser-imm"], rig_path=tmp_path / "rig.yaml", out=tmp_path / "out", video=False)
    assert not (tmp_path / "out" / "report.html").exists()


LOGGED: dict[str, Said] = {
    "on one clock": true,
    "by a recorder whose clock was set back": lambda k: true(k) - 5 * NS_PER_S * (k >= 50),
    "at 0, all of them": lambda k: 0,
    "at one time, all of them": lambda k: EPOCH_NS + NS_PER_DAY,
}


@pytest.mark.parametrize("logged", LOGGED)
def test_a_copy_with_tracks_and_truth_is_read_as_the_bag_is_however_that_was_logged(tmp_path, logged):
    messages = []
    for k in range(N):
        for topic in ("/high", "/low"):
            message: Any = TYPESTORE.deserialize_cdr(encode(a_scan(REGULAR[k], seed=len(topic))).data, LASER_SCAN)
            header = replace(message.header, stamp=time_message(true(k)))
            messages.append((topic, LASER_SCAN, LOGGED[logged](k), replace(message, header=header)))
    write_ros2_bag(tmp_path / "bag", messages)
    rows = [f"{ns / NS_PER_S},{id_},{id_},1" for ns in REGULAR for id_ in (1, 2)]
    (tmp_path / "truth.csv").write_text("\n".join(["t,id,x,y", *rows]))
    recording, truth = Recording(tmp_path / "bag", RIG), read_truth(tmp_path / "truth.csv")
    frames = [("mine", TrackFrame(ns, (Track(1, 0.0, 1.0),))) for ns in REGULAR]
    copy_with_tracks(recording, tmp_path / "copy.mcap", ["mine"], frames, truth=truth)
    copy = Recording(tmp_path / "copy.mcap", RIG)
    assert stamps_of(copy) == stamps_of(recording) == dict.fromkeys(RIG.sensors, REGULAR)
    assert [frame.stamp_ns for frame in copy.truth()] == REGULAR
    assert {len(frame.people) for frame in copy.truth()} == {2}
