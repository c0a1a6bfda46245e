"""State of a person: a body, its head and what bears it, in one Gaussian per mode of motion.

State: x, y, vx, vy of the body; the head's offset from it, and its height; the offset of the middle of the legs, where they stand
on the floor [m, m/s]. Offsets and height stay for a while: Ornstein-Uhlenbeck processes about what the posture has them at in the
long run. So a head tells of the body what a posture lets it, and so do legs: all of walkers, whose legs are under them, and
little of sitting people, whose feet are before them; what else shows the body teaches where.
"""

from __future__ import annotations

import numpy as np

from trackers.arrays import Array, Float, Index, Int
from trackers.filters.imm import ImmState
from trackers.filters.motion import VelocityMotion

_UPRIGHT_M, _UPRIGHT_SIGMA_M = 1.55, np.array([0.05, 0.05, 0.17, 0.05, 0.05])
"""Height of the middle of a head that nobody has seen yet, and standard deviations of head and legs [m]."""
_LEAN_S = 0.026
"""A walker's head is ahead of the pelvis by so much of the velocity [m per m/s]; measured in the twin."""

_OUTLINED = 0.5
"""Place of the outline of a sitting person between the pelvis, 0, and the legs, 1: measured in the twin."""

CROWN_M = 0.12
"""Height of the crown above the middle of a head [m]."""

PLACE = np.eye(2, 9)
"""The place in the state: H of its measurements; and where pictures outline a person, legs bear them, and the head is."""
LEGS = PLACE + np.eye(2, 9, k=7)
OUTLINE = PLACE + _OUTLINED * np.eye(2, 9, k=7)
HEAD = np.eye(3, 9, k=4)
HEAD[:2] += PLACE
HEAD_PLACE = HEAD[:2]


class PersonMotion(VelocityMotion):
    """Motion of a body with its head and legs."""

    def started(
        self,
        position: Float[Array, "n 2"],
        velocity: Float[Array, "n 2"],
        position_variance_m2: float | Float[Array, "n"],
        speed_variance: float | Float[Array, "n"],
    ) -> tuple[Float[Array, "9 n"], Float[Array, "9 9 n"]]:
        """Return mean and covariance of new tracks, whose heads nobody has seen."""
        body, of_body = super().started(position, velocity, position_variance_m2, speed_variance)
        mean, covariance = np.zeros((9, len(position))), np.zeros((9, 9, len(position)))
        mean[:4], covariance[:4, :4] = body, of_body
        mean[6], covariance[range(4, 9), range(4, 9)] = _UPRIGHT_M, _UPRIGHT_SIGMA_M[:, None] ** 2
        return mean, covariance


def seen(state: ImmState, observes: Float[Array, "d s"]) -> tuple[Float[Array, "n m d"], Float[Array, "n m d d"]]:
    """Return means and covariances in each mode of what H shows of tracks [m, m²]."""
    P = np.einsum("pa,abmn->pbmn", observes, state.covariance)
    return np.einsum("pa,amn->nmp", observes, state.mean), np.einsum("pbmn,qb->nmpq", P, observes)


def seen_over_modes(
    state: ImmState, observes: Float[Array, "d s"]
) -> tuple[Float[Array, "n d"], Float[Array, "n d d"]]:
    """Return means and covariances over the modes of what H shows of tracks [m, m²]."""
    mean, P = seen(state, observes)
    whole = np.einsum("nmp,mn->np", mean, state.probability)
    off = mean - whole[:, None]
    return whole, np.einsum("mn,nmpq->npq", state.probability, P + off[..., None] * off[..., None, :])


def crowns_over(place: Float[Array, "n 2"], head: Float[Array, "n 3"]) -> Float[Array, "n 3"]:
    """Return places [m], and above them the heights of the crowns of these heads [m]."""
    return np.column_stack([place, head[:, 2] + CROWN_M])


def drifted(
    state: ImmState, kept: Float[Array, "5 n"], height_m: Float[Array, "n"], variance_m2: Float[Array, "5 n"]
) -> ImmState:
    """Return heads and legs some time later. kept: correlation with where they were.

    height_m, variance_m2: of where they are from their bodies in the long run, by posture; heads of walkers lean ahead.
    """
    F = np.tile(np.eye(9)[:, :, None], (1, 1, len(state)))
    F[range(4, 9), range(4, 9)] = kept
    F[[4, 5], [2, 3]] = (1 - kept[:2]) * _LEAN_S
    mean = np.einsum("abn,bmn->amn", F, state.mean)
    mean[6] += (1 - kept[2]) * height_m
    P, n = state.covariance, len(state)
    for _ in range(2):  # F P, then F (F P)ᵀ: products of matrices of each track
        P = (P.transpose(3, 1, 2, 0).reshape(n, -1, 9) @ F.T).reshape(n, 9, -1, 9).transpose(1, 3, 2, 0)
    P = np.ascontiguousarray(P)
    P[range(4, 9), range(4, 9)] += ((1 - kept**2) * variance_m2)[:, None]
    return ImmState(mean, P, state.probability)


def with_legs_free(state: ImmState, row: Int[Index, "k"], variance_m2: Float[Array, "k"]) -> ImmState:
    """Return tracks whose legs, at `row`, may be elsewhere than before, by a variance on each axis [m²]."""
    P = state.covariance.copy()
    for axis in (7, 8):
        P[axis, axis][:, row] += variance_m2
    return ImmState(state.mean, P, state.probability)
