"""Detection probability of a scan: no person stands where the beams continue behind."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from pydantic import Field

from trackers.arrays import Array
from trackers.configuration import Strict
from trackers.laser.bearings import beams_of_turn
from trackers.observations import LaserScan
from trackers.rig import LaserSensor

_ACROSS = np.array([-1.0, 0.0, 1.0])  # positions across a body at which beams are tested


class DetectionOptions(Strict):
    """Options of a body's extent in the beams of one layer, and of its detection (ours)."""

    detected: float = Field(
        default=0.95,
        ge=0,
        lt=1,
        description="detection probability of a body that nothing occludes; 0: no negative evidence (ours)",
    )
    width_m: float | None = Field(
        default=None,
        gt=0,
        description="width on which as many beams must fall as a cluster has samples, or a body is not detected [m]; null: far "
        "away it is detected as surely as near by (ours)",
    )
    half_width_m: float = Field(default=0.12, gt=0, description="half the width of a body across the beams [m] (ours)")
    behind_m: float = Field(
        default=0.1, description="how far behind a body's axis a beam must go on to have passed it [m] (ours)"
    )
    hidden_up_to: float = Field(
        default=0.0,
        ge=0,
        lt=1,
        description="share of a body's width in clear beams up to which it may still be occluded (ours)",
    )


class DetectionModel:
    """Detection probability of bodies at empty places by a scanner's scans.

    least: the samples of the smallest cluster. A width w is met by w / s beams of spacing s or one more, at least k with the
    probability w / s − k + 1, clipped. A beam without a return (+inf) passed to the end of the range; one without a reading
    (NaN) gives no information.
    """

    def __init__(self, sensor: LaserSensor, options: DetectionOptions, least: int = 1) -> None:
        self.options, self._least = options, least
        self._origin_m = sensor.room_from_sensor.translation[:2].copy()
        self._scan_from_room = sensor.room_from_sensor.rotation[:2, :2].T.copy()

    def seen(self, scan: LaserScan, points: Float[Array, "2 *n"]) -> Float[Array, "*n"]:
        """Return the probability that a body with its axis at room points would have been detected."""
        options, count = self.options, scan.ranges_m.size
        reach_m = np.zeros(count + 2)  # beside the scan nothing is detected
        np.copyto(reach_m[1:-1], np.minimum(scan.ranges_m, scan.range_max_m), where=~np.isnan(scan.ranges_m))
        if beams_of_turn(scan) is not None:
            reach_m[0], reach_m[-1] = reach_m[-2], reach_m[1]
        # bearings relative to the middle beam wrap around behind it
        middle = scan.angle_min_rad + 0.5 * (count - 1) * scan.angle_increment_rad
        cos, sin = np.cos(middle), np.sin(middle)
        ahead_from_room = np.array([[cos, sin], [-sin, cos]]) @ self._scan_from_room
        (a, b), (c, d) = ahead_from_room.tolist()
        off_x, off_y = points[0] - self._origin_m[0], points[1] - self._origin_m[1]
        x, y = a * off_x + b * off_y, c * off_x + d * off_y
        distance = np.sqrt(x * x + y * y)
        half = options.half_width_m / np.maximum(distance, options.half_width_m)
        bearing = np.arctan2(y, x) + _ACROSS.reshape(-1, *[1] * x.ndim) * half
        bearing -= 2 * np.pi * np.rint(bearing / (2 * np.pi))
        beam = np.rint(bearing / scan.angle_increment_rad + (0.5 * (count - 1) + 1))
        beam = np.minimum(np.maximum(beam, 0), count + 1).astype(np.intp)
        clear = (reach_m[beam] > distance + options.behind_m).sum(axis=0) / _ACROSS.size
        seen = options.detected * np.maximum(clear - options.hidden_up_to, 0) / (1 - options.hidden_up_to)
        if options.width_m is None:
            return seen
        apart_m = np.maximum(distance * abs(scan.angle_increment_rad), 1e-9)
        return seen * np.minimum(np.maximum(options.width_m / apart_m - (self._least - 1), 0), 1)
