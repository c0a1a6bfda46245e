"""Where everybody truly is at one moment: what only the twin knows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import nan


@dataclass(frozen=True, slots=True)
class PersonTruth:
    """Where one person truly is, in the room frame.

    x, y: ground point under the pelvis [m]; z: height of the pelvis [m]; yaw: heading of the trunk [rad]; head_*:
    centre of the head [m] and its yaw [rad]; vx, vy: velocity [m/s]; in_area: inside the tracked area; visible: by
    sensor, the share (0–1) of points on the body that a ray from the sensor reaches. NaN where unknown.
    """

    id: int
    x: float
    y: float
    z: float = nan
    yaw: float = nan
    head_x: float = nan
    head_y: float = nan
    head_z: float = nan
    head_yaw: float = nan
    vx: float = nan
    vy: float = nan
    in_area: bool = True
    visible: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class TruthFrame:
    """All people at one stamp; an empty tuple says that nobody is there."""

    stamp_ns: int
    people: tuple[PersonTruth, ...]
