"""From foreground samples to clusters, and from clusters to people."""

import numpy as np
import pytest
from hypothesis import given, strategies as st
from hypothesis.extra.numpy import arrays

from trackers.laser.clusters import ClusterOptions, find_clusters, pair_off, pushed_back, take_legs, trunks
from trackers.laser.layer import KneeOptions, LaserLayer, WaistOptions
from trackers.observations import LaserScan
from trackers.rig import LaserSensor, Pose

INCREMENT = np.deg2rad(0.5)


def scan(ranges) -> LaserScan:
    return LaserScan("scan", 0, np.asarray(ranges, np.float32), -np.pi / 2, float(INCREMENT), 0.05, 8.0)


def discs(centres, radius=0.06, wall=4.0, n=361) -> LaserScan:
    """Discs (c, 2) in the scanner's frame before a wall all around."""
    angles = -np.pi / 2 + INCREMENT * np.arange(n)
    rays = np.stack([np.cos(angles), np.sin(angles)], 1)
    along = rays @ np.asarray(centres, float).T
    root = along**2 - (np.asarray(centres, float) ** 2).sum(1) + radius**2
    ranges = np.where((root >= 0) & (along > 0), along - np.sqrt(np.maximum(root, 0)), np.inf)
    return scan(np.minimum(ranges.min(axis=1), wall))


def ellipse(centre, half_extents, yaw, wall=4.0, n=361) -> LaserScan:
    """An ellipse in the scanner's frame before a wall all around: a circle once its plane is turned and stretched."""
    angles = -np.pi / 2 + INCREMENT * np.arange(n)
    turn = np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]]) / np.asarray(half_extents)[:, None]
    rays, origin = np.stack([np.cos(angles), np.sin(angles)], 1) @ turn.T, -turn @ np.asarray(centre, float)
    square, along = (rays**2).sum(1), rays @ origin
    root = along**2 - square * (origin @ origin - 1)
    near = np.where(root >= 0, (-along - np.sqrt(np.maximum(root, 0))) / square, np.inf)
    return scan(np.minimum(near, wall))


def clusters_of(given: LaserScan, **options):
    return find_clusters(given, given.ranges_m < 3.9, ClusterOptions(**options))


def test_one_cluster_a_disc_with_its_middle_on_the_near_side():
    given = discs([(2.0, 0.0), (1.0, 1.0), (1.5, -1.5)])
    found = clusters_of(given)
    assert len(found) == 3
    axis = pushed_back(found.middle, 0.045)
    np.testing.assert_allclose(axis[np.argsort(axis[:, 1])], [(1.5, -1.5), (2.0, 0.0), (1.0, 1.0)], atol=0.02)


def test_neighbours_at_different_ranges_are_split_and_the_far_one_knows_it_is_hidden():
    found = clusters_of(discs([(1.0, 0.0), (1.8, 0.22)], radius=0.12))
    assert len(found) == 2
    near, far = np.argsort(found.range_m)
    assert found.hidden_before[far]
    assert not found.hidden_after[far]
    assert not (found.hidden_before[near] or found.hidden_after[near])


def test_a_wall_right_behind_somebody_hides_nothing_of_them():
    given = discs([(2.0, 0.0)], radius=0.12, wall=2.0)
    found = find_clusters(given, given.ranges_m < 1.97, ClusterOptions())
    assert (found.hidden_before.tolist(), found.hidden_after.tolist()) == ([False], [False])


