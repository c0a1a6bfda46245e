"""Lengths of a body's segments from its stature."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cache
from typing import Any

import numpy as np

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


class Skeleton:
    """Segment lengths of n people, (n,) each [m]; `scale`: leg length relative to the reference person's."""

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
