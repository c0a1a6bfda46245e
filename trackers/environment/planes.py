"""Planes of a room in its point cloud: floor, ceiling and walls.

Walls are searched above the furniture, where most rooms have nothing else (Okorn et al. 2010, Toward automated modeling of
floor plans). They are lines in the plan: found one after another by a Hough transform (Duda and Hart 1972) over the cells of
the plan, then fitted to the points by total least squares.
"""

from __future__ import annotations

import numpy as np

from trackers.arrays import Array, Bool, Float, Mask

_BIN_M = 0.01
_STRONG = 0.25
"""Least number of points of a floor or ceiling, relative to the fullest level."""
_ROOM_M = 2.0
"""Least height of a ceiling above its floor [m]."""

WALL_FROM_M, WALL_TO_M = 2.0, 3.2
"""Heights above the floor between which walls are searched [m]: over the furniture, under most galleries."""
_BELOW_CEILING_M = 0.1
_CELL_M = 0.05
_ANGLES = 360
_FILLED = 0.3
"""Least filled share of its height for a cell of the plan to be wall."""
_NEAR_M = 0.06
"""Distance of cells that belong to a line [m]."""
_GAP_M = 0.5
_SHORTEST_M = 0.6
_FEWEST_POINTS = 20
_CORNER_M = 0.25
"""Distance from another wall's line within which a wall's end is moved onto it [m]."""
_MOST_WALLS = 100


def find_floor(z: Float[Array, "n"]) -> float:
    """Find the floor's height [m] in the heights of all points: the lowest level with many of them."""
    edges, counts = _levels(z)
    lowest = int(np.flatnonzero(counts >= _STRONG * counts.max())[0])
    return _settle(z, float(edges[lowest]))


def find_ceiling(z: Float[Array, "n"], floor_m: float) -> float:
    """Find the ceiling's height [m]: the highest level with many points; NaN where none was seen."""
    edges, counts = _levels(z)
    strong = np.flatnonzero((counts >= _STRONG * counts.max()) & (edges > floor_m + _ROOM_M))
    return _settle(z, float(edges[strong[-1]])) if strong.size else float("nan")


def find_walls(points: Float[Array, "n 3"], floor_m: float, ceiling_m: float) -> Float[Array, "w 2 2"]:
    """Find the walls as segments in plan [m], the room to the left from first end to second.

    points: in the room frame [m]. Any flat, upright face at least 0.6 m long and taller than two metres is a wall, also of a
    pillar or a high wardrobe.
    """
    low = floor_m + WALL_FROM_M
    high = floor_m + WALL_TO_M if np.isnan(ceiling_m) else min(floor_m + WALL_TO_M, ceiling_m - _BELOW_CEILING_M)
    band = points[(points[:, 2] > low) & (points[:, 2] < high)]
    if high - low < 2 * _CELL_M or not len(band):
        return np.empty((0, 2, 2))
    cells, weights = _tall_cells(band, (high - low) / _CELL_M)
    middle = np.median(points[:, :2], axis=0)
    found: list[Array] = []
    while len(found) < _MOST_WALLS and len(cells) * _CELL_M > _SHORTEST_M:
        normal, offset = _strongest_line(cells, weights)
        own = np.abs(cells @ normal - offset) < 2 * _NEAR_M
        if own.sum() * _CELL_M < _SHORTEST_M:
            break
        for start, end in _runs(cells[own] @ _turned(normal)):
            found.append(_through_points(band[:, :2], normal, offset, start, end))
            own |= _near_wall(cells, found[-1])
        cells, weights = cells[~own], weights[~own]
    walls = np.array([_facing(wall, band[:, :2], middle) for wall in found]).reshape(-1, 2, 2)
    return _meet_at_corners(walls)


def _levels(z: Float[Array, "n"]) -> tuple[Float[Array, "levels"], Float[Array, "levels"]]:
    """Return lower edges and counts of levels of the heights, smoothed over neighbours because of noise."""
    first = np.floor(z.min() / _BIN_M) - 2
    bins = (z / _BIN_M - first).astype(np.intp)
    counts = np.convolve(np.bincount(bins, minlength=bins.max() + 3), np.ones(3), mode="same")
    return (first + np.arange(len(counts))) * _BIN_M, counts


def _settle(z: Float[Array, "n"], level: float) -> float:
    """Return the median height [m] of the points around a level."""
    middle = level + _BIN_M / 2
    for reach in (0.03, 0.02):
        middle = float(np.median(z[np.abs(z - middle) < reach]))
    return middle


