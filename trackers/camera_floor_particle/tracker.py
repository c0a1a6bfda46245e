"""Tracker `camera-floor-particle`: two particle filters per person, independent unless people would overlap.

Tracks are deleted by floor and cameras, and re-identified by clothes.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from math import nan
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from trackers.arrays import Bool, Mask
from trackers.camera_floor_particle.body_filter import CROWN_M, BodyFilter, BodyTracks
from trackers.camera_floor_particle.initiation import Initiation, hull_over
from trackers.camera_floor_particle.options import CameraFloorParticleOptions
from trackers.camera_floor_particle.pan import HeadFilter, unit
from trackers.configuration import validate
from trackers.errors import InputError
from trackers.filters.rows import written
from trackers.likelihood.floor import FloorClusterOptions, FloorFrontEnd, Loads
from trackers.observations import NS_PER_S, FloorFrame, Observation
from trackers.rig import Rig
from trackers.tracking.synced_frames import SyncedFrame, SyncPolicy
from trackers.tracking.synchronized_tracker import SynchronizedTracker
from trackers.tracking.track_manager import TrackManager
from trackers.tracks import Hypotheses, Track
from trackers.vision.front_end import CalibrationMonitor, front_ends, projection_jacobian, silhouette_offsets
from trackers.vision.views import CameraViews, Views

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
        self._deleted: dict[int, BodyTracks] = {}

    def updated(self, people: BodyTracks, loads: Loads | None, views: Views, ns: int, *, is_new: bool) -> BodyTracks:
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

    def identified(self, person: BodyTracks) -> BodyTracks:
        """Return a new track with the id of the most similar deleted one, else with the next id."""
        known = self._reidentified(person)
        if not known:
            return person.changed(roster=self.confirm(person.roster, np.ones(1, np.bool_)))
        del self._deleted[known]
        roster = person.roster.changed(id=written(person.ids, np.array([0]), known), confirmed=np.ones(1, np.bool_))
        return person.changed(roster=roster)

    def _shown(self, people: BodyTracks, views: Views) -> Bool[Mask, "n"]:
        """Return a mask of the tracks that cameras show, with foreground and similar colours."""
        look = views.look(people.place.T)
        n_seen, n_shown = look.seen.sum(axis=0), look.on_foreground.sum(axis=0)
        shown = (n_shown > 0) & (n_shown >= _LEAST_SHOWN * n_seen) & ~people.lost
        alike = 1 + people.body.weights.log_mean / (self._options.body.colour * max(len(views), 1))
        return shown & (alike >= _LEAST_ALIKE)

    def _reidentified(self, person: BodyTracks) -> int:
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


_OFF_M = 0.04
"""Median residual above which a camera is displaced."""
_WALKS_M_S = 0.3
_BENT_M = 0.1
"""Drop of a head below upright from which it is left out: its top may not be the head."""
_SEARCHED_M = 0.35
"""Search radius for a silhouette's top about a crown."""
_APART_M = 0.7
"""Distance of heads in a camera's view within which both are left out."""


def take(calibration: CalibrationMonitor, people: BodyTracks, views: Views) -> None:
    """Add the offsets of one frame [m]. Not with two cameras, as it is unknown which is wrong."""
    upright = people.head_place[:, 2] > people.height_m - CROWN_M - _BENT_M
    walking = upright & (np.hypot(*people.velocity[:, :2].T) > _WALKS_M_S) & ~people.lost
    if len(views) < 3 or not walking.any():
        return
    crowns = people.head_place + np.array([0.0, 0.0, CROWN_M])
    off_m = np.full((calibration.n_camera, len(crowns), 2), np.nan)
    jacobian = np.zeros((calibration.n_camera, len(crowns), 2, 3))
    for view in views:
        m_per_px = np.linalg.norm(crowns - view.camera.eye_m, axis=1) / view.camera.intrinsics.fx
        reach_px = np.maximum(2, np.rint(_SEARCHED_M / m_per_px))
        off_px = silhouette_offsets(view.camera, view.mask, crowns, reach_px, _APART_M / m_per_px)
        off_m[view.number] = off_px * m_per_px[:, None]
        jacobian[view.number] = projection_jacobian(view.camera, crowns) * m_per_px[:, None, None]
    calibration.take_heads(off_m[:, walking], jacobian[:, walking])


_SHOWN = 60
"""Approximate number of particles of a body, or head, for drawings."""
_LONGEST_S = 0.5
"""Greatest time step of the motion after a gap."""


def the_floor(rig: Rig, tracker: str, empty_room: Iterable[Observation]) -> str:
    """Return the name of the rig's pressure floor: of several the first with reports of the empty room, else the first.

    Raises InputError without one.
    """
    reported = {each.sensor for each in empty_room}
    for name in sorted(rig.floors(), key=lambda name: name not in reported):
        return name
    raise InputError(
        f"tracker {tracker}: none of the rig's sensors ({', '.join(rig.sensors)}) is a pressure floor; one of kind floor, "
        "which detects people, is needed"
    )


class DebugState(NamedTuple):
    """Views and loads of the last frame, and the tracks after it."""

    views: Views
    loads: Loads | None
    people: BodyTracks | None


