"""The tracker `camera-floor-particle`: a pair of particle filters a person, that meet only where they would overlap."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from math import nan
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackers.area import Area
from trackers.camera_floor_particle.body import BodyFilter
from trackers.camera_floor_particle.calibration_check import FEWEST, OFF_M, look
from trackers.camera_floor_particle.detection import Newcomers, hull_over
from trackers.camera_floor_particle.head import HeadFilter
from trackers.camera_floor_particle.loads import FloorWatch, Loads
from trackers.camera_floor_particle.options import CameraFloorParticleOptions
from trackers.camera_floor_particle.pan import unit
from trackers.camera_floor_particle.people import People
from trackers.camera_floor_particle.views import CameraFrontEnds, Views
from trackers.configuration import validate
from trackers.errors import InputError
from trackers.observations import NS_PER_S, FloorFrame, Observation
from trackers.rig import Rig
from trackers.tracking.synced_frames import SyncedFrame, SyncPolicy
from trackers.tracking.synced_tracker import SynchronizedTracker
from trackers.tracks import Hypotheses, Track
from trackers.vision.calibration_monitor import CalibrationMonitor

_LEAST_SHOWN = 0.5
"""Share of the cameras that see a place from which, showing foreground there, they show somebody."""
_WEIGHT_MEMORY = 0.9
_MOST_GONE = 50
"""So many of those who left are remembered, so that memory stays flat."""
_SHOWN = 60
"""So many particles of a body, or of a head, are told for drawings, or a few more."""
_LONGEST_S = 0.5
"""However long nothing came, people move for no longer at once."""


def the_floor(rig: Rig, tracker: str, empty_room: Iterable[Observation]) -> str:
    """Return the name of the rig's pressure floor: of several the first that reported of the empty room, else the first.

    Raises InputError where there is none.
    """
    reported = {each.sensor for each in empty_room}
    for name in sorted(rig.floors(), key=lambda name: name not in reported):
        return name
    raise InputError(
        f"tracker {tracker}: none of the rig's sensors ({', '.join(rig.sensors)}) is a pressure floor; one of kind floor, "
        "which detects people, is needed"
    )


class Inside(NamedTuple):
    """What the tracker knew at the moment worked last: pictures as it saw them, the floor's loads, everybody's particles."""

    views: Views
    loads: Loads | None
    people: People | None
    ids: NDArray[np.intp]


class CameraFloorParticle(SynchronizedTracker):
    """Cameras open a moment, the pressure floor's newest frame is held; without cameras the floor alone opens.

    Raises InputError for a rig without a pressure floor, which detects people, and for wrong options.
    """

    def __init__(
        self, rig: Rig, background: Iterable[Observation] = (), rng: np.random.Generator | None = None, **options: Any
    ) -> None:
        self.options = validate(CameraFloorParticleOptions, options, "tracker camera-floor-particle")
        empty_room = list(background)
        self._floor = the_floor(rig, "camera-floor-particle", empty_room)
        cameras = rig.cameras() if self.options.use_cameras else {}
        self.unused_sensors = [name for name in rig.sensors if name not in cameras and name != self._floor]
        area = Area(rig.area, self.options.room_margin_m) if rig.area else None
        self._rng = np.random.default_rng(0) if rng is None else rng
        self._watchers = CameraFrontEnds(cameras, empty_room, self.options, area)
        empty_floor = [each for each in empty_room if isinstance(each, FloorFrame) and each.sensor == self._floor]
        self._watch = FloorWatch(rig.floors()[self._floor], empty_floor, self.options)
        self._bodies, self._heads = BodyFilter(self.options, area), HeadFilter(self.options, area)
        self._newcomers = Newcomers(self.options, len(cameras))
        self._cameras, self._doubts = tuple(cameras), CalibrationMonitor(len(cameras), OFF_M, FEWEST)
        self.background_learned_causally = self._watchers.learns_background
        opens, held = (tuple(cameras), (self._floor,)) if cameras else ((self._floor,), ())
        main = rig.main_sensor if rig.main_sensor in opens else None
        super().__init__(SyncPolicy(opens, latest=held, main=main, awaited=(*opens, *held)))
        self._has_pictures = bool(cameras)
        self._people: People | None = None
        self._ids = np.empty(0, np.intp)
        self._gone: dict[int, People] = {}
        self._last_id, self._ns, self._began = 0, 0, False
        self._views = Views(())
        self._loads: Loads | None = None

    def tracks(self) -> list[Track]:
        """Everybody, as of the moment worked last."""
        people = self._people
        if people is None:
            return []
        z, head, pan = people.place[:, 2], people.head_place, people.pan
        if not self._has_pictures:  # a floor tells no heights
            z, head, pan = np.full(z.shape, nan), np.full(head.shape, nan), np.full(pan.shape, nan)
        rows = np.column_stack([people.place[:, :2], people.velocity[:, :2], z, head, pan]).tolist()
        status = np.where(people.lost | (people.shown_ns < self._ns), "coasting", "confirmed").tolist()
        return [
            Track(number, *row, status=each) for number, row, each in zip(self._ids.tolist(), rows, status, strict=True)
        ]

    @property
    def warnings(self) -> list[str]:
        """What of floor and cameras is not as the rig says, as far as it has been seen by now."""
        floor = self._watch.doubt
        return [f"{self._floor} {floor}"] * (floor is not None) + [
            f"{self._cameras[number]} shows walkers' heads elsewhere than the other cameras do, and cannot hang as the rig says"
            for number in self._doubts.doubted
        ]

    def inside(self) -> Inside:
        """What was known at the moment worked last, for drawings."""
        return Inside(self._views, self._loads, self._people, self._ids)

    def _maps(self) -> tuple[Hypotheses, ...]:
        """Some particles of everybody's body and head, and the windows about both estimates."""
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
            for row, number in enumerate(self._ids.tolist())
        )

    def _work(self, moment: SyncedFrame) -> None:
        dt = min((moment.ns - self._ns) / NS_PER_S, _LONGEST_S) if self._began else 0.0
        self._ns, self._began = moment.ns, True
        frame = {**moment.latest, **moment.observations}.get(self._floor)
        frame = frame if isinstance(frame, FloorFrame) else None
        is_new = self._watch.is_new(frame, moment.ns)
        loads = self._watch.loads(frame, moment.ns)
        views = self._watchers.views(moment.observations)
        self._views, self._loads = views, loads
        if self._people is not None and len(self._people) and dt > 0:
            offset = self._people.head_place - self._people.place
            self._people = self._bodies.step(self._people, dt, loads, views, self._rng)
            if self._has_pictures:
                self._people = self._heads.step(self._people, offset, dt, views, self._rng)
                look(self._doubts, self._people, views)
            self._look_after(loads, views, is_new=is_new)
        if loads is not None and is_new:
            self._detect(loads, views)

    def _look_after(self, loads: Loads | None, views: Views, *, is_new: bool) -> None:
        """Who is shown by floor or cameras; whoever is not for long is gone."""
        people = self._people
        assert people is not None
        n_seen, n_shown = (each.sum(axis=0) for each in views.look(people.place.T)[1:])
        shown = (n_shown > 0) & (n_shown >= _LEAST_SHOWN * n_seen) & ~people.lost
        alike = 1 + people.body.weights.log_mean / (self.options.body.colour * max(len(views), 1))
        shown &= alike >= self.options.detection.least_alike
        if loads is not None:
            near = loads.cluster_near(people.place[:, :2], self.options.detection.apart_m)
            shown |= near.any(axis=1) if not views else False
            alone = near & (near.sum(axis=0) == 1)
            load_n = alone @ loads.clusters.load_n
            learned = _WEIGHT_MEMORY * people.weight_n + (1 - _WEIGHT_MEMORY) * load_n
            if is_new:
                people = people.changed(weight_n=np.where(load_n > 0, learned, people.weight_n))
        people = people.changed(shown_ns=np.where(shown, self._ns, people.shown_ns))
        stays = self._ns - people.shown_ns <= self.options.detection.gone_s * NS_PER_S
        for row in np.flatnonzero(~stays):
            self._gone[int(self._ids[row])] = people.select(np.array([row]))
            if len(self._gone) > _MOST_GONE:
                del self._gone[next(iter(self._gone))]
        self._people, self._ids = people.select(stays), self._ids[stays]

    def _detect(self, loads: Loads, views: Views) -> None:
        """Clusters that are somebody new, or somebody again."""
        new = self._newcomers.unexplained(self._people, loads)
        centroid = loads.clusters.centroid
        hulls = {k: hull_over(centroid[k], views) for k in np.flatnonzero(new)}
        if views:
            nobody = np.zeros(len(new), np.bool_)
            nobody[[k for k, hull in hulls.items() if not len(hull)]] = True
            self._watch.learn_own(loads, nobody, self._ns)
            new &= ~nobody
        places = np.flatnonzero(new)
        for k in places[self._newcomers.confirmed(centroid[places], self._ns)]:
            load_n = float(loads.clusters.load_n[k])
            person = self._newcomers.person(centroid[k], load_n, hulls[k], views, self._ns, self._rng)
            self._join(person)

    def _join(self, person: People) -> None:
        """Take somebody in: under the number of who is gone and looks the same, else under a new one."""
        number = self._recognised(person)
        if number:
            del self._gone[number]
        else:
            self._last_id = number = self._last_id + 1
        self._people = person if self._people is None else self._people.joined(person)
        self._ids = np.append(self._ids, number)

    def _recognised(self, person: People) -> int:
        """Who of those gone wears these clothes, by D of eq. 4 of the colours of all cameras together; 0: none."""
        if not self._gone or not person.clothes.any():
            return 0
        look = unit(person.clothes[0].mean(axis=0))
        distance = {
            number: np.sqrt(max(0.0, 1 - float(look @ unit(gone.clothes[0].mean(axis=0)))))
            for number, gone in self._gone.items()
        }
        best = min(distance, key=distance.__getitem__)
        return best if distance[best] < self.options.detection.same_below else 0
