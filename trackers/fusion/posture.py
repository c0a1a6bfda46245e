"""Posture of each track: a hidden Markov model of people who stand, sit and lie, by the forward algorithm.

p(posture) goes on by the rates at which people change it, and is weighed by what tells: which sensors show a person and which do
not, how high the head is, how far the legs are from the trunk (L. Rabiner, "A tutorial on hidden Markov models", Proc. IEEE 77,
1989). A person gets up before leaving: one who sits or lies stays at the seat.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Self

import numpy as np

from trackers.arrays import Array, Bool, Float, Index, Int, Mask
from trackers.filters.rows import Rows, written

Shares = tuple[float, float, float]
"""Detection probability of people who stand, sit and lie, in that of those who stand; measured in the twin."""
TRUNK_SHOWN: Shares = (1.0, 0.85, 0.01)
LEGS_SHOWN: Shares = (1.0, 0.95, 0.1)
SILHOUETTE_SHOWN: Shares = (1.0, 0.62, 0.03)
DEPTH_SHOWN: Shares = (1.0, 0.95, 0.7)
FLOOR_SHOWN: Shares = (1.0, 0.83, 0.05)
"""A bed bears who lies on it."""

OFF_BODY: Shares = (1.0, 31.0, 620.0)
"""Variance of heads from over the pelvis, on each axis, in that of a standing person's (1.8 cm); measured in the twin."""

REACH = 0.7
"""Trunk and legs of a person who sits, lies or gets up are this near to the place, as a share of the stature."""
_RISES_S, _LIES_DOWN_S = 20.0, 12.0
"""Mean times for which people sit or lie before they rise, and sit before they lie down [s]."""
_FALLS = 0.1
"""Share of the people who lie down, or rise from lying, that do not sit in between."""
_HEAD, _HEAD_SIGMA = np.array([0.93, 0.74, 0.36]), np.array([0.06, 0.09, 0.13])
"""Height of the middle of a head in the stature, and its standard deviation."""
_REST_M_S = 0.25
"""Standard deviation of the speed of people who rest [m/s]."""
_REST_M, _UP_M = 0.5, 0.2
"""Standard deviations of measurements by one sensor of people who rest about their mean, and of those whose head is up [m]."""
_RISEN, _MOST_RISEN = 3.0, 25.0
"""χ² of one who has stood up, from and up to which it tells."""
ALIKE_S = 1.0
"""Time in which all looks at a posture together tell what one tells [s]: their errors are alike."""
_LEGS_ALIKE_S = 0.3
"""The same of distances of legs from trunks [s]."""
_SEAT_S = 2.0
"""Time constant in which one sensor tells where the seat is [s]."""
_LIES_BEHIND_M, _FACES_M = 0.3, 0.22
"""A person who lies down from the edge of a bed lies so far behind where they sat, away from the knees [m]: half a bed, less the
edge; and how far the legs are from there at least where it can be measured [m]."""
LEGS_REST_M = 0.32
"""Standard deviation, on each axis, of the legs of who sits or lies from the pelvis [m]."""
_LEGS_M, _LEGS_STAY_S = np.array([0.03, LEGS_REST_M, LEGS_REST_M]), np.array([0.3, 10.0, 10.0])
"""Standard deviation, on each axis, of the legs from the pelvis [m], and time constant in which they go elsewhere [s]."""
_STRAY = 0.05
"""Share of measurements of legs that are another's, or of a person whose place is wrong."""
_STRAY_M2 = 4.0
"""Area in which those are, anywhere: about that within reach of the place [m²]."""
_STRIDE_M = 0.1
"""Standard deviation, on each axis, of a walker's legs about there at one look [m]."""


