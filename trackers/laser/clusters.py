"""From foreground samples to clusters: split where neighbouring samples jump, one representative point each.

Clusters are in the scanner's frame (x ahead, y left), the detections made of them in the room's. Samples are in order of
angle. In a full turn the first beam follows the last, and a cluster may cross the seam.

Detections become one measurement per person: arms are merged with their trunk, two legs with one another (ours; the paper is
silent).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from pydantic import Field, NonNegativeInt, PositiveInt

from trackers.arrays import Array, Bool, Float, Index, Int, Mask
from trackers.configuration import Strict
from trackers.filters.gating import distances, max_weight_assignment
from trackers.filters.rows import Rows
from trackers.laser.bearings import beams_of_turn, returns
from trackers.observations import LaserScan

STRIDE_M = 0.8
"""Greatest distance between the two legs of a tracked person [m]: a runner's, at knee height."""
PAIR_M = 0.5
"""Distance below which two legs without a track are one person's [m]."""


class ClusterOptions(Strict):
    """Options of the clusters at one height."""

    jump_m: float = Field(
        default=0.15, gt=0, description="distance between neighbouring samples above which a cluster is split [m]"
    )
    jump_spacings: float = Field(
        default=2.0, ge=0, description="added to `jump_m`: this many spacings of the beams at the samples' range"
    )
    max_gap_beams: NonNegativeInt = Field(
        default=1, description="beams that may look past a cluster without splitting it"
    )
    min_samples: PositiveInt = Field(default=3, description="least samples of a cluster")
    min_width_m: float = Field(
        default=0.04,
        ge=0,
        description="least width of a cluster, as the number of beams that a thing so wide returns at its range [m]",
    )


@dataclass(frozen=True, eq=False)
class Clusters(Rows):
    """k clusters of one scan, by angle."""

    first_beam: Int[Index, "k"]
    last_beam: Int[Index, "k"]  # lower than the first of a cluster across the seam
    n_sample: Int[Index, "k"]
    middle: Float[Array, "k 2"]  # mean of the samples [m]
    width_m: Float[Array, "k"]  # from the first sample to the last
    range_m: Float[Array, "k"]  # of the middle
    hidden_before: Bool[Mask, "k"]  # whether a nearer object begins where the cluster starts: it may continue behind
    hidden_after: Bool[Mask, "k"]  # likewise where it ends


def find_clusters(
    scan: LaserScan, foreground: Bool[Mask, "n_beam"], options: ClusterOptions, min_samples: int | None = None
) -> Clusters:
    """Find the clusters among the foreground samples of a scan; min_samples: overrides the options'.

    Two consecutive foreground samples are split if they are farther apart than `jump_m` plus the spacing of the beams, or if
    more than `max_gap_beams` beams passed between them. (The paper compares ranges; the distance between the points also
    holds across a lost beam.)
    """
    turn = beams_of_turn(scan)
    ranges, hit, missed = returns(scan)
    ranges, hit, missed, foreground = ranges[:turn], hit[:turn], missed[:turn], foreground[:turn]
    beams = foreground.nonzero()[0]
    if beams.size == 0:
        return _none()
    looked_past = ((hit | missed) & ~foreground).cumsum(dtype=np.intp)
    if turn is not None:
        beams = _from_a_gap(beams, looked_past, options.max_gap_beams, ranges)
    increment = abs(scan.angle_increment_rad)
    near = ranges[beams]
    points = near * directions(scan)[:, beams]  # (2, n)

    step = points[:, 1:] - points[:, :-1]
    jump = options.jump_m + options.jump_spacings * (increment * np.minimum(near[1:], near[:-1]))
    seen_past = looked_past[beams]
    seen_past[beams < beams[0]] += looked_past[-1]
    splits = (np.hypot(step[0], step[1]) > jump) | (seen_past[1:] - seen_past[:-1] > options.max_gap_beams)
    edges = np.concatenate([[0], splits.nonzero()[0] + 1, [beams.size]])
    starts, stops = edges[:-1], edges[1:]

    n_sample = stops - starts
    middle = np.add.reduceat(points, starts, axis=1) / n_sample
    range_m = np.hypot(middle[0], middle[1])
    expected = options.min_width_m / (increment * range_m)
    least = options.min_samples if min_samples is None else min_samples
    kept = n_sample >= np.maximum(least, np.minimum(expected, foreground.size))
    starts, stops, range_m = starts[kept], stops[kept], range_m[kept]
    first, last = beams[starts], beams[stops - 1]
    hidden_before, hidden_after = _hidden(np.where(hit, ranges, np.inf), turn, first, last, range_m, options.jump_m)
    return Clusters(
        first_beam=first,
        last_beam=last,
        n_sample=n_sample[kept],
        middle=middle[:, kept].T,
        width_m=_width(points, starts, stops),
        range_m=range_m,
        hidden_before=hidden_before,
        hidden_after=hidden_after,
    )


