"""Observations, what sensors report: the decoded message, the same live, from a twin's recording and from a robot's bag.

Stamps are integer nanoseconds as in a bag (`stamp_ns`); `t` is the same in seconds.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite, pi

import numpy as np
from numpy.typing import NDArray

from trackers.errors import InputError

NS_PER_S = 1_000_000_000
_FARTHEST_BEARING_RAD = 4 * pi + 1e-3
_WIDEST_RAD = 1.1 * 2 * pi
"""From the first beam to the last: scanners that turn all around may go on a little."""
_RIGID = 1e-3
"""Largest error of a rotation matrix's Gram matrix: that of a quaternion in float32 is a thousandth of it."""


@dataclass(frozen=True, eq=False)
class _Stamped:
    sensor: str
    stamp_ns: int

    @property
    def t(self) -> float:
        """Stamp [s]."""
        return self.stamp_ns / NS_PER_S


@dataclass(frozen=True, eq=False)
class LaserScan(_Stamped):
    """One sweep of a planar scanner, in the scanner's frame: x ahead, y left, z up, angles counter-clockwise from x.

    `ranges_m` follows ROS REP 117: a finite value is a return, +inf no return within range, NaN an invalid reading.
    `sweep_time_s` is the time from the first beam (taken at the stamp) to the last; 0 for an instantaneous scan. Negative: the
    last beam was taken at the stamp, and the first so much later.
    `range_max_m` may be infinite, as some drivers have it: the scanner names no limit.

    Beams may differ from scan to scan in number and bearing, and go clockwise (a negative increment). A scan without beams, or
    with NaN alone, is no reading. Raises InputError for ranges that are no row, and for beams or limits that no scanner has.
    """

    ranges_m: NDArray[np.float32]  # (n_beam,)
    angle_min_rad: float
    angle_increment_rad: float
    range_min_m: float
    range_max_m: float
    sweep_time_s: float = 0.0

    def __post_init__(self) -> None:
        if self.ranges_m.ndim != 1:
            raise InputError(f"scan of {self.sensor!r}: ranges have shape {self.ranges_m.shape}; one row is expected")
        if not 0 <= self.range_min_m < self.range_max_m:
            raise InputError(
                f"scan of {self.sensor!r}: range_min is {self.range_min_m:g} m and range_max {self.range_max_m:g} m; "
                f"0 <= range_min < range_max is expected"
            )
        if not abs(self.angle_min_rad) <= _FARTHEST_BEARING_RAD:
            raise InputError(
                f"scan of {self.sensor!r}: angle_min is {self.angle_min_rad:g} rad; the bearing of the first beam, "
                "a finite number of at most two turns (4π rad), is expected"
            )
        if not isfinite(self.angle_increment_rad) or self.angle_increment_rad == 0:
            raise InputError(
                f"scan of {self.sensor!r}: angle_increment is {self.angle_increment_rad:g} rad; the angle from beam to "
                "beam, a finite number other than 0, is expected"
            )
        span_rad = abs(self.angle_increment_rad) * (self.ranges_m.size - 1)
        if span_rad > _WIDEST_RAD:
            raise InputError(
                f"scan of {self.sensor!r}: {self.ranges_m.size} beams {abs(self.angle_increment_rad):g} rad apart go over "
                f"{span_rad:g} rad; at most a turn (2π rad, and a tenth) is expected, in radians"
            )
        if not isfinite(self.sweep_time_s):
            raise InputError(
                f"scan of {self.sensor!r}: sweeps for {self.sweep_time_s:g} s; a finite time_increment is expected"
            )

    @property
    def angles_rad(self) -> NDArray[np.float64]:
        """Bearing of each beam in the scanner's frame, (n_beam,)."""
        return self.angle_min_rad + self.angle_increment_rad * np.arange(self.ranges_m.size, dtype=np.float64)


@dataclass(frozen=True, eq=False)
class Image(_Stamped):
    """One colour image, RGB, as decoded from its message."""

    rgb: NDArray[np.uint8]  # (height, width, 3)


@dataclass(frozen=True, eq=False)
class DepthImage(_Stamped):
    """A colour image and the depth of each of its pixels, as decoded from their two messages of one stamp.

    `depth_m` is the distance along the optical axis, not along the ray, in whole millimetres; 0 where there is none
    (nothing matched, nothing within range). `trackers.rig.StereoSensor.points` makes points of it.
    """

    rgb: NDArray[np.uint8]  # (height, width, 3)
    depth_m: NDArray[np.float32]  # (height, width)

    def __post_init__(self) -> None:
        if self.rgb.shape[:2] != self.depth_m.shape:
            raise InputError(
                f"depth image of {self.sensor!r}: colour is {self.rgb.shape[1]} x {self.rgb.shape[0]} and depth of shape "
                f"{self.depth_m.shape}; a depth for each pixel is expected"
            )


@dataclass(frozen=True, eq=False)
class FloorFrame(_Stamped):
    """One reading of all elements of a pressure floor, 8 bits each, in the floor's frame: x along a row, y from row to row.

    What load goes with a value stands in the rig: `trackers.rig.FloorSensor.load_n`.
    """

    values: NDArray[np.uint8]  # (rows, columns)

    def __post_init__(self) -> None:
        if self.values.ndim != 2:
            raise InputError(
                f"floor {self.sensor!r}: values have shape {self.values.shape}; rows and columns are expected"
            )


@dataclass(frozen=True, eq=False)
class Odometry(_Stamped):
    """Pose of a moving base in its odometry frame at the stamp, as wheels or a localization estimate it.

    `frame_from_base` takes the base's coordinates (x ahead, y left, z up, metres) to those of the odometry frame. That frame
    is fixed in the room up to the estimate's error: it drifts, and jumps where the estimate is corrected. The rig says where
    it lies in the room (`trackers.rig.OdometrySensor`). Raises InputError for a matrix that is no rigid transform.
    """

    frame_from_base: NDArray[np.float64]  # (4, 4)

    def __post_init__(self) -> None:
        matrix = self.frame_from_base
        if matrix.shape != (4, 4):
            raise InputError(
                f"odometry {self.sensor!r}: the pose has shape {matrix.shape}; a matrix (4, 4) is expected"
            )
        gram = matrix[:3, :3].T @ matrix[:3, :3]
        if not (np.isfinite(matrix).all() and np.allclose(gram, np.eye(3), atol=_RIGID)):
            raise InputError(
                f"odometry {self.sensor!r}: the pose is no rigid transform; finite numbers and a quaternion of length 1 "
                "are expected"
            )


Observation = LaserScan | Image | DepthImage | FloorFrame | Odometry
