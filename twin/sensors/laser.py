"""The planar laser scanner: one bundle of rays for each instant of its sweep."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise

import mujoco
import numpy as np

from trackers.observations import LaserScan
from trackers.rig import LaserSensor
from twin.instant.snapshot import Snapshot, base_body
from twin.sensors.rays import Hits, RayFan, trace_rays
from twin.sensors.sensor import Reading, State

SWEEP_STEP_S = 0.005
"""Period of snapshots during a sweep [s]: a person at 2 m/s is placed to within 5 mm."""


class Laser:
    """An ideal scanner: exact ranges along infinitely thin rays, and the person at each ray as truth.

    Beams go counter-clockwise from `angle_min_rad` in steps of `angle_increment_rad` in the x-y plane of the sensor's frame (x
    ahead, y left, z up). A return nearer than `range_min_m` is NaN (invalid), none within `range_max_m` is +inf (REP 117).
    With `sweep_time_s` > 0 the first beam is measured at the stamp and the last that much later. Beams are grouped, so that
    each is measured within SWEEP_STEP_S / 2 of its time, from the scanner's pose then. On a driving housing the pose changes;
    rays pass through the housing's own body.

    `origin_m` (3,) and `directions` (n_beam, 3) are its rays in the room frame, or in that of its housing.

    Simplified: every surface reflects; glass and mirrors are walls (geoms with alpha = 0 are not seen at all).
    """

    def __init__(
        self,
        name: str,
        rig: LaserSensor,
        *,
        beams: int,
        angle_min_rad: float,
        angle_increment_rad: float,
        range_min_m: float,
        range_max_m: float,
        sweep_time_s: float = 0.0,
    ) -> None:
        self.name = name
        self._rig = rig
        # A scan message holds these in single precision: the recording has the measured values.
        self._angle_min_rad = float(np.float32(angle_min_rad))
        self._angle_increment_rad = float(np.float32(angle_increment_rad))
        self._range_min_m = float(np.float32(range_min_m))
        self._range_max_m = float(np.float32(range_max_m))
        self._sweep_time_s = sweep_time_s
        angles = self._angle_min_rad + self._angle_increment_rad * np.arange(beams)
        in_sensor = np.stack([np.cos(angles), np.sin(angles), np.zeros(beams)], axis=1)  # (n_beam, 3)
        # Rays of a sensor that never moves are turned into the room's frame once.
        pose = rig.room_from_sensor
        self.origin_m, self.directions = pose.translation, np.ascontiguousarray(in_sensor @ pose.rotation.T)
        self._fan = RayFan(self.origin_m, self.directions, pose.rotation[:, 2].copy(), self._range_max_m)
        self._distance = np.empty(beams)
        self._person = np.empty(beams, dtype=np.int16)
        self._sectors, self.instants_s = self._split_sweep(beams)

    def _split_sweep(self, beams: int) -> tuple[list[slice], tuple[float, ...]]:
        """Group the beams by time; return the groups, and the mean time of each after the stamp [s]."""
        count = min(beams, max(1, int(np.ceil(self._sweep_time_s / SWEEP_STEP_S))))
        edges = np.linspace(0, beams, count + 1).round().astype(int)
        sectors = [slice(int(first), int(last)) for first, last in pairwise(edges)]
        per_beam_s = self._sweep_time_s / max(1, beams - 1)
        return sectors, tuple(per_beam_s * (sector.start + sector.stop - 1) / 2 for sector in sectors)

    def observe(
        self, stamp_ns: int, snapshots: Iterable[Snapshot], state: State, rng: np.random.Generator
    ) -> tuple[Reading, State]:
        """Return the ideal scan; `rng` and `state` are not used."""
        for sector, snapshot in zip(self._sectors, snapshots, strict=True):
            geom, self._distance[sector] = self._trace(snapshot, sector)
            # A miss has geom -1 and takes the last geom's person here; it is cleared with the range below.
            self._person[sector] = snapshot.person_of_geom[geom]
        distance, person = self._distance, self._person
        # A miss is -1.
        silent = (distance < 0) | (distance > self._range_max_m)
        ranges_m = distance.astype(np.float32)
        ranges_m[distance < self._range_min_m] = np.nan
        ranges_m[silent] = np.inf
        person_of_ray = np.where(silent, np.int16(0), person)
        scan = LaserScan(
            sensor=self.name,
            stamp_ns=stamp_ns,
            ranges_m=ranges_m,
            angle_min_rad=self._angle_min_rad,
            angle_increment_rad=self._angle_increment_rad,
            range_min_m=self._range_min_m,
            range_max_m=self._range_max_m,
            sweep_time_s=self._sweep_time_s,
        )
        return Reading(scan, {"person_of_ray": person_of_ray, "range_m": ranges_m}), state

    def _trace(self, snapshot: Snapshot, sector: slice) -> Hits:
        """Return the first hits of some of the beams, from the scanner's pose at the snapshot's time."""
        base = self._rig.mounted_on
        if base is None:
            return self._fan.trace(snapshot, sector)
        room_from_base = snapshot.bases[base]
        turn, pose = room_from_base[:3, :3], self._rig.room_from_sensor
        directions = np.ascontiguousarray(self.directions[sector] @ turn.T)
        geom, distance_m = np.empty(len(directions), dtype=np.int32), np.empty(len(directions))
        trace_rays(
            snapshot,
            turn @ self.origin_m + room_from_base[:3, 3],
            directions,
            geom,
            distance_m,
            normal=turn @ pose.rotation[:, 2],
            range_max_m=self._range_max_m,
            body_left_out=mujoco.mj_name2id(snapshot.model, mujoco.mjtObj.mjOBJ_BODY, base_body(base)),
        )
        return geom, distance_m

    def rig_sensor(self) -> LaserSensor:
        """Return the tracker's view of the sensor: pose, topic and role."""
        return self._rig

    @property
    def field_of_view_rad(self) -> float:
        """Angle between the first beam and the last [rad]."""
        return self._angle_increment_rad * (self._distance.size - 1)

    @property
    def range_max_m(self) -> float:
        """Farthest return [m]."""
        return self._range_max_m
