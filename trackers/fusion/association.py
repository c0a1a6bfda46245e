"""Association of looks' measurements with tracks, by likelihood ratios against clutter and against not being shown.

A measurement z with covariance R is a track's by e p(z), p the density of its prediction; or clutter's, by its density λ. A track
without a measurement was not shown, by 1 − e + e m (D. Mušicki, R. Evans and S. Stanković, "Integrated probabilistic data
association", IEEE Trans. Automatic Control 39, 1994). One assignment of the greatest product of ratios pairs them.

Looks of several cameras at one stamp are each associated with the same predictions.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackers.arrays import Array, Bool, Float, Index, Int, Mask
from trackers.filters.gating import max_weight_assignment
from trackers.filters.imm import ImmState
from trackers.fusion.look import NEW, Look
from trackers.fusion.person_state import seen
from trackers.fusion.person_tracks import People
from trackers.fusion.posture import LEGS_REST_M

LEAST_EXISTENCE, _LEAST_MISSED, _LEAST_SHOWN = 1e-4, 1e-2, 1e-2
_GATE, EXPLAINED = 4.0, 3.0
"""Standard deviations from a prediction beyond which a measurement is gated off, and up to which it initiates no track."""


def log_density(
    state: ImmState, look: Look, wider_m2: Float[Array, "*w"] | float = 0.0
) -> tuple[Float[Array, "*w n k"], Float[Array, "*w n k"]]:
    """Return ln p(z) [ln 1/m²] of measurements over the modes of each track, and the least Mahalanobis distance from one.

    wider_m2: variances to add on each axis, for each of which they are returned.
    """
    mean, P = seen(state, look.observes)
    P = P + np.multiply.outer(wider_m2, np.eye(2))[..., None, None, :, :]
    S = P[..., None, :, :] + look.covariance  # (*w, n, m, k, 2, 2)
    off = look.position - mean[:, :, None]
    s_xx, s_xy, s_yy = S[..., 0, 0], S[..., 0, 1], S[..., 1, 1]
    determinant = s_xx * s_yy - s_xy**2
    x, y = off[..., 0], off[..., 1]
    square = (s_yy * x * x - 2 * s_xy * x * y + s_xx * y * y) / determinant
    log = -0.5 * (square + np.log(determinant)) - np.log(2 * np.pi)
    log += np.log(np.maximum(state.probability, 1e-9)).T[:, :, None]
    return np.logaddexp.reduce(log, axis=-2), np.sqrt(np.maximum(square.min(axis=-2), 0.0))


@dataclass(frozen=True, eq=False)
class Pairs:
    """p tracks with a measurement each of one look."""

    row: Int[Index, "p"]  # of the track
    column: Int[Index, "p"]  # of the measurement
    log_ratio: Float[Array, "p"]  # against clutter, or a track that the look shows nowhere else
    legs_moved: Float[Array, "p"]  # probability that legs are elsewhere than before: of who sits down, lies or gets up
    evidence: Float[Array, "p"]  # that a person is there, in that of a whole one


def pair(people: People, look: Look, missed: Float[Array, "n"], by_trunk: Bool[Mask, "n"]) -> Pairs:
    """Pair tracks with the measurements of a look, in one assignment.

    missed: how probably it would not show each track; by_trunk: the tracks of whom a trunk was measured lately, so that their
    legs are near. Measurements that a source has shared out keep their owners.
    """
    if not len(people):
        return Pairs(np.empty(0, np.intp), np.empty(0, np.intp), np.empty(0), np.empty(0), np.empty(0))
    density, away, legs_moved = _density(people, look, by_trunk)
    ratio = density - np.log(look.kind.clutter_m2) + _log_shown(people, look, missed)[:, None]
    allowed = (away <= _GATE) & (look.owner != NEW)
    given = np.flatnonzero(look.owner >= 0)
    fits = allowed[look.owner[given], given]
    allowed[:, given] = False
    allowed[look.owner[given]] = False
    allowed[look.owner[given], given] = fits
    e = np.maximum(people.existence, LEAST_EXISTENCE)
    unpaired = np.log((1 - e + e * np.maximum(missed, _LEAST_MISSED)) / e)
    worth = np.where(allowed, ratio - unpaired[:, None], 0.0)
    given = given[fits]
    worth[look.owner[given], given] = np.maximum(worth[look.owner[given], given], 1e-9)
    row, column = max_weight_assignment(worth)
    others = np.where(allowed, worth, -np.inf)
    others[row] = -np.inf
    else_explained = np.logaddexp(0.0, np.logaddexp.reduce(others[:, column], axis=0))
    log_ratio = ratio[row, column] - else_explained
    return Pairs(row, column, log_ratio, legs_moved[row, column], look.evidence_of(column, people.confirmed[row]))


def _density(
    people: People, look: Look, by_trunk: Bool[Mask, "n"]
) -> tuple[Float[Array, "n k"], Float[Array, "n k"], Float[Array, "n k"]]:
    """Return `log_density`, and how probably legs are elsewhere than they were from those who were measured by a trunk.

    Who sits down or lies has legs half a metre from there within a second: a mixture, as probable as that people rest.
    """
    if not look.of_legs:
        density, away = log_density(people.state, look)
        return density, away, np.zeros_like(density)
    (density, wide), (away, away_wide) = log_density(people.state, look, np.array([0.0, LEGS_REST_M**2]))
    wide += np.log(np.maximum(people.posture.probability[:, 1:].sum(axis=1) * by_trunk, 1e-300))[:, None]
    whole = np.logaddexp(density, wide)
    return whole, np.where(by_trunk[:, None], np.minimum(away, away_wide), away), np.exp(wide - whole)


def _log_shown(people: People, look: Look, missed: Float[Array, "n"]) -> Float[Array, "n"]:
    """Return ln P_D of each track where a look measured it.

    A scanner or floor that measures a person there sees that place; a silhouette may be of another one on the same line of sight.
    """
    shown = people.posture.shown(look.by_posture) if look.is_sharp or look.of_legs else 1 - missed
    return np.log(np.maximum(shown, _LEAST_SHOWN))


def explained(people: People, look: Look) -> Bool[Mask, "k"]:
    """Mark the measurements that a track explains better than clutter does, though it may have had another one."""
    density, away = log_density(people.state, look)
    return ((away < EXPLAINED) & (density > np.log(look.kind.clutter_m2))).any(axis=0)
