"""Inverse kinematics of the leg against the compiled body."""

from __future__ import annotations

import mujoco
import numpy as np
from hypothesis import given, settings, strategies as st

from twin.people.body.appearance import appearance_of
from twin.people.body.person_spec import JOINT_PLACE, LEG, person_spec
from twin.people.body.proportions import leg_angles
from twin.scenario.person import Person

LOOKS = appearance_of(Person(height_m=1.8), np.random.default_rng(0))
LENGTHS = LOOKS.proportions
MODEL = person_spec(LOOKS).compile()
DATA = mujoco.MjData(MODEL)


@settings(max_examples=60, deadline=None)
@given(
    pelvis_yaw=st.floats(-3, 3),
    turn=st.floats(-0.8, 0.8),
    pitch=st.floats(-0.4, 1.0),
    ahead=st.floats(-0.45, 0.45),
    aside=st.floats(-0.2, 0.2),
    up=st.floats(0.45, 0.7),
)
def test_the_foot_is_where_it_was_asked_to_be(pelvis_yaw, turn, pitch, ahead, aside, up):
    facing = np.exp(1j * pelvis_yaw)
    over_floor = np.array(-(ahead + 1j * aside) * facing)
    foot_yaw = np.array(pelvis_yaw + turn)
    angles = leg_angles(
        over_floor, np.array(up), np.array(pelvis_yaw), foot_yaw, np.array(pitch),
        np.array(LENGTHS.thigh), np.array(LENGTHS.shank),
    )  # fmt: skip
    assert angles[3] >= 0
    DATA.qpos[:] = 0
    DATA.qpos[:7] = [0.3, -0.2, 1.0, np.cos(pelvis_yaw / 2), 0, 0, np.sin(pelvis_yaw / 2)]
    for joint, angle in zip(LEG, angles, strict=False):
        DATA.qpos[JOINT_PLACE[f"left_{joint}"]] = angle
    mujoco.mj_kinematics(MODEL, DATA)
    ankle = DATA.body("left_thigh").xpos - [over_floor.real, over_floor.imag, up]
    np.testing.assert_allclose(DATA.body("left_foot").xpos, ankle, atol=1e-9)
    cy, sy, cp, sp = np.cos(foot_yaw), np.sin(foot_yaw), np.cos(pitch), np.sin(pitch)
    wanted = np.array([[cy * cp, -sy, cy * sp], [sy * cp, cy, sy * sp], [-sp, 0, cp]])
    np.testing.assert_allclose(DATA.body("left_foot").xmat.reshape(3, 3), wanted, atol=1e-9)
