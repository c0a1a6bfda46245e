"""One target for a merged group (Song et al., section V.B): one set of particles that the middle of the group's points weighs.

A group is a connected component of the pairs that are merged. While their points form one cluster, all members share the
particles and have their place. Clusters that stay apart are a split: each goes on as a target of its own, about its middle.
The scanners do not tell which member is in which cluster, so that the order of tracks decides it, and after them the
classifiers (`reidentification`). A cluster gets one member, the remaining ones go to the widest.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from trackers.arrays import Array, Bool, Float, Index, Int, Mask
from trackers.filters.gating import distances, linked
from trackers.filters.particle import Cloud
from trackers.laser.group import Points
from trackers.laser_vision_learning.situations import SituationOptions, Situations
from trackers.likelihood.laser_points import Shares

_SIGMA_M = 0.1
"""Standard deviation of the middle of a group's points about its particles [m]."""


@dataclass(frozen=True, eq=False)
class GroupClusters:
    """Clusters of points of n tracks, of which those of merged groups matter, in a frame."""

    together: Bool[Mask, "n n"]  # pairs of one group whose points are in one cluster, or in none
    middle: Float[Array, "n 2"]  # of each member's cluster; NaN of others [m]
    taken: Bool[Mask, "k"]  # points of groups


def clusters_of(
    before: Situations, places: Float[Array, "n 2"], points: Points, whose: Shares, least_legs: float
) -> GroupClusters:
    """Cluster the points of each group that was merged before, and allot its members to the clusters.

    places: of the tracks [m]; least_legs: legs' widths of points from which a cluster is somebody.
    """
    n, rules = len(places), SituationOptions
    group, owner = linked(before.merged), whose.owner
    together, middle, taken = before.merged.copy(), np.full((n, 2), np.nan), np.zeros(owner.size, np.bool_)
    for each in np.flatnonzero(np.bincount(group, minlength=n) > 1).tolist():
        rows = np.flatnonzero(group == each)
        near = distances(points.place, places[rows]).min(axis=1, initial=np.inf) < rules.lateral_m
        own = np.flatnonzero(np.isin(owner, rows) | ((owner < 0) & near))
        taken[own] = True
        label = linked(distances(points.place[own], points.place[own]) < rules.link_m)
        legs = np.bincount(label, whose.weight[own], minlength=own.size)
        wide = np.flatnonzero(legs >= least_legs)
        wide = np.sort(wide[(-legs[wide]).argsort(kind="stable")[: rows.size]])
        if wide.size == 0:
            continue
        members = np.ones(wide.size, np.intp)
        for _ in range(rows.size - wide.size):
            members[(legs[wide] / members).argmax()] += 1
        part = np.repeat(np.arange(wide.size), members)
        together[np.ix_(rows, rows)] = (part[:, None] == part) & ~np.eye(rows.size, dtype=np.bool_)
        for number, cluster in enumerate(wide.tolist()):
            its = own[label == cluster]
            middle[rows[part == number]] = np.average(points.place[its], axis=0, weights=whose.weight[its])
    return GroupClusters(together, middle, taken)


def as_one(
    cloud: Cloud, moved: Cloud, before: Bool[Mask, "n n"], now: Bool[Mask, "n n"], clusters: GroupClusters
) -> Cloud:
    """Return the particles with one set for each merged group, and of each track that has split from one.

    cloud: weighed by points; moved: the same before. before, now: pairs that were, and are, merged.
    """
    places, places_before = (each.expectation(each.state[:2]).T for each in (cloud, moved))
    group, group_before = linked(now), linked(before)
    size = np.bincount(group, minlength=len(group))
    for each in np.flatnonzero(size).tolist():
        rows: Int[Index, "m"] = np.flatnonzero(group == each)
        was = np.flatnonzero(group_before == group_before[rows[0]])
        if rows.size == 1 and was.size == 1:
            continue
        known = np.isfinite(clusters.middle[rows, 0])
        middle = np.where(known[:, None], clusters.middle[rows], places[rows]).mean(axis=0)
        one = moved.select(rows[:1])
        if not np.array_equal(rows, was):
            state = one.state.copy()
            state[:2] += (middle - places_before[rows[0]])[:, None, None]
            one = replace(one, state=state)
        elif known.any():
            square = ((one.state[:2] - middle[:, None, None]) ** 2).sum(axis=0)
            one = replace(one, weights=one.weights.updated(-0.5 * square / _SIGMA_M**2))
        cloud = cloud.replaced(rows, one.select(np.zeros(rows.size, np.intp)))
    return cloud