def padded_ranges(ranges: Float[Array, "n_beam"], turn: int | None, reach: int) -> Float[Array, "n_padded"]:
    """Return ranges with `reach` more at either end: the next ones of a full turn, or +inf beside the field of view."""
    padded = np.full(ranges.size + 2 * reach, np.inf)
    padded[reach:-reach] = ranges
    if turn is not None:
        padded[:reach], padded[-reach:] = ranges[-reach:], ranges[:reach]
    return padded


def _from_a_gap(
    beams: Int[Index, "n"], looked_past: Int[Index, "n_beam"], max_gap_beams: int, ranges: Float[Array, "n_beam"]
) -> Int[Index, "n"]:
    """Return the foreground beams of a full turn, starting after a gap, so that no cluster crosses the end.

    Without a gap, starting after the largest step of the range.
    """
    between = np.diff(np.append(looked_past[beams], looked_past[beams[0]] + looked_past[-1]))
    if between.max() <= max_gap_beams:
        steps = np.abs(np.diff(ranges[np.append(beams, beams[0])]))
        return np.roll(beams, -1 - steps.argmax())
    return beams if between[-1] > max_gap_beams else np.roll(beams, -1 - between.argmax())


def directions(scan: LaserScan) -> Float[Array, "2 n_beam"]:
    """Return the unit vectors along the beams of a scan."""
    return _directions(scan.angle_min_rad, scan.angle_increment_rad, scan.ranges_m.size)


@lru_cache(maxsize=16)
def _directions(angle_min_rad: float, angle_increment_rad: float, n_beam: int) -> Float[Array, "2 n"]:
    bearing = angle_min_rad + angle_increment_rad * np.arange(n_beam)
    return np.array([np.cos(bearing), np.sin(bearing)])


def pushed_back(middle: Float[Array, "k 2"], depth_m: Float[Array, "k"] | float) -> Float[Array, "k 2"]:
    """Return points moved `depth_m` along their beam, away from the scanner (ours, not the paper's).

    The samples lie on the near side of a body; its axis is about half a body's depth behind their middle.
    """
    range_m = np.maximum(np.hypot(middle[:, 0], middle[:, 1]), 1e-9)
    return middle * (1 + depth_m / range_m)[:, None]


def _width(points: Float[Array, "2 n"], starts: Int[Index, "k"], stops: Int[Index, "k"]) -> Float[Array, "k"]:
    """Return the distance from the first sample of each cluster to its last [m]."""
    ends = points[:, stops - 1] - points[:, starts]
    return np.hypot(ends[0], ends[1])


def _hidden(
    ranges: Float[Array, "n_beam"],
    turn: int | None,
    first: Int[Index, "k"],
    last: Int[Index, "k"],
    range_m: Float[Array, "k"],
    jump_m: float,
) -> tuple[Bool[Mask, "k"], Bool[Mask, "k"]]:
    """Return masks of clusters beside a nearer object, by more than a jump, in one of the two beams next to either end.

    Two, because a beam on an edge may report a range between both sides.
    """
    padded = padded_ranges(ranges, turn, 2)
    nearer = range_m - jump_m
    before = np.minimum(padded[first], padded[first + 1]) < nearer
    after = np.minimum(padded[last + 3], padded[last + 4]) < nearer
    return before, after


