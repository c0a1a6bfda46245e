"""Scan matching: the pose of a scanner by its last scans, point to line.

Each point of a scan is held against the line through the nearest point of the last scans (Chen and Medioni 1991; Censi, "An ICP
variant using a point-to-line metric", ICRA 2008), with a prior of where the scanner is by now: where odometry says, else where
it would be had it moved on as before. Points of what moves fit badly and weigh little (Cauchy's weights). Beams are placed at
the time at which they were taken: the motion during the sweep is found together with the pose, and held against the motion since
the scan before (Dellenbach et al., "CT-ICP", ICRA 2022). By odometry alone, a wheel that slips would bend the scan too.

The first scan of a scanner that drives already is placed by odometry's motion during its sweep; without odometry, anew by the
motion that the second scan finds.

The curvature of the fit says in which directions the scan holds the scanner: a corridor leaves it free along. There the prior
decides. `trust` is the share of the points that are near a line, 0 where the scan or the last ones show too little. A pose
without trust is odometry's; without odometry, the last one: the scanner is taken to stand.

Poses in the plane are arrays (*n, 3) of x, y [m] and yaw [rad], composed like transforms.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field, PositiveInt

from trackers.area import wrap_angle
from trackers.arrays import Array, Bool, Float, Mask
from trackers.configuration import Strict

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

HERE = np.zeros(3)
"""The pose that changes nothing."""


def compose(first: Float[Array, "*n 3"], second: Float[Array, "*n 3"]) -> Float[Array, "*n 3"]:
    """Return the pose `second`, given in the frame of `first`, in the frame that `first` is given in; yaw is not wrapped."""
    cos, sin = np.cos(first[..., 2]), np.sin(first[..., 2])
    x, y = second[..., 0], second[..., 1]
    return np.stack(
        [first[..., 0] + cos * x - sin * y, first[..., 1] + sin * x + cos * y, first[..., 2] + second[..., 2]], axis=-1
    )


def inverse(pose: Float[Array, "*n 3"]) -> Float[Array, "*n 3"]:
    """Return the pose that takes this one back."""
    cos, sin = np.cos(pose[..., 2]), np.sin(pose[..., 2])
    x, y = pose[..., 0], pose[..., 1]
    return np.stack([-cos * x - sin * y, sin * x - cos * y, -pose[..., 2]], axis=-1)


def between(first: Float[Array, "*n 3"], second: Float[Array, "*n 3"]) -> Float[Array, "*n 3"]:
    """Return the pose `second` in the frame of `first`, its yaw within half a turn."""
    moved = compose(inverse(first), second)
    moved[..., 2] = wrap_angle(moved[..., 2])
    return moved


def placed(pose: Float[Array, "*n 3"], points: Float[Array, "*n 2"]) -> Float[Array, "*m 2"]:
    """Return points (n, 2) of the frame of a pose, one for all or one each, in the frame that it is given in [m]."""
    return pose[..., :2] + turned(pose[..., 2], points)


def turned(yaw: Float[Array, "*n"] | float, vectors: Float[Array, "*n 2"]) -> Float[Array, "*m 2"]:
    """Return vectors (n, 2) turned by a yaw [rad], one for all or one each."""
    cos, sin = np.cos(yaw), np.sin(yaw)
    x, y = vectors[..., 0], vectors[..., 1]
    return np.stack([cos * x - sin * y, sin * x + cos * y], axis=-1)


def planar(transform: Float[Array, "4 4"]) -> Float[Array, "3"]:
    """Return the part of a rigid transform (4, 4) that lies in the plane: x, y [m] and the yaw of its x axis [rad]."""
    return np.array([transform[0, 3], transform[1, 3], np.arctan2(transform[1, 0], transform[0, 0])])


_ROUNDS = 8
_SETTLED = 2e-4
"""A round that moves the pose by less ends the search [m, rad]."""
_FEW = 12
"""Points with a line, below which nothing is matched."""
_NEAR_M = 0.1
_REACH_M = 0.5
"""Distance up to which a point is held against a line at first [m]."""
_SCALE_M = 0.03
"""Distance from its line at which a point weighs half [m]."""
_APART_M, _APART_RAD = 0.1, 0.1
"""Way and turn after which a scan joins those that are matched with."""
_SPREAD = np.array([0.5, 0.5, 1.0])
"""Standard deviations of the change of speed and turn rate, in a second [m/s, rad/s]."""
_BY_ODOMETRY = 0.3
"""Share of these that is left where odometry says how the scanner moved."""
_ACCELERATION = np.array([1.5, 1.5, 3.0])
"""Standard deviations of the change of motion from the last interval to the sweep, in a second [m/s, rad/s]."""
_AGAIN = 3
"""Times that the first two scans are matched: each finds more of the motion that bends the first."""
_FASTEST_RAD_S, _MOST_TURN_RAD, _TURN_RAD = 3.0, 1.5, 0.1
"""Without odometry a scanner may have turned by so much: as fast as this, at most so far, tried in such steps."""
_COARSE = 90
"""Points that tell which of these turns it was."""
_SPAN = 2
"""A line goes through so many points to either side."""


class MatchingOptions(Strict):
    """Options of scan matching."""

    scans: PositiveInt = Field(default=6, description="number of last scans that a scan is matched with")
    least_trust: float = Field(default=0.5, ge=0, le=1, description="trust below which a pose is not used")


@dataclass(frozen=True)
class Match:
    """A pose (3,) in the fixed frame at a scan's stamp, the motion (3,) a second during the sweep in the scanner's frame, and the
    trust in them."""

    pose: Float[Array, "3"]
    motion: Float[Array, "3"]
    trust: float


class ScanMatcher:
    """The poses of one scanner, or of the base that it is mounted on, scan after scan."""

    def __init__(self, start: Float[Array, "3"], options: MatchingOptions | None = None) -> None:
        self._options = options or MatchingOptions()
        self._pose, self._motion = np.array(start, float), np.zeros(3)
        self._t: float | None = None
        self._kept: deque[tuple[Array, Array, Array]] = deque(maxlen=self._options.scans)  # pose, points, normals
        self._first: tuple[Array, Array, Array] | None = None  # as measured: points, their times, normals
        self._tree: cKDTree | None = None
        self._lines = np.empty((0, 4))

    def match(
        self,
        t: float,
        points: Float[Array, "n 2"],
        times_s: Float[Array, "n"],
        still: Bool[Mask, "n"],
        moved: Float[Array, "3"] | None = None,
        sweeping: Float[Array, "3"] | None = None,
    ) -> Match:
        """Match the points of a scan in the scanner's frame [m], in order of their beams, `times_s` after its stamp t [s].

        still: those that may be the room's; moved: by odometry, since the scan before, in that one's frame; sweeping: by
        odometry, the motion (3,) a second during the sweep.
        """
        options = self._options
        is_first = self._t is None
        elapsed = 0.0 if self._t is None else max(t - self._t, 0.0)
        self._t = t
        if is_first and sweeping is not None:
            self._motion = sweeping
        motion = self._motion if moved is None or elapsed == 0 else moved / elapsed
        expected = compose(self._pose, motion * elapsed)
        straight = deskewed(points, times_s, motion)
        normal, has_line = _normals(straight)
        useful = has_line & still
        pose, swept, trust = expected, motion, 0.0
        if self._tree is not None and useful.sum() >= _FEW:
            prior = self._prior(max(elapsed, 1e-3), has_odometry=moved is not None)
            began = np.concatenate([expected, motion])
            scan = points[useful], times_s[useful]
            found, trust = self._fit(*scan, began, prior)
            if trust < options.least_trust and moved is None and elapsed > 0:
                found, trust = self._fit(*scan, began, prior, self._turned_start(*scan, began, elapsed))
            for _ in range(_AGAIN):
                if self._first is None or elapsed == 0:
                    break
                self._place_first(between(self._pose, found[:3]) / elapsed)
                found, trust = self._fit(*scan, began, prior, found)
            pose, swept = found[:3], found[3:]
        if trust >= options.least_trust:
            self._motion = between(self._pose, pose) / elapsed if elapsed > 0 else self._motion
        elif moved is not None or is_first:
            pose, swept, self._motion = expected, motion, motion
        else:
            pose, swept, self._motion = self._pose, HERE, HERE
        self._pose = pose
        if useful.sum() >= _FEW:
            self._keep(pose, deskewed(points[useful], times_s[useful], swept), normal[useful], trust)
            is_bent = is_first and sweeping is None
            self._first = (points[useful], times_s[useful], normal[useful]) if is_bent else None
        return Match(pose, swept, 1.0 if is_first else trust)

    def _place_first(self, motion: Float[Array, "3"]) -> None:
        """Place the first scan anew, by the motion (3,) a second during its sweep."""
        assert self._first is not None
        points, times_s, normal = self._first
        self._kept.clear()
        self._keep(self._pose, deskewed(points, times_s, motion), normal, 1.0)

    def _prior(self, elapsed_s: float, *, has_odometry: bool) -> Array:
        """Return the inverse covariance (6, 6) of the pose that is expected and the motion during the sweep."""
        spread = np.maximum(_SPREAD * elapsed_s * (_BY_ODOMETRY if has_odometry else 1.0), 1e-3)
        # the change of motion, `motion - between(last pose, pose) / elapsed_s`, linear in both
        cos, sin = np.cos(self._pose[2]), np.sin(self._pose[2])
        change = np.eye(3, 6, 3)
        change[:, :3] = np.array([[-cos, -sin, 0], [sin, -cos, 0], [0, 0, -1]]) / elapsed_s
        prior = (change.T / (_ACCELERATION * elapsed_s) ** 2) @ change
        prior[:3, :3] += np.diag(1 / spread**2)
        return prior

    def _turned_start(self, points: Array, times_s: Array, expected: Array, elapsed_s: float) -> Array:
        """Return the pose and motion (6,) turned from the expected ones by whatever brings most points near those kept."""
        assert self._tree is not None
        most = min(_FASTEST_RAD_S * elapsed_s, _MOST_TURN_RAD)
        turns = np.linspace(-most, most, 2 * int(np.ceil(most / _TURN_RAD)) + 1)
        starts = np.tile(expected, (len(turns), 1))
        starts[:, 2] += turns
        starts[:, 5] += turns / elapsed_s
        some = slice(None, None, max(len(points) // _COARSE, 1))
        there = np.stack([placed(each[:3], deskewed(points[some], times_s[some], each[3:])) for each in starts])
        gap, _ = self._tree.query(there, distance_upper_bound=_REACH_M)
        return starts[np.maximum(_NEAR_M, gap).clip(max=_REACH_M).mean(axis=1).argmin()]

    def _fit(
        self, points: Array, times_s: Array, expected: Array, prior: Array, start: Array | None = None
    ) -> tuple[Array, float]:
        """Gauss and Newton's steps over pose and motion (6,) together; the prior is a Gaussian about what is expected."""
        state = (expected if start is None else start).copy()
        reach, noise, error = _REACH_M, _SCALE_M, np.empty(0)
        assert self._tree is not None
        for _ in range(_ROUNDS):
            pose, motion = state[:3], state[3:]
            there = placed(pose, deskewed(points, times_s, motion))
            gap, index = self._tree.query(there, distance_upper_bound=reach)
            found = np.isfinite(gap)
            if found.sum() < _FEW:
                return expected, 0.0
            here, line = there[found], self._lines[index[found]]
            normal = line[:, 2:]
            error = ((here - line[:, :2]) * normal).sum(axis=1)
            weight = 1 / (1 + (error / noise) ** 2) / noise**2
            off = here - pose[:2]
            by_yaw = normal[:, 1] * off[:, 0] - normal[:, 0] * off[:, 1]
            by_motion = times_s[found, None] * np.column_stack([turned(-pose[2], normal), by_yaw])
            J = np.column_stack([normal, by_yaw, by_motion])
            # a scan's errors are not independent: the points on one wall share theirs
            H = (J.T * weight) @ J / np.sqrt(len(J)) + prior
            step = np.linalg.solve(H, -(J.T @ (weight * error)) / np.sqrt(len(J)) - prior @ (state - expected))
            state = state + step
            reach = max(0.6 * reach, 5 * noise)
            if np.abs(step[:3]).max() < _SETTLED and reach <= 5 * noise:
                break
        trust = float((np.abs(error) < _NEAR_M).sum() / len(points))
        return state, trust

    def _keep(self, pose: Array, points: Array, normal: Array, trust: float) -> None:
        """Join the scan to those that the next are matched with, unless it was taken where the last of them was."""
        options = self._options
        if self._kept and trust >= options.least_trust:
            apart = between(self._kept[-1][0], pose)
            full = len(self._kept) == options.scans
            if full and np.hypot(*apart[:2]) < _APART_M and abs(apart[2]) < _APART_RAD:
                return
        elif self._kept:
            self._kept.clear()  # lost: what was matched so far is of no use from here on
        self._kept.append((pose, placed(pose, points), turned(pose[2], normal)))
        self._lines = np.concatenate([np.column_stack(each[1:]) for each in self._kept])
        from scipy.spatial import cKDTree  # slow to load, and trackers of scanners that stand have no use for it

        self._tree = cKDTree(self._lines[:, :2], balanced_tree=False, compact_nodes=False)


