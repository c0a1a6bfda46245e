"""Gait, as the compiled body shows it: feet that stand still, knees that bend one way, no jumps."""

from __future__ import annotations

import numpy as np
import pytest
from people_cast import make_cast

from twin.people.body.person_spec import JOINT_PLACE, JOINTS
from twin.scenario.behaviour import Stand, Walk
from twin.scenario.person import Person

DT = 0.02
MOST_PER_TICK_RAD = 0.35
MOST_SLIP_M = 0.005


class Recorded:
    """Joint coordinates and feet of a cast over time, every `DT`."""

    def __init__(self, cast, seconds):
        names = cast.population.names
        shape = (len(names), 2)
        toes = np.array([cast.model.geom(f"{name}/{side}_toes").id for name in names for side in ("left", "right")])
        self.angles, self.toes, self.soles, self.pelvis = [], [], [], []
        for tick in range(1, int(seconds / DT) + 1):
            coordinates = cast.pose(tick * DT)
            feet = cast.population.feet(tick * DT)
            self.angles.append(coordinates[:, 7:])
            self.pelvis.append(coordinates[:, :3])
            self.toes.append(cast.data.geom_xpos[toes].reshape(*shape, 3).copy())
            self.soles.append(np.concatenate([feet.place, feet.height[..., None]], axis=-1))
        self.angles, self.toes = np.array(self.angles), np.array(self.toes)
        self.soles, self.pelvis = np.array(self.soles), np.array(self.pelvis)

    def stances(self):
        """Toe positions (k, 2) over each time a foot stood: on the floor, from flat until it lifted."""
        still = (self.soles[..., 2] == 0) & (np.abs(self.toes[..., 2] - self.toes[..., 2].min(axis=0)) < 1e-4)
        for person in range(still.shape[1]):
            for foot in range(2):
                flags = np.concatenate([[False], still[:, person, foot], [False]])
                starts, ends = np.nonzero(flags[1:] & ~flags[:-1])[0], np.nonzero(~flags[1:] & flags[:-1])[0]
                for start, end in zip(starts, ends, strict=True):
                    if end - start > 3:
                        yield self.toes[start:end, person, foot, :2]


@pytest.fixture(scope="module")
def wandering(wanderers):
    return Recorded(make_cast(wanderers), 20.0)


@pytest.fixture(scope="module", params=[0.4, 1.0, 1.6, 2.0, 2.5])
def walking(request):
    walk = Walk(waypoints=((-9.0, 1.0), (9.0, 1.0)), speed_m_s=request.param)
    return request.param, Recorded(make_cast({"anna": Person(height_m=1.75, script=(walk,))}), 6.0)


def test_a_standing_foot_does_not_slide(wandering):
    slips = [np.linalg.norm(stance - stance[0], axis=1).max() for stance in wandering.stances()]
    assert len(slips) > 100
    assert max(slips) < MOST_SLIP_M


def test_a_standing_foot_does_not_slide_at_any_speed(walking):
    speed, recorded = walking
    slips = [np.linalg.norm(stance - stance[0], axis=1).max() for stance in recorded.stances()]
    assert len(slips) >= 4
    assert max(slips) < MOST_SLIP_M


def test_one_foot_always_stands_in_walking_and_runners_fly(walking):
    speed, recorded = walking
    stands = (recorded.soles[..., 2] == 0).any(axis=-1)
    if speed < 2.3:
        assert stands.all()
    else:
        assert 0.1 < 1 - stands[-100:].mean() < 0.4


def test_knees_bend_backwards_only(wandering, walking):
    for recorded in (wandering, walking[1]):
        for side in ("left", "right"):
            knee = recorded.angles[..., JOINT_PLACE[f"{side}_knee"] - 7]
            assert knee.min() > 0.02
            assert knee.max() < 2.0


def test_no_joint_jumps(wandering, walking):
    for recorded in (wandering, walking[1]):
        steps = np.abs(np.diff(recorded.angles, axis=0))
        worst = JOINTS[np.unravel_index(steps.argmax(), steps.shape)[2]]
        assert steps.max() < MOST_PER_TICK_RAD, worst


def test_no_foot_sinks_into_the_floor(wandering, walking):
    for recorded in (wandering, walking[1]):
        # the toes' half height is 0.030 m at a stature of 1.75 m, less for smaller people
        floor = recorded.toes[..., 2].min(axis=(0, 2))
        first = recorded.toes[0, :, :, 2].min(axis=1)
        assert (floor > first - 0.001).all()