class CameraFloorParticle(SynchronizedTracker):
    """Cameras trigger a frame with the floor's latest one; without cameras the floor triggers.

    Raises InputError for a rig without a pressure floor, which detects people, and for wrong options.
    """

    Options = CameraFloorParticleOptions

    def __init__(
        self, rig: Rig, background: Iterable[Observation] = (), rng: np.random.Generator | None = None, **options: Any
    ) -> None:
        self.options = validate(CameraFloorParticleOptions, options, "tracker camera-floor-particle")
        empty_room = list(background)
        self._floor = the_floor(rig, "camera-floor-particle", empty_room)
        cameras = rig.cameras() if self.options.use_cameras else {}
        self.unused_sensors = [name for name in rig.sensors if name not in cameras and name != self._floor]
        self._rng = np.random.default_rng(0) if rng is None else rng
        self._manager = FloorTrackManager(self.options, rig.area or None)
        area = self._manager.area
        self._views = CameraViews(front_ends(cameras, empty_room, self.options.front_end, area))
        empty_floor = [each for each in empty_room if isinstance(each, FloorFrame) and each.sensor == self._floor]
        of, management = self.options, self.options.track_management
        clusters = FloorClusterOptions(least_value=of.least_value)
        self._loads = FloorFrontEnd(
            rig.floors()[self._floor], empty_floor, clusters, of.load, management.least_load_n, management.stuck_s
        )
        self._bodies, self._heads = BodyFilter(self.options, area), HeadFilter(self.options, area)
        self._initiation = Initiation(self.options, self._manager, len(cameras))
        self._cameras, self._calibration = tuple(cameras), CalibrationMonitor(len(cameras), _OFF_M)
        self.background_learned_causally = self._views.learns_background
        triggers, latest = (tuple(cameras), (self._floor,)) if cameras else ((self._floor,), ())
        main = rig.main_sensor if rig.main_sensor in triggers else None
        super().__init__(SyncPolicy(triggers, latest=latest, main=main, awaited=(*triggers, *latest)))
        self._has_pictures = bool(cameras)
        self._people: BodyTracks | None = None
        self._ns, self._began = 0, False
        self._last: tuple[Views, Loads | None] = Views(()), None

    def tracks(self) -> list[Track]:
        """Return all tracks of the last frame."""
        people = self._people
        if people is None:
            return []
        z, head, pan = people.place[:, 2], people.head_place, people.pan
        if not self._has_pictures:  # a floor shows no heights
            z, head, pan = np.full(z.shape, nan), np.full(head.shape, nan), np.full(pan.shape, nan)
        rows = np.column_stack([people.place[:, :2], people.velocity[:, :2], z, head, pan]).tolist()
        status = np.where(people.lost | (people.roster.measured_ns < self._ns), "coasting", "confirmed").tolist()
        reported = self._manager.reported(people.roster, self._ns)
        return [
            Track(number, *row, status=each)
            for number, row, each, counts in zip(people.ids.tolist(), rows, status, reported, strict=True)
            if counts
        ]

    @property
    def warnings(self) -> list[str]:
        """Deviations of floor and cameras from the rig found so far."""
        floor = self._loads.warning
        return [f"{self._floor} {floor}"] * (floor is not None) + [
            f"{self._cameras[number]} shows walkers' heads elsewhere than the other cameras do, and cannot hang as the rig says"
            for number in self._calibration.suspect
        ]

    def debug_state(self) -> DebugState:
        """Return the state of the last frame, for drawings."""
        return DebugState(*self._last, self._people)

    def _maps(self) -> tuple[Hypotheses, ...]:
        """Return some particles of all bodies and heads, and the windows about both estimates."""
        people = self._people
        if people is None or not self._has_pictures:
            return ()
        return tuple(
            Hypotheses(number, some[:, row].T, partial(window.box, place[row]))
            for cloud, place, window in (
                (people.body, people.place, self.options.body.window),
                (people.head, people.head_place, self.options.head.window),
            )
            for some in (cloud.state[:3, :, :: max(1, cloud.state.shape[2] // _SHOWN)],)
            for row, number in enumerate(people.ids.tolist())
        )

    def _work(self, synced: SyncedFrame) -> None:
        dt = min((synced.ns - self._ns) / NS_PER_S, _LONGEST_S) if self._began else 0.0
        self._ns, self._began = synced.ns, True
        frame = {**synced.latest, **synced.observations}.get(self._floor)
        frame = frame if isinstance(frame, FloorFrame) else None
        is_new = self._loads.is_new(frame)
        loads = self._loads.loads(frame, synced.ns)
        views = self._views.views(synced.observations)
        self._last = views, loads
        if self._people is not None and len(self._people) and dt > 0:
            offset = self._people.head_place - self._people.place
            people = self._bodies.step(self._people, dt, loads, views, self._rng)
            if self._has_pictures:
                people = self._heads.step(people, offset, dt, views, self._rng)
                people = self._initiation.with_heads_on_top(people, views, self._rng)
                take(self._calibration, people, views)
            self._people = self._manager.updated(people, loads, views, self._ns, is_new=is_new)
        if loads is not None and is_new:
            self._initiate(loads, views)

    def _initiate(self, loads: Loads, views: Views) -> None:
        """Initiate tracks of unassigned clusters over which cameras see a person."""
        people, centroid = self._people, loads.clusters.centroid
        new = self._initiation.unexplained(people, loads)
        hulls = {k: hull_over(centroid[k], views, people) for k in np.flatnonzero(new)}
        if views:
            empty = np.zeros(len(new), np.bool_)
            empty[[k for k, (_, maybe) in hulls.items() if not maybe]] = True
            self._loads.learn_own(loads, empty, self._ns)
            new[[k for k, (hull, _) in hulls.items() if not len(hull)]] = False
        places = np.flatnonzero(new)
        for k in places[self._initiation.due(centroid[places], self._ns)]:
            load_n = float(loads.clusters.load_n[k])
            person = self._initiation.person(centroid[k], load_n, hulls[k][0], views, self._ns, self._rng)
            person = self._manager.identified(person)
            self._people = person if self._people is None else self._people.joined(person)
