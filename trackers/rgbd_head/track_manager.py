"""Who begins, is confirmed, is found again, and ends: where a start is known as in the paper, and by foreground alone (ours)."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

from trackers.arrays import Array, Index, Mask
from trackers.filters.gating import distances
from trackers.filters.particle import Cloud
from trackers.filters.rows import written
from trackers.observations import NS_PER_S
from trackers.rgbd_head.options import RgbdHeadOptions
from trackers.rgbd_head.outline import ASPECTS
from trackers.rgbd_head.people import People, around
from trackers.tracking.track_manager import coasting_within, lasted_s, measured_often

_FAR_M_S = 1.5
"""Who is not shown is looked for within the way at this speed."""


class TrackManager:
    """The rules, the numbers given so far, and the known starts still to come."""

    def __init__(self, options: RgbdHeadOptions, n_camera: int, rng: np.random.Generator) -> None:
        self._options, self._n_camera, self._rng = options, n_camera, rng
        self._pending = sorted(options.start, key=lambda start: start.at_s)
        self._last_id = 0
        self._last_ns = 0  # of the moment before

    def nobody(self) -> People:
        """Before anybody has begun."""
        return self._started(np.empty((0, 3)), None, 0)

    def begun(self, people: People, ns: int) -> People:
        """With heads whose start is known and whose time has come."""
        due = [start for start in self._pending if start.at_s * NS_PER_S <= ns]
        self._pending = self._pending[len(due) :]
        if not due:
            return people
        place, yaw = np.array([start.place for start in due]), np.radians([start.yaw_deg for start in due])
        return people.joined(self._numbered(self._started(place, yaw, ns), np.arange(len(due))))

    def shown(self, people: People, is_shown: Bool[Mask, "n"], ns: int) -> People:
        """After a moment that shows some of them: those shown often are confirmed, those not shown for long are gone."""
        roster = people.roster.measured(np.flatnonzero(is_shown), ns, people.roster.state)
        people = people.changed(roster=roster)
        life, before_ns, self._last_ns = self._options.life, self._last_ns, ns
        often = np.flatnonzero(measured_often(roster, ns, life.confirm))
        lasted = [lasted_s(born_ns, ns, before_ns) > life.confirm_s for born_ns in roster.born_ns[often].tolist()]
        people = self._numbered(people, often[np.array(lasted, np.bool_)])
        return people.select(self._staying(people, ns))

    def found(self, people: People, places: Float[Array, "m 3"], ns: int) -> People:
        """With heads at places where the foreground shows somebody whom nobody follows; who was lost is found again there."""
        lost = np.flatnonzero(people.roster.measured_ns != ns)
        if lost.size:
            away = distances(places[:, :2], people.place[lost, :2])
            within = self._options.life.apart_m + _FAR_M_S * (ns - people.roster.measured_ns[lost]) / NS_PER_S
            away[away > within] = np.inf
            again = np.isfinite(away.min(axis=1))
            for k in np.flatnonzero(again):  # at most a few a moment
                row = lost[[away[k].argmin()]]
                state = people.roster.state.replaced(row, self._cloud(places[[k]], None))
                # how fast they seemed to go while they were lost would take them away again
                velocity = written(people.velocity, row, 0.0)
                people = people.changed(roster=people.roster.changed(state=state), velocity=velocity)
            places = places[~again]
        return people.joined(self._started(places, None, ns)) if len(places) else people

    def _cloud(self, place: Float[Array, "n 3"], yaw: Float[Array, "n"] | None) -> Cloud:
        return around(place, yaw, self._options.life.spread_m, self._options.heads, self._rng)

    def _started(self, place: Float[Array, "n 3"], yaw: Float[Array, "n"] | None, ns: int) -> People:
        n_direction = ASPECTS[0] if self._options.weights.colour.directions else 0
        return People.started(self._cloud(place, yaw), ns, self._n_camera, n_direction)

    def _numbered(self, people: People, who: Index) -> People:
        first, self._last_id = self._last_id + 1, self._last_id + who.size
        return people.changed(roster=people.roster.confirm(who, first))

    def _staying(self, people: People, ns: int) -> Bool[Mask, "n"]:
        """Who goes on: shown lately, and not in the head of somebody older."""
        life, place = self._options.life, people.place
        if self._options.start:  # the paper's: who is known to be there stays, coasting at worst
            return np.ones(len(people), np.bool_)
        stays = coasting_within(people.roster, ns, life.gone_s, life.tentative_s)
        if len(people) > 1:
            near = np.tril(distances(place[:, :2], place[:, :2]) < life.same_head_m, -1)
            younger = near.any(axis=1) & ~(people.roster.confirmed & (people.roster.measured_ns == ns))
            stays &= ~younger
        return stays
