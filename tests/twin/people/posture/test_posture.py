"""Postures: feet that stay, pelvises on seats, hands at points, heads that look, weight that is borne."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from posture_cast import DT, Stage, bed, looks_of, seat, standing

from twin.geometry.geom_hull import hull_points
from twin.people.body.person_spec import JOINT_PLACE, JOINTS, NQ_PERSON
from twin.people.posture.body_measures import BodyMeasures
from twin.people.posture.overlay import overlay_postures
from twin.people.posture.posture_rows import POSTURE_ROWS, pressure_shift_m, support
from twin.people.posture.postures import Postures
from twin.people.posture.resting import FEET_SHARE, lying_pose, seated_pose

MOST_PER_TICK_RAD = 0.25
G = 9.81
CHAIR = seat((0.4, -0.3, 0.45), 2.5)
BED = bed((1.0, 2.0, 0.5), -0.7)


def before(seat, stature=1.75):
    seated = seated_pose(seat, Stage(stature).measures, 0)
    # heading wound once more around: it is unwrapped where people have turned
    return Stage(stature, seated.standing_place + 0.03j, seated.yaw + 2 * np.pi + 0.1)


def beside(bed, side, stature=1.75):
    coming = complex(*bed.place[:2]) + side * 2j * np.exp(1j * bed.yaw)
    edge = lying_pose(bed, Stage(stature).measures, 0, coming).edge
    return Stage(stature, edge.standing_place, edge.yaw)


def feet_of(stage, qpos):
    data = stage.pose(qpos)
    return np.array([[*data.body(f"{side}_foot").xpos, *data.body(f"{side}_foot").xmat] for side in ("left", "right")])


def assert_smooth(stage, poses):
    poses = np.concatenate([stage.standing, poses])
    steps = np.abs(np.diff(poses[:, 7:], axis=0))
    worst = JOINTS[np.unravel_index(steps.argmax(), steps.shape)[1]]
    assert steps.max() < MOST_PER_TICK_RAD, worst
    assert np.linalg.norm(np.diff(poses[:, :3], axis=0), axis=1).max() < 0.05
    # a quaternion and its opposite are one orientation
    assert np.abs(np.sum(poses[1:, 3:7] * poses[:-1, 3:7], axis=1)).min() > np.cos(0.1)


def lowest(stage, qpos, geoms):
    """Lowest point of some geoms [m]."""
    data = stage.pose(qpos)
    return min(hull_points(stage.model, data, stage.model.geom(name).id)[:, 2].min() for name in geoms)


def test_measures_are_the_bodys():
    measures = BodyMeasures.of(looks_of(1.2, 1.75, 1.95))
    assert len(measures) == 3
    assert (np.diff(measures.leg) > 0).all()
    np.testing.assert_allclose(measures.leg / measures.stature, measures.leg[1] / 1.75, rtol=0.1)
    np.testing.assert_allclose(measures.of_people(np.array([2])).thigh, measures.thigh[2])


def test_who_does_nothing_keeps_the_very_numbers():
    measures = BodyMeasures.of(looks_of(1.6, 1.8, 1.7))
    place, heading = np.array([0j, 1 + 1j, 3j]), np.array([0.1, 2.0, -1.0])
    postures, qpos = Postures(measures, place, heading), standing(measures, place, heading)
    postures.step(place, heading, DT)
    assert overlay_postures(qpos, postures.rows, measures) is qpos
    postures.bend(1, 0.5)
    postures.look_at(1, np.array([0.0, 0.0, 1.0]))
    for _ in range(20):
        postures.step(place, heading, DT)
    laid = overlay_postures(qpos, postures.rows, measures)
    assert laid.shape == (3, NQ_PERSON)
    np.testing.assert_array_equal(laid[[0, 2]], qpos[[0, 2]])
    assert np.abs(laid[1] - qpos[1]).max() > 0.05


def test_who_has_come_back_keeps_the_very_numbers():
    stage = before(CHAIR)
    stage.tick()
    for command in (
        lambda: stage.postures.sit(0, CHAIR),
        lambda: stage.postures.rise(0),
        lambda: stage.postures.bend(0, 1.0),
        lambda: stage.postures.straighten(0),
        lambda: stage.postures.reach(0, np.array([0.2, 0.1, 0.4])),
        lambda: stage.postures.withdraw(0),
        lambda: stage.postures.turn_head(0, 1.0),
        lambda: stage.postures.look_ahead(0),
    ):
        command()
        poses, _ = stage.run()
    for _ in range(3):
        stage.tick()
    assert not stage.postures.rows.any()
    assert stage.qpos() is stage.standing


@pytest.mark.sample(7)  # each height, each stature
@pytest.mark.parametrize("stature", [1.2, 1.45, 1.75, 1.95])
@pytest.mark.parametrize("height", [0.35, 0.45, 0.55])
def test_sitting_down_and_up_again(stature, height):
    stool = seat((0.4, -0.3, height), 2.5)
    stage = before(stool, stature)
    stage.tick()
    at_first = feet_of(stage, stage.standing[0])
    stage.postures.sit(0, stool)
    assert not stage.postures.may_walk()[0]
    down, rows_down = stage.run("body")
    stage.postures.rise(0)
    up, _ = stage.run("body")
    assert stage.postures.may_walk()[0]
    poses = np.concatenate([down, up])
    assert_smooth(stage, poses)
    for side in ("left", "right"):
        knee = poses[:, JOINT_PLACE[f"{side}_knee"]]
        assert knee.min() > 0.02
        assert knee.max() < 2.2
    # on the seat, not in it
    assert lowest(stage, down[-1], ["hips"]) == pytest.approx(height, abs=0.02)
    assert all(lowest(stage, pose, ["hips"]) > height - 0.02 for pose in poses)
    facing = np.exp(1j * stool.yaw)
    trunk = stage.pose(down[-1]).body("trunk").xmat.reshape(3, 3)
    assert trunk[2, 2] > np.cos(0.2)
    assert trunk[0, 0] * facing.real + trunk[1, 0] * facing.imag > 0.98
    hangs = bool(stage.postures._hang[0])
    assert hangs == ((stature, height) in ((1.2, 0.45), (1.2, 0.55), (1.45, 0.55)))
    if not hangs:
        for pose in poses:
            np.testing.assert_allclose(feet_of(stage, pose), at_first, atol=1e-9)
        slope = [stage.pose(down[-1]).body(f"{side}_thigh").xmat.reshape(3, 3)[2, 2] for side in ("left", "right")]
        assert np.abs(slope).max() < 0.53
    on_feet, _ = support(rows_down.T)
    assert on_feet[-1] == pytest.approx(0.0 if hangs else FEET_SHARE)
    assert down.shape[0] * DT == pytest.approx(2.0, abs=0.05)
    assert up.shape[0] * DT == pytest.approx(1.8, abs=0.05)


def test_the_feet_bear_what_moves():
    stage = before(CHAIR)
    stage.tick()
    stage.postures.sit(0, CHAIR)
    _, down = stage.run()
    stage.postures.rise(0)
    _, up = stage.run()
    for _ in range(3):
        stage.tick()
    for rows, begins, ends in ((down, 1.0, FEET_SHARE), (up, FEET_SHARE, 1.0)):
        share, acceleration = support(rows.T)
        assert share[0] == pytest.approx(begins, abs=0.02)
        assert share[-1] == pytest.approx(ends, abs=0.02)
        assert np.abs(np.diff(share)).max() < 0.15
        # what the body presses down with all the way is its weight: it begins and ends at rest
        assert np.mean(1 + acceleration / G) == pytest.approx(1.0, abs=0.01)
        assert np.abs(acceleration).max() < 4.0
    load = support(up.T)[0] * (1 + support(up.T)[1] / G)
    assert 1.08 < load.max() < 1.3
    assert 0.3 < (load.argmax() + 1) * DT / 1.8 < 0.65
    assert load[-1] == pytest.approx(1.0, abs=0.02)
    shift = pressure_shift_m(up.T)
    assert 0.02 < shift.max() < 0.06
    assert shift[-1] == pytest.approx(0.0, abs=1e-3)


@pytest.mark.sample(4)  # each stature, each side
@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("stature", [1.2, 1.75, 1.95])
def test_lying_down_and_getting_up(side, stature):
    stage = beside(BED, side, stature)
    stage.tick()
    stage.postures.lie(0, BED)
    down, rows = stage.run("body")
    data = stage.pose(down[-1])
    head, pelvis = data.site("head").xpos.copy(), data.site("pelvis").xpos.copy()
    along = np.array([np.cos(BED.yaw), np.sin(BED.yaw)])
    across = np.array([-along[1], along[0]])
    assert abs((pelvis[:2] - BED.place[:2]) @ across) < 0.01
    assert abs((head[:2] - BED.place[:2]) @ across) < 0.03
    assert (head[:2] - pelvis[:2]) @ along > 0.3 * stature
    assert data.body("trunk").xmat.reshape(3, 3)[2, 0] > 0.98  # belly up
    assert lowest(stage, down[-1], ["hips", "chest", "left_thigh", "right_thigh"]) == pytest.approx(0.5, abs=0.035)
    for foot in feet_of(stage, down[-1]):
        assert foot[2] > 0.5
        assert abs((foot[:2] - BED.place[:2]) @ along) < 1.05
    on_feet, _ = support(rows.T)
    assert on_feet[-1] == pytest.approx(0.0, abs=1e-9)
    stage.postures.rise(0)
    up, _ = stage.run("body")
    assert_smooth(stage, np.concatenate([down, up]))
    for _ in range(3):
        stage.tick()
    np.testing.assert_array_equal(stage.qpos(), stage.standing)


@pytest.mark.parametrize("degrees", [30, 60, 90, 110])
@pytest.mark.parametrize("stature", [1.2, 1.95])
def test_bending(degrees, stature):
    stage = Stage(stature, 1 - 1j, 2.0)
    at_first = feet_of(stage, stage.standing[0])
    stage.postures.bend(0, np.deg2rad(degrees))
    poses, _ = stage.run()
    assert_smooth(stage, poses)
    for pose in poses:
        np.testing.assert_allclose(feet_of(stage, pose), at_first, atol=1e-9)
    trunk = stage.pose().body("trunk").xmat.reshape(3, 3)
    assert np.rad2deg(np.arccos(trunk[2, 2])) == pytest.approx(degrees, abs=1.0)
    # the mass stays over the soles
    mujoco.mj_comPos(stage.model, stage.data)
    middle = stage.data.subtree_com[1][:2] - [1, -1]
    ahead = middle @ [np.cos(2.0), np.sin(2.0)]
    assert -0.03 * stature < ahead < 0.08 * stature


REACHED = [(0.45, -0.15, 1.2), (0.5, 0.2, 0.75), (0.55, 0.1, 0.05), (0.3, -0.2, 1.95), (0.1, -0.9, 1.1),
           (0.0, 0.8, 1.5), (0.75, 0.3, 0.5), (-0.3, -0.4, 0.9), (0.2, -0.5, 0.3)]  # fmt: skip


@pytest.mark.parametrize("point", REACHED)
def test_a_hand_reaches(point):
    stage = Stage(1.75, 0.5 + 0.2j, 1.0)
    turn = np.exp(1j * 1.0)
    over_floor = 0.5 + 0.2j + complex(*point[:2]) * turn
    target = np.array([over_floor.real, over_floor.imag, point[2]])
    at_first = feet_of(stage, stage.standing[0])
    stage.tick()
    stage.postures.reach(0, target)
    poses, _ = stage.run("reach")
    assert_smooth(stage, poses)
    hand = 0 if point[1] >= 0 else 1
    np.testing.assert_allclose(stage.pose().geom(f"{('left', 'right')[hand]}_hand").xpos, target, atol=0.02)
    np.testing.assert_allclose(feet_of(stage, poses[-1]), at_first, atol=1e-9)
    assert lowest(stage, poses[-1], ["left_hand", "right_hand"]) > -0.06
    stage.postures.withdraw(0)
    back, _ = stage.run("reach")
    assert_smooth(stage, np.concatenate([poses, back]))


def test_what_is_out_of_reach_is_pointed_at():
    stage = Stage()
    stage.tick()
    stage.postures.reach(0, np.array([3.0, 0.0, 1.3]), "right")
    pose = stage.run("reach")[0][-1]
    data = stage.pose(pose)
    shoulder, hand = data.body("right_upper_arm").xpos, data.geom("right_hand").xpos
    towards = np.array([3.0, 0.0, 1.3]) - shoulder
    assert np.dot(hand - shoulder, towards) / np.linalg.norm(towards) > 0.98 * stage.measures.arm[0]


def test_reaching_while_sitting_and_on_to_another_point():
    stage = before(CHAIR)
    stage.tick()
    stage.postures.sit(0, CHAIR)
    down, _ = stage.run()
    facing = np.exp(1j * CHAIR.yaw)
    poses = [down]
    for ahead, up in ((0.45, 0.9), (0.7, 0.6)):
        place = complex(*CHAIR.place[:2]) + (ahead - 0.15j) * facing
        target = np.array([place.real, place.imag, up])
        stage.postures.reach(0, target, "right")
        poses.append(stage.run()[0])
        np.testing.assert_allclose(stage.pose().geom("right_hand").xpos, target, atol=0.02)
    assert_smooth(stage, np.concatenate(poses))


LOOKED_AT = [(2, 0, 1.6), (1, 1, 1.6), (1, -1.5, 0.3), (0.2, 2, 1.7), (1, 0.1, 2.4), (0.0, -1.5, 1.2)]


def gaze_error(stage, target, pose=None):
    data = stage.pose(pose)
    towards = target - data.site("head").xpos
    return np.arccos(np.clip(data.body("head").xmat.reshape(3, 3)[:, 0] @ towards / np.linalg.norm(towards), -1, 1))


@pytest.mark.parametrize("point", LOOKED_AT)
def test_looking_at_a_point(point):
    stage = Stage()
    stage.tick()
    stage.postures.look_at(0, np.array(point))
    poses, _ = stage.run("look")
    assert len(poses) * DT < 1.5
    assert_smooth(stage, poses)
    assert gaze_error(stage, np.array(point)) < 0.04
    stage.postures.look_at(0, np.array([1.0, 0.5, 1.0]))
    more, _ = stage.run("look")
    stage.postures.look_ahead(0)
    back, _ = stage.run("look")
    assert_smooth(stage, np.concatenate([poses, more, back]))
    assert gaze_error(stage, np.array([1.0, 0.5, 1.0]), more[-1]) < 0.04


def test_the_head_turns_no_farther_than_heads_do():
    stage = Stage()
    stage.tick()
    stage.postures.look_at(0, np.array([-2.0, -0.5, 1.6]))
    poses, _ = stage.run("look")
    assert np.abs(poses[:, JOINT_PLACE["neck_yaw"]]).max() <= np.deg2rad(80) + 1e-6
    assert poses[-1, JOINT_PLACE["neck_yaw"]] < -1.3
    stage.postures.turn_head(0, 0.5, 0.2)
    pose = stage.run("look")[0][-1]
    forward = stage.pose(pose).body("head").xmat.reshape(3, 3)[:, 0]
    assert np.arctan2(forward[1], forward[0]) == pytest.approx(0.5, abs=1e-6)
    assert -np.arcsin(forward[2]) == pytest.approx(0.2, abs=1e-6)


def test_a_point_is_kept_in_sight_while_walking():
    stage, target = Stage(), np.array([2.0, 1.2, 1.4])
    stage.tick()
    stage.postures.look_at(0, target)
    angles = []
    for tick in range(160):
        stage.place[:] = 1.2 * DT * tick
        stage.standing[:, 0] = 1.2 * DT * tick
        pose = stage.tick()[0]
        angles.append(pose[7:])
        beside = np.arctan2(1.2, 2.0 - stage.place[0].real)
        if tick > 40 and beside < 1.6:
            assert gaze_error(stage, target) < 0.06
    assert np.abs(np.diff(angles, axis=0)).max() < MOST_PER_TICK_RAD


def test_two_look_at_each_other():
    measures = BodyMeasures.of(looks_of(1.2, 1.9))
    place, heading = np.array([0j, 1.5 + 0.5j]), np.array([0.0, np.pi])
    postures, qpos = Postures(measures, place, heading), standing(measures, place, heading)
    postures.look_at_person(0, 1)
    postures.look_at_person(1, 0)
    for _ in range(80):
        postures.step(place, heading, DT)
    assert postures.done(0) and postures.done(1)
    laid = overlay_postures(qpos, postures.rows, measures)
    pitch = laid[:, JOINT_PLACE["neck_pitch"]]
    assert pitch[0] < -0.2 and pitch[1] > 0.2


def test_halfway_between_ticks_lies_between():
    stage = beside(BED, -1)
    stage.tick()
    stage.postures.lie(0, BED)
    early, rows = stage.tick()[0], stage.postures.rows
    for _ in range(180):
        late = stage.tick()[0]
        middle = overlay_postures(stage.standing, 0.5 * (rows + stage.postures.rows), stage.measures)[0]
        low, high = np.minimum(early, late), np.maximum(early, late)
        assert (middle > low - 0.02).all() and (middle < high + 0.02).all()
        early, rows = late, stage.postures.rows


def test_same_commands_same_bits():
    runs = []
    for _ in range(2):
        stage = before(CHAIR)
        stage.tick()
        stage.postures.sit(0, CHAIR)
        stage.postures.look_at(0, np.array([1.0, 1.0, 1.0]))
        runs.append(stage.run()[0])
    np.testing.assert_array_equal(runs[0], runs[1])


def test_what_makes_no_sense_is_refused():
    stage = before(CHAIR)
    stage.tick()
    with pytest.raises(ValueError, match="stand up"):
        stage.postures.rise(0)
    with pytest.raises(ValueError, match="stands near"):
        stage.postures.sit(0, seat((3.0, 3.0, 0.45), 0.0))
    with pytest.raises(ValueError, match="bend"):
        stage.postures.bend(0, 3.0)
    with pytest.raises(ValueError, match="reach"):
        stage.postures.reach(0, np.array([np.nan, 0, 0]))
    with pytest.raises(ValueError, match="somebody else"):
        stage.postures.look_at_person(0, 0)
    stage.postures.sit(0, CHAIR)
    with pytest.raises(ValueError, match="sit down"):
        stage.postures.sit(0, CHAIR)
    assert stage.postures.rows.shape == (POSTURE_ROWS, 1)
