"""Odometry of a base as a pose at any stamp, with what it cannot say left out: gaps, and jumps where it was corrected."""

from __future__ import annotations

from bisect import bisect_right

import numpy as np
from jaxtyping import Float

from trackers.arrays import Array
from trackers.frames.planar import between, compose, planar
from trackers.observations import NS_PER_S

_AHEAD_NS = NS_PER_S // 4
"""A pose is carried on so long after the last one, by its motion; a longer silence is a gap."""
_GAP_NS = NS_PER_S
_FASTEST_M_S, _FASTEST_RAD_S = 6.0, 8.0
"""Robots among people are slower; what moves faster has jumped."""
_KEPT = 512


class OdometryTrack:
    """The last poses of one base in its odometry frame, in the plane."""

    def __init__(self) -> None:
        self._ns: list[int] = []
        self._poses: list[Array] = []
        self._up: list[Array] = []  # heights that the base's axes point at
        self._breaks: list[int] = []  # stamps from which on poses do not follow from those before

    def add(self, ns: int, frame_from_base: Float[Array, "4 4"]) -> None:
        """Take a pose at a stamp [ns]; one that comes late or twice is left out."""
        if self._ns and ns <= self._ns[-1]:
            return
        pose = planar(frame_from_base)
        if self._ns:
            elapsed_s = (ns - self._ns[-1]) / NS_PER_S
            moved = between(self._poses[-1], pose)
            is_jump = (
                np.hypot(*moved[:2]) > _FASTEST_M_S * elapsed_s + 0.05
                or abs(moved[2]) > _FASTEST_RAD_S * elapsed_s + 0.05
            )
            if is_jump or ns - self._ns[-1] > _GAP_NS:
                self._breaks.append(ns)
        self._ns.append(ns)
        self._poses.append(pose)
        self._up.append(frame_from_base[2, :3].copy())
        if len(self._ns) > _KEPT:
            del self._ns[:-_KEPT], self._poses[:-_KEPT], self._up[:-_KEPT]
            self._breaks = [each for each in self._breaks if each >= self._ns[0]]

    def at(self, ns: int) -> Float[Array, "3"] | None:
        """Return the pose at a stamp [ns]; None before the first, long after the last, and in a gap."""
        place = bisect_right(self._ns, ns)
        if place == 0:
            return None
        if place == len(self._ns):
            if ns - self._ns[-1] > _AHEAD_NS:
                return None
            if place == 1 or ns == self._ns[-1] or self._ns[-1] in self._breaks:
                return self._poses[-1].copy()
            place -= 1
        first, last = self._ns[place - 1], self._ns[place]
        if last in self._breaks:
            return self._poses[place - 1].copy() if ns - first <= _AHEAD_NS else None
        share = (ns - first) / (last - first)
        return compose(self._poses[place - 1], share * between(self._poses[place - 1], self._poses[place]))

    def tilt(self, ns: int, axis: Float[Array, "3"]) -> float:
        """Return the larger angle, of the poses before and after a stamp [ns], of an axis of the base to the vertical [rad]."""
        place = bisect_right(self._ns, ns)
        near = self._up[max(place - 1, 0) : place + 1]
        return float(np.arccos(min([1.0, *(abs(float(up @ axis)) for up in near)])))

    def follows(self, before_ns: int, ns: int) -> bool:
        """Tell whether poses at two stamps [ns] follow from each other: no jump and no gap lies between."""
        return not any(before_ns < each <= ns for each in self._breaks)
