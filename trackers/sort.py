"""Simple online and realtime tracking (Bewley et al., 2016) on the ground plane: the baseline of all trackers."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, ClassVar, Self

import numpy as np
from pydantic import Field

from trackers.arrays import Array, Float, Index, Int
from trackers.configuration import Strict, validate
from trackers.filters.gating import distances, mahalanobis
from trackers.filters.rows import Rows
from trackers.frames.moving_scanners import FollowingTracker, ReportIn, frames_of, moving_layers
from trackers.laser.group import people_seen, scanner_groups, scanners_by_role
from trackers.observations import NS_PER_S, Observation
from trackers.rig import Rig
from trackers.tracking.roster import Roster, Stage, associate
from trackers.tracking.synced_frames import SyncedFrame, SyncPolicy
from trackers.tracking.track_manager import TrackManagementOptions, TrackManager, measured_now
from trackers.tracks import Detection, Track, TrackFrame


class SortOptions(Strict):
    """Options of the baseline: filter, gates, and common track management."""

    former_names: ClassVar = {
        "hits": "track_management.confirm_hits",
        "show_s": "track_management.report_s",
        "coast_s": "track_management.coast_s",
        "apart_m": "track_management.start_apart_m",
    }

    acceleration_m_s2: float = Field(default=3.0, gt=0, description="standard deviation of the acceleration [m/s²]")
    measurement_m: float = Field(default=0.1, gt=0, description="standard deviation of a measured position [m]")
    gate: float = Field(default=4.0, gt=0, description="largest Mahalanobis distance of a pair")
    radius_m: float = Field(default=1.0, gt=0, description="and its largest distance [m]")
    legs_m: float = Field(default=0.7, gt=0, description="how far legs may be from the track they belong to [m]")
    slowdown_s: float = Field(
        default=0.5, gt=0, description="time constant at which a coasting track's speed fades [s]"
    )
    report_in: ReportIn = "rig"
    track_management: TrackManagementOptions = Field(
        default=TrackManagementOptions(confirm_hits=3, report_s=0.4, start_apart_m=0.6),
        description="when tracks are initiated, confirmed, reported and deleted",
    )


@dataclass(frozen=True, eq=False)
class KalmanTracks(Rows):
    """n Kalman filters over (x, vx, y, vy) [m, m/s], batched, bit-identical to `filterpy`."""

    mean: Float[Array, "n 4"]
    covariance: Float[Array, "n 4 4"]

    @classmethod
    def started(cls, places: Float[Array, "n 2"]) -> KalmanTracks:
        """Return filters of people standing at `places` [m]."""
        mean = np.zeros((len(places), 4))
        mean[:, ::2] = places
        return cls(mean, np.tile(np.diag([0.01, 1.0] * 2), (len(places), 1, 1)))

    @property
    def positions(self) -> Float[Array, "n 2"]:
        """The expected positions [m]."""
        return self.mean[:, ::2]

    def innovation_covariances(self, measurement_m: float) -> Float[Array, "n 1 2 2"]:
        """Return H P Hᵀ + R of each [m²]."""
        return (self.covariance[:, ::2, ::2] + np.eye(2) * measurement_m**2)[:, None]

    def predicted(self, F: Float[Array, "n 4 4"], Q: Float[Array, "4 4"]) -> Self:
        """Return F x and F P Fᵀ + Q of each filter."""
        mean = (F @ self.mean[..., None])[..., 0]
        return type(self)(mean, F @ self.covariance @ F.swapaxes(1, 2) + Q)

    def updated(self, rows: Int[Index, "k"], positions: Float[Array, "k 2"], measurement_m: float) -> Self:
        """Return all tracks, with those at `rows` updated by measured positions [m]; the covariance in Joseph's form."""
        if len(rows) == 0:
            return self
        return self.replaced(rows, self.select(rows)._after(positions, measurement_m))

    def _after(self, positions: Float[Array, "n 2"], measurement_m: float) -> Self:
        R, H = np.eye(2) * measurement_m**2, np.eye(4)[::2]
        covariance_h = self.covariance @ H.T  # P Hᵀ
        gain = covariance_h @ np.linalg.inv(H @ covariance_h + R)
        mean = self.mean + (gain @ (positions - self.positions)[..., None])[..., 0]
        rest = np.eye(4) - gain @ H
        joseph = rest @ self.covariance @ rest.swapaxes(1, 2) + gain @ R @ gain.swapaxes(1, 2)
        return type(self)(mean, joseph)


