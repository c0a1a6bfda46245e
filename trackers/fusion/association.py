"""Association of looks' measurements with tracks, by likelihood ratios against clutter and against not being shown.

A measurement z with covariance R is a track's by e p(z), p the density of its prediction; or clutter's, by its density λ. A track
without a measurement was not shown, by 1 − e + e m (D. Mušicki, R. Evans and S. Stanković, "Integrated probabilistic data
association", IEEE Trans. Automatic Control 39, 1994). One assignment of the greatest product of ratios pairs them.

Looks of several cameras at one stamp are associated at once. A track's hypothesis takes one measurement or none of each, and
the measurements of one person must agree: their density is ∫ p(x) Π p(z | x) dx. Hypotheses of different tracks share no
measurement, which makes it an S-dimensional assignment (S. Deb, M. Yeddanapudi, K. Pattipati and Y. Bar-Shalom, "A generalized
S-D assignment algorithm for multisensor-multitarget state estimation", IEEE Trans. Aerospace and Electronic Systems 33, 1997),
solved exactly as an integer program. The order of the cameras does not matter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import LinearConstraint, milp

from trackers.arrays import Array, Bool, Float, Index, Int, Mask
from trackers.filters.gating import distances, max_weight_assignment
from trackers.filters.imm import ImmState
from trackers.fusion.look import Look
from trackers.fusion.motion import seen, seen_over_modes
from trackers.fusion.people import People
from trackers.fusion.posture import LEGS_REST_M

LEAST_EXISTENCE, _LEAST_MISSED, _LEAST_SHOWN = 1e-4, 1e-2, 1e-2
_NEAR_M, _GATE = 0.3, 4.0
"""A measurement nearer than this to a prediction [m], or nearer than so many standard deviations, is never gated off."""

_MOST = 48
"""Hypotheses of a track that are kept, the likeliest."""
EXPLAINED = 3.0
"""A measurement nearer to a track than so many standard deviations initiates none."""


def log_density(state: ImmState, look: Look, wider_m2: float = 0.0) -> tuple[Float[Array, "n k"], Float[Array, "n k"]]:
    """Return ln p(z) [ln 1/m²] of measurements about the likeliest mode of each track, and its Mahalanobis distance.

    wider_m2: variance to add on each axis.
    """
    mean, P = seen(state, look.observes)
    P = P + wider_m2 * np.eye(2)
    S = P[:, :, None] + look.covariance  # (n, m, k, 2, 2)
    off = look.position - mean[:, :, None]
    s_xx, s_xy, s_yy = S[..., 0, 0], S[..., 0, 1], S[..., 1, 1]
    determinant = s_xx * s_yy - s_xy**2
    x, y = off[..., 0], off[..., 1]
    square = (s_yy * x * x - 2 * s_xy * x * y + s_xx * y * y) / determinant
    log = -0.5 * (square + np.log(determinant)) - np.log(2 * np.pi)
    return log.max(axis=1), np.sqrt(np.maximum(square.min(axis=1), 0.0))


Pairs = tuple[Int[Index, "p"], Int[Index, "p"], Float[Array, "p"]]
"""Tracks, measurements, and log-likelihood ratios against clutter."""


def pairs(
    people: People, looks: Sequence[Look], missed: Sequence[Float[Array, "n"]], by_trunk: Bool[Mask, "n"]
) -> list[Pairs]:
    """Pair tracks with the measurements of looks at one stamp.

    missed: how probably each look would not show each track; by_trunk: the tracks of whom a trunk was measured lately, so that
    their legs are near. Measurements that a source has shared out keep their owners.
    """
    log = [_density(people, look, by_trunk) for look in looks]
    weighed = [_weighed(people, *each) for each in zip(looks, missed, log, strict=True)]
    if not len(people):
        return [(np.empty(0, np.intp), np.empty(0, np.intp), np.empty(0)) for _ in looks]
    if len(looks) == 1:
        return [_by_one(people, looks[0], missed[0], *weighed[0])]
    chosen = _by_several(people, looks, missed, [allowed for _, allowed in weighed])
    return [(rows, columns, ratio[rows, columns]) for (rows, columns), (ratio, _) in zip(chosen, weighed, strict=True)]


def _density(people: People, look: Look, by_trunk: Bool[Mask, "n"]) -> tuple[Float[Array, "n k"], Float[Array, "n k"]]:
    """Return `log_density`; of the legs of those who were measured by a trunk, a mixture with `_elsewhere`.

    Who sits down or lies has legs half a metre from there within a second.
    """
    density, away = log_density(people.state, look)
    if not look.of_legs:
        return density, away
    elsewhere, away_elsewhere = _elsewhere(people, look)
    may = by_trunk[:, None]
    density = np.logaddexp(density, elsewhere, out=density, where=may)
    return density, np.minimum(away, away_elsewhere, out=away, where=may)


def legs_elsewhere(people: People, look: Look) -> Float[Array, "n k"]:
    """Return the probability that measured legs are not where the track's were: those of who sits down, lies or gets up."""
    stay, elsewhere = log_density(people.state, look)[0], _elsewhere(people, look)[0]
    return np.exp(elsewhere - np.logaddexp(stay, elsewhere))


