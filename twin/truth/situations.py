"""Situations of two people that make tracking hard, from the frame in which one begins to the first after it.

- interaction: the ground points under their pelvises are less than 1.5 m apart. least_m: the least distance [m].
- correlated: the gap between their outlines, seen from above, is below 0.3 m (`twin.truth.body_outlines` says what an outline
  is). least_m: the smallest gap [m], 0 where outlines overlap.
- merged: a scanner cannot separate them, judged by its ideal scan; one event a scanner, whose end is the split. how:
  `joined` where beams on both belong to one cluster; `hidden` where one of them returns no beam at all since the other
  stands before, less than 1.5 m away (somebody who is hidden from farther away is only occluded, which
  visible_<sensor> in truth.csv tells); `both` where an event holds frames of either sort. least_m: as of an interaction.
- merged_rig: all scanners of the rig together cannot (`twin.truth.rig_merging`), whatever a tracker makes of it. Breaks
  of up to 0.4 s belong to the event; events shorter than 0.2 s are none. how and least_m: as of merged.

A cluster of one scanner, as a clusterer without any other knowledge forms it: beams on people that follow one another, at
most one beam that looks past between them, and whose points lie no farther apart than 0.15 m plus two spacings of the beams
at the nearer one's range. Clusters do not go on from the last beam of a full turn to the first.

Frames of interaction and correlation are the stamps of all sensors, frames of merging those of the scanner, or of all
scanners. Everything holds for people in the room, whether or not in the tracked area.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations
from math import nan

import numpy as np
from numpy.typing import NDArray

from trackers.observations import NS_PER_S
from twin.truth.frames import Separation, Situation, SituationKind
from twin.truth.pairs import Pair

INTERACTION_M = 1.5
CORRELATED_M = 0.3
JUMP_M = 0.15
JUMP_SPACINGS = 2.0
MAX_GAP_BEAMS = 1
RIG_BREAK_S = 0.4
RIG_SHORTEST_S = 0.2
_BREAK_NS: Mapping[SituationKind, int] = {"merged_rig": round(RIG_BREAK_S * NS_PER_S)}
_SHORTEST_NS: Mapping[SituationKind, int] = {"merged_rig": round(RIG_SHORTEST_S * NS_PER_S)}


@dataclass(frozen=True, slots=True)
class Held:
    """That a situation of a pair holds in a frame: how, and the distance it goes by [m]."""

    how: Separation = ""
    least_m: float = nan


@dataclass(slots=True)
class _Open:
    start_ns: int
    how: Separation
    least_m: float
    break_ns: int | None = None  # since when it does not hold, as long as it may go on


class OpenSituations:
    """Situations that hold, frame by frame: what holds without a break, or one that its kind allows, is one."""

    def __init__(self) -> None:
        self._open: dict[tuple[SituationKind, str], dict[Pair, _Open]] = {}

    @property
    def first_break_ns(self) -> int | None:
        """Since when the first of those does not hold that may go on; None where there is none."""
        breaks = [one.break_ns for open_ in self._open.values() for one in open_.values() if one.break_ns is not None]
        return min(breaks, default=None)

    def update(self, kind: SituationKind, sensor: str, stamp_ns: int, holding: Mapping[Pair, Held]) -> list[Situation]:
        """Those that end with this frame, by pair; `holding`: the pairs (first id < second id) for whom it holds."""
        open_ = self._open.setdefault((kind, sensor), {})
        ended = []
        for pair in sorted(open_.keys() - holding.keys()):
            one = open_[pair]
            one.break_ns = stamp_ns if one.break_ns is None else one.break_ns
            if stamp_ns - one.break_ns >= _BREAK_NS.get(kind, 0):
                ended += _situation(kind, sensor, pair, open_.pop(pair), stamp_ns)
        for pair in sorted(holding):
            held = holding[pair]
            one = open_.get(pair)
            if one is None:
                open_[pair] = _Open(stamp_ns, held.how, held.least_m)
            else:
                one.break_ns = None
                one.how = one.how if one.how == held.how else "both"
                one.least_m = min(one.least_m, held.least_m)
        return ended

    def finish(self, end_ns: int) -> list[Situation]:
        """Those that hold when the run ends, by kind, sensor and pair."""
        rest = [
            situation
            for (kind, sensor), open_ in sorted(self._open.items())
            for pair in sorted(open_)
            for situation in _situation(kind, sensor, pair, open_[pair], end_ns)
        ]
        self._open.clear()
        return rest


def _situation(kind: SituationKind, sensor: str, pair: Pair, one: _Open, end_ns: int) -> list[Situation]:
    """A situation, where it is long enough: complete where it no longer holds, else up to the end of the run."""
    complete = one.break_ns is not None
    end_ns = one.break_ns if one.break_ns is not None else end_ns
    if end_ns - one.start_ns < _SHORTEST_NS.get(kind, 0):
        return []
    return [Situation(kind, *pair, sensor, one.start_ns, end_ns, complete, one.how, one.least_m)]


def joined_pairs(
    range_m: NDArray[np.floating], person_of_ray: NDArray[np.int16], angle_increment_rad: float
) -> set[Pair]:
    """Pairs of people with beams in one cluster of an ideal scan: ranges [m] and ids, both (n_beam,)."""
    beams = np.flatnonzero((person_of_ray > 0) & np.isfinite(range_m))
    person = person_of_ray[beams]
    following = np.stack([beams[:-1], beams[1:]])
    changes = person[1:] != person[:-1]
    # in most scans no cluster goes on from one person to the next
    if _splits(range_m, following[:, changes], angle_increment_rad).all():
        return set()
    cluster = np.concatenate([[0], np.cumsum(_splits(range_m, following, angle_increment_rad))])
    pairs: set[Pair] = set()
    for number in np.unique(cluster[1:][changes]):
        pairs.update(combinations(np.unique(person[cluster == number]).tolist(), 2))
    return pairs


def _splits(range_m: NDArray[np.floating], beams: NDArray[np.intp], angle_increment_rad: float) -> NDArray[np.bool_]:
    """Whether a cluster ends between two beams on people that follow one another, (n,) of the pairs `beams` (2, n)."""
    near, angle = range_m[beams].astype(np.float64), angle_increment_rad * beams
    across, along = near * np.sin(angle), near * np.cos(angle)
    step = np.hypot(along[1] - along[0], across[1] - across[0])
    spacing = abs(angle_increment_rad) * np.minimum(near[1], near[0])
    return (step > JUMP_M + JUMP_SPACINGS * spacing) | (beams[1] - beams[0] > MAX_GAP_BEAMS + 1)
