"""Scans of a bare room by a scanner that drives, without the twin: walls, round posts, and people as two circles."""

from __future__ import annotations

import numpy as np

from trackers.arrays import Array
from trackers.frames.scan_matching import compose
from trackers.observations import NS_PER_S, LaserScan

ROOM = np.array([[-4.0, -3.0], [5.0, -3.0], [5.0, 2.5], [1.0, 2.5], [1.0, 4.0], [-4.0, 4.0]])
BEAMS = 360


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
