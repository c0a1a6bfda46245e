"""Furniture that people use: where one sits and lies in a room, read from the sites of its MJCF file.

By convention, a piece of furniture is a body that stands still, with its geoms in it, and holds

- `<site name="seat_NAME"/>` on top of the seat, in its middle, x axis to where the sitter looks; or
- `<site name="bed_NAME"/>` on top of the mattress, in its middle, x axis from the feet to the head.

z is up in both. One body may hold several seats: a bench, a sofa.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import mujoco
import numpy as np

from trackers.arrays import Array
from trackers.errors import InputError, text_near_bound
from twin.geometry.geom_hull import hull_points
from twin.geometry.polygon import ConvexHull
from twin.room.obstacles import Solid, solids_of

SEAT, BED = "seat_", "bed_"
_UPRIGHT = 0.99
_AROUND_M = 1.5
_LOW_M = 0.05
"""Height above a seat at which a geom is over it, such as a lamp, not part of it [m]."""
_HIGH_M = {SEAT: (0.15, 1.0), BED: (0.05, 1.2)}
"""Heights of what people can sit down and lie down on [m]."""
_OFF_TOP_M = 0.1
"""Greatest distance of a site from the top of its furniture, such as a cushion that is not modelled [m]."""
_NEARLY = re.compile(r"(seat|bed)(?:[-_. ].*|\d+)?", re.IGNORECASE)
_LEFT_AHEAD = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
"""Rotates points (n, 3), as rows, so that left becomes ahead; its transpose: right becomes ahead."""


@dataclass(frozen=True, eq=False)
class Seat:
    """A seat: `place` (3,) middle of its top, room frame [m]; `yaw`: facing direction [rad].

    `furniture`: its body, as obstacles name it too; `geoms`: that body's geoms, which a sitter may press into; `to_front_m`:
    from the middle to the furniture's front edge, `to_sides_m`: to its left and right one [m]; `around`: what stands within a
    body's reach, the furniture itself included.
    """

    name: str
    place: Array
    yaw: float
    furniture: str
    geoms: frozenset[int]
    to_front_m: float
    to_sides_m: tuple[float, float] = (np.inf, np.inf)
    around: tuple[Solid, ...] = ()

    @property
    def height(self) -> float:
        """Height of the seat above the floor [m]."""
        return float(self.place[2])


@dataclass(frozen=True, eq=False)
class Bed:
    """A bed: `place` (3,) middle of the mattress' top, room frame [m]; `yaw`: from the feet to the head [rad].

    `furniture` and `geoms` as of a `Seat`; `to_edge_m` (2,): from the middle to the edges left and right of the yaw [m].
    """

    name: str
    place: Array
    yaw: float
    furniture: str
    geoms: frozenset[int]
    to_edge_m: Array

    def sides(self) -> Array:
        """Return the places on the floor (2, 2) at its edges, left and right of its middle [m]."""
        left = np.array([np.cos(self.yaw + np.pi / 2), np.sin(self.yaw + np.pi / 2)])
        return self.place[:2] + (self.to_edge_m * [1.0, -1.0])[:, None] * left


def furniture_of(model: mujoco.MjModel, source: str = "room") -> dict[str, Seat | Bed]:
    """Return the seats and beds of a room by NAME, in the order of the file, without attached people.

    Raises InputError, naming `source`, for a site without furniture under it, one that is not level or not on top, a height on
    which nobody sits or lies, and a name used twice.
    """
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    found: dict[str, Seat | Bed] = {}
    solids: list[Solid] | None = None
    for site in range(model.nsite):
        full = model.site(site).name
        body = int(model.site_bodyid[site])
        kind = next((kind for kind in (SEAT, BED) if full.startswith(kind)), None)
        if kind is None or model.body_weldid[body] != 0:
            continue
        name = full.removeprefix(kind)
        turn = data.site_xmat[site].reshape(3, 3)
        geoms = np.flatnonzero(model.geom_bodyid == body)
        if body == 0 or not len(geoms):
            raise InputError(
                f"{source}: site {full!r} is in no piece of furniture; a <body> that holds it and the geoms of what "
                "one sits or lies on is expected"
            )
        if turn[2, 2] < _UPRIGHT:
            raise InputError(f"{source}: site {full!r} is not level; its z axis is expected to point up")
        if not name:
            raise InputError(f"{source}: site {full!r} has no name of its own; one such as {kind}left is expected")
        if name in found:
            raise InputError(
                f"{source}: two places are called {name!r}; a name of its own for each seat and bed is expected"
            )
        place = np.array(data.site_xpos[site])
        shapes = [points for geom in geoms if (points := hull_points(model, data, int(geom))) is not None]
        local = [(points - place) @ turn for points in shapes if points[:, 2].min() < place[2] + _LOW_M]
        if not any(_reach(points) >= 0 >= -_reach(points @ _LEFT_AHEAD @ _LEFT_AHEAD) for points in local):
            raise InputError(
                f"{source}: site {full!r} is not over its furniture; the middle of a seat or mattress is expected"
            )
        _check_height(model, data, place, kind, f"{source}: site {full!r}")
        yaw = float(np.arctan2(turn[1, 0], turn[0, 0]))
        furniture, members = model.body(body).name or f"body {body}", frozenset(int(geom) for geom in geoms)
        left, right = (max(_reach(points @ side) for points in local) for side in (_LEFT_AHEAD, _LEFT_AHEAD.T))
        if kind == SEAT:
            solids = solids_of(model, data) if solids is None else solids
            around = tuple(each for each in solids if _is_near(each, place))
            ahead = max(_reach(points) for points in local)
            found[name] = Seat(name, place, yaw, furniture, members, ahead, (left, right), around)
        else:
            found[name] = Bed(name, place, yaw, furniture, members, np.array([left, right]))
    return found


def nearly_furniture(model: mujoco.MjModel) -> list[str]:
    """Return a sentence for each site that is called nearly like a seat or bed, and so is none."""
    names = [model.site(site).name for site in range(model.nsite)]
    return [
        f"{name}: is no {match[1].lower()}; a site called {match[1].lower()}_NAME, in small letters, is expected for one"
        for name in names
        if (match := _NEARLY.fullmatch(name)) is not None and not name.startswith((SEAT, BED))
    ]


def _check_height(model: mujoco.MjModel, data: mujoco.MjData, place: Array, kind: str, source: str) -> None:
    """Raise InputError, naming `source`, for a place (3,) [m] that is not on top of something as high as a seat or bed."""
    (low_m, high_m), what = _HIGH_M[kind], kind.removesuffix("_")
    if not low_m <= place[2] <= high_m:
        high = text_near_bound(float(place[2]), low_m if place[2] < low_m else high_m, ".3g")
        raise InputError(
            f"{source} is {high} m high; lengths in metres, and a {what} of {low_m:g} to {high_m:g} m, are expected"
        )
    above = place + np.array([0.0, 0.0, _OFF_TOP_M])
    way_m = mujoco.mj_ray(model, data, above, np.array([0.0, 0.0, -1.0]), None, 1, -1, np.zeros(1, dtype=np.int32))
    if not 0 < way_m <= 2 * _OFF_TOP_M:
        raise InputError(
            f"{source} is not on top of its furniture: nothing is level there between {place[2] - _OFF_TOP_M:.2f} and "
            f"{above[2]:.2f} m; the height of the {what}'s top is expected"
        )


def _reach(points: Array) -> float:
    """Return the forward reach (x) of the hull of points (n, 3) straight before the origin [m], -inf if it is beside."""
    flat = points[:, :2]
    start = flat[ConvexHull(flat).vertices]
    way = np.roll(start, -1, axis=0) - start
    crosses = start[:, 1] * (start[:, 1] + way[:, 1]) < 0
    share = start[crosses, 1] / way[crosses, 1]
    return float((start[crosses, 0] - share * way[crosses, 0]).max(initial=-np.inf))


def _is_near(solid: Solid, place: Array) -> bool:
    """Return whether the bounding box of a solid is within `_AROUND_M` of a place."""
    low, high = solid.corners.min(axis=0), solid.corners.max(axis=0)
    return bool((low < place[:2] + _AROUND_M).all() and (high > place[:2] - _AROUND_M).all())
