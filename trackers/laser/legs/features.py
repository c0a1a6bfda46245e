"""Features of the clusters of one scan, from which a classifier tells legs from everything else.

Geometry of a cluster by itself (Arras, Martínez Mozos and Burgard, "Using boosted features for the detection of people in 2D
range data", ICRA 2007: points, width, spread, linearity, circularity, boundary length and regularity, curvature, range jumps to
its neighbours; Xavier, Pacheco, Castro, Ruano and Nunes, ICRA 2005: inscribed angles), and about it: the next clusters, and where
the beams beside it go on. Lengths are in metres and none counts beams, so that scanners of any resolution look alike; what is
to the left and to the right is sorted, so that a mirrored scene has the same features.
"""

from __future__ import annotations

import numpy as np

from trackers.arrays import Array, Float, Index, Int
from trackers.filters.gating import distances
from trackers.laser.bearings import beams_of_turn, returns
from trackers.laser.clusters import ClusterOptions, Clusters, directions, find_clusters
from trackers.observations import LaserScan

LEG_CLUSTERS = ClusterOptions(jump_m=0.08, jump_spacings=1.0, max_gap_beams=1, min_samples=1, min_width_m=0.0)
"""Clusters that legs are looked for among: all of a scan, whatever their size."""

NAMES = (
    "range", "spacing", "samples", "extent", "width", "spread_along", "spread_across", "linearity", "slant", "depth",
    "bulge", "radius", "circularity", "length", "regularity", "turn", "curvature", "inscribed", "inscribed_spread",
    "jump_near", "jump_far", "second_jump_near", "second_jump_far", "clear_near_a", "clear_near_b", "clear_a", "clear_b",
    "hidden_a", "hidden_b", "behind", "next", "next_width", "next_depth", "next_extent", "second", "second_width", "legs_m",
    "surface_half_m", "surface_1m",
)  # fmt: skip
"""Names of the features, in their order. a and b: the sides by size; near: within 0.15 m of the cluster's ends."""

_FAR_M = 3.0
"""Jumps and gaps larger than this are alike [m]."""
_PAST_M = 0.3
"""Depth by which a beam passes, or misses, a cluster [m]."""
_BESIDE_M = np.array([0.03, 0.06, 0.1, 0.15, 0.2, 0.27, 0.35, 0.45])
"""Distances beside a cluster at which the beams are asked [m]."""
_N_NEAR = 4
_LEG_M = (0.04, 0.25)
"""Widths of what may be a leg [m]."""
_TINY = 1e-9


def leg_clusters(scan: LaserScan) -> Clusters:
    """Find all clusters of a scan, the room's among them; beams in counter-clockwise order."""
    return find_clusters(scan, returns(scan)[1], LEG_CLUSTERS)


def cluster_features(scan: LaserScan, clusters: Clusters) -> Float[Array, "k features"]:
    """Compute the features of the `leg_clusters` of a scan, in the order of `NAMES`; beams in counter-clockwise order."""
    if len(clusters) == 0:
        return np.empty((0, len(NAMES)))
    turn = beams_of_turn(scan)
    ranges, hit, _ = returns(scan)
    reach = np.where(hit, ranges, np.where(np.isnan(ranges), 0.0, np.inf))[:turn]
    spacing = abs(scan.angle_increment_rad) * clusters.range_m
    own = _own(scan, clusters, ranges, spacing)
    extent, width, depth = own[:, 3], own[:, 4], own[:, 9]
    beside = _beside(reach, clusters, spacing, turn is not None)
    features = np.column_stack([own, beside, _about(clusters.middle, width, depth, extent)])
    return np.round(features, 9)  # nought is nought, in a mirrored scene too


def own_samples(scan: LaserScan, clusters: Clusters) -> tuple[Int[Index, "n"], Int[Index, "k"]]:
    """Return the beams of all clusters' samples, one cluster after the other, and where each cluster starts among them."""
    hits = returns(scan)[1][: beams_of_turn(scan)].nonzero()[0]
    n = clusters.n_sample
    starts = np.cumsum(n) - n
    place = np.arange(n.sum()) + np.repeat(np.searchsorted(hits, clusters.first_beam) - starts, n)
    return hits[place % hits.size], starts


