"""Outlines of many heads at once in pictures: ellipses, and their points' positions on the head (Suzuki et al., eq. 3).

A head is an upright ellipsoid. In the frame of its camera's ray to it (right, down, along) its shape has a lower triangular
root L: the ellipsoid is L times the unit ball. A point (x, y) of the unit disc meets the near surface at L (x, y, −√(1 − x²
− y²)), and the outline is the disc under the upper left of L: an ellipse, as all rays to the head are nearly parallel.
Projecting the middle and the ends of both axes puts it into the picture of any lens: to 1.5 % of its longer semi-axis from 1
m on (`trackers.cameras.placed` is exact for a pinhole, but slower).

Arrays have the heads last: numpy is fastest along long rows.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from trackers.arrays import Array, Bool, Float, Floats, Index, Int, Mask, Singles
from trackers.cameras.placed import CameraGroup

ASPECTS = (72, 16)
"""Steps of the angle from nose to camera over a full turn, and of the camera's elevation from −90° to 90°."""
CELLS = (16, 6)
"""Cells around a head, the first from the nose to its left, and from chin to crown."""


@dataclass(frozen=True, eq=False)
class Outlines:
    """Ellipses of n heads in pictures: centre + x · across + y · down for (x, y) in the unit disc [px].

    seen: whether the picture shows the middle. range_m: of the middle. root (6, n): L by rows. facing: from the nose to the
    camera, counter-clockwise [rad]. rise: elevation of the camera from the head [rad].
    """

    centre: Float[Singles, "2 n"]
    across: Float[Singles, "2 n"]
    down: Float[Singles, "2 n"]
    seen: Bool[Mask, "n"]
    range_m: Float[Singles, "n"]
    root: Float[Singles, "6 n"]
    facing: Float[Singles, "n"]
    rise: Float[Singles, "n"]

    def pixels(self, disc: Float[Array, "k 2"]) -> tuple[Float[Singles, "k n"], Float[Singles, "k n"]]:
        """Return columns and rows of points of the unit disc in each ellipse [px]."""
        points = np.concatenate([np.ones((len(disc), 1)), disc], axis=1, dtype=np.float32)
        columns, rows = np.stack([self.centre, self.across, self.down], axis=1)
        return points @ columns, points @ rows

    def ahead_m(self, disc: Float[Array, "k 2"]) -> Float[Singles, "k n"]:
        """Return the distances beyond the middle, along the camera's ray to it, of the surface at points of the unit disc [m]."""
        x, y, towards = _ball(disc)
        return np.concatenate([x, y, -towards], axis=1, dtype=np.float32) @ self.root[3:]

    def off_ray_m2(self, disc: Float[Array, "k 2"]) -> Float[Singles, "k n"]:
        """Return the squared distances from that ray of the surface at points of the unit disc [m²]."""
        x, y, _ = _ball(disc)
        right, slant, down, *_ = self.root
        return (x * right) ** 2 + (x * slant + y * down) ** 2

    def aspects(self) -> Int[Index, "n"]:
        """Return the viewing direction of each head, as a column of `cells_shown`."""
        return aspects(self.facing, self.rise)


def aspects(facing: Float[Floats, "*n"], rise: Float[Floats, "*#n"]) -> Int[Index, "*n"]:
    """Return the viewing direction of a head, as a column of `cells_shown`, from the angles of `Outlines` [rad]."""
    turn = np.floor(facing * (ASPECTS[0] / (2 * np.pi)))
    turn -= ASPECTS[0] * np.floor(turn / ASPECTS[0])  # exact, and several times faster than the integer remainder
    level = np.minimum(np.maximum(np.floor((rise / np.pi + 0.5) * ASPECTS[1]), 0), ASPECTS[1] - 1)
    return (turn * ASPECTS[1] + level).astype(np.intp)


