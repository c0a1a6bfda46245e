"""A drawn building: plan, furniture and free floor, and its place in the room frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackers.arrays import Array
from twin.drawn.distributions import DrawnRoom
from twin.drawn.floor_plan import FloorPlan, draw_floor_plan
from twin.drawn.free_space import FreeSpace
from twin.drawn.furniture import Piece, draw_furniture, draw_pillars
from twin.drawn.mjcf import Placement, room_mjcf
from twin.streams import stream

_TRIES = 20
_LEAST_FREE = 0.35
"""Least share of the floor that must be free to walk on."""


@dataclass(frozen=True)
class DrawnBuilding:
    """What people and sensors are drawn into, and the room's file."""

    plan: FloorPlan
    pieces: tuple[Piece, ...]
    space: FreeSpace
    placement: Placement
    mjcf: str

    def spots(self, kind: str) -> list[str]:
        """Names, as scenarios use them, of the seats or beds."""
        return [
            f"{piece.name}_{number}_{place}"
            for number, piece in enumerate(self.pieces, start=1)
            for place, spot in enumerate(piece.spots, start=1)
            if spot.kind == kind
        ]

    def to_room(self, places: Array) -> list[tuple[float, float]]:
        """Places (n, 2) of the plan in the room frame [m]."""
        return [(float(x), float(y)) for x, y in self.placement.to_room(np.reshape(places, (-1, 2)))]


def draw_building(options: DrawnRoom, seed: int, name: str) -> DrawnBuilding:
    """Draw a building; the same options and seed give the same file.

    Plans on which too little of the floor can be reached are drawn again.
    """
    seed = options.seed if options.seed is not None else seed
    for attempt in range(_TRIES):
        rng = stream(seed, "drawn room", str(attempt))
        plan = draw_floor_plan(options, rng)
        space = FreeSpace(plan)
        floor_m2 = sum(room.area_m2 for room in plan.rooms)
        area = space.walkable_area()
        enough = plan.doors and space.area_m2 >= _LEAST_FREE * floor_m2 and space.is_reached(plan.thresholds()).all()
        if enough and area is not None:
            break
    else:
        raise ValueError(
            f"no building in {_TRIES} draws has doors and floor enough; larger lengths or fewer rooms are expected"
        )
    pieces = [*draw_pillars(plan, options, space, rng), *draw_furniture(plan, options, space, rng)]
    length, width = plan.size_m / 2
    placement = Placement((float(length), float(width)), float(np.deg2rad(rng.uniform(*options.turned_deg))))
    mjcf = room_mjcf(name, plan, area, pieces, placement, bool(rng.random() < options.dim), rng)
    return DrawnBuilding(plan, tuple(pieces), space, placement, mjcf)
