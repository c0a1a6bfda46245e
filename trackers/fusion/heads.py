"""Heads: offsets from bodies and heights, in one Gaussian with the body's place, weighed at points by all pictures of a stamp.

A head is at the body's place x plus an offset o that stays for a while: an Ornstein-Uhlenbeck process about 0, or the lean of a
walker, with the variance of the posture; its height is one about that of the posture. A picture shows x + o, and so tells of both
by their covariance. A likelihood of a head's place is no Gaussian, so the density is taken at fixed points z of the unit
Gaussian, m + L z, weighed, and made Gaussian again by its sums (J. Kotecha and P. Djurić, "Gaussian particle filtering", IEEE
Trans. Signal Processing 51, 2003), in parts where few points would count (tempering). The points are those of an additive
recurrence with irrational steps, so that nothing is random. Directions are a density over a whole turn: colours of face and
hair weigh it, and people who walk face ahead.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Self

import numpy as np
from numpy.typing import NDArray

from trackers.arrays import Array, Bool, Float, Index, Int, Mask, Singles
from trackers.filters.gating import distances
from trackers.filters.rows import Rows, written
from trackers.fusion.options import HeadEvidenceOptions
from trackers.fusion.shown_places import Camera
from trackers.likelihood.colour import PersonColourOptions, SilhouetteOptions
from trackers.likelihood.stereo_head import StereoHeadOptions, StereoHeads
from trackers.observations import NS_PER_S
from trackers.tracking.roster import NEVER_NS
from trackers.vision.head_colours import HeadColours, HeadModel
from trackers.vision.head_outlines import ASPECTS

_DIRECTIONS = (np.arange(ASPECTS[0]) + 0.5) * (2 * np.pi / ASPECTS[0])
_TOWARDS = np.exp(1j * _DIRECTIONS)
_SAME_M = 0.18
"""Distance within which two heads are one [m]."""
_LEAST_SIGMA_M = 0.012
"""No picture tells a place better than this [m]."""
_ALONG_M = 1.0
"""Standard deviation, along the sight, of a head that one camera without distances shows: how large it is is not known [m]."""
_LEAST_C = 1e-10 * np.eye(3)
"""Added to covariances, so that rounding leaves them positive definite [m²]."""
_KNOWS_NOTHING = 0.1
"""Information of a place from which on a picture tells something of it [1/m²]."""
_LEAST_GAIN = 0.1
"""And at least this share of what was known before: the sums over few points are not exact."""
_PASSES, _LEAST_ESS = 3, 12.0
"""A likelihood is taken in at most so many parts, such that as many points count in each."""
_POWERS = np.array([0.03, 0.1, 0.2, 0.4, 0.7, 1.0])
"""Parts of a likelihood that may be taken."""
_LEAST_FREE = 1e-3
"""Probability at least that a place where another's head is expected is free."""
_LEAST_SHOWN = 0.4
"""Share of foreground in an ellipse times that of background over it, from which a head is seen."""
_TURNS_RAD2_S = 2.0
"""Variance by which a direction spreads in a second [rad²/s]."""
_AHEAD, WALKS_M_S = 4.0, 0.4
"""Concentration about the way, per second, of the direction that people face who walk faster than this [m/s]."""
_TURNED_S, _MOST_TURNED_S = 0.2, 0.4
"""Walkers who face ahead for so long tell which side of a head is the face, and who face backwards that colours were learned the
wrong way round; they tell no more than in the last time [s]."""
_OVERDUE_S = 1.0
"""A head that pictures should have shown for longer, and none has, is not where it is expected [s]."""
_EVIDENCE = StereoHeadOptions(
    person_colour=PersonColourOptions(power=6.0), silhouette=SilhouetteOptions(power=6.0, above=2.2)
)
"""Colours and foreground count alike; the arc above tells a shoulder from a head. Chosen on twins of seeds 1000–1999."""
_SURE = 0.6
"""Mean resultant length of a direction from which colours are learned at it."""


