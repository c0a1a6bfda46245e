"""Parts of a sensor that are dead: beams of a scanner, elements of a floor."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from trackers.observations import FloorFrame, LaserScan
from twin.sensors.fault_kinds import DeadBeams, DeadCells


def beams_between(scan: LaserScan, bearings_deg: tuple[float, float]) -> NDArray[np.bool_]:
    """Which beams (n_beam,) lie between two bearings [deg], both included."""
    first, last = np.deg2rad(bearings_deg)
    slack = abs(scan.angle_increment_rad) * 1e-3  # a beam on the edge belongs to it, whatever its last digit
    angles = scan.angles_rad
    return (angles >= first - slack) & (angles <= last + slack)


class BrokenBeams:
    """Beams that report nothing; which of a share they are is drawn from `rng` once."""

    def __init__(self, fault: DeadBeams, rng: np.random.Generator) -> None:
        self._fault = fault
        self._rng = rng
        self._reads = np.float32(np.nan if fault.reads == "invalid" else np.inf)
        self._dead: NDArray[np.bool_] | None = None

    def spoil(self, observation: LaserScan) -> LaserScan:
        """The scan without them."""
        if self._dead is None:
            self._dead = self._which(observation)
        return replace(observation, ranges_m=np.where(self._dead, self._reads, observation.ranges_m))

    def _which(self, scan: LaserScan) -> NDArray[np.bool_]:
        dead = self._rng.random(scan.ranges_m.size) < self._fault.share
        for each in self._fault.beams:
            dead[each[0] : each[-1] + 1] = True
        if self._fault.bearings_deg is not None:
            dead |= beams_between(scan, self._fault.bearings_deg)
        return dead


class BrokenCells:
    """Elements of a floor that always read the same; which of a share they are is drawn from `rng` once."""

    def __init__(self, fault: DeadCells, rng: np.random.Generator) -> None:
        self._fault = fault
        self._rng = rng
        self._dead: NDArray[np.bool_] | None = None

    def spoil(self, observation: FloorFrame) -> FloorFrame:
        """The frame with them."""
        if self._dead is None:
            self._dead = self._which(observation.values.shape)
        return replace(observation, values=np.where(self._dead, np.uint8(self._fault.reads), observation.values))

    def _which(self, shape: tuple[int, ...]) -> NDArray[np.bool_]:
        dead = self._rng.random(shape) < self._fault.share
        for row, column in self._fault.cells:
            dead[row, column] = True
        dead[list(self._fault.rows)] = True
        dead[:, list(self._fault.columns)] = True
        return dead
