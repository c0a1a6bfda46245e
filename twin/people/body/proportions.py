"""Lengths of a body's segments from its stature, batched rotations, and inverse kinematics of hips and legs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cache
from typing import Any

import numpy as np

from trackers.arrays import Array, Planar
from twin.models import load_yaml

CHILD_BELOW_M = 1.40
"""Stature below which a person is a child, unless the scenario says otherwise."""


@dataclass(frozen=True)
class Proportions:
    """Segment lengths: fractions of stature from `fractions`, metres from `proportions_of`.

    Heights are above the sole. Source: Drillis and Contini (1966), in Winter, "Biomechanics and Motor Control of Human
    Movement", figure 4.1. The table `models/people/proportions.yaml` gives the source of each other entry and of the
    children's.
    """

    ankle_height: float
    knee_height: float
    hip_height: float
    shoulder_height: float
    chin_height: float
    upper_arm: float
    forearm: float
    hand: float
    shoe_length: float
    foot_breadth: float
    shoulder_width: float
    hip_joint_width: float
    heel_behind_ankle: float
    ball_before_ankle: float
    waist_height: float
    head_length: float
    head_breadth: float

    @property
    def thigh(self) -> float:
        """Hip to knee."""
        return self.hip_height - self.knee_height

    @property
    def shank(self) -> float:
        """Knee to ankle."""
        return self.knee_height - self.ankle_height


@cache
def _tables() -> dict[str, Any]:
    return load_yaml("people/proportions.yaml")


def fractions(height_m: float | None = None, child: bool = False) -> Proportions:
    """Return the table of fractions of stature: an adult's, or a child's of this stature [m]."""
    table = dict(_tables()["adult"])
    if child:
        if height_m is None:
            raise ValueError("a child's proportions depend on its stature; height_m is expected")
        columns = dict(_tables()["child"])
        stature = columns.pop("stature_m")
        table |= {name: float(np.interp(height_m, stature, column)) for name, column in columns.items()}
    return Proportions(**table)


def proportions_of(height_m: float, child: bool = False) -> Proportions:
    """Return segment lengths [m] of a person of this stature [m]."""
    table = fractions(height_m, child)
    return Proportions(**{field.name: getattr(table, field.name) * height_m for field in fields(table)})


REFERENCE_STATURE_M = 1.75
"""Stature for which the tables of gait are written."""


_STRAIGHTEST = 0.9945
"""Longest distance from hip to ankle as a share of the leg: the knee keeps 12 degrees."""


class Skeleton:
    """Segment lengths of n people, (n,) each [m]; `scale`: leg length relative to the reference person's.

    `longest`: greatest distance from hip to ankle. `carries` (2, n): left and right arm, 1 where the hand carries a bag, else 0.
    """

    def __init__(self, proportions: Sequence[Proportions], carries: Sequence[tuple[bool, bool]] = ()) -> None:
        def column(name: str) -> np.ndarray:
            return np.array([getattr(person, name) for person in proportions], dtype=float)

        self.ankle_height = column("ankle_height")
        self.thigh = column("thigh")
        self.shank = column("shank")
        self.heel = column("heel_behind_ankle")
        self.ball = column("ball_before_ankle")
        self.shoe = column("shoe_length")
        self.hip_offset = 0.5 * column("hip_joint_width") * np.array([[1.0], [-1.0]])  # (2, n) left of the pelvis
        self.leg = self.thigh + self.shank
        self.longest = _STRAIGHTEST * self.leg
        self.toes = self.shoe - self.heel - self.ball
        self.ball_from_ankle = np.hypot(self.ball, self.ankle_height)
        self.ball_below_ankle_rad = np.arctan2(self.ankle_height, -self.ball)  # of a flat foot, seen from the ball
        reference = proportions_of(REFERENCE_STATURE_M)
        self.scale = self.leg / (reference.thigh + reference.shank)
        self.carries = np.zeros((2, len(self.leg)))
        if carries:
            self.carries[:] = np.transpose(carries)


def _about(angle: Array, first: int, second: int) -> Array:
    out = np.zeros((*angle.shape, 3, 3))
    cosine, sine = np.cos(angle), np.sin(angle)
    fixed = 3 - first - second
    out[..., fixed, fixed] = 1.0
    out[..., first, first] = out[..., second, second] = cosine
    out[..., second, first], out[..., first, second] = sine, -sine
    return out


def about_x(angle: Array) -> Array:
    """Return rotation matrices (..., 3, 3) about x by angles (...) [rad]."""
    return _about(np.asarray(angle, dtype=float), 1, 2)


def about_y(angle: Array) -> Array:
    """Return rotation matrices (..., 3, 3) about y by angles (...) [rad]."""
    return _about(np.asarray(angle, dtype=float), 2, 0)


def about_z(angle: Array) -> Array:
    """Return rotation matrices (..., 3, 3) about z by angles (...) [rad]."""
    return _about(np.asarray(angle, dtype=float), 0, 1)


def turned(rotation: Array, vector: Array) -> Array:
    """Return vectors (..., 3) turned by rotations (..., 3, 3)."""
    return (rotation @ vector[..., None])[..., 0]


def matrix_of(quaternion: Array) -> Array:
    """Return rotation matrices (m, 3, 3) of unit quaternions (m, 4), w first."""
    w, x, y, z = quaternion.T
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    ).transpose(2, 0, 1)


def quaternion_about(axis: int, angle: Array) -> Array:
    """Return quaternions (m, 4), w first, of rotations about x (0), y (1) or z (2) by angles (m,) [rad]."""
    out = np.zeros((len(angle), 4))
    out[:, 0], out[:, 1 + axis] = np.cos(0.5 * angle), np.sin(0.5 * angle)
    return out


def quaternion_product(first: Array, second: Array) -> Array:
    """Return Hamilton products (m, 4): the second rotation, then the first."""
    a, b, c, d = first.T
    e, f, g, h = second.T
    return np.stack(
        [
            a * e - b * f - c * g - d * h,
            a * f + b * e + c * h - d * g,
            a * g - b * h + c * e + d * f,
            a * h + b * g - c * f + d * e,
        ],
        axis=-1,
    )


def hip_angles(rotation: Array) -> tuple[Array, Array, Array]:
    """Return yaw, roll, pitch [rad] of Rz Rx Ry (..., 3, 3), the thigh relative to the pelvis."""
    roll = np.arcsin(np.minimum(np.maximum(rotation[..., 2, 1], -1.0), 1.0))
    pitch = np.arctan2(-rotation[..., 2, 0], rotation[..., 2, 2])
    return np.arctan2(-rotation[..., 0, 1], rotation[..., 1, 1]), roll, pitch


def direction(yaw: Array, pitch: Array) -> Array:
    """Return unit vectors (..., 3) along x turned by Rz(yaw) Ry(pitch): a positive pitch points down."""
    return np.stack([np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), -np.sin(pitch)], axis=-1)


def leg_angles(
    over_floor: Planar, up: Array, pelvis_yaw: Array, foot_yaw: Array, foot_pitch: Array, thigh: Array, shank: Array
) -> tuple[Array, Array, Array, Array, Array, Array]:
    """Solve hip yaw, roll, pitch, knee, ankle pitch, roll [rad] for given feet.

    over_floor, up: from ankle to hip joint, x + iy and z in the room frame [m]; the pelvis is turned by Rz(pelvis_yaw), the
    foot by Rz(foot_yaw) Ry(foot_pitch), so pitch > 0 lifts the heel; thigh, shank [m]. All broadcast. The knee bends
    backwards only. A hip beyond the straight leg is met in direction only. Source: S. Kajita et al., "Introduction to
    Humanoid Robotics", section 2.5 (analytical solution).
    """
    # hip in the foot's frame: turned by -yaw, then -pitch
    seen = over_floor * np.exp(-1j * foot_yaw)
    cosine, sine = np.cos(foot_pitch), np.sin(foot_pitch)
    x, y, z = cosine * seen.real - sine * up, seen.imag, sine * seen.real + cosine * up
    square = x * x + y * y + z * z
    bend = (square - thigh**2 - shank**2) / (2 * thigh * shank)
    knee = np.arccos(np.minimum(np.maximum(bend, -1.0), 1.0))
    ankle_roll = np.arctan2(y, z)
    # hip in the shank's frame, with the knee bent
    toward_hip = np.arctan2(-thigh * np.sin(knee), shank + thigh * np.cos(knee))
    ankle_pitch = toward_hip - np.arctan2(x, np.hypot(y, z))
    # remaining hip rotation: Rz(turn) Ry(foot pitch) Rx(-ankle roll) Ry(-(ankle pitch + knee)) = Rz Rx Ry
    turn = foot_yaw - pelvis_yaw
    c1, s1 = np.cos(turn), np.sin(turn)
    c4, s4 = np.cos(ankle_roll), np.sin(ankle_roll)
    below = ankle_pitch + knee
    c5, s5 = np.cos(below), np.sin(below)
    # Ry(foot pitch) Rx(-ankle roll): its second column, and the last entry of its third
    mid_x, mid_y, mid_z = -sine * s4, c4, -cosine * s4
    last_z = cosine * c4
    hip_yaw = np.arctan2(-(c1 * mid_x - s1 * mid_y), s1 * mid_x + c1 * mid_y)
    hip_roll = np.arcsin(np.minimum(np.maximum(mid_z, -1.0), 1.0))
    # bottom row of the product with Ry(-below): first and third entry
    first = -sine * c5 + last_z * s5
    third = sine * s5 + last_z * c5
    hip_pitch = np.arctan2(-first, third)
    return hip_yaw, hip_roll, hip_pitch, knee, ankle_pitch, ankle_roll