@dataclass(frozen=True, eq=False)
class Heads(Rows):
    """Directions and colours of the heads of n people, and when they were seen; places are in the state of the filter."""

    facing: Float[Array, "n directions"]
    seen_ns: Int[Index, "n"]
    not_due_ns: Int[Index, "n"]  # stamp of the last picture that showed the head, or could not be expected to
    colours: HeadColours
    ahead_s: Float[Array, "n"]  # for how long people have walked facing ahead, less facing backwards [s]

    @classmethod
    def over(cls, n: int) -> Self:
        """Make n heads that nobody has seen, over their bodies."""
        facing = np.full((n, ASPECTS[0]), 1 / ASPECTS[0])
        never = np.full(n, NEVER_NS)
        return cls(facing, never, never, HeadColours.unknown(n), np.zeros(n))

    @property
    def direction(self) -> tuple[Float[Array, "n"], Float[Array, "n"]]:
        """Mean direction [rad] and its resultant length, 0 where it is not known."""
        resultant = self.facing @ _TOWARDS
        return np.angle(resultant), np.abs(resultant)

    def turned(self, dt: float, velocity: Float[Array, "n 2"]) -> Self:
        """Return the directions `dt` later [s]; velocity: of the bodies [m/s], the way of which walkers face.

        Colours learned of the back of a head for its face confirm themselves: those of who walks backwards are forgotten.
        """
        spread = _turned(_TURNS_RAD2_S * dt)
        facing = np.maximum(np.fft.irfft(np.fft.rfft(self.facing, axis=1) * spread, ASPECTS[0], axis=1), 1e-12)
        walks = np.hypot(*velocity.T) > WALKS_M_S
        ahead = np.cos(_DIRECTIONS - np.arctan2(velocity[:, 1], velocity[:, 0])[:, None])
        along = facing * np.exp(_AHEAD * dt * walks[:, None] * ahead)
        tells = walks & (self.direction[1] > _SURE)
        faces_ahead = np.sign((facing * ahead).sum(axis=1))
        ahead_s = np.minimum(self.ahead_s + np.where(tells, faces_ahead * dt, 0.0), _MOST_TURNED_S)
        misled = ahead_s < -_TURNED_S
        along = np.where(misled[:, None], np.exp(_AHEAD * ahead), along)
        return self.changed(
            facing=along / along.sum(axis=1, keepdims=True),
            ahead_s=np.where(misled, 0.0, ahead_s),
            colours=self.colours.forgotten(misled),
        )

    def awaited(self, due: Bool[Mask, "n"], ns: int) -> tuple[Self, Bool[Mask, "n"]]:
        """Return the heads after a stamp whose pictures did not show those due, and which of them must be elsewhere."""
        not_due_ns = np.where(due, self.not_due_ns, ns)
        elsewhere = ns - not_due_ns > _OVERDUE_S * NS_PER_S
        return self.changed(not_due_ns=np.where(elsewhere, ns, not_due_ns)), elsewhere