def test_a_lost_beam_does_not_cut_but_a_gap_does():
    given = discs([(1.5, 0.0)], radius=0.15)
    beams = np.flatnonzero(given.ranges_m < 3.9)
    for lost, value, expected in ((1, np.nan, 1), (3, np.nan, 1), (1, np.inf, 1), (3, np.inf, 2), (3, 4.0, 2)):
        ranges = given.ranges_m.copy()
        middle = beams[len(beams) // 2]
        ranges[middle : middle + lost] = value
        cut = scan(ranges)
        with np.errstate(invalid="ignore"):
            assert len(find_clusters(cut, cut.ranges_m < 3.9, ClusterOptions())) == expected, (lost, value)


def test_fewer_samples_than_a_thing_returns_are_noise_and_more_so_near_by():
    for range_m, n, expected in ((0.5, 5, 0), (0.5, 12, 1), (3.0, 2, 0), (3.0, 3, 1)):
        ranges = np.full(361, 4.0)
        ranges[180 : 180 + n] = range_m
        assert len(clusters_of(scan(ranges), min_samples=3, min_width_m=0.05)) == expected, (range_m, n)


@pytest.mark.parametrize("value", [np.nan, np.inf, 0.0])
def test_scans_without_anything(value):
    given = scan(np.full(361, value))
    found = find_clusters(given, np.zeros(361, bool), ClusterOptions())
    assert len(found) == 0
    assert found.middle.shape == (0, 2)


def test_hundreds_of_clusters():
    ranges = np.where(np.arange(1440) % 4 < 2, 1.0, 4.0)
    given = LaserScan("scan", 0, ranges.astype(np.float32), -np.pi, np.pi / 720, 0.05, 8.0)
    options = ClusterOptions(min_samples=2, min_width_m=0.001)
    assert len(find_clusters(given, ranges < 2, options)) == 360


def test_arms_go_with_their_trunk_and_two_people_stay_two():
    position = np.array([(0, 1.5), (0.25, 1.45), (-0.24, 1.5), (0.6, 1.5), (0.5, 2.1)])
    width = np.array([0.33, 0.09, 0.08, 0.3, 0.1])
    hidden = np.array([False, False, False, False, True])
    kept = trunks(position, width, hidden, 0.16, 0.38, 0.7, 0.25)
    np.testing.assert_array_equal(kept, [True, False, False, True, True])  # the last: half hidden behind, out of reach


def test_an_arm_takes_nobody_with_it():
    position = np.array([(0.0, 1.5), (0.5, 1.5), (1.0, 1.5)])
    kept = trunks(position, np.array([0.3, 0.1, 0.05]), np.zeros(3, bool), 0.16, 0.38, 0.7, 0.25)
    np.testing.assert_array_equal(kept, [True, False, True])


def test_the_pieces_of_somebody_side_on_are_one():
    position = np.array([(0, 1.5), (0.02, 1.38), (-0.05, 1.55)])
    kept = trunks(position, np.array([0.12, 0.08, 0.07]), np.array([True, False, True]), 0.16, 0.38, 0.7, 0.25)
    np.testing.assert_array_equal(kept, [True, False, False])
    equal = trunks(position, np.full(3, 0.1), np.ones(3, bool), 0.16, 0.38, 0.7, 0.25)
    assert equal.sum() == 1


@pytest.mark.parametrize(("apart_m", "people"), [(0.13, 1), (0.35, 2)])
def test_a_trunk_cut_in_two_by_an_arm_is_one_and_two_people_are_as_far_apart_as_bodies(apart_m, people):
    position = np.array([(0.0, 1.5), (apart_m, 1.5)])
    kept = trunks(position, np.array([0.18, 0.25]), np.array([True, False]), 0.16, 0.38, 0.7, 0.25)
    assert kept.sum() == people
    assert kept[1]


def test_the_second_leg_is_looked_for_across_from_the_first():
    legs, together, expected = np.array([(0.1, 0.0), (-0.2, 0.0), (0.16, 0.0)]), np.zeros(3, bool), np.zeros((1, 2))
    for opposite, middle in ((0.0, 0.13), (0.3, -0.05)):
        position, n_leg, _ = take_legs(legs, together, expected, reach_m=0.8, stride_m=0.8, opposite=opposite)
        assert n_leg.tolist() == [2]
        np.testing.assert_allclose(position, [(middle, 0.0)])


def test_strangers_legs_pair_off_from_the_closest_up():
    legs = np.array([(0.0, 0.0), (0.2, 0.0), (0.55, 0.0), (0.8, 0.0), (3.0, 0.0)])
    people, n_leg = pair_off(legs, 0.5)
    np.testing.assert_allclose(people, [(0.1, 0), (0.675, 0), (3, 0)])
    np.testing.assert_array_equal(n_leg, [2, 2, 1])
    firm, n_leg = pair_off(legs, 0.5, np.zeros(5, bool))
    np.testing.assert_allclose(firm, [(0.1, 0), (0.675, 0)])  # a glimpse of one leg is nobody, of two is somebody
    nobody, n_leg = pair_off(np.empty((0, 2)), 0.5)
    assert nobody.shape == (0, 2)
    assert n_leg.size == 0


def test_expected_people_take_a_full_stride_or_one_leg_but_not_each_others():
    legs = np.array([(-0.33, 0.0), (0.33, 0.0), (1.0, 0.05), (5.0, 5.0)])
    expected = np.array([(0.02, 0.0), (1.1, 0.0), (9.0, 9.0)])
    position, n_leg, free = take_legs(legs, np.zeros(4, bool), expected, reach_m=0.4, stride_m=0.8)
    np.testing.assert_allclose(position[:2], [(0, 0), (1.0, 0.05)])
    np.testing.assert_array_equal(n_leg, [2, 1, 0])
    np.testing.assert_array_equal(free, [False, False, False, True])


def test_two_people_side_by_side_take_the_leg_nearest_to_each():
    """As in `library-hall-busy`: two people side by side, the legs of each one cluster."""
    legs, expected = np.array([(-1.31, -0.37), (-1.23, 0.24)]), np.array([(-1.36, -0.33), (-1.2, 0.2)])
    for order in ([0, 1], [1, 0]):
        position, n_leg, free = take_legs(legs, np.zeros(2, bool), expected[order], reach_m=0.7, stride_m=0.8)
        np.testing.assert_allclose(position, legs[order])
        assert (n_leg.tolist(), free.tolist()) == ([1, 1], [False, False])


def test_a_cluster_as_wide_as_both_legs_is_both():
    legs, together = np.array([(0.1, 0.0), (2.0, 0.1)]), np.array([True, False])
    _, n_leg, _ = take_legs(legs, together, np.array([(0.0, 0.0), (2.0, 0.0)]), reach_m=0.5, stride_m=0.8)
    np.testing.assert_array_equal(n_leg, [2, 1])


@given(
    legs=arrays(float, st.tuples(st.integers(0, 4), st.just(2)), elements=st.floats(-1, 1)),
    expected=arrays(float, st.tuples(st.integers(0, 3), st.just(2)), elements=st.floats(-1, 1)),
)
def test_every_leg_is_one_persons_or_nobodys_and_as_many_see_one_as_can(legs, expected):
    reach_m, stride_m = 0.7, 0.8
    position, n_leg, free = take_legs(legs, np.zeros(len(legs), bool), expected, reach_m, stride_m)
    assert n_leg.sum() == (~free).sum()
    assert n_leg.max(initial=0) <= 2
    np.testing.assert_array_equal(position[n_leg == 0], expected[n_leg == 0])
    taken = legs[~free]
    for place, before in zip(position[n_leg == 1], expected[n_leg == 1], strict=True):
        assert np.linalg.norm(place - before) < reach_m
        assert np.linalg.norm(taken - place, axis=1).min() == 0
    # nobody without a leg is in reach of one that nobody has
    assert (np.linalg.norm(expected[n_leg == 0][:, None] - legs[free], axis=2) >= reach_m - 1e-9).all()


def layer(options, room_from_sensor=Pose()) -> LaserLayer:
    sensor = LaserSensor(topic="/scan", room_from_sensor=room_from_sensor)
    return LaserLayer(sensor, [scan(np.full(361, 4.0))], options)


def test_a_layer_answers_in_the_room_frame_with_the_axis_of_the_body():
    pose = Pose(xyz=(1.0, -2.0, 0.95), rpy=(0.0, 0.0, np.pi / 2))
    found = layer(WaistOptions(half_depth_m=0.15 * np.pi / 4, side_half_depth_m=None), pose).detect(
        discs([(2.0, 0.5)], radius=0.15)
    )
    np.testing.assert_allclose(found.position, [(1.0 - 0.5, -2.0 + 2.0)], atol=0.02)


def test_the_axis_of_a_body_is_found_from_every_side():
    centre, options = (2.0, 0.3), WaistOptions(half_depth_m=0.14 * np.pi / 4, side_half_depth_m=0.22 * np.pi / 4)
    for degrees in range(0, 180, 15):
        given = ellipse(centre, (0.14, 0.22), np.deg2rad(degrees))
        (found,) = layer(options).detect(given).position
        (as_from_the_front,) = layer(options.model_copy(update={"side_half_depth_m": None})).detect(given).position
        assert np.hypot(*(found - centre)) < 0.02
        off = np.hypot(*(as_from_the_front - centre))
        assert off > 0.055 if degrees == 90 else off < 0.075


def test_an_arm_behind_its_own_trunk_is_an_arm_and_somebody_behind_is_not():
    trunk, arm, behind = (1.9, 0.0), (2.22, 0.222), (2.5, 0.15)  # of the latter two as much is seen
    for other, radius, expected in ((arm, 0.045, 1), (behind, 0.15, 2)):
        ranges = np.minimum(discs([trunk], radius=0.15).ranges_m, discs([other], radius=radius).ranges_m)
        found = layer(WaistOptions()).detect(scan(ranges))
        assert len(found) == expected, other


def test_an_arm_that_somebody_nearer_hides_a_part_of_is_not_completed_to_a_trunk():
    trunk, arm, nearer = (1.9, 0.0), (2.0, 0.36), (1.144, 0.36)
    discs_of = [discs([at], radius=radius).ranges_m for at, radius in ((trunk, 0.15), (arm, 0.045), (nearer, 0.12))]
    found = layer(WaistOptions()).detect(scan(np.min(discs_of, axis=0)))
    assert len(found) == 2


def test_a_half_hidden_body_is_completed_behind_what_hides_it():
    centres = np.array([(1.0, 0.0), (2.0, 0.3)])
    given = discs(centres, radius=0.15)
    plain = layer(WaistOptions(body_width_m=None, half_depth_m=0.1)).detect(given)
    completed = layer(WaistOptions(body_width_m=0.3, half_depth_m=0.1)).detect(given)
    far = np.argmax(plain.range_m)
    errors = [np.hypot(*(found.position[far] - centres[1])) for found in (plain, completed)]
    assert errors[1] < 0.6 * errors[0]


def test_the_width_of_a_half_hidden_body_tells_nothing_of_its_depth():
    given = discs([(1.0, 0.0), (2.0, 0.3)], radius=0.15)
    by_width = layer(WaistOptions(half_depth_m=0.1, side_half_depth_m=0.2)).detect(given)
    half_way = layer(WaistOptions(half_depth_m=0.15, side_half_depth_m=None)).detect(given)
    near, far = np.argsort(by_width.range_m)
    np.testing.assert_allclose(by_width.position[far], half_way.position[far], rtol=0, atol=1e-12)
    assert np.hypot(*(by_width.position[near] - half_way.position[near])) > 0.02


def test_a_knee_layer_shows_single_legs():
    found = layer(KneeOptions()).detect(discs([(1.5, -0.1), (1.6, 0.12)], radius=0.06))
    np.testing.assert_allclose(found.position, [(1.5, -0.1), (1.6, 0.12)], atol=0.02)


def test_two_beams_half_past_the_legs_beside_them_are_no_leg_behind():
    ranges = np.full(361, 4.0)
    ranges[180:184] = ranges[187:191] = 1.5
    ranges[[184, 186]] = 2.9, 2.92  # the wall is seen between
    assert len(layer(KneeOptions()).detect(scan(ranges))) == 2


def test_one_beam_on_a_far_leg_is_kept_for_those_known_but_not_on_the_edge_of_something_nearer():
    ranges = np.full(361, 4.0)
    ranges[100], ranges[200:203], ranges[203] = 3.5, 1.5, 2.5  # a far leg, a near one and a beam half past it
    given_scan, known = scan(ranges), KneeOptions()
    knee = KneeOptions(cluster=known.cluster.model_copy(update={"min_width_m": 0.001}))
    found = layer(knee).detect(given_scan)
    assert found.n_sample.tolist() == [1, 3]
    without = layer(knee.model_copy(update={"weak_samples": None})).detect(given_scan)
    assert without.n_sample.tolist() == [3]
