"""Simple online and realtime tracking (Bewley et al., 2016) on the ground plane: the baseline beside every other tracker."""

from math import hypot

import numpy as np
from filterpy.kalman import KalmanFilter
from pydantic import Field

from trackers.area import Area
from trackers.configuration import Strict, validate
from trackers.filters.gating import distances, mahalanobis
from trackers.laser.group import people_seen, scanner_groups
from trackers.observations import NS_PER_S
from trackers.tracking.association import Stage, associate
from trackers.tracking.synced_frames import SyncPolicy
from trackers.tracking.synced_tracker import SynchronizedTracker
from trackers.tracks import Track


class SortOptions(Strict):
    acceleration_m_s2: float = Field(default=3.0, gt=0, description="standard deviation of the acceleration [m/s²]")
    measurement_m: float = Field(default=0.1, gt=0, description="standard deviation of a measured position [m]")
    gate: float = Field(default=4.0, gt=0, description="largest Mahalanobis distance of a pair")
    radius_m: float = Field(default=1.0, gt=0, description="and its largest distance [m]")
    legs_m: float = Field(default=0.7, gt=0, description="how far legs may be from whom they belong to [m]")
    apart_m: float = Field(default=0.6, ge=0, description="no track starts nearer than this to another [m]")
    slowdown_s: float = Field(
        default=0.5, gt=0, description="time constant at which a coasting track's speed fades [s]"
    )
    hits: int = Field(default=3, ge=1, description="measurements that confirm a track")
    show_s: float = Field(default=0.4, ge=0, description="how long a coasting track is reported [s]")
    coast_s: float = Field(default=2.0, ge=0, description="and when it ends; a tentative one at its first miss [s]")


class Sort(SynchronizedTracker):
    """Trunks, else legs, of all scanners; a Kalman filter a person. Raises InputError for a rig without a scanner."""

    def __init__(self, rig, background=(), rng=None, **options):
        self.options = validate(SortOptions, options, "tracker sort")
        self.groups, self.area = scanner_groups(rig, list(background)), Area(rig.area, 0.3) if rig.area else None
        used = tuple(name for group in self.groups.values() for name in group.names)
        self.unused_sensors = [name for name in rig.sensors if name not in used]
        super().__init__(SyncPolicy(used, main=rig.main_sensor if rig.main_sensor in used else None))
        self.people, self.ns, self.last_id, self.seen = [], 0, 0, []

    def _work_all(self, moments):
        self.seen = []
        return super()._work_all(moments)

    def detections(self):
        return [
            each for ns, seen in self.seen for role in seen for each in self.groups[role].told(seen[role], role, ns)
        ]

    def tracks(self):
        shown = [p for p in self.people if p.id and self.ns - p.ns <= self.options.show_s * NS_PER_S]
        return [
            Track(p.id, *p.x[[0, 2, 1, 3]].tolist(), status="confirmed" if p.ns == self.ns else "coasting")
            for p in shown
        ]

    def _work(self, moment):
        options, last, dt, self.ns = self.options, self.ns, (moment.ns - self.ns) / NS_PER_S, moment.ns
        # x, vx, y, vy; whoever was missed is likelier to stop than to walk on
        F = [of_both_axes([[1, dt], [0, keep]]) for keep in (np.exp(-dt / options.slowdown_s), 1)]
        Q = of_both_axes(np.outer([dt**2 / 2, dt], [dt**2 / 2, dt])) * options.acceleration_m_s2**2
        for p in self.people:
            p.F, p.Q = F[p.ns == last], Q
            p.predict()
        self.seen.append((moment.ns, {role: group.detect(moment.observations) for role, group in self.groups.items()}))
        expected = np.array([p.x[::2] for p in self.people]).reshape(-1, 2)
        body, whole = people_seen(self.seen[-1][1], expected, self.area, options.legs_m)
        S = np.array([p.P[::2, ::2] + p.R for p in self.people]).reshape(-1, 1, 2, 2)
        deviations = mahalanobis(expected[:, None], S, body)
        out = (deviations > options.gate) | (distances(expected, body) > options.radius_m)
        known = np.array([p.id > 0 for p in self.people], bool)
        rows, columns = associate([Stage(known, [deviations], [out]), Stage(~known, [deviations], [out])])
        for p, column in zip([self.people[row] for row in rows], columns, strict=True):
            p.update(body[column])
            p.ns, p.hits = moment.ns, p.hits + 1
            if not p.id and p.hits >= options.hits:
                self.last_id = p.id = self.last_id + 1
        self.people = [p for p in self.people if self.ns - p.ns <= (options.coast_s * NS_PER_S if p.id else 0)]
        whole[columns] = False
        for place in body[whole]:
            if all(hypot(*(p.x[::2] - place)) > options.apart_m for p in self.people):
                self.people.append(self.started(place))

    def started(self, place):
        p = KalmanFilter(dim_x=4, dim_z=2)
        p.x, p.id, p.ns, p.hits = np.array([place[0], 0, place[1], 0]), 0, self.ns, 1
        p.H, p.R, p.P = np.eye(4)[::2], np.eye(2) * self.options.measurement_m**2, np.diag([0.01, 1.0] * 2)
        return p


def of_both_axes(block):
    both = np.zeros((4, 4))
    both[:2, :2] = both[2:, 2:] = block
    return both