class HeadWeighing:
    """Weighs heads by pictures of one stamp. model: of heads."""

    def __init__(self, model: HeadModel, options: HeadEvidenceOptions) -> None:
        self._model = model
        self._z = unit_points(options.samples)
        self._by_cameras: dict[tuple[int, ...], StereoHeads] = {}

    def updated(
        self,
        heads: Heads,
        expected: Float[Array, "n 3"],
        covariance: Float[Array, "n 3 3"],
        views: Sequence[Camera],
        in_view: Bool[Mask, "c n"],
        outlined: Bool[Mask, "c n"],
        share: Float[Array, "n"],
        ns: int,
    ) -> tuple[Heads, Int[Index, "k"], Float[Array, "k 3"], Float[Array, "k 3 3"]]:
        """Weigh heads expected at places [m], with covariances [m²], by all pictures of a stamp at once.

        in_view: which heads nothing is known to hide from each camera; outlined: which of them have nobody about them; share: of
        a look's evidence. Return the heads, the rows of those that pictures show, and where these alone show them [m], with
        covariances [m²].
        """
        row = np.flatnonzero(outlined.any(axis=0))
        mean, C = expected[row], covariance[row]
        if not row.size:
            return heads, row, mean, C
        showing, left, before = outlined[:, row], share[row].copy(), (mean, C)
        others = np.flatnonzero(in_view.any(axis=0))
        free_of, some = FreePlaces.of(row, others, expected, covariance), heads.select(row)
        tables, direction = some.colours.expected(self._model.common).tables, some.direction[0]
        for number in range(_PASSES):
            root = np.linalg.cholesky(C + _LEAST_C)
            places = mean[:, None] + self._z @ root.transpose(0, 2, 1)
            free = free_of.log(places)
            by = np.flatnonzero(showing.any(axis=1))  # the cameras that tell something
            log, sees = self._weighed(places, free, direction, tables, [views[k] for k in by.tolist()])
            if number == 0:
                showing = written(np.zeros_like(showing), by, showing[by] & sees)
            log = (log * showing[by, :, None]).sum(axis=0) + free
            power = 1.0 if number == _PASSES - 1 else _tempered(log * left[:, None])
            weight = _normalized(log * (left * power)[:, None])
            left = left * (1 - power)
            off = weight @ self._z
            second = np.einsum("kp,pa,pb->kab", weight, self._z, self._z) - off[:, :, None] * off[:, None, :]
            mean, C = mean + np.einsum("kab,kb->ka", root, off), root @ second @ root.transpose(0, 2, 1)
            C += _LEAST_SIGMA_M**2 / 4 * np.eye(3)
            if (left < 1e-6).all():
                break
        here = showing.any(axis=0)
        eyes_m, flat = np.array([each.camera.eye_m for each in views]), [not each.picture.knows_depth for each in views]
        along = sights_of_one(showing[:, here], mean[here], eyes_m, np.array(flat))
        row = row[here]
        heads = heads.changed(seen_ns=written(heads.seen_ns, row, ns))
        heads = self._faced(heads, row, mean[here], views, in_view[:, row], share[row])
        place, R = gained(*(each[here] for each in (*before, mean, C)))
        return heads, row, place, R + _ALONG_M**2 * along[:, :, None] * along[:, None]

    def _weighed(
        self,
        places: Float[Array, "k p 3"],
        free: Float[Array, "k p"],
        direction: Float[Array, "k"],
        tables: Float[Singles, "k entries"],
        views: Sequence[Camera],
    ) -> tuple[Float[Array, "c k p"], Bool[Mask, "c k"]]:
        """Weigh places of each head [m] by each picture: log-likelihoods, and which pictures show which head.

        free: log-probability that no other head is there.
        """
        if not views:
            return np.zeros((0, *free.shape)), np.zeros((0, len(free)), np.bool_)
        asked = np.empty((4, len(views), *places.shape[:2]), np.float32)
        asked[:3], asked[3] = places.transpose(2, 0, 1)[:, None], direction[:, None]
        found = self._heads(views).log_likelihood([each.picture for each in views], asked, tables)
        colour, depth, p_detect, seen = (
            np.array([getattr(each, name) for each in found]).reshape(asked.shape[1:])
            for name in ("colour", "depth", "p_detect", "seen")
        )
        log: Array = (colour + depth).astype(np.float64)
        weight = _normalized(log + free)
        like_a_head = (weight * log).sum(axis=2) > 0  # rather than like anything else
        return log, like_a_head & ((weight * p_detect).sum(axis=2) >= _LEAST_SHOWN) & seen.all(axis=2)

    def _heads(self, views: Sequence[Camera]) -> StereoHeads:
        """Return the likelihood by these cameras' pictures."""
        cameras = tuple(id(each.camera) for each in views)
        if cameras not in self._by_cameras:
            self._by_cameras[cameras] = StereoHeads([each.camera for each in views], self._model, _EVIDENCE)
        return self._by_cameras[cameras]

    def _faced(
        self,
        heads: Heads,
        row: Int[Index, "k"],
        place: Float[Array, "k 3"],
        views: Sequence[Camera],
        in_view: Bool[Mask, "c k"],
        share: Float[Array, "k"],
    ) -> Heads:
        """Weigh the directions of heads that pictures show, and learn the colours of those whose is known.

        Until people have walked facing ahead, the common colours of faces and hair tell their direction: what was learned of a
        face may be of a back.
        """
        if not row.size:
            return heads
        those = np.flatnonzero(in_view.any(axis=1))
        in_view, views = in_view[those], [views[k] for k in those.tolist()]
        by, common, seen = self._heads(views), self._model.common, heads.select(row)
        at = np.repeat(np.concatenate([place.T, seen.direction[0][None]])[:, None], len(views), axis=1)
        look = by.close_look([each.picture for each in views], at)
        known = seen.colours.forgotten(seen.ahead_s <= _TURNED_S)
        log = by.facing(look, known.expected(common).tables)
        facing = seen.facing * _normalized((log * in_view[..., None]).sum(axis=0) * share[:, None])
        seen = seen.changed(facing=facing / facing.sum(axis=1, keepdims=True))
        sure = seen.direction[1] > _SURE
        person, step, colour = by.colours_on(look, sure & in_view)
        seen = seen.changed(colours=seen.colours.learned(person, step, colour, common))
        return heads.replaced(row, seen)


@dataclass(frozen=True, eq=False)
class FreePlaces:
    """Places that the heads of o others are not expected at, for k whose places are sought: a place is one person's.

    As an interaction of targets of a Markov random field (Khan, Balch and Dellaert 2005), with what is expected of the others.
    """

    place: Float[Array, "o 2"]  # [m]
    inverse: Float[Array, "o 2 2"]  # of the covariances, widened by the size of a head [1/m²]
    peak: Float[Array, "o"]  # probability that a head is at the middle
    own: Bool[Mask, "k 1 o"]

    @classmethod
    def of(
        cls,
        row: Int[Index, "k"],
        others: Int[Index, "o"],
        expected: Float[Array, "n 3"],
        covariance: Float[Array, "n 3 3"],
    ) -> Self:
        """Take the others, among n heads expected at places [m] with covariances [m²]; row: those sought."""
        P = covariance[others, :2, :2] + (_SAME_M / 2) ** 2 * np.eye(2)
        peak = (_SAME_M / 2) ** 2 / np.sqrt(np.linalg.det(P))
        return cls(expected[others, :2], np.asarray(np.linalg.inv(P), np.float64), peak, others == row[:, None, None])

    def log(self, places: Float[Array, "k p 3"]) -> Float[Array, "k p"]:
        """Return ln of the probability that the head of none of the others is where one is sought."""
        x, y = (places[..., axis, None] - self.place[:, axis] for axis in (0, 1))
        (xx, xy), (yx, yy) = self.inverse.transpose(1, 2, 0)
        square = x * xx * x + x * xy * y + y * yx * x + y * yy * y
        taken = np.where(self.own, 0.0, self.peak * np.exp(-0.5 * square))
        return np.log1p(-np.minimum(taken, 1 - _LEAST_FREE)).sum(axis=2)


