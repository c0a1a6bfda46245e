"""Tracks of heads: a roster of clouds of hypotheses (x, y, z, yaw), and each person's learned state."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from jaxtyping import Float

from trackers.arrays import Array
from trackers.filters.circular import circular_mean, mean_direction
from trackers.filters.particle import Cloud
from trackers.filters.rows import Rows
from trackers.tracking.roster import Roster
from trackers.vision.head_colours import HeadColours


@dataclass(frozen=True, eq=False)
class People(Rows):
    """n tracks, oldest first, including tentative ones. usual: running mean log-likelihoods of their heads in each camera."""

    roster: Roster[Cloud]
    velocity: Float[Array, "n 3"]  # [m/s]
    colours: HeadColours
    usual: Float[Array, "n cameras"]  # logarithms; NaN before the first picture
    facing: Float[Array, "n directions"]  # a distribution; without directions each hypothesis has its own

    @classmethod
    def started(cls, cloud: Cloud, ns: int, n_camera: int, n_direction: int) -> Self:
        """Start tentative tracks of standing people, with the directions of the hypotheses."""
        n = len(cloud)
        usual = np.full((n, n_camera), np.nan)
        facing = np.zeros((n, n_direction))
        if n_direction:
            step = np.rint(cloud.state[3] * (n_direction / (2 * np.pi))).astype(np.intp) % n_direction
            np.add.at(facing, (np.arange(n)[:, None], step), cloud.weights.normalised)
        return cls(Roster.started(cloud, ns), np.zeros((n, 3)), HeadColours.unknown(n), usual, facing)

    @property
    def place(self) -> Float[Array, "n 3"]:
        """Middle of each head, the expectation [m]."""
        cloud = self.roster.state
        return cloud.expectation(cloud.state[:3]).T

    def heads(self, later_s: float, yaw_rad: Float[Array, "n"] | float) -> Float[Array, "4 n"]:
        """Predict heads (x, y, z [m], yaw [rad]) some time later, at their present velocity."""
        place = self.place + later_s * self.velocity
        return np.column_stack([place, np.broadcast_to(yaw_rad, len(place))]).T

    def direction(self) -> tuple[Float[Array, "n"], Float[Array, "n"]]:
        """Return the direction of each head [rad], averaged on the circle, and its certainty, 0 to 1."""
        if self.facing.shape[1]:
            return mean_direction(self.facing)
        cloud = self.roster.state
        yaw, length = circular_mean(cloud.state[3], cloud.weights.normalised)
        return np.asarray(yaw), np.asarray(length)


def around(
    place: Float[Array, "n 3"],
    yaw_rad: Float[Array, "n"] | None,
    spread_m: float,
    n_heads: int,
    rng: np.random.Generator,
) -> Cloud:
    """Draw hypotheses about places [m], in random directions if the yaw is unknown."""
    n = len(place)
    state = np.empty((4, n, n_heads))
    state[:3] = place.T[..., None] + spread_m * rng.standard_normal((3, n, n_heads))
    turned = rng.uniform(-np.pi, np.pi, (n, n_heads))
    state[3] = turned if yaw_rad is None else yaw_rad[:, None] + np.radians(15) * rng.standard_normal((n, n_heads))
    return Cloud.of(state)
