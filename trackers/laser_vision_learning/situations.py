"""Situations between tracks, from laser points and tracks alone (Song et al., section III and VI).

apart; interacting: nearer than 1.5 m, so that they may soon be confused; correlated: bodies less than 0.3 m apart; merged:
inseparable for the scanners, by single linkage of their points, or because one has no points next to another. Thresholds
have hysteresis against flicker. A pair splits when its merge has ended. Pairs that share a person form one group, which may
have more than two members, and a part of which may go on as a group.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from trackers.arrays import Array, Bool, Float, Index, Int, Mask
from trackers.configuration import Strict
from trackers.filters.gating import distances, linked
from trackers.laser.group import Points
from trackers.tracking.track_manager import nanoseconds

Situation = Literal["apart", "interacting", "correlated", "merged", "split"]


class SituationOptions(Strict):
    """Options: limits for interaction, correlation and merging."""

    interacting_m: float = Field(
        default=1.5, gt=0, description="distance of two below which they may come to be confused"
    )
    correlated_m: float = Field(default=0.3, gt=0, description="gap between two bodies below which they are correlated")
    merged: Literal["each", "one"] = Field(
        default="each",
        description="merged people keep a set of particles each (ours), or are one target until they split (paper, V.B)",
    )
    body_m: ClassVar[float] = 0.4
    """Width of a body, averaged over directions [m] (ours)."""
    link_m: ClassVar[float] = 0.4
    """Single linkage distance of points that merges their people [m] (ours)."""
    lateral_m: ClassVar[float] = 1.0
    """Distance to a measured track within which a track without points is merged with it [m] (ours)."""
    confused_m: ClassVar[float] = 0.4
    """Distance below which two merged people may have been exchanged [m] (ours)."""
    hidden_s: ClassVar[float] = 0.08
    """Time without points of such a track [s] (ours)."""
    hysteresis: ClassVar[float] = 1.15
    """Ratio of the distances at which interaction and correlation end and start (ours)."""
    parts_m_s: ClassVar[float] = 1.0
    """Speed at which a member of a merged target may have walked from the others unseen [m/s] (ours)."""
    lasting_s: ClassVar[float] = 0.2
    """Time of separation after which a merge is over [s] (ours)."""


@dataclass(frozen=True, eq=False)
class Situations:
    """Relations between n tracks with serial numbers; all symmetric, none of a track with itself."""

    serial: Int[Index, "n"]  # ascending
    interacting: Bool[Mask, "n n"]
    correlated: Bool[Mask, "n n"]
    merged: Bool[Mask, "n n"]
    merged_ns: Int[Index, "n n"]  # stamp of each pair's last merge
    confused: Bool[
        Mask, "n n"
    ]  # pairs that came so close, or were hidden, while merged that motion may have exchanged them

    @classmethod
    def none(cls, serial: Int[Index, "n"]) -> Situations:
        """Make situations with all tracks apart."""
        none = np.zeros((serial.size,) * 2, np.bool_)
        return cls(serial, none, none, none, np.zeros(none.shape, np.int64), none)

    def of(self, serial: Int[Index, "k"]) -> Situations:
        """Return the situations between the tracks with these serial numbers, some possibly new."""
        if np.array_equal(serial, self.serial):
            return self
        _, here, there = np.intersect1d(serial, self.serial, assume_unique=True, return_indices=True)

        def carried(between: NDArray[Any]) -> NDArray[Any]:
            whole = np.zeros((serial.size,) * 2, between.dtype)
            whole[np.ix_(here, here)] = between[np.ix_(there, there)]
            return whole

        rest = (self.interacting, self.correlated, self.merged, self.merged_ns, self.confused)
        return Situations(serial, *map(carried, rest))

    def without(self, serial: Int[Index, "k"]) -> Situations:
        """Return the situations with the tracks with these serial numbers merged with nobody."""
        alone = np.isin(self.serial, serial)
        apart = alone | alone[:, None]
        return replace(self, merged=self.merged & ~apart)


def assessed(
    before: Situations,
    serial: Int[Index, "n"],
    places: Float[Array, "n 2"],
    sure: Bool[Mask, "n"],
    missed_s: Float[Array, "n"],
    points: Points,
    owner: Int[Index, "k"],
    ns: int,
    options: SituationOptions,
    together: Bool[Mask, "n n"] | None = None,
) -> Situations:
    """Return the situations in a frame [ns], after those `before`.

    places: positions of all tracks [m]; sure: confirmed tracks, others are ignored; missed_s: time without points; owner:
    track of each point, −1: none. together: where merged people are one target, the pairs of one that are in one cluster.
    """
    before, apart_m = before.of(serial), distances(places, places)
    apart_m[~(sure & sure[:, None]) | np.eye(sure.size, dtype=bool)] = np.inf
    interacting = (apart_m < options.interacting_m) | (
        before.interacting & (apart_m < options.hysteresis * options.interacting_m)
    )
    if not interacting.any():
        return Situations(serial, interacting, interacting, interacting, before.merged_ns, interacting)
    correlated_m = options.correlated_m + options.body_m
    correlated = (apart_m < correlated_m) | (before.correlated & (apart_m < options.hysteresis * correlated_m))
    hidden = (missed_s > options.hidden_s)[:, None] & (missed_s == 0) & (apart_m < options.lateral_m)
    merging = _joined(points, owner, interacting, options.link_m) & interacting
    if together is None:
        merging |= (hidden | hidden.T) & interacting
    else:  # one target is for clusters that cannot be separated: a hidden person has none
        merging = np.where(before.merged, together, merging)
    merged_ns = np.where(merging, ns, before.merged_ns)
    merged = merging | (before.merged & (ns - merged_ns <= nanoseconds(options.lasting_s)))
    if together is not None:
        label = linked(merged)
        merged = (label[:, None] == label) & ~np.eye(label.size, dtype=np.bool_)
        return Situations(serial, interacting, correlated, merged, merged_ns, merged)
    confused = merged & (before.confused | hidden | hidden.T | (apart_m < options.confused_m))
    return Situations(serial, interacting, correlated, merged, merged_ns, confused)


def _joined(points: Points, owner: Int[Index, "k"], interacting: Bool[Mask, "n n"], link_m: float) -> Bool[Mask, "n n"]:
    """Link tracks whose points touch; tracks connected by a chain form one group."""
    theirs = (owner >= 0) & np.logical_or.reduce(interacting, axis=1)[owner]
    place, whose = points.place[theirs], np.zeros((len(interacting), int(theirs.sum())), np.float32)
    whose[owner[theirs], np.arange(len(place))] = 1
    near = (distances(place, place) < link_m).astype(np.float32)
    return (whose @ near @ whose.T > 0) & ~np.eye(len(interacting), dtype=bool)


def situation_names(situations: Situations, deciding: Bool[Mask, "n"]) -> list[Situation]:
    """Return each track's most severe situation with others; `deciding`: split but not yet identified."""
    names: tuple[Situation, ...] = ("apart", "interacting", "correlated", "merged", "split")
    grave = np.zeros(len(situations.serial), np.intp)
    for rank, holds in enumerate((situations.interacting, situations.correlated, situations.merged), start=1):
        grave[holds.any(axis=1)] = rank
    grave[deciding] = 4
    return [names[each] for each in grave.tolist()]
