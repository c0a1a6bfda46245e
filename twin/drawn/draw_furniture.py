"""Furniture of drawn rooms: pieces with their geoms, seats and beds, and their placement.

A piece's frame has its back at y = 0 and its front at +y, its middle at x = 0, and the floor at z = 0.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from trackers.arrays import Array
from twin.drawn.distributions import DrawnRoom, draw_count
from twin.drawn.floor_plan import CELL_M, DOOR_M, KEEP_M, PARTITION_M, FloorPlan, FreeSpace, Wall
from twin.geometry.polygon import overlap

_TRIES = 30
_OFF_WALL_M = 0.02
_STAND_M = KEEP_M + CELL_M
"""Distance from a piece at which one stands before one sits or lies down [m]."""
_ELBOWS_M = 0.38
"""Room for a broad person beside the middle of a seat [m]."""


@dataclass(frozen=True)
class Geom:
    """A geom of a piece: `kind` box (half sizes), cylinder (radius, half height) or ellipsoid (half axes) [m], its middle."""

    kind: str
    size: tuple[float, ...]
    middle: tuple[float, float, float]
    material: str


@dataclass(frozen=True)
class Spot:
    """Place to sit or lie: `kind` seat or bed, place on top [m], yaw in the piece's frame [rad]."""

    kind: str
    place: tuple[float, float, float]
    yaw: float


@dataclass(frozen=True)
class Piece:
    """Piece of furniture: name, width (x) and depth (y) [m], geoms, spots, and its pose in the plan's frame.

    `free_m`: floor to keep free ahead of its front [m]; `at_wall`: whether its back is against a wall.
    """

    name: str
    width_m: float
    depth_m: float
    solids: tuple[Geom, ...]
    spots: tuple[Spot, ...] = ()
    free_m: float = 0.0
    at_wall: bool = True
    place: tuple[float, float] = (0.0, 0.0)
    yaw: float = 0.0

    def placed(self, local: Array) -> Array:
        """Transform points (n, 2) from its frame to the plan's [m]."""
        cos, sin = np.cos(self.yaw), np.sin(self.yaw)
        return local @ np.array([[cos, sin], [-sin, cos]]) + self.place

    def footprint(self, grown_m: float = 0.0, ahead_m: float = 0.0) -> Array:
        """Return its corners (4, 2) in the plan's frame [m], grown on all sides, and to the front."""
        x, y0, y1 = self.width_m / 2 + grown_m, -grown_m, self.depth_m + grown_m + ahead_m
        return self.placed(np.array([[-x, y0], [x, y0], [x, y1], [-x, y1]]))

    def elbow_room(self) -> Array:
        """Return the corners (4, 2) of the footprint with room for the arms of people on its seats [m]."""
        sides = [abs(spot.place[0]) + _ELBOWS_M for spot in self.spots if spot.kind == "seat"]
        x = max([self.width_m / 2, *sides])
        return self.placed(np.array([[-x, 0.0], [x, 0.0], [x, self.depth_m], [-x, self.depth_m]]))


def _table(rng: np.random.Generator) -> Piece:
    width, depth = rng.uniform(1.2, 2.0), rng.uniform(0.7, 0.95)
    legs = tuple(
        Geom("box", (0.03, 0.03, 0.35), (x * (width / 2 - 0.06), depth / 2 + y * (depth / 2 - 0.06), 0.35), "metal")
        for x in (-1, 1)
        for y in (-1, 1)
    )
    top = Geom("box", (width / 2, depth / 2, 0.02), (0, depth / 2, 0.72), "wood")
    return Piece("table", width, depth, (top, *legs), at_wall=False)


def _desk(rng: np.random.Generator) -> Piece:
    width, depth = rng.uniform(1.2, 1.7), rng.uniform(0.65, 0.8)
    solids = (
        Geom("box", (width / 2, depth / 2, 0.015), (0, depth / 2, 0.725), "wood"),
        Geom("box", (0.02, depth / 2 - 0.03, 0.355), (-width / 2 + 0.04, depth / 2, 0.355), "metal"),
        Geom("box", (0.02, depth / 2 - 0.03, 0.355), (width / 2 - 0.04, depth / 2, 0.355), "metal"),
        Geom("box", (0.27, 0.02, 0.17), (0, 0.2, 0.98), "dark"),
        Geom("box", (0.03, 0.03, 0.05), (0, 0.18, 0.78), "dark"),
    )
    return Piece("desk", width, depth, solids, free_m=0.9)