def test_the_walker_reaches_the_speed_and_keeps_the_path(walking):
    speed, recorded = walking
    late = recorded.pelvis[-100:, 0]
    assert (late[-1, 0] - late[0, 0]) / (99 * DT) == pytest.approx(speed, rel=0.02)
    assert np.abs(recorded.pelvis[:, 0, 1] - 1.0).max() < 0.05


def test_steps_get_longer_and_quicker_with_speed():
    lengths, times = [], []
    for speed in (0.6, 1.0, 1.4):
        walk = Walk(waypoints=((-9.0, 1.0), (9.0, 1.0)), speed_m_s=speed)
        recorded = Recorded(make_cast({"anna": Person(height_m=1.75, script=(walk,))}), 8.0)
        left = [stance[0, 0] for stance in recorded.stances()]
        places = np.sort(left)[3:-3]
        lengths.append(np.diff(places).mean())
        times.append(lengths[-1] / speed)
    assert lengths[0] < lengths[1] < lengths[2]
    assert times[0] > times[1] > times[2]
    # 0.65 m at 1.2 m/s is the walk ratio of 0.0064 m/(steps/min); 1.0 and 1.4 m/s lie around it
    assert lengths[1] == pytest.approx(0.60, abs=0.07)
    assert lengths[2] == pytest.approx(0.73, abs=0.07)


def test_the_pelvis_bobs_and_sways_a_little(walking):
    speed, recorded = walking
    height = recorded.pelvis[-100:, 0, 2]
    assert 0.003 < np.ptp(height) < 0.11
    assert 0.005 < np.ptp(recorded.pelvis[-100:, 0, 1]) < 0.08


def test_arms_swing_against_the_legs():
    walk = Walk(waypoints=((-9.0, 1.0), (9.0, 1.0)), speed_m_s=1.2)
    recorded = Recorded(make_cast({"anna": Person(script=(walk,))}), 6.0)
    late = recorded.angles[-150:, 0]
    for side in ("left", "right"):
        arm = late[:, JOINT_PLACE[f"{side}_shoulder_pitch"] - 7]
        leg = late[:, JOINT_PLACE[f"{side}_hip_pitch"] - 7]
        assert np.corrcoef(arm, leg)[0, 1] < -0.6


def test_who_stops_ends_with_feet_side_by_side():
    walk = Walk(waypoints=((-1.0, 1.5), (1.0, 1.5)), speed_m_s=1.3)
    cast = make_cast({"anna": Person(script=(walk,))})
    cast.pose(6.0)
    before = cast.population.feet(6.0).place
    cast.pose(8.0)
    after, feet = cast.population.truth(8.0), cast.population.feet(8.0).place
    np.testing.assert_array_equal(before, feet)
    forward = np.array([np.cos(after.yaw[0]), np.sin(after.yaw[0])])
    gap = feet[0, 0] - feet[0, 1]
    assert abs(gap @ forward) < 0.08
    assert 0.08 < np.linalg.norm(gap) < 0.25
    assert np.hypot(after.vx, after.vy)[0] < 0.01
    assert abs(after.x[0] - 1.0) < 0.08


def test_turning_on_the_spot_steps_around():
    walk = Walk(waypoints=((0.0, 1.5), (1.0, 1.5)), speed_m_s=1.0)
    cast = make_cast({"anna": Person(script=(walk,), heading_deg=180.0)})
    recorded = Recorded(cast, 4.0)
    slips = [np.linalg.norm(stance - stance[0], axis=1).max() for stance in recorded.stances()]
    assert max(slips) < MOST_SLIP_M
    assert np.abs(recorded.angles[..., JOINT_PLACE["left_hip_yaw"] - 7]).max() < 1.2
    assert np.abs(np.diff(recorded.angles, axis=0)).max() < MOST_PER_TICK_RAD
    assert abs(cast.population.truth(4.0).yaw[0]) < 0.05


def test_who_stands_does_not_move():
    cast = make_cast({"anna": Person(start=(0.5, 1.5), heading_deg=90.0, script=(Stand(),))})
    recorded = Recorded(cast, 5.0)
    assert np.ptp(recorded.pelvis[50:], axis=0).max() < 1e-3
    truth = cast.population.truth(5.0)
    assert (truth.x[0], truth.y[0]) == pytest.approx((0.5, 1.5), abs=1e-3)
    assert truth.yaw[0] == pytest.approx(np.pi / 2)
