"""Identities at splits by classifiers alone, given true positions; and the choice of options by them.

The classifiers learn from and judge a recording's images as in a tracker, with true positions in place of tracks. A person
is learned while no other is near enough to be confused. Whenever two people part, their classifiers of the time when they
met decide both identities.

Patches and features are chosen on a development seed in the busy place; M and K of the paper's system on groups (its rules
have the figures). Mixed clothes do not separate the choices, so people wear near-identical ones. The share of correct
decisions differs little; the margin over its deviation differs more.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trackers.configuration import validate
from trackers.laser_vision_learning.colours import learner_of
from trackers.laser_vision_learning.identities import IdentityOptions, decided
from trackers.laser_vision_learning.looks import Learner, Looks, LooksOptions, PeopleInPicture
from trackers.observations import Image
from trackers.rig import FisheyeSensor, PinholeSensor, placed_camera
from twin.messages import OnProgress
from twin.recording.reader import Recording
from twin.recording.situation_table import situation_table
from twin.recording.tables import truth_table
from twin.reproduce.results import Bootstrap, ResultRow, interval
from twin.scenario import load_scenario
from twin.streams import stream
from twin.suites.cache import RecordingCache
from twin.suites.worker import RECORDING, scenario_recording
from twin.truth.truth_types import SituationKind

NEAR_M = 1.5
_BLUE = ("#2456c4", "#2858c2", "#2253c8", "#265abf", "#2054c0")
_NAVY = ("#232c48", "#252e4a", "#212a46")


def near_identical_clothes(people: Iterable[str]) -> list[str]:
    """Make overrides that dress these people in shirts and trousers that differ by a few levels of 255."""
    return [
        f"people.{name}.{garment}='{colours[place % len(colours)]}'"
        for place, name in enumerate(people)
        for garment, colours in (("shirt", _BLUE), ("trousers", _NAVY))
    ]


@dataclass(frozen=True)
class SplitDecision:
    """Decision of classifiers on two people who parted: `margin` below 0 for an exchange, 0 if both are unknown."""

    first_id: int
    second_id: int
    margin: float


@dataclass(frozen=True, eq=False)
class SplitTruth:
    """Truth of a recording at each of k stamps."""

    ids: NDArray[np.int64]  # (k, n, 2) NaN where absent
    stamps_ns: NDArray[np.int64]  # (k,)
    positions_m: NDArray[np.float64]  # (k, n, 2) NaN for who is not there
    apart: NDArray[np.bool_]  # (k, n) whether a tracker can separate the person from all others
    parted: Sequence[tuple[int, int, int, int]]  # the two as columns, and the positions of meeting and parting


@dataclass
class _OpenSplit:
    """Two people who have parted, and their classifiers' scores per image."""

    columns: NDArray[np.intp]
    looks: Looks
    scores: list[NDArray[np.float64]] = field(default_factory=list)


class SplitTrial:
    """One choice of options, fed with the images of a recording."""

    def __init__(self, learner: Learner, truth: SplitTruth) -> None:
        self.decisions: list[SplitDecision] = []
        self._learner, self._truth, self._pictures = learner, truth, IdentityOptions().pictures
        self._looks = Looks.unknown(len(truth.ids), learner.options)
        self._met: dict[tuple[int, int, int, int], Looks] = {}
        self._open: list[_OpenSplit] = []
        self._rng, self._last = stream(0, "reproduce", "splits"), -1

    def add_picture(self, picture: Image) -> None:
        """Take the next picture."""
        truth, last = self._truth, self._last
        self._last = place = int(np.searchsorted(truth.stamps_ns, picture.stamp_ns, side="right")) - 1
        position = truth.positions_m[place]
        here = np.isfinite(position[:, 0])
        # absent people are far from all others
        position = np.where(here[:, None], position, 1e6)
        for pair in truth.parted:
            if last < pair[2] <= place:
                self._met[pair] = self._looks
            if last < pair[3] <= place:
                columns = np.array(pair[:2])
                self._open.append(_OpenSplit(columns, self._met.pop(pair, self._looks)))
        people = PeopleInPicture(picture.rgb, position)
        for each in self._open:
            each.scores.append(self._learner.scores(each.looks, people, each.columns, each.columns, self._rng))
        self._close([each for each in self._open if len(each.scores) >= self._pictures])
        distance = np.linalg.norm(position[:, None] - position, axis=2)
        near = (distance < NEAR_M) & ~np.eye(len(here), dtype=bool) & here
        apart = truth.apart[place] & here
        self._looks = self._learner.trained(self._looks, people, near, apart, picture.stamp_ns, self._rng)

    def _close(self, due: list[_OpenSplit]) -> None:
        for each in due:
            self._open.remove(each)
            seen = [scores for scores in each.scores if np.isfinite(scores).any()]
            mean = np.nansum(seen, axis=0) / len(seen) if seen else np.full((2, 2), np.nan)
            by_looks = decided(np.nan_to_num(mean), np.arange(2), margin=0.0)
            margin = float(by_looks.margin[0]) * (1 if by_looks.column[0] == 0 else -1)
            first, second = self._truth.ids[each.columns].tolist()
            self.decisions.append(SplitDecision(first, second, margin))


