"""People for the tests of postures: standing bodies without a gait, a seat, a bed, and the compiled bodies."""

from __future__ import annotations

import os

os.environ.setdefault("MUJOCO_GL", "egl")

import mujoco
import numpy as np

from twin.people.body.appearance import appearance_of
from twin.people.body.person_spec import JOINT_PLACE, LEG, NQ_PERSON, SIDES, person_spec
from twin.people.body.proportions import leg_angles
from twin.people.posture.body_measures import BodyMeasures
from twin.people.posture.overlay import overlay_postures
from twin.people.posture.postures import Postures
from twin.room.furniture import Bed, Seat
from twin.scenario.person import Person

DT = 0.025


def seat(place, yaw):
    return Seat("chair", np.array(place), yaw, "chair", frozenset(), 0.21)


def bed(place, yaw):
    return Bed("bed", np.array(place), yaw, "bed", frozenset(), np.array([0.45, 0.45]))


def looks_of(*statures, seed=3):
    return [appearance_of(Person(height_m=height), np.random.default_rng(seed)) for height in statures]


def standing(measures, place, heading):
    """Joint coordinates (n, NQ_PERSON) of people who stand at place (n,) complex, facing heading (n,)."""
    count = len(measures)
    qpos = np.zeros((count, NQ_PERSON))
    height = 0.992 * measures.leg + measures.ankle_height
    qpos[:, 0], qpos[:, 1], qpos[:, 2] = np.real(place), np.imag(place), height
    qpos[:, 3], qpos[:, 6] = np.cos(heading / 2), np.sin(heading / 2)
    for side, sign in zip(SIDES, (1, -1), strict=True):
        facing = np.exp(1j * heading)
        hip = 1j * sign * measures.hip_lateral * facing
        foot = (0.02 + 1j * sign * 0.09) * facing
        angles = leg_angles(
            hip - foot, height - measures.ankle_height, heading, heading + sign * 0.1, np.zeros(count),
            measures.thigh, measures.shank,
        )  # fmt: skip
        for joint, angle in zip(LEG, angles, strict=False):
            qpos[:, JOINT_PLACE[f"{side}_{joint}"]] = angle
        qpos[:, JOINT_PLACE[f"{side}_shoulder_roll"]] = 0.1 * sign
        qpos[:, JOINT_PLACE[f"{side}_shoulder_pitch"]] = 0.04
        qpos[:, JOINT_PLACE[f"{side}_elbow"]] = -0.2
    return qpos


class Stage:
    """One person who stands, told what to do."""

    def __init__(self, stature=1.75, place=0j, heading=0.0):
        self.looks = looks_of(stature)
        self.measures = BodyMeasures.of(self.looks)
        self.place, self.heading = np.array([place]), np.array([heading])
        self.standing = standing(self.measures, self.place, self.heading)
        self.postures = Postures(self.measures, self.place, self.heading)
        self.model = person_spec(self.looks[0]).compile()
        self.data = mujoco.MjData(self.model)

    def tick(self):
        self.postures.step(self.place, self.heading, DT)
        return self.qpos()

    def qpos(self):
        return overlay_postures(self.standing, self.postures.rows, self.measures)

    def run(self, part=None, most_s=12.0):
        """Tick until done; returns joint coordinates (k, NQ_PERSON) and rows (k, POSTURE_ROWS)."""
        poses, rows = [], []
        for _ in range(int(most_s / DT)):
            poses.append(self.tick()[0])
            rows.append(self.postures.rows[:, 0].copy())
            if self.postures.done(0, part):
                return np.array(poses), np.array(rows)
        raise AssertionError("never done")

    def pose(self, qpos=None):
        self.data.qpos[:] = self.qpos()[0] if qpos is None else qpos
        mujoco.mj_kinematics(self.model, self.data)
        return self.data
