"""What the lab's runs are told in: the six columns of table I, a condition's figures, one run in full.

A condition is an entry of the suite: so many people, in such clothes and such light. The entry `people-5` is the paper's
experiment; `people-N` with other numbers are its densities.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trackers.arrays import Array
from trackers.laser_fisheye_imm.options import LaserFisheyeImmOptions
from twin.evaluate import Evaluation
from twin.recording.tables import TrackTable, TruthTable
from twin.reproduce.moments import SeenMoment

COAST_S = LaserFisheyeImmOptions().track_management.coast_s
"""How long a track of these trackers goes on unmeasured [s]."""


@dataclass(frozen=True)
class Column:
    """A column of table I: a preset, its filter and its sensors in the paper's words."""

    tracker: str
    filter: str
    sensors: str

    @property
    def name(self) -> str:
        """As it stands in tables."""
        return f"{self.filter}, {self.sensors}"


IMM, KALMAN = "IMM", "Kalman"
SENSOR_SETS = ("both layers + camera", "waist layer + camera", "both layers")
_PRESETS = ("laser-fisheye", "waist-fisheye", "laser")
COLUMNS = tuple(
    Column(f"{preset}-{filter_.lower()}", filter_, sensors)
    for filter_ in (IMM, KALMAN)
    for preset, sensors in zip(_PRESETS, SENSOR_SETS, strict=True)
)
"""The six columns; the first is the full system."""
NAMES = {each.tracker: each.name for each in COLUMNS}
FULL = COLUMNS[0]
PAPERS = "people-5"
"""The condition of the paper's experiment."""
DENSITY = re.compile(r"people-\d+")
"""The names of the conditions that differ in the number of people alone."""


@dataclass(frozen=True)
class Hidden:
    """An occlusion of a run that lasts longer than tracks coast; lost: whether the full system's track ended in it."""

    seed: int
    person: str
    start_s: float
    end_s: float
    lost: bool


@dataclass(frozen=True, eq=False)
class Condition:
    """What n runs of a condition gave."""

    name: str
    overrides: tuple[str, ...]
    seeds: tuple[int, ...]  # (n,)
    n_person: int
    person_minutes: Array  # (n,) [min] inside the area
    figures: Mapping[str, Mapping[str, Array]]  # tracker -> figure of metrics.json -> (n,)
    hidden: tuple[Hidden, ...]
    moments: tuple[SeenMoment, ...]

    def errors(self, column: Column) -> Array:
        """Misidentified and lost together in each run, (n,)."""
        found = self.figures[column.tracker]
        return found["misidentifications"] + found["lost_tracks"]

    @property
    def with_hidden(self) -> NDArray[np.bool_]:
        """Which runs hold an occlusion longer than tracks coast, (n,)."""
        return np.isin(self.seeds, [each.seed for each in self.hidden])


@dataclass(frozen=True, eq=False)
class OneRun:
    """One run in full: truth, the full system's tracks, their evaluation, and the people's names and shirts by id."""

    seed: int
    truth: TruthTable
    tracks: TrackTable
    evaluation: Evaluation
    names: Mapping[int, str]
    shirts: Mapping[int, str | None]  # None: drawn at random


@dataclass(frozen=True, eq=False)
class LabRuns:
    """All conditions, the paper's first, then its densities, then the others; and its first run in full."""

    conditions: tuple[Condition, ...]
    first: OneRun
    area: Array  # (k, 2) corners of the tracked area [m]
    n_scan: int  # of the paper's condition, each scanner
    scan_rate_hz: float
    not_done: tuple[str, ...]  # ids of cases that failed, or were never run

    @property
    def area_m2(self) -> float:
        """The tracked area's size."""
        (x, y), (x2, y2) = self.area.T, np.roll(self.area, -1, axis=0).T
        return float(abs((x * y2 - x2 * y).sum()) / 2)

    @property
    def papers(self) -> Condition:
        """The paper's experiment."""
        return self.conditions[0]

    @property
    def densities(self) -> list[Condition]:
        """The conditions that differ in the number of people alone, fewest first."""
        found = [each for each in self.conditions if DENSITY.fullmatch(each.name)]
        return sorted(found, key=lambda each: each.n_person)

    @property
    def others(self) -> list[Condition]:
        """The conditions that are neither the paper's nor a density."""
        return [each for each in self.conditions if not DENSITY.fullmatch(each.name)]
