"""People followed by the points of knee scanners alone: everybody apart, whole rigs and degraded ones."""

from dataclasses import replace

import numpy as np
import pytest
from synthetic_room import AREA, Walk, score, straight_walk
from two_scanners import EMPTY, RIG, laser, observed, one_scan

from trackers.errors import InputError
from trackers.feeding import track_frames
from trackers.laser.group import ScannerGroup
from trackers.laser.layer import KneeOptions
from trackers.presets import make_tracker
from trackers.rig import Rig

PRESET = "laser-vision-learning-laser"


def followed(walk: Walk, on: Rig = RIG, empty=tuple(EMPTY), late_s: float = 0.0, **options):
    tracker = make_tracker(PRESET, on, list(empty), np.random.default_rng(0), options)
    return list(track_frames(tracker, on, observed(walk, late_s))), tracker


WALK = straight_walk([(-1.6, 1.3), (1.5, 1.9), (0.3, 2.5)], [(0.8, 0.0), (-0.7, 0.05), (0.0, 0.0)], 40)


def test_people_apart_are_followed_by_both_scanners():
    frames, tracker = followed(WALK)
    found = score(WALK, frames)
    assert (found.switches, found.misidentified, found.false_positives) == (0, 0, 0)
    assert found.misses <= 2
    assert found.error_m < 0.08
    assert tracker.unused_sensors == [] and not tracker.background_learned_causally
    moving = {track.id: track for track in frames[-1].tracks}
    assert sorted(round(track.vx, 0) for track in moving.values()) == [-1.0, 0.0, 1.0]


def test_the_same_observations_and_generator_give_the_same_bits():
    assert repr(followed(WALK)[0]) == repr(followed(WALK)[0])


def test_one_scanner_follows_whom_it_sees():
    found = score(WALK, followed(WALK, Rig(sensors={"front": laser(False)}, area=AREA))[0])
    assert found.misidentified == 0
    assert found.misses <= 12


def test_scanners_half_a_period_apart_are_fused_all_the_same():
    found = score(WALK, followed(WALK, late_s=0.05)[0])
    assert (found.switches, found.misidentified, found.false_positives) == (0, 0, 0)
    assert found.error_m < 0.1


def test_without_scans_of_the_empty_room_it_is_learned_and_said_so():
    walk = straight_walk([(-1.6, 1.3), (1.5, 1.9)], [(0.8, 0.0), (-0.7, 0.05)], 40)
    frames, tracker = followed(walk, empty=())
    assert tracker.background_learned_causally
    assert score(walk, frames, skip=25).misses <= 6


def test_a_rig_without_a_knee_scanner_is_refused():
    with pytest.raises(InputError, match="no laser scanner for knee height"):
        make_tracker(PRESET, Rig(sensors={"waist": laser(False, "waist")}), ())


def test_a_beam_that_another_scanner_denies_is_no_point():
    walk = straight_walk([(0.0, 2.5)], [(0.0, 0.0)], 1)
    scans = {name: one_scan(walk, 0, 1.0, name == "back", 3) for name in ("front", "back")}
    ranges = scans["front"].ranges_m.copy()
    ranges[[100, 101]] = 1.0  # in the open, before the wall: where the scanner ahead looks past
    scans["front"] = replace(scans["front"], ranges_m=ranges)
    front, both = (
        ScannerGroup({name: RIG.lasers()[name] for name in names}, EMPTY, KneeOptions()).points(scans)
        for names in (("front",), ("front", "back"))
    )
    ghost = [np.hypot(*(each.place - [0.64, 0.76]).T).min() < 0.3 for each in (front, both)]
    assert ghost == [True, False]
    assert np.hypot(*(both.place - [0.0, 2.5]).T).min() < 0.2
