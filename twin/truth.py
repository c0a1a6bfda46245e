"""Where everybody truly is at one moment: what only the twin knows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import nan
from typing import Literal


@dataclass(frozen=True, slots=True)
class FootTruth:
    """Where one foot truly is and what it carries, in the room frame.

    x, y: point of the sole under the ankle, as if the foot were flat [m]; z: lowest point of the sole above the floor
    [m]; yaw [rad]; load_n: weight that it carries to the floor [N]; pressure_x, pressure_y: where that acts [m], NaN for a
    foot in the air; cells: by floor sensor, the cells it loads at a stamp of that sensor, counted row by row from 0.
    """

    side: Literal["left", "right"]
    x: float
    y: float
    z: float
    yaw: float
    load_n: float
    pressure_x: float = nan
    pressure_y: float = nan
    cells: Mapping[str, tuple[int, ...]] = field(default_factory=dict)

    @property
    def contact(self) -> bool:
        """Whether it stands on the floor."""
        return self.load_n > 0


@dataclass(frozen=True, slots=True)
class PersonTruth:
    """Where one person truly is, in the room frame.

    x, y: ground point under the pelvis [m]; z: height of the pelvis [m]; yaw: heading of the trunk [rad]; head_*:
    centre of the head [m] and its yaw [rad]; vx, vy: velocity [m/s]; in_area: inside the tracked area; visible: by
    sensor, the share (0–1) of points on the body that a ray from the sensor reaches; feet: left, right. NaN where unknown.
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
    feet: tuple[FootTruth, ...] = ()


@dataclass(frozen=True, slots=True)
class TruthFrame:
    """All people at one stamp; an empty tuple says that nobody is there."""

    stamp_ns: int
    people: tuple[PersonTruth, ...]
