"""Track management of `rgbd-head`: known starts as in the paper, else initiation by foreground, re-identification by
position.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float
from numpy.typing import ArrayLike

from trackers.arrays import Array, Mask
from trackers.filters.gating import distances
from trackers.filters.particle import Cloud
from trackers.filters.rows import written
from trackers.observations import NS_PER_S
from trackers.rgbd_head.options import RgbdHeadOptions
from trackers.rgbd_head.people import People, around
from trackers.tracking.track_manager import TrackManager
from trackers.vision.head_outlines import ASPECTS

_FAR_M_S = 1.5
"""Speed that bounds the search for a head not shown."""


class HeadTrackManager(TrackManager):
    """Common track management, and the known starts still to come."""

    def __init__(
        self, options: RgbdHeadOptions, corners: ArrayLike | None, n_camera: int, rng: np.random.Generator
    ) -> None:
        super().__init__(options.track_management, corners)
        self._options, self._n_camera, self._rng = options, n_camera, rng
        self._pending = sorted(options.start, key=lambda start: start.at_s)
        self._last_ns = 0  # of the frame before

    def no_tracks(self) -> People:
        """Return an empty set of tracks."""
        return self._started(np.empty((0, 3)), None, 0)

    def with_known_starts(self, people: People, ns: int) -> People:
        """Add the heads whose known start has come."""
        due = [start for start in self._pending if start.at_s * NS_PER_S <= ns]
        self._pending = self._pending[len(due) :]
        if not due:
            return people
        place, yaw = np.array([start.place for start in due]), np.radians([start.yaw_deg for start in due])
        started = self._started(place, yaw, ns)
        roster = self.confirm(started.roster, np.ones(len(due), np.bool_))
        return people.joined(started.changed(roster=roster))

    def updated(self, people: People, is_shown: Bool[Mask, "n"], ns: int) -> People:
        """Update the tracks shown by a frame: confirm those shown often, delete those not shown for long."""
        roster = people.roster.measured(np.flatnonzero(is_shown), ns, people.roster.state)
        before_ns, self._last_ns = self._last_ns, ns
        roster = self.confirm(roster, self.to_confirm(roster, ns, ns - before_ns))
        people = people.changed(roster=roster)
        return people.select(self._staying(people, ns))

    def initiated(self, people: People, places: Float[Array, "m 3"], ns: int) -> People:
        """Add heads at places of unassigned foreground; re-identify lost ones there."""
        lost = np.flatnonzero(people.roster.measured_ns != ns)
        if lost.size:
            away = distances(places[:, :2], people.place[lost, :2])
            within = self._options.track_management.start_apart_m
            within = within + _FAR_M_S * (ns - people.roster.measured_ns[lost]) / NS_PER_S
            away[away > within] = np.inf
            again = np.isfinite(away.min(axis=1))
            for k in np.flatnonzero(again):  # at most a few per frame
                row = lost[[away[k].argmin()]]
                state = people.roster.state.replaced(row, self._cloud(places[[k]], None))
                # the speed while lost would drive them away again
                velocity = written(people.velocity, row, 0.0)
                people = people.changed(roster=people.roster.changed(state=state), velocity=velocity)
            places = places[~again]
        places = places[self.inside(places[:, :2])]
        return people.joined(self._started(places, None, ns)) if len(places) else people

    def _cloud(self, place: Float[Array, "n 3"], yaw: Float[Array, "n"] | None) -> Cloud:
        return around(place, yaw, self._options.track_management.spread_m, self._options.heads, self._rng)

    def _started(self, place: Float[Array, "n 3"], yaw: Float[Array, "n"] | None, ns: int) -> People:
        n_direction = ASPECTS[0] if self._options.motion.directions else 0
        return People.started(self._cloud(place, yaw), ns, self._n_camera, n_direction)

    def _staying(self, people: People, ns: int) -> Bool[Mask, "n"]:
        """Return a mask of the tracks to keep: shown lately, in the area, and not in the head of an older one."""
        place = people.place
        if self._options.start:  # the paper's: a head of known start stays, coasting if necessary
            return np.ones(len(people), np.bool_)
        stays = self.lasting(people.roster, ns) & self.inside(place[:, :2])
        if len(people) > 1:
            near = distances(place[:, :2], place[:, :2]) < self._options.track_management.same_head_m
            younger = np.tril(near, -1).any(axis=1) & ~(people.roster.confirmed & (people.roster.measured_ns == ns))
            stays &= ~younger
        return stays
