"""Weights of people by pressure floors: they tell who it is where no camera looks, and who sits.

The logarithm of what a floor bears of a person who stands is that of the weight, with an error of the gait, which is alike for a
while, and one of the elements, which stays. A seat bears a part of who sits, and who rests is not heavier: a load far below a
weight tells of the posture, one above it of another person, or of what is carried. It is a mixture:
ln load ~ (1 − q) N(ln weight, σ²) + q U(ln share, 0).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from trackers.arrays import Array, Bool, Float, Index, Int, Mask
from trackers.filters.rows import Rows, written
from trackers.observations import NS_PER_S
from trackers.tracking.roster import NEVER_NS

GAIT, _STAYS = 0.12, 0.04
"""Standard deviations of the logarithm of a walker's load about the weight, and of what stays of it."""
_ALIKE_S = 0.3
"""Time in which all loads together tell what one tells [s]: as much as each counts for that comes later than that."""
_USUAL_N, _PEOPLE = 600.0, 0.5
"""Median of the weights of people, children too [N], and standard deviation of their logarithm."""
_SEATED, _LEAST_BORNE = 0.2, 0.05
"""Probability that a seat bears a part of a person q, and share of the weight that the feet bear at least, on beds."""
_EDGE = 0.02
"""Probability that a standing person is only in part on the floor."""
_WRONG_S = 2.0
"""A weight was wrong after as many loads as tell so long [s], heavier ones, or others of who walks: the track has not changed
people."""
_STEADY = 0.3
"""A load farther from the last ones in its logarithm is on its way: of who gets up, or steps onto the floor."""
_FELT_S = 2.0
"""A person who bore the whole weight no longer ago has not sat down yet [s]."""
_MOST = 4.5
"""Log-likelihood ratio at most."""


