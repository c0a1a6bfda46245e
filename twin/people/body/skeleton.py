"""The segment lengths of many people, as arrays."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from twin.people.body.proportions import Proportions, proportions_of

REFERENCE_STATURE_M = 1.75
"""Tables of gait are written for this stature."""


class Skeleton:
    """Segment lengths of n people, (n,) each [m]; `scale`: the leg as a share of the reference person's."""

    def __init__(self, proportions: Sequence[Proportions]) -> None:
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
        self.toes = self.shoe - self.heel - self.ball
        reference = proportions_of(REFERENCE_STATURE_M)
        self.scale = self.leg / (reference.thigh + reference.shank)