def _elsewhere(people: People, look: Look) -> tuple[Float[Array, "n k"], Float[Array, "n k"]]:
    """Return `log_density` of legs anywhere about people, as probable as that these rest."""
    density, away = log_density(people.state, look, LEGS_REST_M**2)
    return density + np.log(people.posture.probability[:, 1:].sum(axis=1))[:, None], away


def _weighed(
    people: People, look: Look, missed: Float[Array, "n"], log: tuple[Float[Array, "n k"], Float[Array, "n k"]]
) -> tuple[Float[Array, "n k"], Bool[Mask, "n k"]]:
    """Return the log-likelihood ratios of pairs against clutter, and which pairs may be."""
    density, away = log
    ratio = density - np.log(look.kind.clutter_m2) + _log_shown(people, look, missed)[:, None]
    allowed = (away <= _GATE) | (distances(seen_over_modes(people.state, look.observes)[0], look.position) < _NEAR_M)
    given = np.flatnonzero(look.owner >= 0)
    fits = allowed[look.owner[given], given]
    allowed[:, given] = False
    allowed[look.owner[given]] = False
    allowed[look.owner[given], given] = fits
    return ratio, allowed


def _log_shown(people: People, look: Look, missed: Float[Array, "n"]) -> Float[Array, "n"]:
    """Return ln P_D of each track where a look measured it.

    A scanner that measures a person there sees that place; a silhouette may be of another one on the same line of sight.
    """
    shown = people.posture.shown(look.by_posture) if look.is_sharp else 1 - missed
    return np.log(np.maximum(shown, _LEAST_SHOWN))


def _by_one(
    people: People,
    look: Look,
    missed: Float[Array, "n"],
    ratio: Float[Array, "n k"],
    allowed: Bool[Mask, "n k"],
) -> Pairs:
    """Pair the measurements of one look: an assignment of two dimensions."""
    e = np.maximum(people.existence, LEAST_EXISTENCE)
    unpaired = np.log((1 - e + e * np.maximum(missed, _LEAST_MISSED)) / e)
    worth = np.where(allowed, ratio - unpaired[:, None], 0.0)
    given = np.flatnonzero((look.owner >= 0) & allowed.any(axis=0))
    worth[look.owner[given], given] = np.maximum(worth[look.owner[given], given], 1e-9)
    rows, columns = max_weight_assignment(worth)
    return rows, columns, ratio[rows, columns]


@dataclass(frozen=True, eq=False)
class _Hypotheses:
    """h hypotheses of each of n tracks: one measurement or none (−1) of each look so far, and what they tell of its place.

    information: the prediction's and Σ R⁻¹; vector: Σ R⁻¹ d, of offsets d from the prediction.
    """

    column: Int[Index, "n h looks"]
    information: Float[Array, "n h 2 2"]
    vector: Float[Array, "n h 2"]
    log: Float[Array, "n h"]  # of all but the exponential and the determinant of the joint density

    @property
    def worth(self) -> Float[Array, "n h"]:
        """ln ∫ p(x) Π p(z | x) dx and what the looks count besides."""
        a, b, c = self.information[..., 0, 0], self.information[..., 0, 1], self.information[..., 1, 1]
        x, y = self.vector[..., 0], self.vector[..., 1]
        determinant = a * c - b * b
        return self.log + 0.5 * ((c * x * x - 2 * b * x * y + a * y * y) / determinant - np.log(determinant))

    def best(self) -> _Hypotheses:
        """Return the likeliest hypotheses of each track, at most `_MOST`."""
        if self.log.shape[1] <= _MOST:
            return self
        kept = np.argsort(-self.worth, axis=1, kind="stable")[:, :_MOST]
        row = np.arange(len(kept))[:, None]
        return _Hypotheses(
            self.column[row, kept], self.information[row, kept], self.vector[row, kept], self.log[row, kept]
        )

    def extended(
        self,
        look: Look,
        off: Float[Array, "n k 2"],
        log_shown: Float[Array, "n"],
        log_missed: Float[Array, "n"],
        allowed: Bool[Mask, "n k"],
    ) -> _Hypotheses:
        """Return each hypothesis with none, and with each allowed measurement of one more look."""
        n, h = self.log.shape
        most = int(allowed.sum(axis=1).max(initial=0))
        column = np.argsort(~allowed, axis=1, kind="stable")[:, :most]  # (n, most)
        inverse = np.linalg.inv(look.covariance)
        R, vector, log = np.zeros((n, most + 1, 2, 2)), np.zeros((n, most + 1, 2)), np.empty((n, most + 1))
        R[:, 1:] = inverse[column]
        off = np.take_along_axis(off, column[..., None], axis=1)
        vector[:, 1:] = np.einsum("nkab,nkb->nka", R[:, 1:], off)
        log[:, 0] = log_missed
        log[:, 1:] = 0.5 * (np.log(np.linalg.det(inverse))[column] - np.einsum("nka,nka->nk", vector[:, 1:], off))
        log[:, 1:] += log_shown[:, None] - np.log(2 * np.pi * look.kind.clutter_m2)
        log[:, 1:][~np.take_along_axis(allowed, column, axis=1)] = -np.inf
        column = np.concatenate([np.full((n, 1), -1), column], axis=1)
        size = (n, h * (most + 1))
        return _Hypotheses(
            np.concatenate([np.repeat(self.column, most + 1, axis=1), np.tile(column, (1, h))[..., None]], axis=2),
            (self.information[:, :, None] + R[:, None]).reshape(*size, 2, 2),
            (self.vector[:, :, None] + vector[:, None]).reshape(*size, 2),
            (self.log[:, :, None] + log[:, None]).reshape(size),
        ).best()