@dataclass(frozen=True, eq=False)
class Posture(Rows):
    """Postures of n people."""

    probability: Float[Array, "n 3"]  # of standing, sitting, lying
    seat: Float[Array, "n 2"]  # where they sit or lie [m]; NaN: they stand
    feet: Float[Array, "n 2"]  # where the middle of their legs is there [m]; NaN: they stand
    lain: Bool[Mask, "n"]  # who lies, or has lain and not stood up since

    @classmethod
    def upright(cls, n: int) -> Self:
        """Make postures of n people who are met standing, more likely than not."""
        nowhere = np.full((n, 2), np.nan)
        return cls(np.tile([0.9, 0.09, 0.01], (n, 1)), nowhere, nowhere, np.zeros(n, np.bool_))

    @property
    def low(self) -> Float[Array, "n"]:
        """Probability that they lie."""
        return self.probability[:, 2]

    @property
    def lies(self) -> Bool[Mask, "n"]:
        """The people who probably lie."""
        return self.low > 0.5

    @property
    def rests(self) -> Bool[Mask, "n"]:
        """The people who probably sit or lie."""
        return self.probability[:, 0] < 0.5

    @property
    def faces(self) -> Bool[Mask, "n"]:
        """The people who sit or lie of whom it is known which way their legs are from their pelvis."""
        return np.hypot(*(self.feet - self.seat).T) > _FACES_M  # NaN: they stand

    def shown(self, shares: Shares) -> Float[Array, "n"]:
        """Return the detection probability in that of a standing person."""
        return self.probability @ np.array(shares)

    def later(self, elapsed_s: float, lies_down_s: float) -> Self:
        """Return the postures some time later; lies_down_s: how long people stand on average [s]."""
        rate, root, inverse = _modes(lies_down_s)
        return self.changed(probability=self.probability @ (root * np.exp(elapsed_s * rate) @ inverse))

    def weighed(self, row: Int[Index, "k"], log_likelihood: Float[Array, "k 3"]) -> Self:
        """Return the postures, those at `row`, some of them repeatedly, weighed by log-likelihoods of what is seen."""
        log = np.zeros((len(self), 3))
        np.add.at(log, row, log_likelihood)
        p = self.probability * np.exp(log - log.max(axis=1, keepdims=True)) + 1e-6
        weighed = written(self.probability, row, (p / p.sum(axis=1, keepdims=True))[row])
        return self.changed(probability=weighed)

    def detected(self, row: Int[Index, "k"], of_lying: Float[Array, "k"], share: Float[Array, "k"]) -> Self:
        """Weigh those at `row` by a detection: they do not lie. Sensors that show people who sit do so look after look.

        of_lying: detection probability of people who lie, in that of those who stand.
        """
        return self.weighed(row, (share * np.log(of_lying))[:, None] * np.array([0.0, 0.0, 1.0]))

    def by_head(
        self,
        row: Int[Index, "k"],
        height_m: Float[Array, "k"],
        variance_m2: Float[Array, "k"],
        stature_m: Float[Array, "k"],
        since_s: Float[Array, "k"],
    ) -> Self:
        """Weigh those at `row` by the height of their heads [m], at their statures [m], last looked at since_s ago [s]."""
        variance = (stature_m[:, None] * _HEAD_SIGMA) ** 2 + variance_m2[:, None]
        off = height_m[:, None] - stature_m[:, None] * _HEAD
        return self.weighed(row, -0.5 * (since_s / ALIKE_S)[:, None] * (off**2 / variance + np.log(variance)))

    def head_height(self, stature_m: Float[Array, "n"]) -> tuple[Float[Array, "n"], Float[Array, "n"]]:
        """Return the mean [m] and the variance [m²] of the heights of heads at these statures [m]."""
        mean = self.probability @ _HEAD
        variance = self.probability @ (_HEAD**2 + _HEAD_SIGMA**2) - mean**2
        return stature_m * mean, stature_m**2 * variance

    def by_legs(
        self,
        row: Int[Index, "k"],
        off_m: Float[Array, "k 2"],
        variance_m2: Float[Array, "k"],
        since_s: Float[Array, "k"],
    ) -> Self:
        """Weigh those at `row` by how far legs are from where the pelvis is expected [m], last measured since_s ago [s]."""
        variance = _LEGS_M**2 + _STRIDE_M**2 + variance_m2[:, None]
        log = -0.5 * (off_m**2).sum(axis=1)[:, None] / variance - np.log(2 * np.pi * variance)
        log = np.logaddexp(np.log1p(-_STRAY) + log, np.log(_STRAY / _STRAY_M2))
        return self.weighed(row, np.minimum(since_s / _LEGS_ALIKE_S, 1.0)[:, None] * log)

    def legs_there(self) -> tuple[Float[Array, "n"], Float[Array, "n"]]:
        """Return the long-run variance of the offsets of legs on each axis [m²], and the rate at which they change [1/s].

        Geometric means over the postures: who hardly sits has legs that stand.
        """
        return np.exp(2 * self.probability @ np.log(_LEGS_M)), np.exp(-self.probability @ np.log(_LEGS_STAY_S))

    def by_place(
        self,
        row: Int[Index, "k"],
        off_m: Float[Array, "k"],
        of_legs: Bool[Mask, "k"],
        head_is_up: Bool[Mask, "k"],
        speed_m_s: Float[Array, "k"],
        share: Float[Array, "k"],
    ) -> Self:
        """Weigh those at `row` by their speed [m/s], and by how far a sensor measures them from where it does at rest [m].

        head_is_up: whose head a picture shows as high as that of who stands: they do not lie down there.
        """
        sigma_m = np.where(head_is_up, _UP_M, np.where(of_legs, LEGS_REST_M, _REST_M))
        moves = (speed_m_s / _REST_M_S) ** 2 + (off_m / sigma_m) ** 2
        # who stays may stand there as well
        moves = share * np.clip(moves - _RISEN, 0.0, _MOST_RISEN)
        return self.weighed(row, -0.5 * moves[:, None] * np.array([0.0, 1.0, 1.0]))

    def settled(self, place: Float[Array, "n 2"], legs: Float[Array, "n 2"], since_s: Float[Array, "n"]) -> Self:
        """Learn the seats of people who sit at places [m], and where their feet are; who lies has none on the floor.

        legs: from the places to the middles of the legs [m]; since_s: for how long the sensors that show them now had not,
        together [s].
        """
        stays = np.where(self.lies, 1.0, np.exp(-since_s / _SEAT_S))
        kept = np.where(np.isnan(self.seat[:, 0]), 0.0, stays)[:, None]
        old, new = np.concatenate([self.seat, self.feet], axis=1), np.concatenate([place, place + legs], axis=1)
        learned = np.where(self.rests[:, None], np.where(kept > 0, kept * old, 0.0) + (1 - kept) * new, np.nan)
        return self.changed(seat=learned[:, :2], feet=learned[:, 2:])

    def lain_down(self) -> Self:
        """Remember who lies, and move the seats of those who just lay down to where they lie, away from their feet."""
        ahead = self.feet - self.seat
        now = (self.lies & ~self.lain & self.faces)[:, None]
        seat = np.where(
            now, self.seat - _LIES_BEHIND_M * ahead / np.maximum(np.hypot(*ahead.T), 1e-9)[:, None], self.seat
        )
        return self.changed(seat=seat, lain=self.rests & (self.lain | self.lies))


@lru_cache(maxsize=4)
def _modes(lies_down_s: float) -> tuple[Float[Array, "3"], Float[Array, "3 3"], Float[Array, "3 3"]]:
    """Return the eigenvalues [1/s] of the rates at which postures change, and their eigenvectors with the inverse."""
    rates = np.array(
        [
            [0.0, 1 / lies_down_s, _FALLS / lies_down_s],
            [1 / _RISES_S, 0.0, 1 / _LIES_DOWN_S],
            [_FALLS / _RISES_S, (1 - _FALLS) / _RISES_S, 0.0],
        ]
    )
    rate, root = np.linalg.eig(rates - np.diag(rates.sum(axis=1)))
    return rate, root, np.linalg.inv(root)