def decide(
    recording: Path, variants: Mapping[str, LooksOptions], kind: SituationKind
) -> dict[str, list[SplitDecision]]:
    """Let the classifiers of every variant decide when two people joined by this kind of situation part again.

    All variants share one pass over the recording, to read its images once.
    """
    bag = Recording(recording)
    name, camera = next((n, s) for n, s in bag.rig.sensors.items() if isinstance(s, PinholeSensor | FisheyeSensor))
    placed, truth = placed_camera(camera), split_truth(bag, kind)
    trials = {variant: SplitTrial(learner_of(placed, options), truth) for variant, options in variants.items()}
    for picture in bag.observations():
        if isinstance(picture, Image) and picture.sensor == name:
            for trial in trials.values():
                trial.add_picture(picture)
    return {variant: trial.decisions for variant, trial in trials.items()}


def split_truth(bag: Recording, kind: SituationKind) -> SplitTruth:
    """Read the truth of a recording; a person is apart if in no correlated pair and no situation of this kind."""
    truth, situations = truth_table(bag.truth()), situation_table(bag.situations())
    stamps_ns, ids = truth.frame_stamps_ns, np.unique(truth.id)
    positions = np.full((len(stamps_ns), len(ids), 2), np.nan)
    at = np.searchsorted(stamps_ns, truth.stamps_ns), np.searchsorted(ids, truth.id)
    positions[at] = np.stack([truth.x, truth.y], axis=1)
    apart, parted = np.ones(positions.shape[:2], bool), []
    kinds: set[SituationKind] = {"correlated", kind}
    for each in sorted(kinds):
        chosen = situations.select(each)
        first, second = np.searchsorted(ids, chosen.first_id), np.searchsorted(ids, chosen.second_id)
        for row, column in zip(*chosen.frames(stamps_ns).nonzero(), strict=True):
            apart[column, [first[row], second[row]]] = False
        if each == kind:
            starts, ends = np.searchsorted(stamps_ns, chosen.start_ns), np.searchsorted(stamps_ns, chosen.end_ns)
            rows = np.flatnonzero(chosen.complete & (ends < len(stamps_ns)))
            parted = [(int(first[i]), int(second[i]), int(starts[i]), int(ends[i])) for i in rows]
    return SplitTruth(ids, stamps_ns, positions, apart, parted)


_CHANGES: Mapping[str, Mapping[str, Any]] = {
    "colours": {"by": "colours"},
    "patches, as chosen": {},
    "M 20, K 15": {"boosting": {"trees": 20, "kept": 15}},
    "M 30, K 21": {"boosting": {"kept": 21}},
    "M 30, K 29": {"boosting": {"kept": 29}},
    "M 50, K 35": {"boosting": {"trees": 50, "kept": 35}},
    "M 50, K 45": {"boosting": {"trees": 50, "kept": 45}},
    "M 100, K 99, as in the paper's system": {"boosting": {"trees": 100, "kept": 99}},
    "K 0: fresh every picture": {"boosting": {"kept": 0}},
    "K = M: never trained again": {"boosting": {"kept": 30}},
    "patches of 0.12 m": {"patch_m": 0.12},
    "patches of 0.3 m": {"patch_m": 0.3},
    "20 patches": {"patch_count": 20},
    "80 patches": {"patch_count": 80},
    "RGB only": {"kinds": ["rgb"]},
    "edge orientations only": {"kinds": ["edges"]},
    "Haralick texture": {"kinds": ["texture"]},
    "without the height on the body": {"height": False},
    "without patches of the room": {"background": 0},
}

VARIANTS: Mapping[str, LooksOptions] = {
    name: validate(LooksOptions, {"by": "classifier", **change}, name) for name, change in _CHANGES.items()
}
"""Options by their differences from the boosted patches as chosen."""


CHOICE = "beyond the paper, choice"
RIGHT, MARGIN = "identities right, classifiers alone", "margin over its deviation"
SEED, DURATION_S = 1003, 16
_SCENARIO = "library-hall-busy"


def compare_choices(cache: RecordingCache, on_progress: OnProgress) -> list[ResultRow]:
    """Record the busy place in near-identical clothes, and compare every choice's decisions when correlated people part."""
    on_progress("choices of the classifiers", 0, 1)
    changes = [f"seed={SEED}", f"duration_s={DURATION_S}", "background=none"]
    people = load_scenario(_SCENARIO, changes).people
    scenario = load_scenario(_SCENARIO, changes + near_identical_clothes(people))
    with scenario_recording(scenario, cache) as entry:
        decided = decide(entry / RECORDING, VARIANTS, "correlated")
    found = []
    for name, decisions in decided.items():
        margin = np.array([each.margin for each in decisions])
        boot = Bootstrap(len(margin), stream(SEED, "reproduce", "choices bootstrap"))
        mean = boot.mean(margin)
        deviation = np.sqrt(np.maximum(boot.mean(margin**2) - mean**2, 1e-12))
        right = interval(100 * boot.mean(np.where(margin > 0, 1.0, 0.0)))
        margin_interval = interval(mean / deviation)
        for column, each, unit in ((RIGHT, right, "%"), (MARGIN, margin_interval, "1")):
            found.append(ResultRow.of(CHOICE, name, column, each, unit, len(margin)))
    on_progress("choices of the classifiers", 1, 1)
    return found
