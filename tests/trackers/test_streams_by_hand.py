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
from trackers.rig import LaserSensor, Rig

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
        (("sort", RIG, (), None, "gate"), "options is 'gate'; a mapping of the tracker's options"),
    ],
)
def test_a_tracker_made_with_something_else_is_refused(arguments: Any, said: str) -> None:
    with pytest.raises(InputError, match=said):
        make_tracker(*arguments)
    with pytest.raises(InputError, match="rig is 'rig.yaml'; a trackers.rig.Rig"):
        list(track_frames(make_tracker("sort", RIG), "rig.yaml", []))  # pyright: ignore[reportArgumentType]