def _tall_cells(band: Float[Array, "n 3"], layers: float) -> tuple[Float[Array, "c 2"], Float[Array, "c"]]:
    """Return mean position [m] and weight of the plan's cells whose points fill enough of the height of the band."""
    low = band.min(axis=0)
    cell = ((band - low) / _CELL_M).astype(np.int64)
    shape = cell.max(axis=0) + 1
    voxel = np.unique((cell[:, 0] * shape[1] + cell[:, 1]) * shape[2] + cell[:, 2])
    column = cell[:, 0] * shape[1] + cell[:, 1]
    filled = np.bincount(voxel // shape[2], minlength=shape[0] * shape[1])
    counts = np.maximum(np.bincount(column, minlength=len(filled)), 1)
    place = np.stack([np.bincount(column, band[:, axis], len(filled)) / counts for axis in (0, 1)], axis=-1)
    tall = filled >= _FILLED * layers
    return place[tall], filled[tall].astype(float)


def _strongest_line(cells: Float[Array, "c 2"], weights: Float[Array, "c"]) -> tuple[Float[Array, "2"], float]:
    """Find the normal and offset [m] of the line with the largest weight."""
    angles = np.arange(_ANGLES) * np.pi / _ANGLES
    normals = np.stack([np.cos(angles), np.sin(angles)])  # (2, a)
    offsets = cells @ normals  # (c, a)
    low = offsets.min() - _CELL_M
    bins = ((offsets - low) / _CELL_M).astype(np.intp)
    count = int(bins.max()) + 2
    votes = np.bincount((np.arange(_ANGLES) * count + bins).ravel(), np.repeat(weights, _ANGLES), _ANGLES * count)
    table = votes.reshape(_ANGLES, count)
    table = table + np.roll(table, 1, axis=1)  # for lines on the border between two bins
    angle, place = np.unravel_index(int(table.argmax()), table.shape)
    return normals[:, angle], float(low + place * _CELL_M)


def _through_points(
    places: Float[Array, "n 2"], normal: Float[Array, "2"], offset: float, start: float, end: float
) -> Float[Array, "2 2"]:
    """Fit a segment to the points around a stretch of a line, iteratively with a narrower band."""
    ends = normal * offset + np.outer([start, end], _turned(normal))
    along = places @ _turned(normal)
    places = places[(along > start - _CELL_M) & (along < end + _CELL_M)]
    for reach in (0.12, 0.06, 0.03, 0.03):
        near = places[np.abs(places @ normal - offset) < reach]
        if len(near) < _FEWEST_POINTS:
            break
        middle = near.mean(axis=0)
        _, vectors = np.linalg.eigh(np.cov((near - middle).T))
        normal = vectors[:, 0] * np.sign(vectors[:, 0] @ normal)  # of least spread
        offset = float(np.median(near @ normal))
    return ends - np.outer(ends @ normal - offset, normal)


def _near_wall(cells: Float[Array, "c 2"], wall: Float[Array, "2 2"]) -> Bool[Mask, "c"]:
    """Return a mask of the cells at a segment."""
    way = (wall[1] - wall[0]) / np.linalg.norm(wall[1] - wall[0])
    off = cells - wall[0]
    along, across = off @ way, off @ _turned(way)
    return (np.abs(across) < _NEAR_M) & (along > -_CELL_M) & (along < np.linalg.norm(wall[1] - wall[0]) + _CELL_M)


def _turned(normal: Float[Array, "2"]) -> Float[Array, "2"]:
    """Return the direction of a line with this normal."""
    return np.array([-normal[1], normal[0]])


def _runs(along: Float[Array, "n"]) -> list[tuple[float, float]]:
    """Find the starts and ends [m] of the stretches of a line without a long gap, without short ones."""
    along = np.sort(along)
    breaks = np.flatnonzero(np.diff(along) > _GAP_M)
    starts, ends = along[np.r_[0, breaks + 1]], along[np.r_[breaks, len(along) - 1]]
    return [(float(a), float(b)) for a, b in zip(starts, ends, strict=True) if b - a >= _SHORTEST_M]


def _facing(wall: Float[Array, "2 2"], places: Float[Array, "n 2"], middle: Float[Array, "2"]) -> Float[Array, "2 2"]:
    """Direct the segment so that the room, on the side of more points, lies to its left."""
    way = wall[1] - wall[0]
    left = _turned(way) / np.linalg.norm(way)
    across = (places - wall[0]) @ left
    on_left, on_right = (across > _NEAR_M).sum(), (across < -_NEAR_M).sum()
    if on_left == on_right:
        on_left, on_right = float((middle - wall[0]) @ left), 0.0
    return wall if on_left > on_right else wall[::-1]


def _meet_at_corners(walls: Float[Array, "w 2 2"]) -> Float[Array, "w 2 2"]:
    """Move the ends of walls along them to the intersection with a nearby wall."""
    met = walls.copy()
    for number, wall in enumerate(walls):
        way = wall[1] - wall[0]
        for end in (0, 1):
            best = _CORNER_M
            for other in (each for place, each in enumerate(walls) if place != number):
                across = other[1] - other[0]
                turn = way[0] * across[1] - way[1] * across[0]
                if abs(turn) < 0.3 * np.linalg.norm(way) * np.linalg.norm(across):
                    continue  # nearly parallel
                off = other[0] - wall[0]
                corner = wall[0] + way * ((off[0] * across[1] - off[1] * across[0]) / turn)
                share = (corner - other[0]) @ across / (across @ across)
                beyond = max(-share, share - 1, 0) * np.linalg.norm(across)
                moved = float(np.linalg.norm(corner - wall[end]))
                if moved < best and beyond < _CORNER_M:
                    best, met[number, end] = moved, corner
    return met
