"""Closed surfaces lofted from rings, of which bodies and clothes are made."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from trackers.arrays import Array


class Texture(NamedTuple):
    """Texture coordinates of a mesh: coordinates (k, 2), and the rows of these at the corners of each face (m, 3).

    u from the back over the right side, front (0.5) and left side to the back again, v from bottom to top.
    """

    coordinates: Array
    face: NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Surface:
    """A closed triangle mesh: vertex (n, 3) [m], face (m, 3), and a function to its texture, worked out for pictures alone."""

    vertex: Array
    face: NDArray[np.intp]
    texture: Callable[[], Texture]

    def __add__(self, other: Surface) -> Surface:
        """Return both as one mesh of two parts."""

        def texture() -> Texture:
            own, others = self.texture(), other.texture()
            return Texture(
                np.vstack([own.coordinates, others.coordinates]),
                np.vstack([own.face, others.face + len(own.coordinates)]),
            )

        vertex = np.vstack([self.vertex, other.vertex])
        return Surface(vertex, np.vstack([self.face, other.face + len(self.vertex)]), texture)

    def moved(self, by: ArrayLike) -> Surface:
        """Return the surface shifted by (3,) [m]."""
        return replace(self, vertex=self.vertex + np.asarray(by))

    def turned(self, pitch_rad: float) -> Surface:
        """Return the surface turned about the y axis, forward and down."""
        c, s = np.cos(pitch_rad), np.sin(pitch_rad)
        rotation = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
        return replace(self, vertex=self.vertex @ rotation.T)

    def mirrored(self) -> Surface:
        """Return the surface with left and right exchanged, its texture with it."""

        def texture() -> Texture:
            own = self.texture()
            return Texture(own.coordinates, own.face[:, ::-1])

        return Surface(self.vertex * (1, -1, 1), self.face[:, ::-1], texture)

    def painted(self, u: float, v: float) -> Surface:
        """Return the surface in the colour of one texture coordinate."""
        return replace(self, texture=lambda: Texture(np.array([[u, v]]), np.zeros_like(self.face)))

    def tiled(self, around: float, along: float) -> Surface:
        """Return the surface with its texture repeated so many times around and along."""

        def texture() -> Texture:
            own = self.texture()
            return Texture(own.coordinates * (around, along), own.face)

        return replace(self, texture=texture)

    def add_to(self, spec: mujoco.MjSpec, name: str, *, pictures: bool = True) -> None:
        """Add the surface to the spec as a mesh; without `pictures` it has no texture."""
        spec.add_mesh(
            name=name,
            **self._shape,
            **(self._wrapping if pictures else {}),
            inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
            smoothnormal=True,
        )

    @cached_property
    def _shape(self) -> dict[str, list[Any]]:
        """Arguments of a mesh: lists, which MuJoCo takes twice as fast as arrays."""
        return {"uservert": self.vertex.ravel().tolist(), "userface": self.face.ravel().tolist()}

    @cached_property
    def _wrapping(self) -> dict[str, list[Any]]:
        """Further arguments of a mesh with a texture."""
        coordinates, face = self.texture()
        return {"usertexcoord": coordinates.ravel().tolist(), "userfacetexcoord": face.ravel().tolist()}


def around(sides: int) -> Array:
    """Return the angles of a ring's vertices (sides,) [rad], from the back over the right side; 0 is ahead."""
    return -np.pi + 2 * np.pi * np.arange(sides) / sides


def rings(sections: ArrayLike, sides: int = 14, square: float = 2.0) -> Array:
    """Return level rings (m, sides, 3) from sections (m, 5): centre x, y, z, half depth (x), half breadth (y) [m].

    `square`: exponent of the superellipse; 2 is an ellipse, more is squarer.
    """
    section = np.asarray(sections, dtype=float)
    c, s = _superellipse(sides, square)
    ring = np.empty((len(section), sides, 3))
    ring[..., 0] = section[:, 0, None] + section[:, 3, None] * c
    ring[..., 1] = section[:, 1, None] + section[:, 4, None] * s
    ring[..., 2] = section[:, 2, None]
    return ring


@lru_cache(maxsize=256)
def _superellipse(sides: int, square: float) -> tuple[Array, Array]:
    """Return x and y (sides,) of a ring of half depth and breadth 1; kept, since bodies use few kinds of ring."""
    angle = around(sides)
    c, s = np.cos(angle), np.sin(angle)
    return np.sign(c) * np.abs(c) ** (2 / square), np.sign(s) * np.abs(s) ** (2 / square)


