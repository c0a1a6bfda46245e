"""Baselines: clusters of the floor, one Kalman filter per person, nearest neighbour; with or without colour."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from pydantic import Field, PositiveInt

from trackers.arrays import Array, Bool, Float, Index, Int, Mask
from trackers.camera_floor_particle.options import HeadOptions
from trackers.camera_floor_particle.tracker import the_floor
from trackers.configuration import Strict, described, validate
from trackers.filters.gating import distances
from trackers.filters.rows import Rows
from trackers.likelihood.floor import FloorClusterOptions, floor_clusters
from trackers.observations import NS_PER_S, FloorFrame, Observation
from trackers.rig import Rig
from trackers.sort import KalmanTracks, of_both_axes
from trackers.tracking.roster import Roster, Stage, associate, left_over
from trackers.tracking.synced_frames import SyncedFrame, SyncPolicy
from trackers.tracking.synchronized_tracker import SynchronizedTracker
from trackers.tracking.track_manager import TrackManagementOptions, TrackManager, measured_now
from trackers.tracks import Track
from trackers.vision.front_end import FrontEndOptions, front_ends
from trackers.vision.histogram import bhattacharyya_distance, normalised
from trackers.vision.views import BINS, CameraViews, Views

_CHEST_M = 1.1
"""Height of the chest, whose colours distinguish people."""
_WINDOW = HeadOptions().window


class ClusterTrackManagementOptions(TrackManagementOptions):
    """Common track management options; a track is detected if it has a cluster."""

    confirm_s: float = Field(default=0.28, ge=0, description=described(TrackManagementOptions, "confirm_s"))
    confirm_hits: PositiveInt = Field(default=2, description=described(TrackManagementOptions, "confirm_hits"))
    start_apart_m: float = Field(default=0.8, ge=0, description=described(TrackManagementOptions, "start_apart_m"))
    area_margin_m: float = Field(default=100.0, ge=0, description="how far outside the rig's area tracks are kept [m]")


class ClusterKalmanOptions(Strict):
    """Options of the baselines."""

    former_names: ClassVar[Mapping[str, str]] = {
        "confirm_s": "track_management.confirm_s",
        "gone_s": "track_management.coast_s",
    }

    colour: float = Field(
        default=0.0,
        ge=0,
        description="what the distance D in colour adds to the distance of a pair [m]; 0: no camera is used",
    )
    floor: FloorClusterOptions = Field(
        default=FloorClusterOptions(least_load_n=80.0), description="what counts as a person's load"
    )
    acceleration_m_s2: float = Field(default=3.0, gt=0, description="standard deviation of the acceleration [m/s²]")
    measurement_m: float = Field(default=0.1, gt=0, description="standard deviation of a cluster's middle [m]")
    radius_m: float = Field(default=0.8, gt=0, description="a cluster farther from a track is not its own [m]")
    track_management: ClusterTrackManagementOptions = Field(
        default=ClusterTrackManagementOptions(),
        description="when tracks are initiated, confirmed, reported and deleted",
    )


@dataclass(frozen=True, eq=False)
class ClusterTracks(Rows):
    """n tracks: Kalman filters, and the colours that cameras saw over the first cluster."""

    kalman: KalmanTracks
    colours: Float[Array, "n bins"]


class ClusterKalman(SynchronizedTracker):
    """Tracker triggered by the floor's frames; raises InputError for a rig without a floor."""

    Options = ClusterKalmanOptions

    def __init__(
        self, rig: Rig, background: Iterable[Observation] = (), rng: np.random.Generator | None = None, **options: Any
    ) -> None:
        self.options = validate(ClusterKalmanOptions, options, "tracker floor-kalman")
        empty_room = list(background)
        self._name = the_floor(rig, "floor-kalman", empty_room)
        self._floor = rig.floors()[self._name]
        cameras = rig.cameras() if self.options.colour else {}
        self._views = CameraViews(front_ends(cameras, empty_room, FrontEndOptions()))
        self.unused_sensors = [name for name in rig.sensors if name not in cameras and name != self._name]
        super().__init__(SyncPolicy((self._name,), attached=tuple(cameras)))
        self._manager = TrackManager(self.options.track_management, rig.area or None)
        self._roster = Roster.started(self._started(np.empty((0, 2)), np.empty((0, BINS.size))), 0)
        self._ns = 0

    def tracks(self) -> list[Track]:
        """Return the tracks to report for the last frame."""
        roster, measured = self._roster, measured_now(self._roster, self._ns)
        return [
            Track(
                int(roster.id[k]),
                *roster.state.kalman.mean[k, [0, 2, 1, 3]].tolist(),
                status="confirmed" if measured[k] else "coasting",
            )
            for k in np.flatnonzero(self._manager.reported(roster, self._ns))
        ]

    def _work(self, synced: SyncedFrame) -> None:
        before_ns, self._ns = self._ns, synced.ns
        roster, manager = self._roster, self._manager
        dt = (synced.ns - before_ns) / NS_PER_S
        F = np.tile(of_both_axes(np.array([[1, dt], [0, 1]])), (len(roster), 1, 1))
        Q = of_both_axes(np.outer([dt**2 / 2, dt], [dt**2 / 2, dt])) * self.options.acceleration_m_s2**2
        tracks = roster.state.changed(kalman=roster.state.kalman.predicted(F, Q))
        frame = synced.observations.get(self._name)
        is_there = isinstance(frame, FloorFrame)
        places = floor_clusters(frame, self._floor, self.options.floor).centroid if is_there else np.empty((0, 2))
        colours = self._colours(places, self._views.views(synced.observations))
        rows, columns = self._paired(tracks, places, colours)
        kalman = tracks.kalman.updated(rows, places[columns], self.options.measurement_m)
        roster = roster.measured(rows, self._ns, tracks.changed(kalman=kalman))
        roster = manager.confirm(roster, manager.to_confirm(roster, self._ns, self._ns - before_ns))
        kept = manager.lasting(roster, self._ns) & manager.inside(roster.state.kalman.positions)
        roster = roster.select(kept)
        for column in left_over(len(places), columns):
            place = places[[column]]
            # the other foot of a tracked person is a separate cluster; as a track it would be confirmed at high rates
            if manager.may_start(place, roster.state.kalman.positions).all():
                roster = roster.joined(Roster.started(self._started(place, colours[[column]]), self._ns))
        self._roster = roster

    def _paired(
        self, tracks: ClusterTracks, places: Float[Array, "k 2"], colours: Float[Array, "k bins"]
    ) -> tuple[Int[Index, "p"], Int[Index, "p"]]:
        away = distances(tracks.kalman.positions, places)
        cost = away
        if self.options.colour and len(places) and len(tracks):
            cost = away + self.options.colour * bhattacharyya_distance(tracks.colours, colours)
        every: Bool[Mask, "n"] = np.ones(len(tracks), np.bool_)
        return associate([Stage(every, [cost], [away > self.options.radius_m])])

    def _colours(self, places: Float[Array, "k 2"], views: Views) -> Float[Array, "k bins"]:
        """Count the colours of the foreground at chest height over each place, all cameras together."""
        total = np.zeros((len(places), BINS.size))
        chest = np.column_stack([places, np.full(len(places), _CHEST_M)]).T
        look = views.look(chest)
        if look.seen.any():
            np.add.at(total, look.seen.nonzero()[1], views.colours(chest, look.pixels, look.seen, _WINDOW))
        return normalised(total)

    def _started(self, places: Float[Array, "n 2"], colours: Float[Array, "n bins"]) -> ClusterTracks:
        return ClusterTracks(KalmanTracks.started(places), colours)