def _tempered(log: Float[Array, "k p"]) -> Float[Array, "k"]:
    """Return the power of a likelihood at which enough points count (ESS, the effective sample size), at most 1."""
    ess = 1 / (_normalized(log[:, None] * _POWERS[:, None]) ** 2).sum(axis=2)  # (k, powers)
    return _POWERS[np.maximum((ess >= _LEAST_ESS).cumprod(axis=1).sum(axis=1) - 1, 0)]


def _normalized(log: Float[Array, "*n p"]) -> Float[Array, "*n p"]:
    """Return weights that sum to one along the last axis, of these logarithms."""
    weight = np.exp(log - log.max(axis=-1, keepdims=True))
    return weight / weight.sum(axis=-1, keepdims=True)


def own(place: Float[Array, "n 3"]) -> Bool[Mask, "n"]:
    """Mark the heads at places [m] that are in no older one."""
    return ~np.logical_or.reduce(np.tril(distances(place[:, :2], place[:, :2]) < _SAME_M, -1), axis=1)


def sights_of_one(
    showing: Bool[Mask, "c k"], place: Float[Array, "k 3"], eyes_m: Float[Array, "c 3"], flat: Bool[Mask, "c"]
) -> Float[Array, "k 3"]:
    """Return unit vectors along the sights to heads at places [m] that one camera alone shows, and is flat; 0 of others."""
    by = showing.argmax(axis=0)
    sight = place - eyes_m[by]
    one = (showing.sum(axis=0) == 1) & flat[by]
    return np.where(one[:, None], sight / np.linalg.norm(sight, axis=1, keepdims=True), 0.0)


def gained(
    mean: Float[Array, "k d"], covariance: Float[Array, "k d d"], after: Float[Array, "k d"], P: Float[Array, "k d d"]
) -> tuple[Float[Array, "k d"], Float[Array, "k d d"]]:
    """Return what made a Gaussian another one: places [m] and covariances, large where nothing was measured.

    The information of a likelihood is that of the posterior less that of the prior, so that nothing is counted twice.
    """
    inverse, before = np.linalg.inv(P), np.linalg.inv(covariance)
    values, axes = np.linalg.eigh(inverse - before)
    informs = values > np.maximum(_LEAST_GAIN * np.einsum("kab,kac,kcb->kb", axes, before, axes), _KNOWS_NOTHING)
    variance = 1 / np.where(informs, values, _KNOWS_NOTHING)
    R = np.einsum("kab,kb,kcb->kac", axes, variance, axes)
    moved = np.einsum("kab,kb->ka", inverse, after - mean)
    return mean + np.einsum("kab,kb,kcb,kc->ka", axes, informs * variance, axes, moved), R


@lru_cache(maxsize=4)
def unit_points(count: int) -> Float[Array, "p 3"]:
    """Spread points over the unit Gaussian evenly, with mean 0 and covariance 1.

    An additive recurrence with the powers of the root of x⁴ = x + 1 (M. Roberts, "The unreasonable effectiveness of quasirandom
    sequences", 2018), through the inverse of the normal distribution.
    """
    from scipy.special import ndtri

    golden = 1.2207440846057596
    uniform = (0.5 + np.arange(1, count + 1)[:, None] * golden ** -np.arange(1.0, 4.0)) % 1.0
    z = ndtri(uniform)
    z -= z.mean(axis=0)
    z = z @ np.linalg.inv(np.linalg.cholesky(z.T @ z / count)).T
    z.setflags(write=False)
    return z


@lru_cache(maxsize=16)
def _turned(variance: float) -> NDArray[np.complex128]:
    """Return the Fourier coefficients of the density of a turn of this variance [rad²] over the steps of a whole turn."""
    angle = np.minimum(_DIRECTIONS - _DIRECTIONS[0], 2 * np.pi - (_DIRECTIONS - _DIRECTIONS[0]))
    density = np.exp(-0.5 * angle**2 / max(variance, 1e-5))
    return np.fft.rfft(density / density.sum())
