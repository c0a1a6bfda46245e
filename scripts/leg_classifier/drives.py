"""Scanners that drive, or stand, among people and clutter in drawn rooms: scans, odometry, and where people truly are.

Stepping people costs most, so that several robots, each with its own scanner, way and clutter, scan the same people.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from leg_classifier.samples import (
    Scanner,
    clutter_at,
    drawn_trousers_m,
    drawn_world,
    nearest,
    of_legs,
    people_in,
    places_in,
    scanned,
    worn_by,
)
from numpy.typing import NDArray

from trackers.arrays import Array
from trackers.frames.scan_matching import between, compose
from trackers.observations import NS_PER_S, LaserScan
from twin.instant.snapshot import Snapshot
from twin.streams import stream
from twin.world.world import PoseCache

ROBOTS = 3
"""Robots in each room."""
DRIVE_S = 12.0
_STANDS, _NO_PERSON = 0.25, 0.25
"""Share of scanners that do not drive, and of those that nobody is near."""
RATES_HZ = (3.0, 40.0)
"""Rates of scanners, drawn by their logarithm."""
_JITTER, _DRIFT_PPM = 0.05, 1000.0
"""Deviation of stamps from when a sweep began, in periods, and the most by which the clock of a robot is fast or slow."""
_STEP_S = 0.05
"""Time from pose to pose of the way, and of odometry."""
_SECTORS = 6
"""Parts of a sweep, each from where the scanner is by then."""
_CLEAR_M = 0.3


@dataclass(frozen=True, eq=False)
class Sweep:
    """One sweep of a drive: the scan, the scanner's pose (3,) as it begins, and people's places (p, 2) by id.

    odometry: poses that were reported since the sweep before, (k, 4): the stamp [s], x, y [m] and yaw.
    """

    scan: LaserScan
    leg: NDArray[np.int16]  # that each beam met: 2 id, 2 id + 1 for the right one; 0: none
    pose: Array
    odometry: Array
    ids: NDArray[np.int16]
    places: Array

    @property
    def beams(self) -> NDArray[np.intp]:
        """Number of beams (p,) that met each of the people."""
        return np.bincount(self.leg // 2, minlength=int(self.ids.max(initial=0)) + 1)[self.ids]


def drives(
    seed: int, *, people: bool | None = None, is_driving: bool | None = None, rate_hz: float | None = None
) -> Iterator[list[Sweep]]:
    """Yield the drive of each robot in the room of a seed; people, is_driving, rate_hz: drawn where they are None."""
    rng = stream(seed, "leg drives", "")
    with tempfile.TemporaryDirectory() as folder:
        world, area, is_wide = drawn_world(seed, Path(folder), rng, DRIVE_S)
    slowest, fastest = np.log(RATES_HZ).tolist()
    drawn_hz = np.exp(rng.uniform(slowest, fastest, ROBOTS))
    times = [np.arange(0.3, DRIVE_S - 0.2, 1 / each) for each in (drawn_hz if rate_hz is None else [rate_hz] * ROBOTS)]
    world.pose_cache = PoseCache(world.scene.person_of_geom)
    people_at = {t: people_in(of_legs(world.snapshot(t))) for t in np.unique(np.concatenate(times)).tolist()}
    legs_at = np.concatenate([legs for _, _, legs in people_at.values()])
    trousers_m = drawn_trousers_m(rng)
    for robot in range(ROBOTS):
        own = stream(seed, "leg drive", str(robot))
        there = own.random() >= _NO_PERSON if people is None else people
        drive = own.random() >= _STANDS if is_driving is None else is_driving
        clutter = clutter_at(area, is_wide, own, legs_at if there else None)
        scanner = Scanner.drawn(own)
        poses = _way(world.empty_snapshot(0.0), clutter, area, scanner.height_m, own)
        poses = poses if drive else np.tile(poses[:1], (len(poses), 1))
        period_s = float(np.diff(times[robot][:2])[0])
        sweep_s, pace = own.uniform(0.5, 0.9) * period_s, 1 + 1e-6 * own.uniform(-_DRIFT_PPM, _DRIFT_PPM)
        reported = np.column_stack(
            [_STEP_S * pace * np.arange(len(poses)), np.stack(list(_odometry(poses, own)))]
        ).astype(float)
        empty, sweeps, before = of_legs(world.empty_snapshot(0.0)), [], -np.inf
        for t in times[robot].tolist():
            snapshot = replace(world.snapshot(t), person_of_geom=empty.person_of_geom) if there else empty
            scenes = (snapshot, clutter, worn_by(snapshot, trousers_m)) if there else (snapshot, clutter)
            sectors = np.stack([_at(poses, t + sweep_s * (each + 0.5) / _SECTORS) for each in range(_SECTORS)])
            stamp_s = t * pace + _JITTER * period_s * own.normal()
            scan, leg = scanned(scenes, scanner, sectors, own, round(stamp_s * NS_PER_S), sweep_s)
            ids, places, _ = people_at[t] if there else (np.empty(0, np.int16), np.empty((0, 2)), None)
            since = reported[(reported[:, 0] > before) & (reported[:, 0] <= stamp_s)]
            before = stamp_s
            sweeps.append(Sweep(scan, leg, _at(poses, t), since, ids, places))
        yield sweeps


def _odometry(poses: Array, rng: np.random.Generator) -> Iterator[Array]:
    """Yield the poses as wheels tell them: wrong in scale and turn, and noisy."""
    drift = rng.normal(0, 0.03, 3) * (1, 0.3, 1)
    reported = poses[0]
    for step in between(poses[np.maximum(np.arange(len(poses)) - 1, 0)], poses):
        reported = compose(
            reported, step * (1 + drift) + rng.normal(0, 0.02, 3) * np.abs(step) + [0, 0, drift[1] * step[0]]
        )
        yield reported


def _at(poses: Array, t: float) -> Array:
    """Interpolate poses that are `_STEP_S` apart."""
    place = min(max(t / _STEP_S, 0.0), len(poses) - 1.001)
    first, share = int(place), place - int(place)
    return compose(poses[first], share * between(poses[first], poses[first + 1]))


def _way(empty: Snapshot, clutter: Snapshot, area: Array, height_m: float, rng: np.random.Generator) -> Array:
    """Drive from place to place where nothing stands, turning on the way; poses (n, 3) `_STEP_S` apart."""
    speed, turn = rng.uniform(0.3, 1.2), rng.uniform(0.5, 1.2)
    places = places_in(area, 60, rng)
    here = places[0]
    yaw = rng.uniform(-np.pi, np.pi)
    poses = [np.array([*here, yaw])]
    aim = None
    while len(poses) < DRIVE_S / _STEP_S + 20:
        if aim is None:
            drawn = places[rng.permutation(len(places))]
            aim = next((each for each in drawn if _is_free(empty, clutter, here, each, height_m)), None)
            if aim is None:
                poses.append(compose(poses[-1], np.array([0, 0, _STEP_S * turn])))
                here = poses[-1][:2]
                continue
        off = aim - here
        to_go = float(np.hypot(*off))
        if to_go < 0.15:
            aim = None
            continue
        error = (np.arctan2(off[1], off[0]) - yaw + np.pi) % (2 * np.pi) - np.pi
        yaw += float(np.clip(error, -_STEP_S * turn, _STEP_S * turn))
        if abs(error) < 0.6:
            here = here + min(_STEP_S * speed, to_go) * np.array([np.cos(yaw), np.sin(yaw)])
        poses.append(np.array([*here, yaw]))
    return np.array(poses)


def _is_free(empty: Snapshot, clutter: Snapshot, start: Array, end: Array, height_m: float) -> bool:
    off = end - start
    length = float(np.hypot(*off))
    if length < 0.7:
        return False
    ahead = np.array([*off / length, 0.0])
    side = np.array([-ahead[1], ahead[0], 0.0]) * _CLEAR_M
    for shift in (-side, np.zeros(3), side):
        origin = np.array([*start, height_m]) + shift
        if nearest((empty, clutter), origin, ahead[None], 60.0)[0] < length + 0.4:
            return False
    return True