@dataclass(frozen=True, eq=False)
class Weights(Rows):
    """Weights of n people, of each identity and as its track has shown them lately: logarithms of newtons, NaN: not known."""

    LATELY_S: ClassVar[float] = 1.0
    """Time constant of what a track has shown lately [s]."""

    reference: Float[Array, "n"]
    learned_s: Float[Array, "n"]  # for how long it was learned, as loads count [s]
    learned_ns: Int[Index, "n"]  # stamp at which it was learned last
    learned_at: Float[Array, "n 2"]  # and where the person was then [m]
    lately: Float[Array, "n"]
    lately_s: Float[Array, "n"]  # for how long loads have been about that, as they count [s]
    felt_ns: Int[Index, "n"]  # stamp of the last load

    @classmethod
    def unknown(cls, n: int) -> Self:
        """Make weights of people whom no floor has felt."""
        nothing, never = np.full(n, np.nan), np.full(n, NEVER_NS)
        return cls(nothing, np.zeros(n), never, np.full((n, 2), np.nan), nothing, np.zeros(n), never)

    @property
    def known(self) -> Bool[Mask, "n"]:
        """Mark the weights that are known."""
        return self.learned_s >= _ALIKE_S

    @property
    def newtons(self) -> Float[Array, "n"]:
        """Weights [N], NaN: not known."""
        return np.where(self.known, np.exp(self.reference), np.nan)

    def on_feet(self, ns: int) -> Bool[Mask, "n"]:
        """Mark the people who bore all of their weights on their feet lately before stamp ns."""
        return (np.abs(self.lately - self.reference) < _STEADY) & (ns - self.felt_ns <= _FELT_S * NS_PER_S)

    def felt(
        self,
        row: Int[Index, "k"],
        load_n: Float[Array, "k"],
        place: Float[Array, "k 2"],
        walks: Bool[Mask, "k"],
        ns: int,
        learns_s: float,
    ) -> Self:
        """Return the weights after loads [N] of the people at `row` at places [m] and stamp ns, learned in a time [s]."""
        load, reference, learned_s = np.log(load_n), self.reference[row], self.learned_s[row]
        since_s = np.minimum((ns - self.felt_ns[row]) / NS_PER_S, _ALIKE_S) * (self.felt_ns[row] != NEVER_NS)
        steady = np.abs(load - self.lately[row]) < _STEADY
        lately_s = np.where(steady, np.minimum(self.lately_s[row] + since_s, _WRONG_S), 0.0)
        share = np.where(lately_s > 0, since_s / np.clip(lately_s, 1e-9, self.LATELY_S), 1.0)
        lately = np.where(steady, self.lately[row] + share * (load - self.lately[row]), load)
        off = lately - reference
        other = ((off > 3 * GAIT) | walks) & (np.abs(off) > 3 * GAIT) & (lately_s >= _WRONG_S)
        afresh = (learned_s < self.LATELY_S) | other
        alike = steady & (np.abs(off) <= 3 * GAIT)
        longer_s = np.minimum(learned_s + since_s, max(learns_s, self.LATELY_S))
        learned = np.where(alike, reference + since_s / np.maximum(longer_s, 1e-9) * (load - reference), reference)
        now = afresh | alike
        return type(self)(
            reference=written(self.reference, row, np.where(afresh, lately, learned)),
            learned_s=written(self.learned_s, row, np.where(afresh, lately_s, np.where(alike, longer_s, learned_s))),
            learned_ns=written(self.learned_ns, row, np.where(now, ns, self.learned_ns[row])),
            learned_at=written(self.learned_at, row, np.where(now[:, None], place, self.learned_at[row])),
            lately=written(self.lately, row, lately),
            lately_s=written(self.lately_s, row, lately_s),
            felt_ns=written(self.felt_ns, row, ns),
        )

    def log_ratio(self, tracks: Self) -> Float[Array, "n k"]:
        """Return the log-likelihood ratio of what tracks have borne lately as these people's, against others'; NaN: unknown."""
        ratio = _log_ratio(self.reference[:, None], self.learned_s[:, None], tracks.lately, tracks.lately_s)
        return np.where(self.known[:, None] & (tracks.felt_ns > NEVER_NS), ratio, np.nan)

    @property
    def own_log_ratio(self) -> Float[Array, "n"]:
        """Log-likelihood ratio of what each track has borne lately as its own person's, against others'; 0: unknown."""
        ratio = _log_ratio(self.reference, self.learned_s, self.lately, self.lately_s)
        return np.where(self.known, np.nan_to_num(ratio), 0.0)

    def log_postures(self, row: Int[Index, "k"], load_n: Float[Array, "k"]) -> Float[Array, "k 3"]:
        """Return log-likelihoods of who stands, sits and lies by loads [N] of people at `row`; 0 of unknown weights."""
        off = np.log(load_n) - self.reference[row]
        seated = _seated(off)
        stands = (1 - _EDGE) * _normal(off, _variance(self.learned_s[row]) + GAIT**2) + _EDGE * seated
        log = np.log(np.stack([stands, seated, seated], axis=1) + 1e-2)
        return np.where(self.known[row, None], log, 0.0)

    def of(self, identity: Self, taken: Bool[Mask, "n"]) -> Self:
        """Return the weights of identities on tracks that have borne these lately; others than those taken keep their own."""
        return self.changed(
            reference=np.where(taken, identity.reference, self.reference),
            learned_s=np.where(taken, identity.learned_s, self.learned_s),
            learned_ns=np.where(taken, identity.learned_ns, self.learned_ns),
            learned_at=np.where(taken[:, None], identity.learned_at, self.learned_at),
        )


def _log_ratio(
    reference: Float[Array, "*n"],
    learned_s: Float[Array, "*n"],
    lately: Float[Array, "*n"],
    lately_s: Float[Array, "*n"],
) -> Float[Array, "*n"]:
    """Return the log-likelihood ratio of loads as a person's of a weight, all as logarithms, against any other person's."""
    off, variance = lately - reference, _variance(lately_s)
    same = (1 - _SEATED) * _normal(off, _variance(learned_s) + variance) + _SEATED * _seated(off)
    off, least = lately - np.log(_USUAL_N), np.log(_LEAST_BORNE)
    other = (1 - _SEATED) * _normal(off, _PEOPLE**2 + variance)
    # a uniform share of the weight, by its mean and variance
    other += _SEATED * _normal(off - least / 2, _PEOPLE**2 + least**2 / 12 + variance)
    return np.clip(np.log(np.maximum(same, 1e-9) / np.maximum(other, 1e-9)), -_MOST, _MOST)


def _variance(learned_s: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """Return the variance of the logarithm of a weight that was learned for a time [s]."""
    return _STAYS**2 + GAIT**2 * _ALIKE_S / np.maximum(learned_s, _ALIKE_S)


def _normal(off: Float[Array, "*n"], variance: Float[Array, "*n"]) -> Float[Array, "*n"]:
    return np.exp(-0.5 * off**2 / variance) / np.sqrt(2 * np.pi * variance)


def _seated(off: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """Return the density of the logarithm of the share of a weight that is borne by feet below a seat."""
    least = np.log(_LEAST_BORNE)
    return np.where((off > least) & (off < 0), -1 / least, 0.0)
