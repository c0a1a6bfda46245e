"""Scanners that drive, or stand, among people and clutter in drawn rooms: scans, odometry, and where people truly are."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from leg_classifier.samples import DURATION_S, Scanner, clutter_at, drawn_world, nearest, of_legs, places_in, scanned
from numpy.typing import NDArray

from trackers.arrays import Array
from trackers.frames.planar import between, compose
from trackers.observations import LaserScan
from twin.instant.snapshot import Snapshot
from twin.streams import stream

_STANDS = 0.25
"""Share of scanners that do not drive."""
_SECTORS = 6
"""Parts of a sweep, each from where the scanner is by then."""
_CLEAR_M = 0.3


@dataclass(frozen=True, eq=False)
class Drive:
    """A sweep of a drive: the scan, the scanner's pose (3,) at its stamp and by odometry, and people's places (p, 2) by id."""

    scan: LaserScan
    pose: Array
    odometry: Array
    ids: NDArray[np.int16]
    places: Array
    beams: NDArray[np.intp]  # (p,) that met each of them


def drives(seed: int, *, people: bool = True, is_driving: bool | None = None) -> Iterator[Drive]:
    """Yield the sweeps of a drive of `DURATION_S`; without people the room is empty."""
    rng = stream(seed, "leg drive", "")
    with tempfile.TemporaryDirectory() as folder:
        world, area, is_wide = drawn_world(seed, Path(folder), rng)
    clutter = clutter_at(area, is_wide, rng)
    scanner = Scanner.drawn(rng)
    rate_hz, sweep_share = rng.uniform(7, 20), rng.uniform(0.5, 0.9)
    empty = world.empty_snapshot(0.0)
    poses = _way(empty, clutter, area, scanner.height_m, rng)
    if not (rng.random() >= _STANDS if is_driving is None else is_driving):
        poses = np.tile(poses[:1], (len(poses), 1))
    drift = rng.normal(0, 0.03, 3) * (1, 0.3, 1)
    odometry, before = poses[0], poses[0]
    for t in np.arange(0.3, DURATION_S - 0.2, 1 / rate_hz):
        snapshot = of_legs(world.snapshot(float(t)) if people else world.empty_snapshot(float(t)))
        pose = _at(poses, t)
        step = between(before, pose)
        odometry = compose(
            odometry, step * (1 + drift) + rng.normal(0, 0.02, 3) * np.abs(step) + [0, 0, drift[1] * step[0]]
        )
        before = pose
        sweep_s = sweep_share / rate_hz
        sector_poses = np.stack([_at(poses, t + sweep_s * (k + 0.5) / _SECTORS) for k in range(_SECTORS)])
        scan, leg = scanned(snapshot, clutter, scanner, sector_poses, rng, round(t * 1e9), sweep_s)
        ids, places = _people(snapshot) if people else (np.empty(0, np.int16), np.empty((0, 2)))
        met = np.bincount(leg // 2, minlength=int(ids.max(initial=0)) + 1)[ids]
        yield Drive(scan, pose, odometry, ids, places, met)


def _people(snapshot: Snapshot) -> tuple[NDArray[np.int16], Array]:
    """Return who is there, and the middle of their two shanks: the place under the pelvis to a few centimetres."""
    model, owner = snapshot.model, snapshot.person_of_geom
    shank = np.array([model.geom(geom).name.endswith("_shank") for geom in range(model.ngeom)])
    there = shank & (owner > 0) & (snapshot.data.geom_xpos[:, 2] > -1)
    ids = np.unique(owner[there] // 2)
    places = [snapshot.data.geom_xpos[there & (owner // 2 == each), :2].mean(axis=0) for each in ids]
    return ids, np.reshape(places, (-1, 2))


def _at(poses: Array, t: float) -> Array:
    """Interpolate poses that are 0.05 s apart."""
    place = min(max(t / 0.05, 0.0), len(poses) - 1.001)
    first, share = int(place), place - int(place)
    return compose(poses[first], share * between(poses[first], poses[first + 1]))


def _way(empty: Snapshot, clutter: Snapshot, area: Array, height_m: float, rng: np.random.Generator) -> Array:
    """Drive from place to place where nothing stands, turning on the way; poses (n, 3) 0.05 s apart."""
    speed, turn = rng.uniform(0.3, 1.2), rng.uniform(0.5, 1.2)
    places = places_in(area, 60, rng)
    here = places[0]
    yaw = rng.uniform(-np.pi, np.pi)
    poses = [np.array([*here, yaw])]
    aim = None
    while len(poses) < DURATION_S / 0.05 + 20:
        if aim is None:
            drawn = places[rng.permutation(len(places))]
            aim = next((each for each in drawn if _is_free(empty, clutter, here, each, height_m)), None)
            if aim is None:
                poses.append(compose(poses[-1], np.array([0, 0, 0.05 * turn])))
                here = poses[-1][:2]
                continue
        off = aim - here
        to_go = float(np.hypot(*off))
        if to_go < 0.15:
            aim = None
            continue
        error = (np.arctan2(off[1], off[0]) - yaw + np.pi) % (2 * np.pi) - np.pi
        yaw += float(np.clip(error, -0.05 * turn, 0.05 * turn))
        if abs(error) < 0.6:
            here = here + min(0.05 * speed, to_go) * np.array([np.cos(yaw), np.sin(yaw)])
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
