"""The ground people walk on: the tracked area, what stands in the way, where one can sit and lie."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from trackers.arrays import Array
from trackers.errors import InputError
from twin.geometry.polygon import inset
from twin.people.crowd.places import free_places
from twin.people.crowd.routes import Routes
from twin.room.furniture import Bed, Seat
from twin.room.obstacles import KEEP_FROM_EDGE_M, Obstacle

_MARGIN_M = KEEP_FROM_EDGE_M + 0.1


@dataclass(frozen=True, eq=False)
class Ground:
    """Where the people of a scenario walk.

    `area` (k, 2): polygon in which wanderers stay and starts are drawn, `walkable` (k, 2): where everybody stays, room
    frame [m]; `furniture`: seats and beds by name; `source`: what describes the area, as errors name it.
    """

    area: Array
    walkable: Array
    obstacles: Sequence[Obstacle]
    routes: Routes
    furniture: Mapping[str, Seat | Bed]
    source: str

    @cached_property
    def inner(self) -> Array:
        """The area drawn in so that a body's middle keeps from its edge, (k, 2) [m]; raises InputError for a sliver."""
        inner = inset(self.area, _MARGIN_M)
        if inner is None:
            raise InputError(
                f"{self.source}: area: is too narrow to walk in; more than {2 * _MARGIN_M:g} m between its edges is expected"
            )
        return inner

    def free_places(self, count: int, rng: np.random.Generator) -> Array:
        """Random places (count, 2) [m] in the area, clear of furniture; raises InputError where there is none."""
        return free_places(self.inner, self.obstacles, count, rng, source=f"{self.source}: area")
