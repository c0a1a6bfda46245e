"""Observations, what sensors report: the decoded message, the same live, from a twin's recording and from a robot's bag.

Stamps are integer nanoseconds as in a bag (`stamp_ns`); `t` is the same in seconds. The values of a pressure floor's elements
are those of force-sensing resistors in voltage dividers (`ForceCurve`).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite, pi
from numbers import Integral

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from trackers.arrays import Array
from trackers.configuration import Strict
from trackers.errors import InputError
from trackers.user_input.text_file import check_limit

NS_PER_S = 1_000_000_000
_FARTHEST_BEARING_RAD = 4 * pi + 1e-3
_WIDEST_RAD = 1.1 * 2 * pi
"""From the first beam to the last: scanners that turn all around may go on a little."""
MOST_BEAMS = 1_000_000
"""Greatest number of beams of a scan, a hundred times that of any scanner; each takes some 70 bytes at work."""
_RIGID = 1e-3
"""Largest error of a rotation matrix's Gram matrix: that of a quaternion in float32 is a thousandth of it."""


MOST_STAMPS_NS = -(2**60), 2**63 - 2**60
"""Stamps lie between these [ns], until the year 2225: what has not happened yet has the first (`roster.NEVER_NS`)."""


@dataclass(frozen=True, eq=False)
class _Stamped:
    sensor: str  # name in the rig
    stamp_ns: int  # since the epoch of the recording's clock [ns]; `t` is the same in s

    def __post_init__(self) -> None:
        """Raise InputError for a stamp that is no number of nanoseconds."""
        if not isinstance(self.stamp_ns, Integral) or not MOST_STAMPS_NS[0] < self.stamp_ns < MOST_STAMPS_NS[1]:
            raise InputError(
                f"{type(self).__name__} of {self.sensor!r}: stamp_ns is {self.stamp_ns!r}; a whole number of nanoseconds, "
                f"from {MOST_STAMPS_NS[0]:.3g} to {MOST_STAMPS_NS[1]:.3g}, is expected"
            )

    def _require_array(self, field: str) -> None:
        """Raise InputError for a field that holds no array."""
        value = getattr(self, field)
        if not isinstance(value, np.ndarray):
            raise InputError(
                f"{type(self).__name__} of {self.sensor!r}: {field} is a {type(value).__name__}; a NumPy array is expected"
            )

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

    ranges_m: NDArray[np.float32]  # (n_beam,) distance of each beam's return [m]; inf: none within range, NaN: invalid
    angle_min_rad: float  # bearing of the first beam [rad]
    angle_increment_rad: float  # from beam to beam [rad], negative: clockwise
    range_min_m: float  # least range that the scanner measures [m]
    range_max_m: float  # greatest range that it measures [m]
    sweep_time_s: float = 0.0  # from the first beam to the last [s]

    def __post_init__(self) -> None:
        super().__post_init__()
        self._require_array("ranges_m")
        if self.ranges_m.ndim != 1:
            raise InputError(f"scan of {self.sensor!r}: ranges have shape {self.ranges_m.shape}; one row is expected")
        check_limit(self.ranges_m.size, MOST_BEAMS, f"scan of {self.sensor!r}: has", "beams")
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

    @property
    def points(self) -> NDArray[np.float64]:
        """Returns in the scanner's frame, (n, 3) [m]."""
        hit = np.isfinite(self.ranges_m)
        ranges, angles = self.ranges_m[hit].astype(np.float64), self.angles_rad[hit]
        return np.stack([ranges * np.cos(angles), ranges * np.sin(angles), np.zeros(len(ranges))], axis=-1)


@dataclass(frozen=True, eq=False)
class Image(_Stamped):
    """One colour image, RGB, as decoded from its message."""

    rgb: NDArray[np.uint8]  # (height, width, 3) red, green, blue

    def __post_init__(self) -> None:
        super().__post_init__()
        self._require_array("rgb")
        if self.rgb.ndim != 3 or self.rgb.shape[2] != 3 or self.rgb.dtype != np.uint8:
            raise InputError(
                f"image of {self.sensor!r}: rgb has shape {self.rgb.shape} and type {self.rgb.dtype}; (height, width, 3) and "
                "uint8 are expected"
            )