def _by_several(
    people: People, looks: Sequence[Look], missed: Sequence[Float[Array, "n"]], allowed: Sequence[Bool[Mask, "n k"]]
) -> list[tuple[Int[Index, "p"], Int[Index, "p"]]]:
    """Pair the measurements of looks at one stamp: an assignment of as many dimensions."""
    n = len(people)
    P = people.covariance
    tried = _Hypotheses(
        np.empty((n, 1, 0), np.intp),
        np.linalg.inv(P).astype(np.float64)[:, None],
        np.zeros((n, 1, 2)),
        -0.5 * np.log(np.linalg.det(P))[:, None],
    )
    log_missed = [np.log(np.maximum(each, _LEAST_MISSED)) for each in missed]
    for look, chance, log_miss, may in zip(looks, missed, log_missed, allowed, strict=True):
        off = look.position - seen_over_modes(people.state, look.observes)[0][:, None]
        tried = tried.extended(look, off, _log_shown(people, look, chance), log_miss, may)
    e = np.maximum(people.existence, LEAST_EXISTENCE)
    nothing = np.log(1 - e + e * np.exp(sum(log_missed)))
    shown = (tried.column >= 0).any(axis=2)
    worth = np.where(shown, tried.worth + (np.log(e) - nothing)[:, None], 0.0)
    chosen = _disjoint(worth, tried.column)
    return [(rows := np.flatnonzero(each >= 0), each[rows]) for each in chosen.T]


def _disjoint(worth: Float[Array, "n h"], column: Int[Index, "n h looks"]) -> Int[Index, "n looks"]:
    """Choose a hypothesis of each track, or none, of the greatest total worth, such that no measurement is shared."""
    n, c = len(column), column.shape[2]
    size = column.max(axis=(0, 1), initial=-1) + 1
    first = np.cumsum(size) - size
    best = column[np.arange(n), worth.argmax(axis=1)]
    chosen = np.where((worth.max(axis=1) > 0)[:, None], best, -1)
    if np.bincount((chosen + first)[chosen >= 0], minlength=1).max() < 2:
        return chosen
    track, of = np.nonzero(worth > 0)
    picked = column[track, of]  # (v, looks)
    variable, look = np.nonzero(picked >= 0)
    shares = np.zeros((n + size.sum(), track.size))
    shares[track, np.arange(track.size)] = 1
    shares[n + first[look] + picked[variable, look], variable] = 1
    found = milp(-worth[track, of], integrality=1, bounds=(0, 1), constraints=LinearConstraint(shares, ub=1.0))
    taken = np.flatnonzero(found.x > 0.5)
    chosen = np.full((n, c), -1)
    chosen[track[taken]] = picked[taken]
    return chosen


def explained(people: People, look: Look) -> Bool[Mask, "k"]:
    """Mark the measurements that a track explains better than clutter does, though it may have had another one."""
    if not len(people):
        return np.zeros(len(look.position), np.bool_)
    density, away = log_density(people.state, look)
    return np.logical_or.reduce((away < EXPLAINED) & (density > np.log(look.kind.clutter_m2)), axis=0)