class Sort(FollowingTracker):
    """One Kalman filter per person on trunks, else legs, of all scanners. Raises InputError for a rig without a scanner."""

    Options = SortOptions

    def __init__(
        self, rig: Rig, background: Iterable[Observation] = (), rng: np.random.Generator | None = None, **options: Any
    ) -> None:
        self.options = validate(SortOptions, options, "tracker sort")
        names = [name for each in scanners_by_role(rig, ("waist", "knee")).values() for name in each]
        frames = frames_of(rig, names)
        self.groups = scanner_groups(rig, list(background), moving_layers(frames))
        self.manager = TrackManager(self.options.track_management, rig.area)
        used = tuple(name for group in self.groups.values() for name in group.names)
        rules = SyncPolicy(used, main=rig.main_sensor if rig.main_sensor in used else None)
        super().__init__(rules, frames, self.options.report_in, self.options.track_management.coast_s)
        self.unused_sensors = [name for name in rig.sensors if name not in {*used, *self.bases}]
        self.roster = Roster.started(KalmanTracks.started(np.empty((0, 2))), 0)
        self.ns, self.has_started = 0, False  # stamp of the last frame, and whether there was one
        self.seen = []

    def detections(self) -> list[Detection]:
        """Return the detections of the last frames, trunks first."""
        found = [
            each
            for ns, seen in self.seen
            for role in seen
            for each in self.groups[role].to_detections(seen[role], role, ns)
        ]
        return self.reported_detections(found)

    def tracks(self) -> list[Track]:
        """Return the tracks to report for the last frame, in the order of their starts."""
        roster = self.roster
        shown = self.manager.reported(roster, self.ns).nonzero()[0]
        measured = measured_now(roster, self.ns)[shown].tolist()
        mean = roster.state.mean[shown]
        places, velocities = self.reported(mean[:, ::2], mean[:, 1::2], self.ns)
        rows = zip(roster.id[shown].tolist(), places.tolist(), velocities.tolist(), measured, strict=True)
        return [
            Track(number, *place, *velocity, status="confirmed" if is_measured else "coasting")
            for number, place, velocity, is_measured in rows
        ]

    def _work_all(self, synced_frames: list[SyncedFrame]) -> list[TrackFrame]:
        self.seen = []
        return super()._work_all(synced_frames)

    def _work(self, synced: SyncedFrame) -> None:
        options, manager, last_ns = self.options, self.manager, self.ns if self.has_started else synced.ns
        self.ns, self.has_started = synced.ns, True
        self._predict(last_ns)
        self.seen.append((self.ns, {role: group.detect(synced.observations) for role, group in self.groups.items()}))
        roster, state = self.roster, self.roster.state
        expected = state.positions
        body, whole = people_seen(self.seen[-1][1], expected, manager.area, options.legs_m)
        mahalanobis_distances = mahalanobis(
            expected[:, None], state.innovation_covariances(options.measurement_m), body
        )
        out = (mahalanobis_distances > options.gate) | (distances(expected, body) > options.radius_m)
        known = roster.confirmed
        rows, columns = associate(
            [Stage(known, [mahalanobis_distances], [out]), Stage(~known, [mahalanobis_distances], [out])]
        )
        state = state.updated(rows, body[columns], options.measurement_m)
        roster = roster.measured(rows, self.ns, state)
        roster = manager.confirm(roster, manager.to_confirm(roster, self.ns, self.ns - last_ns))
        roster = roster.select(manager.lasting(roster, self.ns))
        whole[columns] = False
        for place in body[whole]:  # each excludes later ones near it
            if manager.may_start(place[None], roster.state.positions)[0]:
                new = KalmanTracks.started(place[None])
                roster = roster.joined(Roster.started(new, self.ns))
        self.roster = roster

    def _predict(self, last_ns: int) -> None:
        """Predict all filters to the frame's stamp; a track just missed is likelier to stop than to walk on."""
        F, Q = _motion((self.ns - last_ns) / NS_PER_S, self.options.slowdown_s, self.options.acceleration_m_s2)
        in_sight = measured_now(self.roster, last_ns).astype(int)
        self.roster = self.roster.changed(state=self.roster.state.predicted(F[in_sight], Q))


@lru_cache(maxsize=16)
def _motion(
    dt: float, slowdown_s: float, acceleration_m_s2: float
) -> tuple[Float[Array, "2 4 4"], Float[Array, "4 4"]]:
    """Return F of tracks that coast and of those in sight, and Q, over `dt` [s]; read-only, kept for the usual periods."""
    F = np.stack([of_both_axes(np.array([[1, dt], [0, keep]])) for keep in (np.exp(-dt / slowdown_s), 1)])
    Q = of_both_axes(np.outer([dt**2 / 2, dt], [dt**2 / 2, dt])) * acceleration_m_s2**2
    F.setflags(write=False)
    Q.setflags(write=False)
    return F, Q


def of_both_axes(block: Float[Array, "2 2"]) -> Float[Array, "4 4"]:
    """Return the block-diagonal matrix of the same block for x and for y."""
    both = np.zeros((4, 4))
    both[:2, :2] = both[2:, 2:] = block
    return both