@dataclass(frozen=True, eq=False)
class DepthImage(_Stamped):
    """A colour image and the depth of each of its pixels, as decoded from their two messages of one stamp.

    `depth_m` is the distance along the optical axis, not along the ray, in whole millimetres; 0 where there is none
    (nothing matched, nothing within range). `trackers.rig.StereoSensor.points` makes points of it.
    """

    rgb: NDArray[np.uint8]  # (height, width, 3) red, green, blue
    depth_m: NDArray[np.float32]  # (height, width) along the optical axis [m], 0: none

    def __post_init__(self) -> None:
        super().__post_init__()
        self._require_array("rgb")
        self._require_array("depth_m")
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

    values: NDArray[np.uint8]  # (rows, columns) reading of each element

    def __post_init__(self) -> None:
        super().__post_init__()
        self._require_array("values")
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

    frame_from_base: NDArray[np.float64]  # (4, 4) homogeneous transform [m]

    def __post_init__(self) -> None:
        super().__post_init__()
        self._require_array("frame_from_base")
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


FULL_SCALE = 255
"""Value of an element without resistance: the whole supply voltage."""


class ForceCurve(Strict):
    """Force-sensing resistor in a divider with a measuring resistor, digitised to 8 bits.

    Its conductance grows with load^`exponent` (resistance falls as an inverse power law); the divider's share of the supply
    voltage is 1 / (1 + (half_scale_n / load)^exponent): one half where the resistance equals the measuring resistor's. Below
    `threshold_n` the element reads 0; above `saturation_n` it is constant. All in newton on the element.

    Source: Interlink Electronics, FSR integration guide (force curve with turn-on threshold, power law and saturation at a
    pressure; voltage divider). Default: 10 kg/cm² on 14.5 cm² (the 38.1 mm square of FSR 406), so that one element holds the
    step of a walking adult.
    """

    half_scale_n: float = Field(
        default=200.0, gt=0, allow_inf_nan=False, description="load at which an element reads half of 255 [N]"
    )
    exponent: float = Field(default=0.9, gt=0, le=2, description="power of the load with which the conductance grows")
    threshold_n: float = Field(
        default=5.0, ge=0, allow_inf_nan=False, description="load below which an element reads 0 [N]"
    )
    saturation_n: float = Field(
        default=1422.0, gt=0, allow_inf_nan=False, description="load above which an element reads no more [N]"
    )

    @model_validator(mode="after")
    def _consistent(self) -> ForceCurve:
        if self.threshold_n >= self.saturation_n:
            raise ValueError(f"threshold_n {self.threshold_n:g} must be below saturation_n {self.saturation_n:g}")
        if self.full_value < 1:
            raise ValueError(
                f"half_scale_n {self.half_scale_n:g} is so far above saturation_n {self.saturation_n:g} that no load is "
                f"ever seen in 8 bits; one below it is valid"
            )
        return self

    @property
    def full_value(self) -> int:
        """Reading of a saturated element."""
        return int(np.rint(self.signal(np.array(self.saturation_n))))

    def signal(self, load_n: Array) -> Array:
        """Compute the divider's voltage in 8-bit steps, before rounding, for loads of any shape [N]."""
        held = np.minimum(load_n, self.saturation_n)
        conductance = (held / self.half_scale_n) ** self.exponent  # relative to the measuring resistor's
        return np.where(load_n >= self.threshold_n, FULL_SCALE * conductance / (1 + conductance), 0.0)

    def values(self, load_n: Array) -> NDArray[np.uint8]:
        """Return the readings of elements under these loads [N], same shape."""
        return np.rint(self.signal(load_n)).astype(np.uint8)

    def load_n(self, values: NDArray[np.uint8]) -> Array:
        """Convert values to loads [N], same shape: 0 for 0, saturation_n from a saturated element's value on.

        Inverse of `values` to half an 8-bit step, between threshold and saturation.
        """
        return self._loads[values]

    @property
    def _loads(self) -> Array:
        """The load of each of the 256 values [N]."""
        share = np.arange(1, FULL_SCALE) / FULL_SCALE
        loads = np.full(FULL_SCALE + 1, self.saturation_n)
        loads[0] = 0.0
        loads[1:-1] = self.half_scale_n * (share / (1 - share)) ** (1 / self.exponent)
        loads[self.full_value :] = self.saturation_n
        return np.minimum(loads, self.saturation_n)
