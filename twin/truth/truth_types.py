"""Types of the truth: people and feet at one stamp, boxes in images, runs of beams, situations of two people."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import nan
from typing import Literal

from trackers.tracks import NanEqual

SituationKind = Literal["interaction", "correlated", "merged", "merged_rig"]
Separation = Literal["", "joined", "hidden", "both"]


@dataclass(frozen=True, slots=True, eq=False)
class FootTruth(NanEqual):
    """True pose and load of one foot, in the room frame.

    x, y: point of the sole under the ankle of the flat foot [m]; z: lowest point of the sole above the floor [m]; yaw [rad];
    load_n: weight on the floor [N]; pressure_x, pressure_y: centre of pressure [m], NaN for a foot in the air; cells: by
    floor sensor, the loaded cells at a stamp of that sensor, counted row by row from 0.
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
        """True while it stands on the floor."""
        return self.load_n > 0


@dataclass(frozen=True, slots=True, eq=False)
class PersonTruth(NanEqual):
    """True pose of one person, in the room frame.

    x, y: ground point under the pelvis [m]; z: height of the pelvis [m]; yaw: heading of the trunk [rad]; head_*: centre of
    the head [m] and its yaw [rad]; vx, vy: velocity [m/s]; in_area: in the tracked area; visible: by sensor, the share (0–1)
    of points on the body that a ray from the sensor reaches; feet: left, right. NaN where unknown.
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
    """All people at one stamp; an empty tuple: none is present."""

    stamp_ns: int
    people: tuple[PersonTruth, ...]


@dataclass(frozen=True, slots=True)
class Box:
    """Pixels of one person in one image, and their bounding box [px].

    The box covers the columns left, ..., left + width - 1 and rows top, ..., top + height - 1, counted from 0 at the top
    left. With pixel (0, 0) spanning the square from (0, 0) to (1, 1), as in COCO's files, these are its edges. Only visible
    pixels count, so visible_px <= width * height. truncated: some pixels lie at the border of the image, or of the lens's
    field, beyond which the person may extend.
    """

    id: int
    left: int
    top: int
    width: int
    height: int
    visible_px: int
    truncated: bool


@dataclass(frozen=True, slots=True)
class BoxFrame:
    """All people visible in one image of a camera, by id; an empty tuple: none."""

    stamp_ns: int
    camera: str
    boxes: tuple[Box, ...]


@dataclass(frozen=True, slots=True)
class RayRun:
    """Consecutive beams of a scanner that meet the same person: first_beam, ..., last_beam, from 0."""

    id: int
    first_beam: int
    last_beam: int


@dataclass(frozen=True, slots=True)
class RayFrame:
    """All runs of one scan that meet people, in the order of the beams; an empty tuple: none."""

    stamp_ns: int
    sensor: str
    runs: tuple[RayRun, ...]


@dataclass(frozen=True, slots=True)
class BaseTruth:
    """True pose of a housing that drives, in the room frame: x, y, z [m] and yaw [rad]."""

    base: str
    x: float
    y: float
    z: float
    yaw: float


@dataclass(frozen=True, slots=True)
class BasesFrame:
    """Poses of all housings that drive, at one stamp."""

    stamp_ns: int
    bases: tuple[BaseTruth, ...]


@dataclass(frozen=True, slots=True)
class Situation:
    """One situation of two people (first_id < second_id), from the first frame in which it holds to the first after.

    kind, how and least_m: see `twin.truth.situations`. sensor: the scanner that cannot separate them, '' if independent of
    one. complete: False if the run ended first, at end_ns.
    """

    kind: SituationKind
    first_id: int
    second_id: int
    sensor: str
    start_ns: int
    end_ns: int
    complete: bool = True
    how: Separation = ""
    least_m: float = nan


TruthDetail = BoxFrame | RayFrame | BasesFrame | Situation
"""Truth of an image, a scan, the bases at a stamp, or a time span."""