def _none() -> Clusters:
    index, number, mask = np.empty(0, np.intp), np.empty(0), np.empty(0, np.bool_)
    return Clusters(index, index, index, np.empty((0, 2)), number, number, mask, mask)


@dataclass(frozen=True, eq=False)
class Detections(Rows):
    """k detections in front of the room in the scans of one frame; positions are in the room frame."""

    position: Float[Array, "k 2"]  # of the body's or leg's axis [m]
    variance_m2: Float[Array, "k"]  # of the position on each axis, beyond the measurement noise
    n_sample: Int[Index, "k"]  # of all scanners
    width_m: Float[Array, "k"]
    range_m: Float[Array, "k"]  # from the first scanner that detects it to the middle of the samples
    angle: Float[Array, "k 2"]  # of the first sample and the last in that scanner's frame [rad]
    scanner: Bool[Mask, "k s"]  # which of s scanners detect it

    def of_scanner(self, column: int, n_scanner: int) -> Detections:
        """Return the detections as one of several scanners'."""
        scanner = np.zeros((len(self), n_scanner), np.bool_)
        scanner[:, column] = True
        return self.changed(scanner=scanner)

    def sight_lines(self, origins: Float[Array, "s 2"]) -> Float[Array, "k s 2"]:
        """Return unit vectors to the detections from the scanners, at `origins` [m], that detect them; 0 from the others."""
        along = self.position[:, None] - origins
        length_m = np.maximum(np.hypot(along[..., 0], along[..., 1]), 1e-9)
        return along * (self.scanner / length_m)[..., None]

    @classmethod
    def none(cls, n_scanner: int = 1) -> Detections:
        """Make a value that holds no detections."""
        nothing, by_none = np.empty(0), np.empty((0, n_scanner), np.bool_)
        return cls(np.empty((0, 2)), nothing, np.empty(0, np.intp), nothing, nothing, np.empty((0, 2)), by_none)


def trunks(
    position: Float[Array, "k 2"],
    width_m: Float[Array, "k"],
    hidden: Bool[Mask, "k"],
    satellite_width_m: float,
    reach_m: float,
    arm_reach_m: float,
    apart_m: float,
) -> Bool[Mask, "k"]:
    """Return a mask of the k clusters that are trunks: the widest part of every body.

    From the widest down, each remaining cluster is a trunk, and absorbs all within `apart_m`, where no other person can
    stand, and narrow ones about its axis: up to `arm_reach_m` those in full view, as a visible trunk is never so narrow; up
    to `reach_m` partly `hidden` ones, such as the far side of a trunk divided by its own arm. Beyond, a narrow hidden
    cluster is a person behind.
    """
    apart, kept = distances(position, position), np.ones(len(width_m), np.bool_)
    near = (apart < np.where(hidden, reach_m, arm_reach_m)) & (width_m < satellite_width_m)
    near |= apart < apart_m
    near &= width_m <= width_m[:, None]
    np.fill_diagonal(near, False)
    if not np.count_nonzero(near):
        return kept
    for one in (-width_m).argsort(kind="stable").tolist():  # each choice depends on those before it
        if kept[one]:
            kept &= ~near[one]
    return kept


