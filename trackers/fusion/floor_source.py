"""Source of people by a pressure floor: loads of expected people, and clusters of what none of them explains.

Each element's load is shared among the people expected about it, and what is left starts tracks. An element at p is person i's
by the share w_i(p) = exp(−½ |p − x_i|² / s²) / (Σ_j exp(−½ |p − x_j|² / s²) + exp(−½ g² / s²)), the last term standing for an
unknown person at the gate g. A person's place is the middle of their loads; so two whose footprints touch stay two. After Mori
et al., who divide a cluster's load by particles (eq. 3). Where weights are known they are kept: a foot that comes down ahead of
a walker is the walker's who lacks as much, and a load that others lack is no evidence of one more person.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from trackers.arrays import Array, Bool, Float, Mask
from trackers.filters.gating import distances
from trackers.fusion.look import Expected, Look, detections_of, round_covariance
from trackers.fusion.options import KindOptions
from trackers.fusion.person_state import LEGS
from trackers.fusion.posture import FLOOR_SHOWN
from trackers.fusion.weights import GAIT
from trackers.likelihood.floor import FloorClusterOptions, FloorFrontEnd
from trackers.observations import FloorFrame, Observation
from trackers.rig import FloorSensor
from trackers.tracking.track_manager import clear_of

_NEAR_M, _GATE_M = 0.2, 0.6
"""Standard deviation s of an element's load about its person, and the gate g [m]: half a stride, and where nobody's begins."""
_LEAST_N = 60.0
"""Load from which it is a person's: a child's on one foot [N]."""
_FOOT_M, _LACKS = 0.9, 0.3
"""A foot is this near to the middle of the other one's load [m]; a person who lacks so much of the weight has another foot."""
_PARTLY = 0.05
"""Density of loads of who bears a part of the weight, in that of usual loads at their mean."""
_MIXED = 0.1
"""Share of a person's load that may be others', up to which it tells of the weight."""
_LINKED_M = 0.45
"""Unexplained clusters nearer than this are the feet of one person [m]."""


