"""Scans of a bare room by a scanner that drives, without the twin: walls, round posts, and people as two circles."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable

import numpy as np

from trackers.area import Pose
from trackers.arrays import Array
from trackers.frames.scan_matching import between, compose, inverse, planar
from trackers.observations import NS_PER_S, LaserScan, Observation, Odometry
from trackers.rig import LaserSensor, OdometrySensor, Rig, Role

ROOM = np.array([[-4.0, -3.0], [5.0, -3.0], [5.0, 2.5], [1.0, 2.5], [1.0, 4.0], [-4.0, 4.0]])
BEAMS = 360
POSTS = [(-1.0, 1.5, 0.05), (2.5, 1.0, 0.1), (0.5, -2.0, 0.03), (3.5, -1.5, 0.2)]
Person = tuple[float, float, float, float]
"""Somebody who walks on a straight line: x, y, vx, vy."""
WALKER = (0.5, 1.2, 0.3, -0.6)
MOUNT = Pose(xyz=(0.2, 0.1, 0.3), rpy=(0, 0, 0.5))
"""Of a scanner on its base."""


def scan_at(pose, t: float = 0.0, sweep_s: float = 0.0, motion=(0.0, 0.0, 0.0), extra=()) -> LaserScan:
    """A scan of the room from a pose, taken while it moves; extra: round posts (x, y, radius)."""
    angle = -np.pi + 2 * np.pi / BEAMS * np.arange(BEAMS)
    poses = compose(np.array(pose, float), np.outer(np.linspace(0, sweep_s, BEAMS), motion))
    bearing = poses[:, 2] + angle
    ahead = np.column_stack([np.cos(bearing), np.sin(bearing)])
    ranges = np.full(BEAMS, np.inf)
    for start, end in zip(ROOM, np.roll(ROOM, -1, axis=0), strict=True):
        along, off = end - start, start - poses[:, :2]
        cross = ahead[:, 0] * along[1] - ahead[:, 1] * along[0]
        with np.errstate(divide="ignore", invalid="ignore"):
            far = (off[:, 0] * along[1] - off[:, 1] * along[0]) / cross
            share = (off[:, 0] * ahead[:, 1] - off[:, 1] * ahead[:, 0]) / cross
        met = (far > 0) & (share >= 0) & (share <= 1)
        ranges[met] = np.minimum(ranges[met], far[met])
    for x, y, radius in extra:
        off = np.array([x, y]) - poses[:, :2]
        near, across = (off * ahead).sum(axis=1), ahead[:, 0] * off[:, 1] - ahead[:, 1] * off[:, 0]
        met = (np.abs(across) < radius) & (near > 0)
        ranges[met] = np.minimum(ranges[met], near[met] - np.sqrt(radius**2 - across[met] ** 2))
    rng = np.random.default_rng(round(t * 1000))
    return LaserScan(
        "scan", round(t * NS_PER_S), (ranges + rng.normal(0, 0.005, BEAMS)).astype(np.float32), -np.pi, 2 * np.pi / BEAMS,
        0.05, 20.0, sweep_s,
    )  # fmt: skip


def drive(n: int = 50, speed: float = 0.8, turn: float = 0.5) -> tuple[Array, Array]:
    """Poses (n, 3) of an arc, 0.1 s apart, and the motions (n, 3) a second."""
    motion = np.array([speed, 0.0, turn])
    path = [np.array([-2.0, -1.0, 0.3])]
    for _ in range(n - 1):
        step = path[-1]
        for _ in range(10):
            step = compose(step, motion * 0.01)
        path.append(step)
    return np.array(path), np.tile(motion, (n, 1))


def legs_at(place, heading: float, t: float) -> list[tuple[float, float, float]]:
    """The two legs of somebody who walks, as circles."""
    ahead = np.array([np.cos(heading), np.sin(heading)])
    left = np.array([-ahead[1], ahead[0]])
    swing = 0.22 * np.sin(2 * np.pi * 0.9 * t)
    return [(*(np.array(place) + side * (0.1 * left + swing * ahead)), 0.06) for side in (-1, 1)]


def legs_of(person: Person, t: float) -> list[tuple[float, float, float]]:
    """The two legs of a person."""
    x, y, vx, vy = person
    return legs_at((x + vx * t, y + vy * t), np.arctan2(vy, vx), t)


def trunk_of(person: Person, t: float) -> list[tuple[float, float, float]]:
    """The trunk of a person."""
    x, y, vx, vy = person
    return [(x + vx * t, y + vy * t, 0.15)]


def rig_on_base(mount: Pose = MOUNT, role: Role | None = None) -> Rig:
    """A scanner on a base with odometry."""
    scanner = LaserSensor(topic="/scan", mounted_on="base", room_from_sensor=mount, role=role)
    return Rig(sensors={"base": OdometrySensor(topic="/odom"), "scan": scanner})


def pose_in_plane(pose: Array) -> Pose:
    """A pose (3,) as that of a sensor."""
    x, y, yaw = (float(each) for each in pose)
    return Pose(xyz=(x, y, 0), rpy=(0, 0, yaw))


def driven(
    way: tuple[Array, Array],
    people: Iterable[Person],
    slip: float = 1.0,
    lost: Collection[int] = (),
    start: tuple[float, float, float] = (3.0, -1.0, 1.2),
    mount: Pose = MOUNT,
    body: Callable[[Person, float], list[tuple[float, float, float]]] = legs_of,
) -> tuple[list[Observation], Array]:
    """Odometry and scans of a scanner on a base that drives a way, and (n, 3) the room in the frame of the odometry.

    slip: of the wheels; lost: numbers of scans that do not come; start: of the base in the frame of its odometry.
    """
    path, motions = way
    bases = compose(path, inverse(planar(mount.matrix)))
    odometry = compose(np.array(start), between(bases[0], bases) * (slip, slip, 1.0))
    fed: list[Observation] = []
    for k, (pose, motion) in enumerate(zip(path, motions, strict=True)):
        t = 0.1 * k
        fed.append(Odometry("base", round(t * NS_PER_S), pose_in_plane(odometry[k]).matrix))
        if k not in lost:
            met = [each for person in people for each in body(person, t)]
            fed.append(scan_at(pose, t, 0.05, motion, [*POSTS, *met]))
    return fed, compose(odometry, inverse(bases))