def _cupboard(rng: np.random.Generator) -> Piece:
    width, depth, height = rng.uniform(0.8, 1.8), rng.uniform(0.4, 0.6), rng.uniform(1.85, 2.1)
    solids = (
        Geom("box", (width / 2, depth / 2, height / 2), (0, depth / 2, height / 2), "furniture"),
        Geom("box", (0.004, 0.004, height / 2 - 0.05), (0, depth, height / 2), "dark"),
    )
    return Piece("cupboard", width, depth, solids, free_m=0.5)


def _shelf(rng: np.random.Generator) -> Piece:
    width, depth, height = rng.uniform(0.8, 2.0), rng.uniform(0.28, 0.4), rng.uniform(1.0, 2.0)
    boards = tuple(
        Geom("box", (width / 2, depth / 2, 0.015), (0, depth / 2, z), "wood") for z in np.arange(0.1, height, 0.36)
    )
    sides = tuple(
        Geom("box", (0.015, depth / 2, height / 2), (x * (width / 2 - 0.015), depth / 2, height / 2), "wood")
        for x in (-1, 1)
    )
    books = tuple(
        Geom("box", (share * width / 2, 0.1, 0.11), (0, depth / 2, z + 0.125), f"books_{rng.integers(3)}")
        for z, share in zip(np.arange(0.1, height - 0.3, 0.36), rng.uniform(0.5, 0.93, 6), strict=False)
    )
    return Piece("shelf", width, depth, (*boards, *sides, *books), free_m=0.5)


def _sofa(rng: np.random.Generator) -> Piece:
    n_seat = int(rng.integers(2, 4))
    width, depth = 0.62 * n_seat + 0.3, rng.uniform(0.8, 0.9)
    solids = (
        Geom("box", (width / 2, depth / 2, 0.21), (0, depth / 2, 0.21), "cloth"),
        Geom("box", (width / 2, 0.11, 0.2), (0, 0.11, 0.62), "cloth"),
        Geom("box", (0.075, depth / 2, 0.1), (-width / 2 + 0.075, depth / 2, 0.52), "cloth"),
        Geom("box", (0.075, depth / 2, 0.1), (width / 2 - 0.075, depth / 2, 0.52), "cloth"),
    )
    seats = tuple(
        Spot("seat", ((place - (n_seat - 1) / 2) * 0.62, 0.22 + (depth - 0.22) / 2, 0.42), np.pi / 2)
        for place in range(n_seat)
    )
    return Piece("sofa", width, depth, solids, seats, free_m=0.9)


def _bed(rng: np.random.Generator) -> Piece:
    width, length = rng.uniform(0.9, 1.4), 2.05  # its head at the wall
    solids = (
        Geom("box", (width / 2, length / 2, 0.15), (0, length / 2, 0.15), "wood"),
        Geom("box", (width / 2 - 0.02, length / 2 - 0.03, 0.09), (0, length / 2 + 0.01, 0.39), "sheet"),
        Geom("box", (width / 2, 0.03, 0.25), (0, 0.03, 0.55), "wood"),
        Geom("box", (0.3, 0.18, 0.04), (0, 0.28, 0.5), "sheet"),
    )
    return Piece("bed", width, length, solids, (Spot("bed", (0, length / 2, 0.48), -np.pi / 2),), free_m=0.5)


def _plant(rng: np.random.Generator) -> Piece:
    radius, height = rng.uniform(0.14, 0.22), rng.uniform(0.8, 1.6)
    solids = (
        Geom("cylinder", (radius, 0.18), (0, radius, 0.18), "dark"),
        Geom("ellipsoid", (radius * 1.4, radius * 1.4, (height - 0.3) / 2), (0, radius, 0.3 + (height - 0.3) / 2), "leaf"),
    )  # fmt: skip
    return Piece("plant", 2.8 * radius, 2.4 * radius, solids)


def _counter(rng: np.random.Generator) -> Piece:
    width, depth = rng.uniform(1.4, 2.6), rng.uniform(0.5, 0.65)
    solids = (
        Geom("box", (width / 2 - 0.03, depth / 2 - 0.05, 0.51), (0, depth / 2, 0.51), "furniture"),
        Geom("box", (width / 2, depth / 2, 0.02), (0, depth / 2, 1.04), "wood"),
    )
    return Piece("counter", width, depth, solids, at_wall=False)