class FusedFloor:
    """One pressure floor. empty_room: observations without people, of it and others; floors: all of the rig."""

    learns_background = False
    of_legs = True

    def __init__(
        self, name: str, floors: Mapping[str, FloorSensor], empty_room: Sequence[Observation], kind: KindOptions
    ) -> None:
        self.names, self._kind = (name,), kind
        self._floor = floor = floors[name]
        self._floors, self._reporting = floors, {name}
        frames = [each for each in empty_room if isinstance(each, FloorFrame) and each.sensor == name]
        self._front_end = FloorFrontEnd(floor, frames, FloorClusterOptions())

    def look(self, observations: Mapping[str, Observation], expected: Expected, ns: int) -> Look | None:
        """Return the middles of the loads of expected people, and clusters of what none of them explains."""
        self._reporting |= self._floors.keys() & observations.keys()
        frame = observations.get(self.names[0])
        if not isinstance(frame, FloorFrame):
            return None
        found = self._front_end.clusters(frame)
        if found is None:
            return None
        loaded = found.cell_load_n > 0
        place, load_n = self._floor.centres[loaded], found.cell_load_n[loaded]
        feet = expected.place + expected.legs
        away_m = distances(feet, place)
        closeness = np.exp(-0.5 * (away_m / _NEAR_M) ** 2)
        share = closeness / (closeness.sum(axis=0) + np.exp(-0.5 * (_GATE_M / _NEAR_M) ** 2))
        lacking = expected.on_feet & _is_on(self._floor, feet.T, 0.0)  # beside the floor all of the weight lacks
        weight_n = np.where(lacking, expected.weight_n, np.nan)
        share, is_foot = self._with_other_foot(share, load_n, away_m, weight_n, expected.confirmed)
        own_n = share * load_n
        total_n = own_n.sum(axis=1)
        owner = np.flatnonzero(total_n >= _LEAST_N)
        middle = own_n[owner] @ place / total_n[owner, None]
        # what others may have as well says less
        mixed = 1 - (own_n[owner] * share[owner]).sum(axis=1) / total_n[owner]
        evidence = self._evidence(share, load_n, expected.weight_n, lacking)
        left_n = load_n * (1 - share.sum(axis=0))
        new = self._unexplained(place, left_n)
        position = np.concatenate([middle, new])
        variance = np.full(len(position), self._kind.sigma_m**2)
        variance[: len(owner)] += (2 * _NEAR_M * mixed) ** 2
        whole = (mixed < _MIXED) & ~is_foot[owner] & _is_on(self._floor, middle.T, _NEAR_M)
        for other in self._reporting - {*self.names}:  # which may bear the other foot
            whole &= ~_is_on(self._floors[other], middle.T, -_FOOT_M / 2)
        whole_n = np.append(np.where(whole, total_n[owner], np.nan), np.full(len(new), np.nan))
        covariance = round_covariance(variance)
        return Look(
            self.names,
            self._kind,
            position,
            covariance,
            np.concatenate(
                [np.zeros(len(owner)), clear_of(new, np.concatenate([expected.place, feet]), _GATE_M)]
            ).astype(np.intp),
            np.concatenate([owner, np.full(len(new), -1)]),
            self._missed,
            FLOOR_SHOWN,
            observes=LEGS,
            load_n=whole_n,
            evidence=np.append(evidence[owner], np.ones(len(new))),
            shown=detections_of(ns, self.names, "floor", position, covariance),
        )

    @staticmethod
    def _with_other_foot(
        share: Float[Array, "n c"],
        load_n: Float[Array, "c"],
        away_m: Float[Array, "n c"],
        weight_n: Float[Array, "n"],
        confirmed: Bool[Mask, "n"],
    ) -> tuple[Float[Array, "n c"], Bool[Mask, "n"]]:
        """Return the shares of loads [N] with the other foot of walkers who lack some of their weights, and who they are.

        A foot that comes down more than half a stride ahead of where a person is expected is explained by nobody, or it has
        initiated a tentative track. It is theirs if it bears nearly what they lack. The nearest take theirs first.
        """
        is_foot = np.zeros(len(share), np.bool_)
        lacks_n = weight_n - share @ load_n
        lack = np.flatnonzero(lacks_n > _LACKS * weight_n)  # no weight: NaN, no
        unexplained = share[confirmed].sum(axis=0) < 0.5
        for row in lack[away_m[lack][:, unexplained].min(axis=1, initial=np.inf).argsort()]:
            free = 1 - share[confirmed].sum(axis=0)
            near = away_m[row] < _FOOT_M
            found_n = (free * near) @ load_n
            if _LACKS * weight_n[row] < found_n < lacks_n[row] + _LACKS * weight_n[row]:
                share = np.where(confirmed[:, None] | ~near, share, 0.0)
                share[row] += free * near
                is_foot[row] = True
        return share, is_foot

    @staticmethod
    def _evidence(
        share: Float[Array, "n c"], load_n: Float[Array, "c"], weight_n: Float[Array, "n"], lacking: Bool[Mask, "n"]
    ) -> Float[Array, "n"]:
        """Return the evidence of loads that people share with others that each of them is there, −1 to 1, else 1.

        Against it is what others lack of their weights [N], of those who may: who is there bears a weight, and theirs are whole
        without that. It is the log-likelihood ratio of both for normal errors of the gait, and for who sits there.
        """
        own_n = share * load_n
        total_n = own_n.sum(axis=1)
        others_n = np.where(lacking, np.nan_to_num(weight_n), 0.0)
        overlap = own_n @ share.T > _MIXED * total_n[:, None]
        np.fill_diagonal(overlap, False)
        theirs_n, sigma_n = overlap @ np.maximum(others_n - total_n, 0.0), GAIT * (overlap @ others_n)
        tells = (theirs_n > sigma_n) & ~np.isnan(weight_n)
        weight_n = np.where(tells, weight_n, 1.0)
        sigma_n += GAIT * weight_n
        there = np.exp(-0.5 * (((total_n - weight_n) ** 2 + theirs_n**2) / sigma_n**2)) + _PARTLY
        ratio = np.log(there) + 0.5 * ((total_n - theirs_n) / sigma_n) ** 2
        return np.where(tells, np.clip(ratio, -1.0, 1.0), 1.0)

    def _unexplained(self, place: Float[Array, "c 2"], left_n: Float[Array, "c"]) -> Float[Array, "k 2"]:
        """Gather unexplained loads about the heaviest elements, greedily: middles [m]."""
        middles, left_n = [], left_n.copy()
        while left_n.sum() >= _LEAST_N:
            near = np.hypot(*(place - place[left_n.argmax()]).T) < _LINKED_M
            load_n = left_n[near].sum()
            if load_n >= _LEAST_N:
                middles.append(left_n[near] @ place[near] / load_n)
            left_n[near] = 0.0
        return np.reshape(middles, (-1, 2))

    def _missed(self, points: Float[Array, "2 *n"]) -> Float[Array, "*n"]:
        """Return how probably a person there is not felt: on the floor hardly, beside it always."""
        on_floor = _is_on(self._floor, points.reshape(2, -1), 0.5 * self._floor.pitch_m)
        return np.where(on_floor, 1 - self._kind.p_detect, 1.0).reshape(points.shape[1:])


def _is_on(floor: FloorSensor, points: Float[Array, "2 k"], margin_m: float) -> Bool[Mask, "k"]:
    """Mark the points [m] that are on a floor by more than a margin."""
    pose = floor.room_from_sensor
    local = np.linalg.inv(pose.rotation[:2, :2]) @ (points - pose.translation[:2, None])
    size = np.array([[floor.columns], [floor.rows]]) * floor.pitch_m
    return np.logical_and.reduce((local > margin_m) & (local < size - margin_m), axis=0)
