"""The naive baselines: clusters of the floor, a Kalman filter a person, the nearest neighbour; and the same with colour."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from filterpy.kalman import KalmanFilter
from jaxtyping import Bool, Float
from pydantic import Field

from trackers.arrays import Array, Mask
from trackers.camera_floor_particle.options import CameraFloorParticleOptions
from trackers.camera_floor_particle.tracker import the_floor
from trackers.camera_floor_particle.views import CameraFrontEnds, Views
from trackers.configuration import Strict, validate
from trackers.filters.gating import distances
from trackers.floor.clusters import FloorClusterOptions, floor_clusters
from trackers.observations import NS_PER_S, FloorFrame, Observation
from trackers.rig import Rig
from trackers.tracking.association import Stage, associate
from trackers.tracking.synced_frames import SyncedFrame, SyncPolicy
from trackers.tracking.synced_tracker import SynchronizedTracker
from trackers.tracking.track_manager import lasted_s
from trackers.tracks import Track
from trackers.vision.histogram import bhattacharyya_distance, normalised

_LOOK_AT_M = 1.1
"""Height of the chest, whose colours tell who it is."""


class ClusterKalmanOptions(Strict):
    """Constants of the baselines."""

    colour: float = Field(
        default=0.0,
        ge=0,
        description="what the distance D in colour adds to the distance of a pair [m]; 0: not looked at",
    )
    floor: FloorClusterOptions = Field(
        default=FloorClusterOptions(least_load_n=80.0), description="what counts as somebody's load"
    )
    acceleration_m_s2: float = Field(default=3.0, gt=0, description="standard deviation of the acceleration [m/s²]")
    measurement_m: float = Field(default=0.1, gt=0, description="standard deviation of a cluster's middle [m]")
    radius_m: float = Field(default=0.8, gt=0, description="a cluster farther from everybody is somebody new [m]")
    confirm_s: float = Field(
        default=0.28,
        ge=0,
        description="a track measured at each frame for longer than this is confirmed, each frame standing for the time since "
        "the one before [s]",
    )
    gone_s: float = Field(default=2.0, gt=0, description="who is not measured for so long is gone [s]")


class ClusterKalman(SynchronizedTracker):
    """Works at the floor's own frames; raises InputError for a rig without a floor."""

    def __init__(
        self, rig: Rig, background: Iterable[Observation] = (), rng: np.random.Generator | None = None, **options: Any
    ) -> None:
        self.options = validate(ClusterKalmanOptions, options, "tracker floor-kalman")
        empty_room = list(background)
        self._name = the_floor(rig, "floor-kalman", empty_room)
        self._floor = rig.floors()[self._name]
        cameras = rig.cameras() if self.options.colour else {}
        self._shared = CameraFloorParticleOptions()
        self._watchers = CameraFrontEnds(cameras, empty_room, self._shared)
        self.unused_sensors = [name for name in rig.sensors if name not in cameras and name != self._name]
        super().__init__(SyncPolicy((self._name,), attached=tuple(cameras)))
        self._people: list[Any] = []
        self._ns, self._last_id = 0, 0

    def tracks(self) -> list[Track]:
        """Everybody confirmed, as of the moment worked last."""
        return [
            Track(p.id, *p.x[[0, 2, 1, 3]].tolist(), status="confirmed" if p.ns == self._ns else "coasting")
            for p in self._people
            if p.id
        ]

    def _work(self, moment: SyncedFrame) -> None:
        options, before_ns, self._ns = self.options, self._ns, moment.ns
        dt = (moment.ns - before_ns) / NS_PER_S
        for p in self._people:
            p.F = np.kron(np.eye(2), [[1, dt], [0, 1]])
            p.Q = np.kron(np.eye(2), np.outer([dt**2 / 2, dt], [dt**2 / 2, dt])) * options.acceleration_m_s2**2
            p.predict()
        frame = moment.observations.get(self._name)
        floor = isinstance(frame, FloorFrame)
        places = floor_clusters(frame, self._floor, options.floor).centroid if floor else np.empty((0, 2))
        colours = self._colours(places, self._watchers.views(moment.observations))
        rows, columns = self._paired(places, colours)
        for row, column in zip(rows.tolist(), columns.tolist(), strict=True):
            p = self._people[row]
            p.update(places[column])
            p.ns = moment.ns
            if not p.id and lasted_s(p.born_ns, moment.ns, before_ns) > options.confirm_s:
                self._last_id = p.id = self._last_id + 1
        self._people = [p for p in self._people if self._ns - p.ns <= (options.gone_s * NS_PER_S if p.id else 0)]
        for column in np.setdiff1d(np.arange(len(places)), columns):
            self._people.append(self._started(places[column], colours[column]))

    def _paired(self, places: Float[Array, "k 2"], colours: Float[Array, "k bins"]) -> tuple[Any, Any]:
        expected = np.array([p.x[::2] for p in self._people]).reshape(-1, 2)
        away = distances(expected, places)
        cost = away
        if self.options.colour and len(places) and self._people:
            cost = away + self.options.colour * bhattacharyya_distance(
                np.array([p.colours for p in self._people]), colours
            )
        everybody: Bool[Mask, "n"] = np.ones(len(expected), np.bool_)
        return associate([Stage(everybody, [cost], [away > self.options.radius_m])])

    def _colours(self, places: Float[Array, "k 2"], views: Views) -> Float[Array, "k bins"]:
        """The colours of the foreground at the height of a chest over each place, all cameras together."""
        total = np.zeros((len(places), self._shared.histogram.size))
        chest = np.column_stack([places, np.full(len(places), _LOOK_AT_M)]).T
        pixels, seen, _ = views.look(chest)
        if seen.any():
            np.add.at(total, seen.nonzero()[1], views.colours(chest, pixels, seen, self._shared.head.window))
        return normalised(total)

    def _started(self, place: Float[Array, "2"], colours: Float[Array, "bins"]) -> Any:
        p: Any = KalmanFilter(dim_x=4, dim_z=2)
        p.x, p.id, p.colours = np.array([place[0], 0, place[1], 0]), 0, colours
        p.ns = p.born_ns = self._ns
        p.H, p.R, p.P = np.eye(4)[::2], np.eye(2) * self.options.measurement_m**2, np.diag([0.01, 1.0] * 2)
        return p
