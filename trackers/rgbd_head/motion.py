"""Motion of heads (ours: the paper gives no model): diffusion growing with speed and time, turns, alignment with the walk."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from trackers.arrays import Array
from trackers.filters.circular import diffused, drawn
from trackers.rgbd_head.options import MotionOptions
from trackers.rgbd_head.people import People


class Motion:
    """Motion of all tracks over `dt_s`.

    place: of the heads before. facing (n, directions): predicted; empty if each hypothesis has its own direction.
    """

    def __init__(self, people: People, dt_s: float, options: MotionOptions) -> None:
        self._people, self._dt_s, self._options = people, dt_s, options
        self.place: Float[Array, "n 3"] = people.place
        speed = np.linalg.norm(people.velocity[:, :2], axis=1)
        level = options.still_m + options.per_speed_m * speed
        self._turn = np.sqrt(dt_s) * np.radians(options.turn_deg)
        self._sigma = np.sqrt(dt_s) * np.stack([level, level, np.full_like(level, options.up_m)])[..., None]
        self.facing: Float[Array, "n g"] = people.facing
        if self.facing.size:
            anywhere = options.turned / self.facing.shape[1]
            self.facing = (1 - options.turned) * diffused(people.facing, self._turn) + anywhere

    def moved(self, state: Float[Array, "4 n p"], rng: np.random.Generator, layer: int) -> Float[Array, "4 n p"]:
        """Move hypotheses of a layer: the first layer moves and diffuses, later ones diffuse less about their positions."""
        options = self._options
        way = self._dt_s * self._people.velocity.T[..., None] if layer == 0 else 0.0
        moved = np.empty_like(state)
        moved[:3] = state[:3] + way + options.nearer**layer * self._sigma * rng.standard_normal(state[:3].shape)
        moved[3] = drawn(self.facing, state.shape[2], rng) if self.facing.size else self._turned(state[3], rng)
        return moved

    def _turned(self, yaw: Float[Array, "n p"], rng: np.random.Generator) -> Float[Array, "n p"]:
        """Turn hypotheses, a share of them to random directions."""
        yaw = yaw + self._turn * rng.standard_normal(yaw.shape)
        some = rng.permutation(yaw.shape[1])[: round(self._options.turned * yaw.shape[1])]
        yaw[:, some] = rng.uniform(-np.pi, np.pi, (len(yaw), some.size))
        return yaw

    def walking(self, yaw: Float[Array, "n k"]) -> Float[Array, "n k"]:
        """Return log-likelihoods of directions given the direction of walking."""
        velocity = self._people.velocity[:, :2]
        heading = np.arctan2(velocity[:, 1], velocity[:, 0])
        speed = np.minimum(np.linalg.norm(velocity, axis=1), 1.0)
        return self._options.walking * speed[:, None] * np.cos(yaw - heading[:, None])

    def velocity(self, place: Float[Array, "n 3"]) -> Float[Array, "n 3"]:
        """Return the running mean velocities of heads after moving to places [m/s]."""
        before, options = self._people, self._options
        if not (options.velocity_s and self._dt_s):
            return before.velocity
        kept = np.exp(-self._dt_s / options.velocity_s)
        return kept * before.velocity + (1 - kept) * (place - self.place) / self._dt_s
