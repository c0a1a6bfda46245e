"""Merged people as one target: one set of particles for a group, and one for each cluster after a split."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from synthetic_room import AREA, image, rig, straight_walk
from two_scanners import EMPTY, RIG, observed

from trackers.feeding import track_frames
from trackers.filters.particle import Cloud
from trackers.laser.group import Points
from trackers.laser_vision_learning.situations import Situations
from trackers.laser_vision_learning.walkers import as_one, clusters_of
from trackers.likelihood.laser_points import PointOptions, shares
from trackers.presets import make_tracker
from trackers.rig import Rig


def merged(n: int) -> Situations:
    """All of n tracks in one group."""
    pairs = ~np.eye(n, dtype=bool)
    return Situations(np.arange(n), pairs, pairs, pairs, np.zeros((n, n), np.int64), pairs)


def seen_at(*places: tuple[float, float], people: np.ndarray):
    """Points of legs at these places, and their shares among people."""
    middle = np.repeat(np.array(places, float), 8, axis=0)
    place = middle + 0.05 * np.random.default_rng(0).standard_normal(middle.shape)
    points = Points(place, np.full(len(place), 0.03), np.zeros(len(place), np.bool_))
    return points, shares(points, np.stack([people.T, people.T]), PointOptions(own_m=0.0))


@pytest.mark.parametrize(
    ("places", "n_together"),
    [(((0, 0), (0.3, 0), (0.6, 0)), 6), (((0, 0), (0.3, 0), (2, 0)), 2), (((-0.9, 0), (0, 0), (0.9, 0)), 0)],
    ids=["one cluster", "two and one", "three"],
)
def test_each_cluster_of_a_group_has_a_member_and_all_are_allotted(places: tuple, n_together: int) -> None:
    people = np.tile([0.6, 0.0], (3, 1))
    points, whose = seen_at(*places, people=people)
    found = clusters_of(merged(3), people + np.array([[0, 0], [0.5, 0], [-0.5, 0]]), points, whose, least_legs=0.4)
    assert found.together.sum() == n_together
    assert np.isfinite(found.middle).all()
    assert found.taken.any()
    assert len(np.unique(found.middle.round(6), axis=0)) == 3 - n_together // 2 + (n_together == 6)


def test_a_group_without_points_stays_together_where_it_was() -> None:
    people = np.zeros((2, 2))
    points, whose = seen_at((9, 9), people=people)
    found = clusters_of(merged(2), people, points, whose, least_legs=0.4)
    assert found.together.sum() == 2
    assert np.isnan(found.middle).all() and not found.taken.any()


def test_members_share_their_particles_and_after_the_split_each_has_its_cluster() -> None:
    rng, pair = np.random.default_rng(0), ~np.eye(2, dtype=bool)
    cloud = Cloud.normal(np.array([[0.0, 0], [0.5, 0]]), np.tile(0.01 * np.eye(2), (2, 1, 1)), 400, rng)
    people = cloud.expectation(cloud.state).T
    points, whose = seen_at((0, 0), (0.35, 0), people=people)
    clusters = clusters_of(merged(2), people, points, whose, least_legs=0.4)
    one = as_one(cloud, cloud, np.zeros_like(pair), pair, clusters)
    np.testing.assert_array_equal(one.state[:, 0], one.state[:, 1])
    np.testing.assert_allclose(one.expectation(one.state)[:, 0], [0.175, 0], atol=0.02)
    people = one.expectation(one.state).T
    points, whose = seen_at((-0.3, 0), (0.6, 0), people=people)
    clusters = clusters_of(merged(2), people, points, whose, least_legs=0.4)
    assert not clusters.together.any()
    split = as_one(one, one, pair, np.zeros_like(pair), clusters)
    np.testing.assert_allclose(np.sort(split.expectation(split.state[0])), [-0.3, 0.6], atol=0.05)


def test_whoever_is_hidden_as_a_merged_pair_parts_is_found_again_as_a_member() -> None:
    walk = straight_walk([(-1.6, 1.0), (-1.6, 1.0)], [(0.5, 0.0), (0.5, 0.0)], 50)
    k, hidden = np.arange(len(walk)), range(25, 35)
    walk.position[:, 1, 1] += np.where(
        k < hidden[0], np.maximum(0.9 - 0.06 * k, 0.35), np.minimum(0.35 + 0.1 * (k - 25), 1.5)
    )
    shown = walk.position.copy()
    shown[hidden, 1] = 50.0
    scans = observed(replace(walk, position=shown))
    fused = Rig(sensors={**RIG.sensors, "camera": rig(waist=False, knee=False).sensors["camera"]}, area=AREA)
    looks = [
        image(walk, k, scans[2 * k].stamp_ns, np.random.default_rng(k), ("pink", "blue")) for k in range(len(walk))
    ]
    given = sorted([*scans, *looks], key=lambda each: each.stamp_ns)
    tracker = make_tracker("laser-vision-learning-paper", fused, EMPTY, np.random.default_rng(0))
    frames = list(track_frames(tracker, fused, given))
    one_place = [frame for frame in frames if len(frame.tracks) == 2 and frame.tracks[0].y == frame.tracks[1].y]
    assert one_place and {len(frame.tracks) for frame in frames[-5:]} == {2}