def _chair() -> Piece:
    solids = (
        Geom("box", (0.22, 0.22, 0.025), (0, 0.23, 0.435), "cloth"),
        Geom("box", (0.22, 0.02, 0.2), (0, 0.02, 0.7), "cloth"),
        *(Geom("box", (0.015, 0.015, 0.205), (x * 0.2, 0.23 + y * 0.2, 0.205), "metal") for x in (-1, 1) for y in (-1, 1)),
    )  # fmt: skip
    return Piece("chair", 0.45, 0.46, solids, (Spot("seat", (0, 0.24, 0.46), np.pi / 2),), free_m=0.55, at_wall=False)


_DRAWN: dict[str, Callable[[np.random.Generator], Piece]] = {
    "table": _table,
    "desk": _desk,
    "cupboard": _cupboard,
    "shelf": _shelf,
    "sofa": _sofa,
    "bed": _bed,
    "plant": _plant,
    "counter": _counter,
}


def draw_pillars(plan: FloorPlan, options: DrawnRoom, space: FreeSpace, rng: np.random.Generator) -> list[Piece]:
    """Draw pillars to the ceiling, each taken from `space`, none blocking an only way."""
    pillars: list[Piece] = []
    for _ in range(draw_count(options.pillars, rng)):
        width, is_round = float(rng.uniform(*options.pillar_m)), rng.random() < 0.5
        half = plan.height_m / 2
        solid = (
            Geom("cylinder", (width / 2, half), (0, width / 2, half), "pillar")
            if is_round
            else Geom("box", (width / 2, width / 2, half), (0, width / 2, half), "pillar")
        )
        pillar = Piece("pillar", width, width, (solid,), at_wall=False)
        placed = _stood(pillar, plan, space, [], rng, gap_m=0.9)
        if placed is not None:
            pillars.append(placed)
    return pillars


def draw_furniture(
    plan: FloorPlan, options: DrawnRoom, space: FreeSpace, pillars: list[Piece], rng: np.random.Generator
) -> list[Piece]:
    """Draw and place pieces beside pillars, each taken from `space`; return all. Those without room are left out.

    Doors and doorways stay free, every seat and bed is reachable, and no part of the floor is cut off.
    """
    kinds = [kind for kind, weight in options.furniture.items() if weight > 0]
    if not kinds:
        return pillars
    weights = np.array([options.furniture[kind] for kind in kinds])
    pieces = list(pillars)
    for _ in range(round(rng.uniform(*options.furniture_per_m2) * sum(room.area_m2 for room in plan.rooms))):
        piece = _DRAWN[kinds[int(rng.choice(len(kinds), p=weights / weights.sum()))]](rng)
        put_up = _against_a_wall if piece.at_wall else _stood
        placed = put_up(piece, plan, space, pieces, rng)
        if placed is None:
            continue
        pieces.append(placed)
        if piece.name in ("table", "desk"):
            pieces += _chairs(placed, plan, space, pieces, rng)
    return pieces


def _against_a_wall(
    piece: Piece, plan: FloorPlan, space: FreeSpace, others: list[Piece], rng: np.random.Generator
) -> Piece | None:
    """Place the piece with its back to a wall or partition, where it fits; taken from `space`."""
    walls = [(wall, 0.0) for wall in plan.walls]
    for each in plan.partitions:
        walls += [(each.wall, PARTITION_M / 2), (Wall(each.end, each.start), PARTITION_M / 2)]
    lengths = np.array([wall.length_m for wall, _ in walls])
    for _ in range(_TRIES):
        wall, thick_m = walls[int(rng.choice(len(walls), p=lengths / lengths.sum()))]
        room_for = wall.length_m - piece.width_m - 0.1
        if room_for <= 0:
            continue
        along = 0.05 + piece.width_m / 2 + rng.uniform(0, room_for)
        x, y = wall.at(along, thick_m + _OFF_WALL_M)
        yaw = wall.faces - np.pi / 2
        placed = replace(piece, place=(float(x), float(y)), yaw=yaw)
        if _put(placed, plan, space, others):
            return placed
    return None


def _stood(
    piece: Piece, plan: FloorPlan, space: FreeSpace, others: list[Piece], rng: np.random.Generator, gap_m: float = 0.0
) -> Piece | None:
    """Place the piece free in a room, along its walls or across, where it fits; taken from `space`."""
    for _ in range(_TRIES):
        place = space.draw(1, rng)[0]
        placed = replace(piece, place=(float(place[0]), float(place[1])), yaw=float(rng.integers(4)) * np.pi / 2)
        if space.is_reached(placed.footprint(gap_m)).all() and _put(placed, plan, space, others):
            return placed
    return None


