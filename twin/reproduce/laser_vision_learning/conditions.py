"""What the hall's runs are told in: the three systems, a condition's figures, what its place was like, one run in full.

A condition is an entry of the suite. Its name says what it is for: `busy` is table I, `hall` is table II and figure 11,
`people-N` a density; `ablation` sets variants of the fused system beside it; every other is the hall with one thing changed.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from trackers.arrays import Array
from twin.evaluate import Evaluation
from twin.recording.situation_table import SituationTable
from twin.recording.tables import TruthTable
from twin.suites.expansion import Case

FUSED, LASER, VISION = "laser-vision-learning", "laser-vision-learning-laser", "laser-vision-learning-vision"
SYSTEMS: Mapping[str, str] = {FUSED: "fused", LASER: "laser only", VISION: "vision only"}
"""The paper's three systems, by preset, as they stand in tables."""
HALL, BUSY, ABLATION = "hall", "busy", "ablation"
DENSITY = re.compile(r"people-\d+")


@dataclass(frozen=True, eq=False)
class PlaceFigures:
    """What n runs of a condition were like, by the truth, each (n,) but for the durations of all merges together."""

    frames: Array  # of the scanners
    people: Array  # person-frames inside the area
    interacting: Array  # of them, those less than 1.5 m from somebody
    correlated: Array  # pairs of people in frames
    merges: Array
    minutes: Array
    merge_s: Array  # (m,) how long each merge lasted


@dataclass(frozen=True, eq=False)
class OneRun:
    """A run of the hall or the busy place in full: its case and evaluation by system, truth and situations."""

    cases: Mapping[str, Case]
    truth: TruthTable
    situations: SituationTable
    evaluations: Mapping[str, Evaluation]
    interacting: Array  # (f,) people who interact in each judged frame
    people: Array  # (f,) inside the area
    names: Mapping[int, str]


@dataclass(frozen=True, eq=False)
class Condition:
    """What n runs of a condition gave."""

    name: str
    trackers: tuple[str, ...]
    overrides: tuple[str, ...]
    seeds: tuple[int, ...]
    figures: Mapping[str, Mapping[str, Array]]  # tracker -> figure of metrics.json -> (n,), NaN where it does not apply
    place: PlaceFigures
    course: Mapping[str, tuple[Array, ...]] | None = (
        None  # tracker -> of each run failures and person-frames so far, (2, f)
    )

    def called(self, tracker: str) -> str:
        """A tracker as it stands in tables."""
        return SYSTEMS.get(tracker, tracker.replace("-", " "))

    def failures(self, tracker: str) -> Array:
        """Failures of all kinds in each run, (n,)."""
        kinds = self.figures[tracker]
        return kinds["failures.missed"] + kinds["failures.false_location"] + kinds["failures.identity_wrong"]

    def accuracy(self, tracker: str) -> Array:
        """Accuracy of each run, (n,) [%]."""
        return 100 * (1 - self.failures(tracker) / self.figures[tracker]["failures.person_frames"])

    def accuracy_so_far(self, tracker: str, seed: int, frames: int) -> float:
        """Accuracy of a run's first frames, so many [%]; of the whole run where its course is not known."""
        run = self.seeds.index(seed)
        if self.course is None:
            return float(self.accuracy(tracker)[run])
        failed, count = self.course[tracker][run][:, :frames][:, -1]
        return float(100 * (1 - failed / count))


@dataclass(frozen=True, eq=False)
class HallRuns:
    """All conditions by name, and the first run of the hall and of the busy place in full."""

    conditions: Mapping[str, Condition]
    hall: OneRun
    busy: OneRun
    not_done: tuple[str, ...]

    @property
    def densities(self) -> list[Condition]:
        """The conditions that differ in the number of people, fewest first."""
        found = [each for each in self.conditions.values() if DENSITY.fullmatch(each.name)]
        return sorted(found, key=lambda each: int(each.name.removeprefix("people-")))

    @property
    def changed(self) -> list[Condition]:
        """The hall with one thing changed."""
        others = (HALL, BUSY, ABLATION)
        return [each for each in self.conditions.values() if each.name not in others and each not in self.densities]

    @property
    def ablation(self) -> Condition | None:
        """Variants of the fused system beside it; None where the suite has none."""
        return self.conditions.get(ABLATION)


def interacting(truth: TruthTable, situations: SituationTable, stamps_ns: np.ndarray) -> tuple[Array, Array]:
    """People inside the area in each of these frames, and how many of them interact with somebody, (f,) each."""
    people, close = np.zeros(len(stamps_ns)), np.zeros(len(stamps_ns))
    pairs = situations.select("interaction")
    holds = pairs.frames(stamps_ns)
    for person in np.unique(truth.id).tolist():
        there = np.isin(stamps_ns, truth.stamps_ns[(truth.id == person) & truth.in_area])
        people += there
        close += there & holds[(pairs.first_id == person) | (pairs.second_id == person)].any(axis=0)
    return people, close
