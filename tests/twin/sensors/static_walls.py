"""How much a scanner errs on walls that stand still, measured on its scans: the same for a real one's and the twin's.

Used by the test of the noise and by the benchmark.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, binary_erosion

from trackers.observations import LaserScan
from twin.sensors.laser_noise import LaserNoise

HOKUYO_SCANS = Path(__file__).parents[3].parent / "shared" / "data" / "lasers" / "positive_5.npz"
"""296 scans of a standing Hokuyo, 768 beams over 270°, 7.5 Hz, in a room in which people walk."""

_FOREIGN_M = 0.1
"""A reading this far from its beam's median over time is of something else: a person, an edge [m]."""

_STRAIGHT_M = 0.05
"""On a wall the median range bends by no more than this from beam to beam [m]."""

_MOVED_M = 0.01
"""What stands still has the same median in the first third of the time and in the last [m]."""

_AROUND = np.ones((5, 7))
"""What lies within two scans and three beams of a foreign reading is left out with it: feet half in the beam."""


@dataclass(frozen=True, eq=False)
class Walls:
    """The beams that look at a wall, by number, and what is known of each."""

    beams: NDArray[np.intp]  # (n,)
    range_m: NDArray[np.float64]  # (n,) median
    sigma_m: NDArray[np.float64]  # (n,) standard deviation over time
    drop_out: float  # share of readings, people and what is near them left out, that are none
    readings: int  # over which that share is taken


def hokuyo_ranges() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Ranges (n_scan, n_beam) [m], NaN where there is none, and (angle_min, increment [rad], range_min, range_max [m])."""
    with np.load(HOKUYO_SCANS) as file:
        ranges, limits = file["scan_ranges"].astype(float), file["scan_amin_inc_rmin_rmax_scantime"][:4].astype(float)
    # Ranges below 2 cm are the device's error codes, in millimetres.
    return np.where(np.isfinite(ranges) & (ranges > 0.06) & (ranges < limits[3]), ranges, np.nan), limits


def walls_in(ranges: NDArray[np.float64]) -> Walls:
    """The walls in scans (n_scan, n_beam) [m], NaN for no reading, of a scanner that stands still."""
    measured = np.isfinite(ranges)
    median = _median(ranges)
    third = len(ranges) // 3
    still = np.abs(_median(ranges[:third]) - _median(ranges[-third:])) < _MOVED_M
    straight = np.zeros(median.size, dtype=bool)
    straight[1:-1] = np.abs(median[2:] - 2 * median[1:-1] + median[:-2]) < _STRAIGHT_M
    # Two beams of the same on either side, so that no edge is near.
    wall = binary_erosion(still & straight & (measured.mean(axis=0) > 0.9), np.ones(5))
    foreign = measured & (np.abs(ranges - median) > _FOREIGN_M) & wall
    clear = ~binary_dilation(foreign, _AROUND) & wall
    beams = np.flatnonzero(wall)
    if beams.size == 0:
        raise ValueError(
            "no beam looks at a wall that stands still; scans of a standing scanner in a room are expected"
        )
    values = np.where(clear & measured, ranges, np.nan)[:, beams]
    return Walls(
        beams=beams,
        range_m=median[beams],
        sigma_m=np.nanstd(values, axis=0),
        drop_out=float((clear & ~measured).sum() / clear.sum()),
        readings=int(clear.sum()),
    )


def simulated(
    ideal_m: NDArray[np.float64], limits: NDArray[np.float64], noise: LaserNoise, count: int, seed: int = 0
) -> NDArray[np.float64]:
    """Scans (count, n_beam) [m] of walls at these ranges (n_beam,) by a scanner of these limits; NaN for no reading."""
    rng = np.random.default_rng(seed)
    angle_min, increment, least, most = limits
    scan = LaserScan(
        "scan", 0, np.nan_to_num(ideal_m, nan=np.inf).astype(np.float32), angle_min, increment, least, most
    )
    scans = np.stack([noise.corrupt(scan, None, rng)[0].ranges_m for _ in range(count)]).astype(float)
    return np.where(np.isfinite(scans), scans, np.nan)


def _median(ranges: NDArray[np.float64]) -> NDArray[np.float64]:
    """Median over time of each beam (n_beam,), NaN where fewer than half of its readings are any."""
    enough = np.isfinite(ranges).mean(axis=0) > 0.5
    median = np.full(ranges.shape[1], np.nan)
    median[enough] = np.nanmedian(ranges[:, enough], axis=0)
    return median
