"""Track management of `camera-floor-particle`: deletion by floor and cameras, re-identification by clothes."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool
from numpy.typing import ArrayLike

from trackers.arrays import Mask
from trackers.camera_floor_particle.loads import Loads
from trackers.camera_floor_particle.options import CameraFloorParticleOptions
from trackers.camera_floor_particle.pan import unit
from trackers.camera_floor_particle.people import People
from trackers.filters.rows import written
from trackers.tracking.track_manager import TrackManager
from trackers.vision.views import Views

_LEAST_SHOWN = 0.5
"""Share of the cameras with a place in view that must show foreground there."""
_LEAST_ALIKE = 0.3
"""Least similarity of colours (1 − D²), averaged over cameras and particles, of a track shown by cameras."""
_WEIGHT_MEMORY = 0.9
_MOST_DELETED = 50
"""Greatest number of remembered deleted tracks, to bound memory."""


class FloorTrackManager(TrackManager):
    """Common track management; a track is detected where cameras, or without pictures the floor, show its person."""

    def __init__(self, options: CameraFloorParticleOptions, corners: ArrayLike | None) -> None:
        super().__init__(options.track_management, corners)
        self._options = options
        self._deleted: dict[int, People] = {}

    def updated(self, people: People, loads: Loads | None, views: Views, ns: int, *, is_new: bool) -> People:
        """Return the tracks updated by a frame, without those not detected for too long. is_new: of the floor's frame."""
        shown = self._shown(people, views)
        if loads is not None:
            near = loads.cluster_near(people.place[:, :2], self._options.track_management.start_apart_m)
            shown |= near.any(axis=1) if not views else False
            if is_new:
                alone = near & (near.sum(axis=0) == 1)
                load_n = alone @ loads.clusters.load_n
                learned = _WEIGHT_MEMORY * people.weight_n + (1 - _WEIGHT_MEMORY) * load_n
                people = people.changed(weight_n=np.where(load_n > 0, learned, people.weight_n))
        people = people.changed(roster=people.roster.measured(np.flatnonzero(shown), ns, people.body))
        stays = self.lasting(people.roster, ns)
        for row in np.flatnonzero(~stays):
            self._deleted[int(people.ids[row])] = people.select(np.array([row]))
            if len(self._deleted) > _MOST_DELETED:
                del self._deleted[next(iter(self._deleted))]
        return people.select(stays)

    def identified(self, person: People) -> People:
        """Return a new track with the id of the most similar deleted one, else with the next id."""
        known = self._reidentified(person)
        if not known:
            return person.changed(roster=self.confirm(person.roster, np.ones(1, np.bool_)))
        del self._deleted[known]
        roster = person.roster.changed(id=written(person.ids, np.array([0]), known), confirmed=np.ones(1, np.bool_))
        return person.changed(roster=roster)

    def _shown(self, people: People, views: Views) -> Bool[Mask, "n"]:
        """Return a mask of the tracks that cameras show, with foreground and similar colours."""
        look = views.look(people.place.T)
        n_seen, n_shown = look.seen.sum(axis=0), look.on_foreground.sum(axis=0)
        shown = (n_shown > 0) & (n_shown >= _LEAST_SHOWN * n_seen) & ~people.lost
        alike = 1 + people.body.weights.log_mean / (self._options.body.colour * max(len(views), 1))
        return shown & (alike >= _LEAST_ALIKE)

    def _reidentified(self, person: People) -> int:
        """Return the id of the deleted track in these clothes, by D (eq. 4) of all cameras' colours together; 0: none."""
        if not self._deleted or not person.clothes.any():
            return 0
        colours = unit(person.clothes[0].mean(axis=0))
        distance = {
            number: np.sqrt(max(0.0, 1 - float(colours @ unit(each.clothes[0].mean(axis=0)))))
            for number, each in self._deleted.items()
        }
        best = min(distance, key=distance.__getitem__)
        return best if distance[best] < self._options.track_management.reid_distance else 0