def deskewed(points: Float[Array, "n 2"], times_s: Float[Array, "n"], motion: Float[Array, "3"]) -> Float[Array, "n 2"]:
    """Return points, each taken `times_s` after the stamp by a scanner in `motion` (a second), in its frame at the stamp [m]."""
    if not times_s.any() or not motion.any():
        return points
    return placed(times_s[:, None] * motion, points)


def _normals(points: Float[Array, "n 2"]) -> tuple[Float[Array, "n 2"], Bool[Mask, "n"]]:
    """Fit a line to each point and its neighbours along the scan; return unit normals, and where there is a line."""
    n = len(points)
    if n < 2 * _SPAN + 1:
        return np.zeros((n, 2)), np.zeros(n, np.bool_)
    near = np.clip(np.arange(n)[:, None] + np.arange(-_SPAN, _SPAN + 1), 0, n - 1)
    off = points[near] - points[:, None]
    close = (off**2).sum(axis=2) < 0.04 + 0.0025 * (points**2).sum(axis=1)[:, None]
    count = close.sum(axis=1)
    off = np.where(close[..., None], off, 0.0)
    off = np.where(close[..., None], off - off.sum(axis=1, keepdims=True) / count[:, None, None], 0.0)
    xx, yy, xy = (off[..., 0] ** 2).sum(1), (off[..., 1] ** 2).sum(1), (off[..., 0] * off[..., 1]).sum(1)
    angle = 0.5 * np.arctan2(2 * xy, xx - yy)  # of the line
    root = np.sqrt((xx - yy) ** 2 / 4 + xy**2)
    flat = (xx + yy) / 2 - root < 0.1 * ((xx + yy) / 2 + root)
    return np.column_stack([-np.sin(angle), np.cos(angle)]), flat & (count >= 3)
