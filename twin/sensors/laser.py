"""The planar laser scanner: one bundle of rays for each instant of its sweep."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise

import mujoco
import numpy as np
from numpy.typing import NDArray

from trackers.arrays import Array, Mask
from trackers.observations import LaserScan
from trackers.rig import LaserSensor
from twin.instant.snapshot import Snapshot
from twin.sensors.rays import Hits, RayFan, trace_rays
from twin.sensors.sensor import Reading, State

SWEEP_STEP_S = 0.005
"""Period of snapshots during a sweep [s]: a person at 2 m/s is placed to within 5 mm."""
_DARKEST, _BRIGHTEST = 0.02, 0.9
_FLUCTUATION = 0.2
"""Deviation of the logarithm of a received signal from beam to beam; assumed."""


def reflected(model: mujoco.MjModel, geom: NDArray[np.integer], faces: Array, directions: Array) -> Array:
    """Return the share of light near 905 nm that beams (n,) see reflected: reflectivity times cosine of the angle of incidence.

    `faces` and `directions` (n, 3): unit normals of the surfaces of `geom` (n,) and beams. A surface is matt and as bright as
    its colour's brightest linear channel: only what is black to the eye is dark to a scanner. Carbon black is; dark tones of
    organic pigments can reflect over 0.6 at 905 nm (Lim et al. 2022, doi 10.1007/s13233-022-0037-5), which a colour does not
    tell. A geom with a texture has the colour of its material.
    """
    material = model.geom_matid[geom]
    has = material >= 0
    rgb = model.geom_rgba[geom, :3].astype(float)
    rgb[has] = model.mat_rgba[material[has], :3]
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)  # sRGB, IEC 61966-2-1
    return np.clip(linear.max(axis=1), _DARKEST, _BRIGHTEST) * np.abs((faces * directions).sum(axis=1))


def returns_echo(reflected: Array, distance_m: Array, range_10_percent_m: float, rng: np.random.Generator) -> Mask:
    """Draw which beams (n,) get an echo: those whose received signal is over the threshold.

    The signal of a surface wider than the beam goes with `reflected` / distance². It meets the threshold at `range_10_percent_m`
    for a reflectivity of 0.1 faced squarely, as data sheets state ranges. Kneip et al. (ICRA 2009) measured such losses on dark
    surfaces and at large angles of incidence, with a Hokuyo URG-04LX.
    """
    signal = reflected / 0.1 * (range_10_percent_m / np.maximum(distance_m, 1e-6)) ** 2
    return signal * np.exp(_FLUCTUATION * rng.standard_normal(signal.size)) >= 1


class Laser:
    """A scanner without noise: exact ranges along infinitely thin rays, and the person at each ray as truth.

    Beams go counter-clockwise from `angle_min_rad` in steps of `angle_increment_rad` in the x-y plane of the sensor's frame (x
    ahead, y left, z up). A return nearer than `range_min_m` is NaN (invalid), none within `range_max_m` is +inf (REP 117).
    With `sweep_time_s` > 0 the first beam is measured at the stamp and the last that much later. Beams are grouped, so that
    each is measured within SWEEP_STEP_S / 2 of its time, from the scanner's pose then. On a driving housing the pose changes;
    rays pass through the housing's own body.

    `origin_m` (3,) and `directions` (n_beam, 3) are its rays in the room frame, or in that of its housing.

    With `range_10_percent_m` a beam whose echo is too weak (`returns_echo`) reads +inf and meets no person; without it every
    surface returns an echo. Glass and mirrors are walls (geoms with alpha = 0 are not seen at all).
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
        range_10_percent_m: float | None = None,
    ) -> None:
        self.name = name
        self._rig = rig
        # A scan message holds these in single precision: the recording has the measured values.
        self._angle_min_rad = float(np.float32(angle_min_rad))
        self._angle_increment_rad = float(np.float32(angle_increment_rad))
        self._range_min_m = float(np.float32(range_min_m))
        self._range_max_m = float(np.float32(range_max_m))
        self._sweep_time_s = sweep_time_s
        self._range_10_percent_m = range_10_percent_m
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
        """Return the scan without noise; `rng` draws the fluctuation of weak echoes, `state` is not used."""
        for sector, snapshot in zip(self._sectors, snapshots, strict=True):
            geom, self._distance[sector] = self._trace(snapshot, sector, rng)
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

    def _trace(self, snapshot: Snapshot, sector: slice, rng: np.random.Generator) -> Hits:
        """Return the first hits of some of the beams, from the scanner's pose at the snapshot's time."""
        base = self._rig.mounted_on
        if base is None and self._range_10_percent_m is None:
            return self._fan.trace(snapshot, sector)
        room_from_base = np.eye(4) if base is None else snapshot.bases[base]
        turn, pose = room_from_base[:3, :3], self._rig.room_from_sensor
        directions = np.ascontiguousarray(self.directions[sector] @ turn.T)
        geom, distance_m = np.empty(len(directions), dtype=np.int32), np.empty(len(directions))
        faces = None if self._range_10_percent_m is None else np.zeros((len(directions), 3))
        trace_rays(
            snapshot,
            turn @ self.origin_m + room_from_base[:3, 3],
            directions,
            geom,
            distance_m,
            normal=turn @ pose.rotation[:, 2],
            range_max_m=self._range_max_m,
            base=base,
            faces=faces,
        )
        if faces is not None and self._range_10_percent_m is not None:
            seen = reflected(snapshot.model, geom, faces, directions)
            distance_m[~returns_echo(seen, distance_m, self._range_10_percent_m, rng)] = -1
        return geom, distance_m

    def rig_sensor(self) -> LaserSensor:
        """Return the tracker's view of the sensor: pose, topic and role."""
        return self._rig

    @property
    def range_max_m(self) -> float:
        """Farthest return [m]."""
        return self._range_max_m
