"""Likelihoods and rules that weigh heads of all tracks (eq. 9: their product): pictures, the room, other heads, the walk."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from trackers.arrays import Array, Bool, Float, Mask
from trackers.filters.circular import grid_of
from trackers.filters.particle import LogWeights
from trackers.likelihood.floor import EnvironmentLikelihood
from trackers.likelihood.stereo_head import HeadLikelihoods
from trackers.rgbd_head.evaluators import Evaluators
from trackers.rgbd_head.head_tracks import HeadTracks, Motion
from trackers.rgbd_head.options import RgbdHeadOptions
from trackers.vision.head_colours import HeadColours

_USUAL = 0.2
"""Weight of a new picture in the running mean of a head's log-likelihood."""
_SURE = 0.6
"""Mean resultant length of a direction above which colours are learned."""
_OTHERS = 4.0
"""Penalty in log-likelihood of a hypothesis inside another person's head."""


class Likelihoods:
    """Cameras' evaluators, the room and the rules, for all tracks.

    common: distributions of colours of faces, and of hair, among people. later_s: by camera, delay of its picture after the
    frame [s].
    """

    def __init__(
        self,
        evaluators: Evaluators,
        room: EnvironmentLikelihood,
        common: Float[Array, "2 colours"],
        options: RgbdHeadOptions,
    ) -> None:
        self._evaluators, self._room, self._common, self._options = evaluators, room, common, options
        self._numbers = {name: number for number, name in enumerate(evaluators.here)}

    @property
    def learns_colours(self) -> bool:
        """True where each person's own colours are learned."""
        return self._options.stereo_head.person_colour is not None

    def expect(self, people: HeadTracks, later_s: Mapping[str, float]) -> None:
        """Send each track's colours to the cameras, weighted by their evidence."""
        if self.learns_colours:
            self._evaluators.expect(later_s, people.colours.expected(self._common))

    def by_camera(
        self, people: HeadTracks, state: Float[Array, "4 n p"], later_s: Mapping[str, float]
    ) -> dict[str, HeadLikelihoods]:
        """Weigh hypotheses, moved to each picture's own stamp."""
        velocity, heads = people.velocity.T[..., None].astype(np.float32), {}
        for name, later in later_s.items():
            heads[name] = state.astype(np.float32)
            heads[name][:3] += np.float32(later) * velocity
        return self._evaluators.log_likelihood(heads)

    def log_likelihood(
        self, people: HeadTracks, state: Float[Array, "4 n p"], found: Mapping[str, HeadLikelihoods], motion: Motion
    ) -> Float[Array, "n p"]:
        """Return the sum of all likelihoods and rules; `found` by each camera (`by_camera`)."""
        terms = [self._by_pictures(people, state, found), self._by_room(state)]
        if not people.facing.size:
            terms.append(motion.walking(state[3]))
        if len(people) > 1:
            terms.append(self._by_other_heads(state, motion.place))
        return sum(terms[1:], start=terms[0])

    def _by_pictures(
        self, people: HeadTracks, state: Float[Array, "4 n p"], found: Mapping[str, HeadLikelihoods]
    ) -> Float[Array, "n p"]:
        n, p = state.shape[1:]
        total, out_of_view = np.zeros((n, p)), self._options.stereo_head.out_of_view
        missed = np.nan_to_num(people.usual) - (out_of_view or 0.0)
        for name, each in found.items():
            usual, seen = missed[:, self._numbers[name], None], each.seen.reshape(n, p)
            of_picture = (each.colour + each.depth).reshape(n, p)
            total += of_picture if out_of_view is None else np.where(seen, of_picture, usual)
        return total

    def _by_room(self, state: Float[Array, "4 n p"]) -> Float[Array, "n p"]:
        n, p = state.shape[1:]
        return self._room.log_likelihood(state[:3].reshape(3, n * p).T).reshape(n, p)

    def _by_other_heads(self, state: Float[Array, "4 n p"], place: Float[Array, "n 3"]) -> Float[Array, "n p"]:
        """Penalize hypotheses inside the heads of others at their last positions."""
        x, y, z = np.square(state[:3, None] - place.T[..., None, None])
        away_m2 = x + y + z  # from each to every head, (n, n, p)
        away_m2[np.arange(len(place)), np.arange(len(place))] = np.inf
        return -_OTHERS * (away_m2.min(axis=0) < self._options.track_management.same_head_m**2)

    def facing(self, people: HeadTracks, motion: Motion, later_s: Mapping[str, float]) -> Float[Array, "n g"]:
        """Return the directions of heads updated by pictures at their expected positions, and by the walk."""
        facing = motion.facing
        log = motion.walking(np.broadcast_to(grid_of(facing.shape[1]), facing.shape))
        if self._options.stereo_head.uses_colours:
            heads = {name: people.heads(later, 0.0) for name, later in later_s.items()}
            log = log + sum(self._evaluators.facing(heads))
        with np.errstate(divide="ignore"):
            return LogWeights.of(np.log(facing) + log).normalised

    def usual(self, people: HeadTracks, found: Mapping[str, HeadLikelihoods]) -> Float[Array, "n cameras"]:
        """Return the running means of the log-likelihoods in each camera's pictures, updated by these."""
        usual, share = people.usual.copy(), people.roster.state.weights.normalised
        for name, each in found.items():
            number, seen = self._numbers[name], share * each.seen.reshape(share.shape)
            total = seen.sum(axis=1)
            mean = (seen * (each.colour + each.depth).reshape(seen.shape)).sum(axis=1) / np.maximum(total, 1e-9)
            old = np.where(np.isnan(usual[:, number]), mean, usual[:, number])
            usual[:, number] = np.where(total > 0.5, old + _USUAL * (mean - old), usual[:, number])
        return usual

    def is_shown(self, people: HeadTracks, found: Mapping[str, HeadLikelihoods]) -> Bool[Mask, "n"]:
        """Return a mask of the tracks whose heads are detected on average by the cameras that see them."""
        share, n_seen, shown = people.roster.state.weights.normalised, np.zeros(len(people)), np.zeros(len(people))
        for each in found.values():
            n_seen += np.einsum("np,np->n", share, each.seen.reshape(share.shape))
            shown += np.einsum("np,np->n", share, each.p_detect.reshape(share.shape))
        return (n_seen > 0.5) & (shown >= self._options.track_management.least_shown * n_seen)

    def colours(self, people: HeadTracks, is_shown: Bool[Mask, "n"], name: str, later_s: float) -> HeadColours:
        """Learn colours from one camera's view of heads that are shown with a certain direction."""
        yaw, sure = people.direction()
        person, step, colour = pixels = self._evaluators.colours_on(name, people.heads(later_s, yaw))
        person, step, colour = pixels[:, (is_shown & (sure > _SURE))[person]]
        return people.colours.learned(person, step, colour, self._common)
