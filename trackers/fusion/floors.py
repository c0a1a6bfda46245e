"""Pressure floors: each element's load is shared among the people expected about it, and what is left starts tracks.

An element at p is person i's by the share w_i(p) = exp(−½ |p − x_i|² / s²) / (Σ_j exp(−½ |p − x_j|² / s²) + exp(−½ g² / s²)),
the last term standing for an unknown person at the gate g. A person's place is the middle of their loads; so two whose
footprints touch stay two. After Mori et al., who divide a cluster's load by particles (eq. 3).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from trackers.arrays import Array, Float
from trackers.filters.gating import distances
from trackers.fusion.look import Expected, Look, detections_of, round_covariance
from trackers.fusion.motion import LEGS
from trackers.fusion.options import KindOptions
from trackers.fusion.posture import FLOOR_SHOWN
from trackers.likelihood.floor import FloorClusterOptions, floor_clusters
from trackers.observations import FloorFrame, Observation
from trackers.rig import FloorSensor
from trackers.tracking.track_manager import clear_of

_NEAR_M, _GATE_M = 0.2, 0.6
"""Standard deviation s of an element's load about its person, and the gate g [m]: half a stride, and where nobody's begins."""
_LEAST_N = 60.0
"""Load from which it is a person's: a child's on one foot [N]."""
_LINKED_M = 0.45
"""Unexplained clusters nearer than this are the feet of one person [m]."""
_MOST_LOADED = 0.5
"""Share of the elements from which a frame is that of a broken floor."""


class FusedFloor:
    """One pressure floor. empty_room: observations without people, of it and others."""

    learns_background = False

    def __init__(self, name: str, floor: FloorSensor, empty_room: Sequence[Observation], kind: KindOptions) -> None:
        self.names, self._floor, self._kind = (name,), floor, kind
        frames = [each.values for each in empty_room if isinstance(each, FloorFrame) and each.sensor == name]
        shape = (floor.rows, floor.columns)
        self._own = np.rint(np.median(frames, axis=0) if frames else np.zeros(shape)).astype(np.uint8)

    def look(self, observations: Mapping[str, Observation], expected: Expected, ns: int) -> Look | None:
        """Return the middles of the loads of expected people, and clusters of what none of them explains."""
        frame = observations.get(self.names[0])
        if not isinstance(frame, FloorFrame):
            return None
        values = frame.values
        if values.shape == self._own.shape:  # another size is refused below, in words
            values = values - np.minimum(values, self._own)
        found = floor_clusters(replace(frame, values=values), self._floor, FloorClusterOptions())
        loaded = found.cell_load_n > 0
        if loaded.mean() > _MOST_LOADED:
            return None
        place, load_n = self._floor.centres[loaded], found.cell_load_n[loaded]
        feet = expected.place + expected.legs
        closeness = np.exp(-0.5 * (distances(feet, place) / _NEAR_M) ** 2)
        share = closeness / (closeness.sum(axis=0) + np.exp(-0.5 * (_GATE_M / _NEAR_M) ** 2))
        own_n = share * load_n
        total_n = own_n.sum(axis=1)
        owner = np.flatnonzero(total_n >= _LEAST_N)
        middle = own_n[owner] @ place / total_n[owner, None]
        # what others may have as well says less
        mixed = 1 - (own_n[owner] * share[owner]).sum(axis=1) / total_n[owner]
        left_n = load_n * (1 - share.sum(axis=0))
        new = self._unexplained(place, left_n)
        position = np.concatenate([middle, new])
        variance = np.full(len(position), self._kind.sigma_m**2)
        variance[: len(owner)] += (2 * _NEAR_M * mixed) ** 2
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
            shown=detections_of(ns, self.names, "floor", position, covariance),
        )

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
        pose, floor = self._floor.room_from_sensor, self._floor
        local = np.linalg.inv(pose.rotation[:2, :2]) @ (points.reshape(2, -1) - pose.translation[:2, None])
        size = np.array([[floor.columns], [floor.rows]]) * floor.pitch_m
        margin_m = 0.5 * floor.pitch_m
        on_floor = ((local > margin_m) & (local < size - margin_m)).all(axis=0)
        return np.where(on_floor, 1 - self._kind.p_detect, 1.0).reshape(points.shape[1:])