def take_legs(
    legs: Float[Array, "k 2"],
    both_together: Bool[Mask, "k"],
    expected: Float[Array, "n 2"],
    reach_m: Float[Array, "n"] | float,
    stride_m: float,
    opposite: Float[Array, "n"] | float = 0.0,
    forbidden: Bool[Mask, "n k"] | None = None,
) -> tuple[Float[Array, "n 2"], Int[Index, "n"], Bool[Mask, "k"]]:
    """Assign legs to people expected at these places [m], two to each, by least squares.

    The two legs of a person are at most `reach_m` from it and `stride_m` apart; one cluster may be `both_together`. An
    unassigned leg costs as much as one at `reach_m`: the likeliest assignment for legs distributed as a Gaussian about
    bodies. So each leg goes to the nearest person, unless that one has two nearer legs. All but the nearest of each person
    are then assigned once more: as second legs by the distance from their position predicted by the first, and as first ones
    to a person without any. opposite: minus the correlation of a person's two legs about the place, below 1; 0 if both may
    be on one side, as of a sitting person. forbidden: impossible pairs.

    Returns the position of each person, the middle of their legs; the number of legs of each, 0 leaving the position as
    expected; and a mask of the unassigned legs.
    """
    n, k = len(expected), len(legs)
    position, n_leg, free = expected.copy(), np.zeros(n, np.intp), np.ones(k, np.bool_)
    if n == 0 or k == 0:
        return position, n_leg, free
    away = distances(expected, legs)
    if forbidden is not None:
        away[forbidden] = np.inf
    reach, against = ((np.zeros(n) + each)[:, None] for each in (reach_m, opposite))
    worth = reach**2 - away**2
    places, leg = max_weight_assignment(np.concatenate([worth, worth]))
    person = places % n
    farthest_first = away[person, leg].argsort(kind="stable")[::-1]
    nearest = np.full(n, -1)
    nearest[person[farthest_first]] = leg[farthest_first]  # the last written stays
    person = (nearest >= 0).nonzero()[0]
    first = nearest[person]
    position[person], n_leg[person], free[first] = legs[first], 1 + both_together[first], False

    others = free.nonzero()[0]
    place, spread, near = expected.copy(), np.ones((n, 1)), np.isfinite(away[:, others])
    place[person] += against[person] * (expected[person] - legs[first])
    spread[person] = np.sqrt(1 - against[person] ** 2)
    near[person] &= distances(legs[first], legs[others]) < stride_m
    off = distances(place, legs[others]) / spread
    person, column = max_weight_assignment(np.where(near, reach**2 - off**2, 0.0))
    also, had = others[column], n_leg[person] > 0
    position[person] = np.where(had[:, None], 0.5 * (position[person] + legs[also]), legs[also])
    n_leg[person], free[also] = 1 + (had | both_together[also]), False
    return position, n_leg, free


def pair_off(
    legs: Float[Array, "k 2"], pair_m: float, sufficient: Bool[Mask, "k"] | None = None
) -> tuple[Float[Array, "p 2"], Int[Index, "p"]]:
    """Return people from unassigned legs, and the number of legs of each.

    Legs are paired from the closest up, at most `pair_m` apart, so that two people side by side, whose own legs are closer
    than the neighbours', stay two. sufficient: legs that count as a person even alone (None: all).
    """
    if not len(legs):
        return legs, np.empty(0, np.intp)
    free = np.ones(len(legs), np.bool_)
    people = []
    first, second, apart = _pairs(legs, pair_m)
    closest_first = apart.argsort(kind="stable")
    for one, other in zip(first[closest_first].tolist(), second[closest_first].tolist(), strict=True):
        if free[one] and free[other]:
            free[one] = free[other] = False
            people.append(0.5 * (legs[one] + legs[other]))
    if sufficient is not None:
        free &= sufficient
    position = np.concatenate([np.reshape(people, (-1, 2)), legs[free]])
    return position, np.repeat(np.array([2, 1], np.intp), [len(people), free.sum()])


def _pairs(
    points: Float[Array, "k 2"], limit_m: float
) -> tuple[Int[Index, "pairs"], Int[Index, "pairs"], Float[Array, "pairs"]]:
    """Return all pairs of points nearer than `limit_m`: first, second, distance."""
    apart = distances(points, points)
    first, second = (apart < limit_m).nonzero()
    once = first < second  # each pair once
    first, second = first[once], second[once]
    return first, second, apart[first, second]
