"""What the pictures of a moment make of everybody who is followed: the product of all weights (eq. 9), who is shown, and how."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from jaxtyping import Bool, Float

from trackers.arrays import Array, Mask
from trackers.filters.circular import grid_of
from trackers.filters.particle import LogWeights
from trackers.rgbd_head.colours import HeadColours
from trackers.rgbd_head.evaluators import Evaluators
from trackers.rgbd_head.motion import Motion
from trackers.rgbd_head.options import RgbdHeadOptions
from trackers.rgbd_head.people import People
from trackers.rgbd_head.room import Room
from trackers.rgbd_head.weighing import Weights

_USUAL = 0.2
"""Share of a new picture in what a person's heads usually weigh."""
_SURE = 0.6
"""How sure a direction has to be for colours to be learned at it."""
_OTHERS = 4.0
"""What the logarithm of a hypothesis's weight loses in another person's head."""


class Sight:
    """The cameras' evaluators and the room, asked about people.

    common: how often each colour is face, and hair, among people. later_s: of each camera that is asked, how much later than the
    moment its picture was taken [s].
    """

    def __init__(
        self, evaluators: Evaluators, room: Room, common: Float[Array, "2 colours"], options: RgbdHeadOptions
    ) -> None:
        self._evaluators, self._room, self._common, self._options = evaluators, room, common, options
        self._numbers = {name: number for number, name in enumerate(evaluators.here)}

    def expect(self, people: People, later_s: Mapping[str, float]) -> None:
        """Tell the cameras which colours everybody has, as far as that counts."""
        colour = self._options.weights.colour
        if colour.used and colour.by_person:
            self._evaluators.expect(later_s, people.colours.expected(self._common, colour))

    def weighed(self, people: People, state: Float[Array, "4 n p"], later_s: Mapping[str, float]) -> dict[str, Weights]:
        """What each picture makes of everybody's hypotheses, moved to its own stamp."""
        velocity, heads = people.velocity.T[..., None].astype(np.float32), {}
        for name, later in later_s.items():
            heads[name] = state.astype(np.float32)
            heads[name][:3] += np.float32(later) * velocity
        return self._evaluators.weights(heads)

    def log_weight(
        self, people: People, state: Float[Array, "4 n p"], weighed: Mapping[str, Weights], motion: Motion
    ) -> Float[Array, "n p"]:
        """The logarithm of the product of all weights (eq. 9)."""
        life = self._options.life
        n, p = state.shape[1:]
        total, unseen = np.zeros((n, p)), np.nan_to_num(people.usual) - life.unseen
        for name, weights in weighed.items():
            usual, seen = unseen[:, self._numbers[name], None], weights.seen.reshape(n, p)
            total += np.where(seen, (weights.colour + weights.depth).reshape(n, p), usual)
        total += self._room.log_weight(state[:3].reshape(3, n * p).T).reshape(n, p)
        if not people.facing.size:
            total += motion.walking(state[3])
        if n > 1:
            x, y, z = np.square(state[:3, None] - motion.place.T[..., None, None])
            away_m2 = x + y + z  # of each from everybody's head, (n, n, p)
            away_m2[np.arange(n), np.arange(n)] = np.inf
            total -= _OTHERS * (away_m2.min(axis=0) < life.same_head_m**2)
        return total

    def facing(self, people: People, motion: Motion, later_s: Mapping[str, float]) -> Float[Array, "n g"]:
        """Where everybody faces after what the pictures show at their expected places, and by where they walk."""
        facing = motion.facing
        log = motion.walking(np.broadcast_to(grid_of(facing.shape[1]), facing.shape))
        if self._options.weights.colour.used:
            heads = {name: people.heads(later, 0.0) for name, later in later_s.items()}
            log = log + sum(self._evaluators.facing(heads))
        with np.errstate(divide="ignore"):
            return LogWeights.of(np.log(facing) + log).normalised

    def usual(self, people: People, weighed: Mapping[str, Weights]) -> Float[Array, "n cameras"]:
        """What a person's heads usually weigh in each camera's pictures, after these."""
        usual, share = people.usual.copy(), people.roster.state.weights.normalised
        for name, weights in weighed.items():
            number, seen = self._numbers[name], share * weights.seen.reshape(share.shape)
            total = seen.sum(axis=1)
            mean = (seen * (weights.colour + weights.depth).reshape(seen.shape)).sum(axis=1) / np.maximum(total, 1e-9)
            old = np.where(np.isnan(usual[:, number]), mean, usual[:, number])
            usual[:, number] = np.where(total > 0.5, old + _USUAL * (mean - old), usual[:, number])
        return usual

    def is_shown(self, people: People, weighed: Mapping[str, Weights]) -> Bool[Mask, "n"]:
        """Whose heads the cameras that see them show, on average."""
        share, n_seen, shown = people.roster.state.weights.normalised, np.zeros(len(people)), np.zeros(len(people))
        for weights in weighed.values():
            n_seen += np.einsum("np,np->n", share, weights.seen.reshape(share.shape))
            shown += np.einsum("np,np->n", share, weights.shown.reshape(share.shape))
        return (n_seen > 0.5) & (shown >= self._options.life.least_shown * n_seen)

    def colours(self, people: People, is_shown: Bool[Mask, "n"], name: str, later_s: float) -> HeadColours:
        """Everybody's, after one camera's look at who is shown and faces surely somewhere."""
        yaw, sure = people.direction()
        person, step, colour = pixels = self._evaluators.look(name, people.heads(later_s, yaw))
        person, step, colour = pixels[:, (is_shown & (sure > _SURE))[person]]
        return people.colours.learned(person, step, colour, self._common, self._options.weights.colour)
