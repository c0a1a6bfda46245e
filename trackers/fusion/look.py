"""A look: what one sensor measured of people at one stamp, in the terms that every sensor shares."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from trackers.arrays import Array, Bool, Float, Index, Int, Mask
from trackers.fusion.options import KindOptions
from trackers.fusion.person_state import HEAD_PLACE, LEGS, OUTLINE, PLACE, crowns_over
from trackers.fusion.posture import ALIKE_S, Shares
from trackers.observations import Observation
from trackers.tracks import Detection

APART_M = 0.3
"""Nobody is so near to another person who is measured [m]: a third leg there is a bag of theirs."""
_STAYS = 0.4
"""Share of the variance along a sight that stays: measured in the twin."""
_TRUST = 1.5
"""Log-likelihood ratio of a detection at most, in that of detecting a person against missing one."""
NEW = -2
"""Owner of a measurement that is nobody's who is known: it initiates a track, which may prove to be a hidden person's."""


@dataclass(frozen=True, eq=False)
class Expected:
    """n tracks, as they are expected at a look's stamp."""

    place: Float[Array, "n 2"]  # ground point [m]
    head: Float[Array, "n 3"]  # [m]
    legs: Float[Array, "n 2"]  # from the place to the middle of the legs [m]
    speed_m_s: Float[Array, "n"]
    facing: Float[Array, "n 2"]  # mean of the unit vector that they face by, of length 0 where that is not known
    by_trunk: Bool[Mask, "n"]  # of whom a trunk was measured lately: nobody else is there
    weight_n: Float[Array, "n"]  # [N], NaN: not known
    on_feet: Bool[Mask, "n"]  # who bore all of it on their feet lately
    confirmed: Bool[Mask, "n"]  # tentative ones may be a foot of another person

    @property
    def crowns(self) -> Float[Array, "n 3"]:
        """Places [m], and above them the heights of the crowns: what hides others."""
        return crowns_over(self.place, self.head)


@dataclass(frozen=True, eq=False)
class Look:
    """k measurements of one kind at one stamp.

    owner: the track that a measurement is of, −1 where it is to be associated, `NEW` where it is nobody's who is known;
    starts: the hits with which a track begins that a measurement initiates, 0 where it may not: one that can be nobody but a
    person counts as several; missed: the probability that the look would not show a standing person at room points (2, ...)
    [m], (...); known: that of the expected tracks at their places, None where it is not known already; by_posture: the
    detection probability of who stands, sits and lies, in that of who stands; is_sharp: whether `missed` tells one place from
    another near by; observes: H of the measurements; evidence: of each measurement that a person is there, in that of a whole
    person; None: of all 1. likeness: how much what is measured looks like a person, −1 to 1, by which it counts for those who
    are not yet confirmed; None: 1. load_n: what a floor bears of all of a person [N], NaN where it may be less or others'.
    """

    sensors: tuple[str, ...]
    kind: KindOptions
    position: Float[Array, "k 2"]
    covariance: Float[Array, "k 2 2"]  # [m²]
    starts: Int[Index, "k"]
    owner: Int[Index, "k"]
    missed: Callable[[Array], Array]
    by_posture: Shares
    is_sharp: bool = False
    known: Float[Array, "n"] | None = None
    observes: Float[Array, "2 s"] = field(default_factory=lambda: PLACE)
    shown: tuple[Detection, ...] = field(default=())
    evidence: Float[Array, "k"] | None = None
    likeness: Float[Array, "k"] | None = None
    load_n: Float[Array, "k"] | None = None

    @property
    def stays_m2(self) -> Float[Array, "k"]:
        """Variances, on each axis, of what stays of the measurements' errors while people are seen alike [m²].

        Of a camera's it is a share of that along the sight: people are taller or smaller, and furniture hides their legs.
        """
        xx, xy, yy = self.covariance[:, 0, 0], self.covariance[:, 0, 1], self.covariance[:, 1, 1]
        along_m2 = np.hypot(xx - yy, 2 * xy)  # one axis of the covariance more than the other
        return self.kind.offset_m**2 + _STAYS * along_m2 / 2

    def evidence_of(self, column: Int[Index, "p"], confirmed: Bool[Mask, "p"] | bool = False) -> Float[Array, "p"]:
        """Return the share of evidence of the measurements at `column`, of tracks confirmed or not, that of a whole person."""
        share = np.ones(len(column)) if self.evidence is None else self.evidence[column]
        return share if self.likeness is None else share * np.where(confirmed, 1.0, self.likeness[column])

    @property
    def alike_s(self) -> float:
        """Time in which all looks together tell of a posture what one tells [s]: how an outline shows a body stays so."""
        return max(self.kind.lasts_s, ALIKE_S) if self.observes is OUTLINE else self.kind.lasts_s

    @property
    def of_heads(self) -> bool:
        """Tell whether the measurements are of heads."""
        return self.observes is HEAD_PLACE

    @property
    def of_legs(self) -> bool:
        """Tell whether the measurements are of legs, loads of their feet among them."""
        return self.observes is LEGS


class Source(Protocol):
    """Sensors of one kind that are looked at together."""

    @property
    def names(self) -> tuple[str, ...]:
        """The sensors."""
        ...

    @property
    def learns_background(self) -> bool:
        """True where the background is learned from the observations as they come."""
        ...

    @property
    def of_legs(self) -> bool:
        """True where legs are measured, not bodies."""
        ...

    def look(self, observations: Mapping[str, Observation], expected: Expected, ns: int) -> Look | None:
        """Return what the observations measure; None where they are of other sensors, or blind."""
        ...


def most_nats(p_detect: Float[Array, "p"] | float) -> Float[Array, "p"]:
    """Return the log-likelihood ratio of a detection at most, by detection probability [nat].

    What is no person and stays looks like one at every look: a sensor shows no more than that it detects people.
    """
    return _TRUST * np.log(np.divide(p_detect, np.subtract(1.0, p_detect)))


def round_covariance(variance_m2: Float[Array, "k"]) -> Float[Array, "k 2 2"]:
    """Return covariances of the same variance on each axis."""
    return variance_m2[:, None, None] * np.eye(2)


def detections_of(
    ns: int, sensors: tuple[str, ...], role: str, position: Float[Array, "k 2"], covariance: Float[Array, "k 2 2"]
) -> tuple[Detection, ...]:
    """Return measurements one by one, as trackers hand them out."""
    variance = covariance.trace(axis1=1, axis2=2) / 2
    rows = zip(position.tolist(), variance.tolist(), strict=True)
    return tuple(Detection(ns, sensors, role, x, y, m2) for (x, y), m2 in rows)
