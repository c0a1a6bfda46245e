"""The walk of figure 6: what its description promises, and that position, heading and speed belong together."""

import numpy as np

from twin.reproduce.laser_fisheye_imm.walk import PERIOD_S, maneuvering_walk

WALK = maneuvering_walk()


def test_85_scans_of_a_person_who_stops_starts_turns_and_runs():
    assert len(WALK) == 85
    np.testing.assert_allclose(np.diff(WALK.t), PERIOD_S)
    kinds = [maneuver.kind for maneuver in WALK.maneuvers]
    assert (kinds.count("stop"), kinds.count("turn")) == (2, 3) and kinds.count("start") >= 2
    assert 2.0 <= WALK.speed.max() <= 3.0
    assert (WALK.speed >= 0).all() and (WALK.speed == 0).sum() >= 5


def test_maneuvers_are_in_order_and_where_the_motion_changes():
    ends = np.array([(maneuver.start_t, maneuver.end_t) for maneuver in WALK.maneuvers])
    assert (np.diff(ends.ravel()) >= 0).all()
    inside = ((WALK.t[:-1, None] >= ends[:, 0] - 1e-9) & (WALK.t[1:, None] <= ends[:, 1] + 1e-9)).any(axis=1)
    changing = (abs(np.diff(WALK.speed)) > 1e-9) | (abs(np.diff(WALK.heading)) > 1e-9)
    np.testing.assert_array_equal(inside, changing)


def test_position_is_the_integral_of_the_velocity():
    # the trapezium over a scan is off by T³/12 times the velocity's second derivative, at most v ω²: 4 mm in the turns
    velocity = WALK.speed[:, None] * np.stack([np.cos(WALK.heading), np.sin(WALK.heading)], axis=1)
    moved = np.diff(WALK.position, axis=0)
    np.testing.assert_allclose(moved, PERIOD_S * (velocity[1:] + velocity[:-1]) / 2, atol=0.005)
    steady = (abs(np.diff(WALK.heading)) < 1e-9) & (abs(np.diff(WALK.speed)) < 1e-9)
    np.testing.assert_allclose(np.linalg.norm(moved, axis=1)[steady], PERIOD_S * WALK.speed[1:][steady], atol=1e-9)
    np.testing.assert_allclose(np.diff(WALK.heading), PERIOD_S * WALK.turn_rate[1:], atol=1e-9)


def test_accelerations_are_what_a_person_can_do():
    ahead = np.diff(WALK.speed) / PERIOD_S
    sideways = WALK.speed * np.maximum(abs(WALK.turn_rate), abs(np.append(WALK.turn_rate[1:], 0)))
    assert abs(ahead).max() <= 4.0 + 1e-9
    assert sideways.max() <= 7.0
    assert abs(WALK.turn_rate).max() <= 2 * np.pi + 1e-9
