"""People whom no scanner shows, measured by a camera's detections, on plain figures."""

from __future__ import annotations

import numpy as np
import pytest
import synthetic_view as view

from trackers.filters.particle import Cloud
from trackers.laser_vision_learning.camera_people import CameraPeople, CameraPeopleOptions
from trackers.laser_vision_learning.walking_model import WalkerTracks
from trackers.observations import NS_PER_S
from trackers.prior import Prior
from trackers.tracking.roster import Roster

ON = view.rig()
EMPTY = Prior.of([view.picture(ON, 1000.0 + k, np.empty((0, 2))) for k in range(5)])
PERIOD_S = 0.04


def camera_people() -> CameraPeople:
    return CameraPeople("camera", ON.cameras()["camera"], EMPTY, ON.area, CameraPeopleOptions())


def people_at(places, hidden, spread_m: float = 0.25) -> WalkerTracks:
    """Confirmed tracks of people at places, measured at 0 s, but for the hidden, which were measured before."""
    n = len(places)
    state = np.zeros((5, n, 400))
    state[:2] = np.asarray(places, float).T[..., None] + spread_m * np.random.default_rng(0).normal(size=(2, n, 400))
    measured_ns = np.where(hidden, -round(0.2 * NS_PER_S), 0)
    roster = Roster(np.arange(1, n + 1), Cloud.of(state), measured_ns, measured_ns, np.full(n, 9), np.ones(n, bool))
    return WalkerTracks(np.arange(n), roster, np.where(hidden, 0.2, 0.0), np.full(n, -1), np.zeros(n, int))


def looked(
    believed, truly, hidden, pictures: int = 3, late_s: float = 0.0, move: bool = True
) -> tuple[WalkerTracks, WalkerTracks]:
    """The people before and after some pictures at one moment; frozen ones do not `move` their noise."""
    camera, before = camera_people(), people_at(believed, np.array(hidden))
    people = before
    for k in range(pictures):
        image = view.picture(ON, late_s + PERIOD_S * k * move, np.array(truly, float).reshape(-1, 2))
        people = camera.measure(people, image, 0)
    return before, people


def test_a_hidden_person_is_measured_where_the_picture_shows_them_and_a_seen_one_is_left_alone():
    before, after = looked([(-1.0, 0.0), (1.3, 0.3)], [(-1.2, 0.1), (1.0, 0.0)], [False, True])
    assert np.hypot(*(after.places[1] - (1.0, 0.0))) < 0.2 < np.hypot(*(before.places[1] - (1.0, 0.0)))
    np.testing.assert_array_equal(after.places[0], before.places[0])
    assert after.missing_s[1] == 0 and after.pictured_ns.tolist() == [-1, 0]


def test_where_the_picture_shows_nobody_a_hidden_track_is_missing_sooner():
    before, after = looked([(-1.0, 0.0), (1.3, 0.3)], [(-1.0, 0.0)], [False, True])
    assert after.missing_s[1] > before.missing_s[1] + PERIOD_S
    assert after.pictured_ns.tolist() == [-1, -1]


def test_the_detection_of_a_person_that_scanners_show_is_no_hidden_ones():
    _, after = looked([(0.0, 0.0), (0.3, 0.0)], [(0.05, 0.0)], [False, True])
    assert after.pictured_ns.tolist() == [-1, -1]


@pytest.mark.parametrize("pictures", [1, 6])
def test_a_frozen_camera_measures_once(pictures: int):
    _, once = looked([(1.0, 0.0)], [(1.2, 0.0)], [True], pictures=1)
    _, after = looked([(1.0, 0.0)], [(1.2, 0.0)], [True], pictures=pictures, move=False)
    np.testing.assert_array_equal(after.places, once.places)


def test_a_picture_that_is_foreground_throughout_tells_nothing():
    camera, before = camera_people(), people_at([(1.0, 0.0)], np.array([True]))
    image = view.picture(ON, 0.0, np.empty((0, 2)))
    image.rgb[:] = 255
    assert camera.measure(before, image, 0) is before
