"""Streams that callers put together themselves: what cannot be is refused in a sentence, what is left out is told."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from trackers.errors import InputError
from trackers.feeding import track_frames
from trackers.observations import NS_PER_S, DepthImage, FloorFrame, Image, LaserScan, Odometry
from trackers.presets import make_tracker
from trackers.rig import FloorSensor, LaserSensor, Rig
from trackers.tracks import Track, TrackFrame

RIG = Rig(sensors={"waist": LaserSensor(topic="/waist", role="waist"), "knee": LaserSensor(topic="/knee")})
RANGES = np.full(90, 4.0, np.float32)
PICTURE = np.zeros((4, 4, 3), np.uint8)


def scan(stamp_ns: Any = 0, sensor: str = "waist", ranges: Any = RANGES) -> LaserScan:
    return LaserScan(sensor, stamp_ns, ranges, -0.8, 0.02, 0.05, 8.0)


@pytest.mark.parametrize(
    "make",
    [
        lambda stamp: scan(stamp),
        lambda stamp: Image("camera", stamp, PICTURE),
        lambda stamp: DepthImage("camera", stamp, PICTURE, np.zeros((4, 4), np.float32)),
        lambda stamp: FloorFrame("floor", stamp, PICTURE[..., 0]),
        lambda stamp: Odometry("base", stamp, np.eye(4)),
    ],
)
def test_a_stamp_is_a_whole_number_of_nanoseconds(make: Callable[[Any], Any]) -> None:
    for stamp in (0, -(10**12), np.int64(5), 1_700_000_000 * NS_PER_S):
        assert make(stamp).stamp_ns == stamp
    for stamp in (0.5, 3.0, None, "0", float("nan"), 9 * 10**18, -(2**62)):
        with pytest.raises(InputError, match=r"stamp_ns is .*; a whole number of nanoseconds, from .* is expected"):
            make(stamp)


@pytest.mark.parametrize(
    "make",
    [
        lambda: scan(ranges=[1.0, 2.0]),
        lambda: Image("camera", 0, PICTURE.tolist()),  # pyright: ignore[reportArgumentType]
        lambda: FloorFrame("floor", 0, [[0]]),  # pyright: ignore[reportArgumentType]
        lambda: Odometry("base", 0, [[1.0]]),  # pyright: ignore[reportArgumentType]
    ],
)
def test_a_list_in_the_place_of_an_array_is_refused(make: Callable[[], Any]) -> None:
    with pytest.raises(InputError, match="is a list; a NumPy array is expected"):
        make()


@pytest.mark.parametrize("rgb", [PICTURE[..., 0], PICTURE.astype(float), np.zeros((4, 4, 4), np.uint8)])
def test_a_picture_is_rgb_of_8_bits(rgb: Any) -> None:
    with pytest.raises(InputError, match=r"rgb has shape .*; \(height, width, 3\) and uint8 are expected"):
        Image("camera", 0, rgb)


@pytest.mark.parametrize(
    ("stream", "said"),
    [
        ([scan(), None], "observation 2 is None; an object of a class of trackers.observations"),
        (["scan"], "observation 1 is 'scan'; an object"),
        (
            [Image("waist", 0, PICTURE)],
            "Image of 'waist': sensors.waist of the rig is of kind laser; LaserScan is expected",
        ),
        (None, "observations is None; an iterable of observations"),
        (scan(), "observations is LaserScan.*; an iterable of observations"),
    ],
)
def test_what_is_no_observation_of_the_rig_is_refused(stream: Any, said: str) -> None:
    with pytest.raises(InputError, match=said):
        list(track_frames(make_tracker("sort", RIG), RIG, stream))


def test_observations_of_sensors_that_the_rig_lacks_are_told() -> None:
    stream = [scan(k * NS_PER_S // 10, sensor) for k in range(10) for sensor in ("waist", "knee", "head")]
    told = "10 of 30 observations were left out .10 of 'head'.: the rig has no such sensor; its sensors are waist, knee"
    with pytest.warns(UserWarning, match=told):
        assert len(list(track_frames(make_tracker("sort", RIG), RIG, stream))) == 10


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("sort", "rig.yaml"), "rig is 'rig.yaml'; a trackers.rig.Rig"),
        (("sort", None), "rig is None; a trackers.rig.Rig"),
        ((None, RIG), "name is None; the name of a tracker"),
        (("sort", RIG, None), "background is None; an iterable of observations"),
        (
            ("sort", Rig(sensors={"floor": FloorSensor(topic="/floor", rows=2, columns=2, pitch_m=0.2)})),
            "^tracker sort: the rig has no laser scanner",
        ),
        (("sort", RIG, (), 5), "rng is 5; a numpy.random.Generator"),
        (("sort", RIG, (), None, "gate"), "options is 'gate'; a mapping of the tracker's options"),
    ],
)
def test_a_tracker_made_with_something_else_is_refused(arguments: Any, said: str) -> None:
    with pytest.raises(InputError, match=said):
        make_tracker(*arguments)
    with pytest.raises(InputError, match="rig is 'rig.yaml'; a trackers.rig.Rig"):
        list(track_frames(make_tracker("sort", RIG), "rig.yaml", []))  # pyright: ignore[reportArgumentType]


class Giving:
    """A tracker that gives the same at each call."""

    def __init__(self, tracks: Any, frames: Any = None) -> None:
        self._tracks, self._frames = tracks, frames

    def update(self, observation: LaserScan) -> Any:
        return self._frames

    def tracks(self) -> Any:
        return self._tracks


@pytest.mark.parametrize(
    ("tracker", "said"),
    [
        (Giving(None), r"tracks\(\) gave None; a list of Track is expected"),
        (Giving({1: Track(1, 0.0, 0.0)}), r"tracks\(\) gave {.*; a list of Track is expected"),
        (Giving([(1, 0.0, 0.0)]), r"tracks\(\) gave \(1, 0.0, 0.0\) among them; a list of Track"),
        (Giving([Track(1, 0.0, 0.0)] * 2), "frame at 0 ns: id 1 stands there twice"),
        (Giving([Track(1, float("nan"), 0.0)]), r"id 1 is at \(nan, 0.0\); finite numbers .m. are expected"),
        (Giving([Track(1, "1", 0.0)]), r"id 1 is at \('1', 0.0\); finite"),  # pyright: ignore[reportArgumentType]
        (Giving([Track(1, np.zeros(1), 0.0)]), "id 1 is at .*; finite"),  # pyright: ignore[reportArgumentType]
        (Giving([Track(1.0, 0.0, 0.0)]), "id 1.0; a whole number from 1 to"),  # pyright: ignore[reportArgumentType]
        (Giving([Track(1, 0.0, 0.0, status="lost")]), "'confirmed' or 'coasting' is expected"),  # pyright: ignore[reportArgumentType]
        (Giving([], TrackFrame(0, ())), r"what update\(\) gave: frames are TrackFrame.*; an iterable of TrackFrame"),
        (Giving([], [Track(1, 0.0, 0.0)]), "is among the frames; an iterable of TrackFrame"),
        (Giving([], [TrackFrame(0.5, ())]), "frame at 0.5 ns: the stamp of an observation"),  # pyright: ignore[reportArgumentType]
        (None, "tracker is None; an object with update"),
        (Giving, "tracker is <class .*; an object with update"),
    ],
)
def test_what_a_tracker_must_not_give_is_refused(tracker: Any, said: str) -> None:
    with pytest.raises(InputError, match=said):
        list(track_frames(tracker, RIG, [scan()]))


def test_tracks_from_an_iterator_are_kept() -> None:
    frames = list(track_frames(Giving(Track(k, 0.0, 0.0) for k in (1, 2)), RIG, [scan()]))
    assert [len(frame.tracks) for frame in frames] == [2]
    frame = TrackFrame(0, (Track(k, 0.0, 0.0) for k in (1, 2)))  # pyright: ignore[reportArgumentType]
    assert len(frame.tracks) == 2
