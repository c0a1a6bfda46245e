"""Whose a laser point is, how likely a particle is by its points, and who is new."""

import numpy as np
from hypothesis import given, strategies as st

from trackers.laser.group import Points
from trackers.likelihood.laser_points import PointOptions, log_likelihood, shares, unexplained_people

OPTIONS = PointOptions()
NOWHERE = np.zeros((2, 2, 0))


def points(place, width_m=0.03, alone=False) -> Points:
    place = np.asarray(place, float).reshape(-1, 2)
    return Points(place, np.full(len(place), width_m), np.broadcast_to(alone, len(place)))


def scalar_log_likelihood(seen: Points, share, weight, legs, options) -> np.ndarray:
    n, p = legs.shape[2:]
    result = np.zeros((n, p))
    for person in range(n):
        for particle in range(p):
            for k, place in enumerate(seen.place):
                square = min(((place - legs[side, :, person, particle]) ** 2).sum() for side in (0, 1))
                lost = share[person, k] * weight[k] * min(square, options.cut_m**2)
                result[person, particle] -= options.weight * lost / (2 * options.sigma_m**2)
    return result


@given(st.integers(0, 2**31), st.integers(1, 4), st.integers(0, 12))
def test_the_likelihood_is_that_of_the_written_out_sum(seed, n, k):
    rng = np.random.default_rng(seed)
    middle = rng.uniform(-9, 9, (n, 2))
    legs = middle.T[None, :, :, None] + rng.normal(0, 0.2, (2, 2, n, 7))
    seen = points(middle[rng.integers(0, n, k)] + rng.normal(0, 0.2, (k, 2)), rng.uniform(0.01, 0.2))
    whose = shares(seen, legs.mean(axis=-1), OPTIONS)
    expected = scalar_log_likelihood(seen, whose.share, whose.weight, legs, OPTIONS)
    # points with next to no share are left out
    np.testing.assert_allclose(log_likelihood(seen, whose, legs, OPTIONS), expected, atol=0.18 * k + 0.01)
    assert (whose.share.sum(axis=0) <= 1 + 1e-12).all() and (whose.unknown >= -1e-12).all()


def test_a_point_is_the_nearest_persons_one_between_is_shared_and_a_far_one_is_nobodys():
    legs = np.zeros((2, 2, 2))
    legs[:, 0, 1] = 1.0  # two people a metre apart
    whose = shares(points([(0.1, 0), (0.5, 0), (0.9, 0), (5, 0)]), legs, OPTIONS)
    np.testing.assert_allclose(whose.share[:, [0, 2]], [[1, 0], [0, 1]], atol=0.02)
    assert whose.share[0, 1] == whose.share[1, 1] < 0.5
    assert whose.unknown[3] > 0.99


def test_at_the_gate_a_point_is_as_likely_nobodys():
    at_the_gate = points([(0, OPTIONS.gate_m), (0, OPTIONS.gate_m - 0.1), (0, OPTIONS.gate_m + 0.1)])
    at, nearer, farther = shares(at_the_gate, np.zeros((2, 2, 1)), OPTIONS).share[0]
    assert abs(at - 0.5) < 1e-9 and nearer > 0.9 and farther < 0.1


def test_legs_near_by_tell_no_more_than_far_ones():
    legs = np.array([[-0.1, 0.1], [0.0, 0.0]]).T.reshape(2, 2, 1)
    many, few = points([(-0.1, 0)] * 10, 0.01), points([(-0.1, 0)], 0.1)
    particles = legs[..., None] + np.array([0.0, 0.1])
    one, other = (log_likelihood(each, shares(each, legs, OPTIONS), particles, OPTIONS) for each in (many, few))
    np.testing.assert_allclose(one, other, rtol=1e-5)
    assert one[0, 0] > one[0, 1]


def test_no_points_and_nobody_are_worked_like_any():
    nothing = points([])
    assert log_likelihood(
        nothing, shares(nothing, np.zeros((2, 2, 1)), OPTIONS), np.zeros((2, 2, 1, 5)), OPTIONS
    ).tolist() == [[0.0] * 5]
    seen = points([(0, 0)])
    assert log_likelihood(seen, shares(seen, NOWHERE, OPTIONS), np.zeros((2, 2, 0, 5)), OPTIONS).shape == (0, 5)
    assert len(unexplained_people(nothing, np.ones(0), OPTIONS)[0]) == 0


def test_what_nobody_explains_is_somebody_a_group_of_points():
    seen = points([(0, 0), (0.3, 0), (3, 0), (3.2, 0.1), (6, 0)], 0.1)
    places, legs = unexplained_people(seen, np.array([1, 1, 1, 1, 0.0]), OPTIONS)
    np.testing.assert_allclose(places, [(0.15, 0), (3.1, 0.05)])
    np.testing.assert_allclose(legs, [2, 2])


def test_a_point_alone_is_nobody_as_a_beam_on_an_edge_leaves_one():
    seen = points([(0, 0), (3, 0), (3.2, 0.1)], 0.1)
    places, _ = unexplained_people(seen, np.ones(3), OPTIONS)
    np.testing.assert_allclose(places, [(3.1, 0.05)])


def test_samples_that_are_all_alone_are_nobody_as_beams_half_past_far_legs_leave_them():
    place = [(0, 0), (0.3, 0), (3, 0), (3.2, 0.1)]
    places, _ = unexplained_people(points(place, 0.1, [True, True, False, True]), np.ones(4), OPTIONS)
    np.testing.assert_allclose(places, [(3.1, 0.05)])


def test_of_two_tracks_on_one_body_the_surer_alone_is_measured_and_beside_it_the_other_is():
    legs = np.zeros((2, 2, 2))
    legs[0, 0], legs[1, 0] = -0.1, 0.1  # side by side, the second track's a little off
    seen = points([(-0.1, 0), (0.1, 0.0)], 0.1)
    for missing_s in ([0.0, 0.5], [0.5, 0.0]):
        legs[:, 1] = [0.0, 0.1] if missing_s[0] == 0 else [0.1, 0.0]
        whose = shares(seen, legs, OPTIONS, np.array(missing_s))
        unsure = int(np.argmax(missing_s))
        assert whose.legs[unsure] == 0
        assert (whose.share[unsure] == 0).all()  # nor are its particles drawn by the other's points
    legs[:, 0, 1] += 0.7  # a body's breadth away
    beside = points([(-0.1, 0), (0.1, 0.0), (0.6, 0.05), (0.8, 0.05)], 0.1)
    assert (shares(beside, legs, OPTIONS, np.array([0.0, 1.0])).legs >= 2).all()