def loft(ring: Array) -> Surface:
    """Make the closed surface through rings (m, n, 3) [m], each counter-clockwise as seen from the end of the last one."""
    count, sides, _ = ring.shape
    vertex = np.concatenate([ring.reshape(-1, 3), ring[[0, -1]].mean(axis=1)])
    return Surface(vertex, _faces(count, sides, sides), partial(_wrapped, ring))


def _wrapped(ring: Array) -> Texture:
    """Wrap a texture about the surface through rings (m, n, 3) [m]: v by their distances."""
    count, sides, _ = ring.shape
    way = ring[1:] - ring[:-1]
    v = np.zeros(count)
    np.cumsum(np.sqrt((way * way).sum(axis=-1)).mean(axis=1), out=v[1:])
    coordinates = np.zeros((count * (sides + 1) + 2, 2))
    coordinates[:-2, 0], coordinates[-2:, 0] = np.tile(np.linspace(0, 1, sides + 1), count), 0.5
    coordinates[:-2, 1], coordinates[-1, 1] = np.repeat(v / max(v[-1], 1e-9), sides + 1), 1.0
    return Texture(coordinates, _faces(count, sides, sides + 1))


@lru_cache(maxsize=256)
def _faces(count: int, sides: int, places: int) -> NDArray[np.intp]:
    """Return the faces between rings of `places` vertices and to both poles: `sides`, or one more in a texture.

    Kept, since bodies use few kinds of ring.
    """

    def place(i: Any, j: Any) -> Any:
        return i * places + j % places

    poles = count * places
    i, j = np.meshgrid(np.arange(count - 1), np.arange(sides), indexing="ij")
    a, b, c, d = place(i, j), place(i, j + 1), place(i + 1, j + 1), place(i + 1, j)
    walls = np.concatenate([np.stack([a, b, c], axis=-1).reshape(-1, 3), np.stack([a, c, d], axis=-1).reshape(-1, 3)])
    j = np.arange(sides)
    low, top = np.full(sides, poles), np.full(sides, poles + 1)
    bottom = np.stack([low, place(0, j + 1), place(0, j)], axis=-1)
    lid = np.stack([top, place(count - 1, j), place(count - 1, j + 1)], axis=-1)
    faces = np.concatenate([walls, bottom, lid]).astype(np.intp)
    faces.flags.writeable = False
    return faces


def limb(stations: Sequence[tuple[float, ...]], sides: int = 12, round_low: bool = True) -> Surface:
    """Make a rounded limb along z: stations (z, half depth, half breadth, x = 0, y = 0) [m] from low to high.

    A round end is half an ellipsoid about its station: the next segment, turning about the same point, leaves no gap.
    """
    station = np.array([(*each, 0.0, 0.0)[:5] for each in stations])
    z, a, b, x, y = station.T
    rows = list(np.column_stack([x, y, z, a, b]))
    tilt = np.deg2rad([68.0, 35.0])
    low = [[x[0], y[0], z[0] - np.sin(t) * a[0], a[0] * np.cos(t), b[0] * np.cos(t)] for t in tilt]
    high = [[x[-1], y[-1], z[-1] + np.sin(t) * a[-1], a[-1] * np.cos(t), b[-1] * np.cos(t)] for t in tilt[::-1]]
    return loft(rings((low if round_low else []) + rows + high, sides))


def ellipsoid(middle: ArrayLike, size: ArrayLike, sides: int = 10) -> Surface:
    """Make an ellipsoid about `middle` (3,) with half axes `size` (3,) [m]."""
    x, y, z = np.asarray(middle, dtype=float)
    a, b, c = np.asarray(size, dtype=float)
    tilt = np.deg2rad([-65.0, -30.0, 0.0, 30.0, 65.0])
    return loft(rings([[x, y, z + c * np.sin(t), a * np.cos(t), b * np.cos(t)] for t in tilt], sides))


def cord(path: ArrayLike, radius: float) -> Surface:
    """Make a strap of this radius [m] along a path (m, 3) [m]."""
    path = np.asarray(path, dtype=float)
    way = np.gradient(path, axis=0)
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    first = np.cross(way, [0.3, 0.2, 0.93])
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(way, first)
    angle = around(6)
    ring = path[:, None] + radius * (
        np.cos(angle)[None, :, None] * first[:, None] + np.sin(angle)[None, :, None] * second[:, None]
    )
    return loft(ring)