def outlines(cameras: CameraGroup, heads: Float[Floats, "4 c k"], semi_axes_m: tuple[float, float, float]) -> Outlines:
    """Project heads (x, y, z [m], yaw [rad]) of semi-axes ahead, to the side and up [m] as ellipses.

    heads: k of each camera; their ellipses are concatenated camera by camera.
    """
    c, k = heads.shape[1:]
    heads = heads.astype(np.float32)  # half the bits, twice the speed, with negligible error
    off = (heads[:3] - cameras.eyes_m.T[..., None].astype(np.float32)).reshape(3, c * k)
    x, y, z = off * off
    level_m = np.sqrt(np.maximum(x + y, np.float32(1e-12)))
    range_m = np.sqrt(x + y + z)
    sine, cosine = off[2] / range_m, level_m / range_m
    east, north = off[:2] / level_m
    ahead, across_m2, up = np.square(semi_axes_m).tolist()
    facing = np.arctan2(-off[1], -off[0]) - heads[3].reshape(c * k)
    nose = np.cos(facing)
    square = nose * nose
    # the level section, along the ray and across it to the right
    hh, rr = across_m2 + (ahead - across_m2) * square, ahead - (ahead - across_m2) * square
    rh = (ahead - across_m2) * nose * np.sin(facing)
    xx = np.sqrt(rr)
    cross = rh / xx
    xy, xz = sine * cross, cosine * cross
    yy = np.sqrt(sine * sine * hh + cosine * cosine * up - xy * xy)
    yz = (sine * cosine * (hh - up) - xy * xz) / yy
    zz = np.sqrt(np.maximum(cosine * cosine * hh + sine * sine * up - xz * xz - yz * yz, 0.0))
    n = len(xx)
    points = np.empty((3, 3, n), np.float32)  # xyz, then middle and ends of the axes
    points[:] = heads[:3].reshape(3, 1, n)
    along = sine * xy
    points[0, 1] += xx * north + along * east
    points[1, 1] += along * north - xx * east
    points[2, 1] -= cosine * xy
    along = sine * yy
    points[0, 2] += along * east
    points[1, 2] += along * north
    points[2, 2] -= cosine * yy
    pixels, shown = cameras.project(points.reshape(9, c, k).transpose(1, 0, 2).reshape(c, 3, 3 * k))
    pixels = pixels.reshape(c, 2, 3, k).transpose(1, 2, 0, 3).reshape(2, 3, n).astype(np.float32)
    across, down = pixels[:, 1] - pixels[:, 0], pixels[:, 2] - pixels[:, 0]
    seen = shown[:, :k].ravel() & np.isfinite(across[0] + down[0])  # row and column are known together
    root = np.array([xx, xy, yy, xz, yz, zz])
    return Outlines(pixels[:, 0], across, down, seen, range_m, root, facing, -np.arcsin(sine))


@lru_cache(maxsize=32)
def inner_points(count: int) -> Float[Array, "k 2"]:
    """Spread points evenly over the unit disc (H. Vogel, "A better way to construct the sunflower head", 1979)."""
    number = np.arange(count) + 0.5
    radius, angle = np.sqrt(number / count), np.pi * (3 - np.sqrt(5)) * number
    return _kept(radius * np.cos(angle), radius * np.sin(angle))


@lru_cache(maxsize=32)
def ring_points(count: int, size: float, span_rad: float = np.pi) -> Float[Array, "k 2"]:
    """Spread points over an arc above the middle of the disc, `size` times as large; a half ring unless `span_rad` is less."""
    angle = (np.pi - span_rad) / 2 + span_rad * (np.arange(count) + 0.5) / count
    return _kept(size * np.cos(angle), -size * np.sin(angle))


def _kept(x: Array, y: Array) -> Float[Array, "k 2"]:
    points = np.stack([x, y], axis=-1)
    points.setflags(write=False)
    return points


def _ball(disc: Float[Array, "k 2"]) -> tuple[Float[Array, "k 1"], Float[Array, "k 1"], Float[Array, "k 1"]]:
    """Return x, y and the distance towards the camera of the unit ball's point over (x, y)."""
    x, y = np.asarray(disc.T, np.float32)[..., None]
    return x, y, np.sqrt(np.maximum(1 - x**2 - y**2, 0.0))


@lru_cache(maxsize=8)
def cells_shown(count: int) -> Int[Index, "k m"]:
    """Return the cell, by azimuth, then level, at each of `inner_points(count)` for every viewing direction of a ball."""
    x, y, towards = (each[:, :, None].astype(float) for each in _ball(inner_points(count)))
    facing = ((np.arange(ASPECTS[0]) + 0.5) / ASPECTS[0] * 2 * np.pi)[:, None]
    rise = ((np.arange(ASPECTS[1]) + 0.5) / ASPECTS[1] - 0.5) * np.pi
    azimuth = facing + np.arctan2(x, towards * np.cos(rise) + y * np.sin(rise))
    height = towards * np.sin(rise) - y * np.cos(rise)
    column = np.floor(azimuth / (2 * np.pi) * CELLS[0]).astype(np.intp) % CELLS[0]
    level = np.clip(np.floor((height + 1) / 2 * CELLS[1]), 0, CELLS[1] - 1).astype(np.intp)
    return (column * CELLS[1] + level).reshape(count, -1)
