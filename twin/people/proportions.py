"""Lengths of a body's segments from its stature."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cache

import yaml

from twin.models import MODELS


@dataclass(frozen=True)
class Proportions:
    """Segment lengths; as fractions of stature from `fractions`, in metres from `proportions_of`.

    Heights are above the sole. Source: Drillis and Contini (1966), in Winter, "Biomechanics and Motor Control of
    Human Movement", figure 4.1; the table `models/people/proportions.yaml` says which entries are ours.
    """

    ankle_height: float
    knee_height: float
    hip_height: float
    shoulder_height: float
    chin_height: float
    eye_height: float
    upper_arm: float
    forearm: float
    hand: float
    foot_length: float
    foot_breadth: float
    shoulder_width: float
    hip_joint_width: float
    heel_behind_ankle: float
    ball_before_ankle: float
    waist_height: float

    @property
    def thigh(self) -> float:
        """Hip to knee."""
        return self.hip_height - self.knee_height

    @property
    def shank(self) -> float:
        """Knee to ankle."""
        return self.knee_height - self.ankle_height


@cache
def fractions() -> Proportions:
    """The shipped table, fractions of stature (`models/people/proportions.yaml`)."""
    return Proportions(**yaml.safe_load((MODELS / "people" / "proportions.yaml").read_text(encoding="utf-8")))


def proportions_of(height_m: float) -> Proportions:
    """Segment lengths [m] of a person of this stature [m]."""
    table = fractions()
    return Proportions(**{field.name: getattr(table, field.name) * height_m for field in fields(table)})