def _own(
    scan: LaserScan, clusters: Clusters, ranges: Float[Array, "n_beam"], spacing: Float[Array, "k"]
) -> Float[Array, "k 19"]:
    """Geometry of each cluster by itself."""
    n = clusters.n_sample
    beam, starts = own_samples(scan, clusters)
    of = np.repeat(np.arange(n.size), n)
    points = ranges[beam] * directions(scan)[:, beam]

    def mean(values: Array) -> Array:
        return np.add.reduceat(values, starts) / n

    # along: away from the scanner; across: to the left of that
    ahead = clusters.middle.T / np.maximum(clusters.range_m, _TINY)
    off = points - clusters.middle.T[:, of]
    along = off[0] * ahead[0, of] + off[1] * ahead[1, of]
    across = off[1] * ahead[0, of] - off[0] * ahead[1, of]
    aa, ac, cc = mean(along**2), mean(along * across), mean(across**2)
    root = np.sqrt((aa - cc) ** 2 / 4 + ac**2)
    major, minor = np.sqrt(np.maximum((aa + cc) / 2 + root, 0)), np.sqrt(np.maximum((aa + cc) / 2 - root, 0))
    linearity = np.round(minor / np.maximum(major, 1e-3), 6)  # a root of a rounded nought
    slant = np.abs(0.5 * np.arctan2(2 * ac, cc - aa))  # 0: across the beam
    last = starts + n - 1
    middle_along = np.where(n > 2, (along[starts + (n - 1) // 2] + along[starts + n // 2]) / 2, 0.0)
    bulge = (along[starts] + along[last]) / 2 - middle_along  # ends behind the middle: round
    radius, circularity = _circle(along, across, of, starts, n)

    step = np.diff(points, append=points[:, -1:])
    same = np.diff(of, append=-1) == 0
    step_m = np.where(same, np.hypot(step[0], step[1]), 0.0)
    n_step = np.maximum(n - 1, 1)
    length = np.add.reduceat(step_m, starts)
    mean_step = length / n_step
    squares = np.add.reduceat(np.where(same, (step_m - mean_step[of]) ** 2, 0.0), starts)
    heading = np.arctan2(step[1], step[0])
    turns = np.angle(np.exp(1j * np.diff(heading, append=0.0)))
    inner = same & np.append(same[1:], False)
    turns = np.where(inner, turns, 0.0)
    n_turn = np.maximum(n - 2, 1)
    turn = np.add.reduceat(np.abs(turns), starts) / n_turn
    curvature = np.add.reduceat(turns, starts) / np.maximum(length, 0.01)
    inscribed, inscribed_spread = _inscribed(points, of, starts, last, n)
    width = np.hypot(*(points[:, last] - points[:, starts]))
    thickness = np.maximum.reduceat(along, starts) - np.minimum.reduceat(along, starts)
    return np.column_stack([
        clusters.range_m, spacing, np.minimum(n, 30), n * spacing, width, np.sqrt(aa), np.sqrt(cc),
        linearity, slant, thickness, bulge, radius, circularity, length, np.sqrt(squares / n_step),
        turn, np.clip(curvature, -30, 30), inscribed, inscribed_spread,
    ])  # fmt: skip


def _circle(
    along: Float[Array, "n"],
    across: Float[Array, "n"],
    of: Int[Index, "n"],
    starts: Int[Index, "k"],
    n: Int[Index, "k"],
) -> tuple[Float[Array, "k"], Float[Array, "k"]]:
    """Fit circles by Kåsa's least squares: signed radius [m], positive for a bulge towards the scanner, and the relative error.

    Samples are centred, so that the sums of first order vanish; a millimetre of noise keeps a line from having none.
    """

    def mean(values: Array) -> Array:
        return np.add.reduceat(values, starts) / n

    square = along**2 + across**2
    aa, cc, ac, z = mean(along**2) + 1e-6, mean(across**2) + 1e-6, mean(along * across), mean(square)
    az, cz = mean(along * square), mean(across * square)
    determinant = aa * cc - ac**2
    a, c = (az * cc - cz * ac) / determinant / 2, (cz * aa - az * ac) / determinant / 2
    radius = np.sqrt(z + a**2 + c**2)
    error = mean((square - z[of] - 2 * along * a[of] - 2 * across * c[of]) ** 2)
    # two samples lie on circles to either side
    return np.clip(np.sign(np.round(a, 9)) * radius, -1, 1), np.sqrt(error) / (2 * np.maximum(radius, 0.01))


def _inscribed(
    points: Float[Array, "2 n"], of: Int[Index, "n"], starts: Int[Index, "k"], last: Int[Index, "k"], n: Int[Index, "k"]
) -> tuple[Float[Array, "k"], Float[Array, "k"]]:
    """Mean and standard deviation of the angles under which inner samples see the ends of their cluster [rad]; π: a line."""
    first_off, last_off = points[:, starts[of]] - points, points[:, last[of]] - points
    dot = (first_off * last_off).sum(axis=0)
    angle = np.arctan2(np.abs(first_off[0] * last_off[1] - first_off[1] * last_off[0]), dot)
    inner = np.ones(of.size, np.bool_)
    inner[starts] = inner[last] = False
    count = np.maximum(n - 2, 1)
    mean = np.where(n > 2, np.add.reduceat(np.where(inner, angle, 0.0), starts) / count, np.pi)
    square = np.add.reduceat(np.where(inner, (angle - mean[of]) ** 2, 0.0), starts) / count
    return mean, np.sqrt(square)


def _beside(
    reach: Float[Array, "n_beam"], clusters: Clusters, spacing: Float[Array, "k"], is_turn: bool
) -> Float[Array, "k 11"]:
    """Range jumps at the ends of each cluster, and which beams beside it pass or are hidden; sides sorted.

    reach: how far each beam came, infinite where it met nothing, 0 where it says nothing.
    """
    range_m, count = clusters.range_m[:, None], reach.size
    away = np.maximum(np.rint(_BESIDE_M / np.maximum(spacing, _TINY)[:, None]), 1).astype(np.intp)
    away = np.concatenate([np.tile([[1, 2]], (len(clusters), 1)), away], axis=1)
    beams = np.stack([clusters.first_beam[:, None] - away, clusters.last_beam[:, None] + away])  # (2, k, places)
    inside = (beams >= 0) & (beams < count) | is_turn
    gap = np.where(inside, reach[beams % count], 0.0) - range_m
    gap = np.clip(np.where(inside, gap, -_FAR_M), -_FAR_M, _FAR_M)
    jump, second, beside = gap[..., 0], gap[..., 1], gap[..., 2:]
    past, hidden = beside > _PAST_M, beside < -_PAST_M
    columns = (
        jump, second, past[..., :_N_NEAR].mean(axis=-1), past[..., _N_NEAR:].mean(axis=-1), hidden.mean(axis=-1)
    )  # fmt: skip
    behind = np.where(past, beside, np.inf).min(axis=(0, 2))
    return np.column_stack([*(part for each in columns for part in np.sort(each, axis=0)), np.minimum(behind, _FAR_M)])


def _about(
    middle: Float[Array, "k 2"], width: Float[Array, "k"], depth: Float[Array, "k"], extent: Float[Array, "k"]
) -> Float[Array, "k 9"]:
    """Distances and sizes of the two nearest other clusters, and how much there is around."""
    apart = distances(middle, middle)
    np.fill_diagonal(apart, np.inf)
    rows = np.arange(len(middle))
    nearest = apart.argmin(axis=1)
    to_next = apart[rows, nearest]
    others = apart.copy()
    others[rows, nearest] = np.inf
    following = others.argmin(axis=1)
    to_second = others[rows, following]
    alike = (width >= _LEG_M[0]) & (width <= _LEG_M[1])
    to_leg = np.where(alike, apart, np.inf).min(axis=1)
    around = [np.where(apart < limit, np.minimum(extent, 2.0), 0.0).sum(axis=1) for limit in (0.5, 1.0)]
    one = np.isfinite(to_next), np.isfinite(to_second)
    return np.column_stack([
        np.minimum(to_next, _FAR_M), np.where(one[0], width[nearest], 0), np.where(one[0], depth[nearest], 0),
        np.where(one[0], extent[nearest], 0), np.minimum(to_second, _FAR_M), np.where(one[1], width[following], 0),
        np.minimum(to_leg, _FAR_M), around[0], around[1],
    ])  # fmt: skip