def _chairs(
    table: Piece, plan: FloorPlan, space: FreeSpace, others: list[Piece], rng: np.random.Generator
) -> list[Piece]:
    """Draw chairs about a table or before a desk, pulled out and turned aside as if left."""
    chairs: list[Piece] = []
    for side in (1,) if table.at_wall else (1, -1):
        n_chair = 1 if table.at_wall else int(rng.integers(0, int(table.width_m / 0.75) + 1))
        for place in range(n_chair):
            x = (place + 0.5 - n_chair / 2) * 0.75
            y = table.depth_m / 2 + side * (table.depth_m / 2 + rng.uniform(0.5, 0.6))
            chair = _chair()
            yaw = table.yaw + rng.choice([-1.0, 1.0]) * np.deg2rad(rng.uniform(70, 110))
            middle = table.placed(np.array([[x, y]]))[0]
            turned = replace(chair, yaw=float(yaw))
            corner = middle - (turned.placed(np.array([[0.0, 0.23]]))[0] - np.array(turned.place))
            placed = replace(turned, place=(float(corner[0]), float(corner[1])))
            # a desk keeps the floor ahead of it free for this
            around = [replace(table, free_m=0.0), *(each for each in others if each is not table), *chairs]
            if _put(placed, plan, space, around):
                chairs.append(placed)
    return chairs


def _put(piece: Piece, plan: FloorPlan, space: FreeSpace, others: list[Piece]) -> bool:
    """Take the piece's footprint from `space` if it may stand there."""
    footprint, room = piece.footprint(), piece.elbow_room()
    edges = np.concatenate([room, (room + np.roll(room, -1, axis=0)) / 2, room.mean(axis=0)[None]])
    if not plan.is_within(edges).all() or any(overlap(piece.footprint(0.05), other.footprint()) for other in others):
        return False
    for other in others:
        theirs = other.footprint()
        if overlap(footprint, other.footprint(ahead_m=other.free_m)) or overlap(footprint, other.elbow_room()):
            return False
        if overlap(piece.footprint(ahead_m=piece.free_m), theirs) or overlap(room, theirs):
            return False
    for partition in plan.partitions:
        wall = partition.wall
        line = [(0.0, partition.gap_m[0]), (partition.gap_m[1], wall.length_m)]
        if any(overlap(room, _strip(wall, first, last, PARTITION_M / 2)) for first, last in line):
            return False
        if overlap(footprint, _strip(wall, partition.gap_m[0] - 0.1, partition.gap_m[1] + 0.1, 0.9)):
            return False
    for door in plan.doors:
        if overlap(footprint, _strip(door.wall, door.along_m - DOOR_M / 2 - 0.1, door.along_m + DOOR_M / 2 + 0.1, 1.0)):
            return False
    changed = space.copy()
    changed.take(footprint)
    lost_m2 = space.area_m2 - changed.area_m2
    x, y = piece.width_m + 0.8, piece.depth_m + 0.8
    if lost_m2 > x * y * 1.15 + 0.1:  # more than the piece itself: something is cut off
        return False
    wanted = [*plan.thresholds(), *(place for each in (*others, piece) for place in standing_places(each))]
    if not changed.is_reached(np.array(wanted).reshape(-1, 2)).all():
        return False
    space.take(footprint)
    return True


def standing_places(piece: Piece) -> Array:
    """Return places (n, 2) [m] of the plan from which a person sits or lies down on the piece."""
    places = []
    for spot in piece.spots:
        if spot.kind == "seat":
            ahead = piece.depth_m + _STAND_M - spot.place[1]
            places.append([spot.place[0] + ahead * np.cos(spot.yaw), spot.place[1] + ahead * np.sin(spot.yaw)])
        else:
            side = piece.width_m / 2 + _STAND_M
            places += [[spot.place[0] + side, spot.place[1]], [spot.place[0] - side, spot.place[1]]]
    return piece.placed(np.array(places).reshape(-1, 2))


def _strip(wall: Wall, first_m: float, last_m: float, half_m: float) -> Array:
    """Return the rectangle (4, 2) along a wall from `first_m` to `last_m`, of half width `half_m` [m]."""
    return np.array(
        [wall.at(first_m, -half_m), wall.at(last_m, -half_m), wall.at(last_m, half_m), wall.at(first_m, half_m)]
    )
