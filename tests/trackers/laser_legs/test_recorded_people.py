"""Trackers of legs on recorded scans: a walk of three people, and labelled legs at the recorded rate and at a part of it."""

import numpy as np
import pytest
from driving_room import rig_on_base
from recorded_scans import labelled, needs_data, on_furniture, walkers_in_the_robots_bag

from trackers.feeding import track_frames
from trackers.filters.gating import distances, max_weight_assignment
from trackers.laser.clusters import pair_off
from trackers.presets import make_tracker
from trackers.rig import LaserSensor, Pose, Rig

RIG = Rig(sensors={"scan": LaserSensor(topic="/scan", room_from_sensor=Pose(xyz=(0, 0, 0.3)))})
ON_BASE = rig_on_base(Pose(xyz=(0, 0, 0.3)))


@needs_data
def test_three_people_who_walk_past_a_robot_are_three_tracks():
    """One of them turns about behind another at 67 s, and comes out where no track of theirs was expected."""
    scans = walkers_in_the_robots_bag()[500:760]
    tracker = make_tracker("laser-legs", RIG, (), np.random.default_rng(0))
    frames = list(track_frames(tracker, RIG, scans))
    assert len({track.id for frame in frames for track in frame.tracks}) == 3


@needs_data
@pytest.mark.sample(5)  # each recording, each rate
@pytest.mark.parametrize(
    ("tracker_name", "rig", "number", "every", "least"),
    [("laser-legs", RIG, number, every, 0.8) for number in (1, 2, 3) for every in (1, 2, 3)]
    + [(name, ON_BASE, number, 1, 0.75) for name in ("sort", "laser-imm") for number in (1, 2, 3)],
    ids=lambda value: "" if isinstance(value, Rig) else str(value),
)
def test_people_by_their_labelled_legs_are_found_at_any_rate_and_from_a_base(
    tracker_name: str, rig: Rig, number: int, every: int, least: float
):
    scans, legs = labelled(number)
    legs = legs[~on_furniture(scans, legs)]
    tracker = make_tracker(tracker_name, rig, (), np.random.default_rng(0))
    frames = list(track_frames(tracker, rig, scans[::every]))
    found = there = 0
    for k, frame in enumerate(frames):
        people = pair_off(legs[legs[:, 0] == k * every, 1:], 0.7)[0]
        places = np.array([[track.x, track.y] for track in frame.tracks]).reshape(-1, 2)
        away = distances(people, places)
        found += len(max_weight_assignment(np.where(away < 0.5, 0.5 - away, 0.0))[0])
        there += len(people)
    assert found / there > least
