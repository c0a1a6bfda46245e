"""Effects of faults on observations: covered lenses, blocked sectors, dead beams and dead floor elements."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from trackers.observations import DepthImage, FloorFrame, Image, LaserScan
from trackers.rig import FisheyeSensor, RigSensor
from twin.sensors.fault_kinds import BlockedSector, DeadBeams, DeadCells, LensOcclusion

_LOBES = np.arange(2, 7)
"""Numbers of lobes of an outline: few, as of a thumb or a drop."""

_NO_DEPTH_ABOVE = 0.3
"""Covered share of a pixel above which it has no match in the other view."""

_SMEAR_SHARE = 0.06
"""Spread of light by a smear: standard deviation as a share of the picture's height."""

_SMALL_SHARE = 4
"""Resolution divisor for blurring a smear, which has no finer detail."""


class LensCover:
    """Soft-edged cover over part of a camera's image; its outline is drawn from `rng` once."""

    def __init__(self, fault: LensOcclusion, rig: RigSensor, rng: np.random.Generator) -> None:
        self._fault = fault
        self._rig = rig
        self._swing = fault.irregularity * rng.uniform(0.3, 1.0, _LOBES.size) / (_LOBES - 1)
        self._phase = rng.uniform(0.0, 2 * np.pi, _LOBES.size)
        self._cover: NDArray[np.float32] | None = None

    def apply(self, observation: Image | DepthImage) -> Image | DepthImage:
        """Return the image with the cover on it, without depth where it covers much of a pixel."""
        height, width, _ = observation.rgb.shape
        if self._cover is None or self._cover.shape != (height, width):
            self._cover = self.cover(width, height)
        covered = self._blend(observation.rgb, self._cover)
        if isinstance(observation, DepthImage):
            depth_m = np.where(self._cover > _NO_DEPTH_ABOVE, np.float32(0), observation.depth_m)
            return replace(observation, rgb=covered, depth_m=depth_m)
        return replace(observation, rgb=covered)

    def cover(self, width: int, height: int) -> NDArray[np.float32]:
        """Return the covered share of each pixel, 0 to 1, (height, width); 0 outside a fisheye's field of view."""
        fault = self._fault
        x = np.arange(width) - (fault.at[0] * width - 0.5)
        y = np.arange(height)[:, None] - (fault.at[1] * height - 0.5)
        bearing = np.arctan2(y, x)
        outline = np.ones_like(bearing)
        for lobes, swing, phase in zip(_LOBES, self._swing, self._phase, strict=True):
            outline += swing * np.cos(lobes * bearing + phase)
        radius = np.hypot(x, y) / (fault.size * height / 2 * outline)  # 1 on the outline
        inwards = np.clip((1 + fault.softness / 2 - radius) / fault.softness, 0, 1)
        cover = fault.opacity * inwards * inwards * (3 - 2 * inwards)
        return np.where(self._sees_light(width, height), cover, 0).astype(np.float32)

    def _sees_light(self, width: int, height: int) -> NDArray[np.bool_]:
        """Return the pixels where the lens forms an image, (height, width)."""
        if not isinstance(self._rig, FisheyeSensor):
            return np.ones((height, width), dtype=bool)
        lens = self._rig.intrinsics
        edge = lens.field_of_view_rad / 2
        rim, _ = lens.project(np.array([np.sin(edge), 0.0, np.cos(edge)]))
        rim_radius = (rim[0] - lens.cx) / lens.fx
        x, y = (np.arange(width) - lens.cx) / lens.fx, (np.arange(height)[:, None] - lens.cy) / lens.fy
        return np.hypot(x, y) <= rim_radius

    def _blend(self, rgb: NDArray[np.uint8], cover: NDArray[np.float32]) -> NDArray[np.uint8]:
        rows, columns = np.flatnonzero(cover.any(axis=1)), np.flatnonzero(cover.any(axis=0))
        covered_rgb = rgb.copy()
        if rows.size == 0:
            return covered_rgb
        box = (slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1))
        share = cover[box][..., None]
        seen = rgb[box].astype(np.float32)
        behind = (
            np.array(self._fault.rgb, np.float32)
            if self._fault.look == "cover"
            else _smeared(rgb)[box].astype(np.float32)
        )
        covered_rgb[box] = np.rint(seen + share * (behind - seen)).astype(np.uint8)
        return covered_rgb


def _smeared(rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Blur an image like grease or water on the lens."""
    height, width, _ = rgb.shape
    small = cv2.resize(
        rgb, (max(1, width // _SMALL_SHARE), max(1, height // _SMALL_SHARE)), interpolation=cv2.INTER_AREA
    )
    blurred = cv2.GaussianBlur(small, (0, 0), _SMEAR_SHARE * height / _SMALL_SHARE)
    return np.asarray(cv2.resize(blurred, (width, height), interpolation=cv2.INTER_LINEAR), dtype=np.uint8)


class SectorBlock:
    """Obstacle right before a scanner's window."""

    def __init__(self, fault: BlockedSector) -> None:
        self._fault = fault

    def apply(self, observation: LaserScan) -> LaserScan:
        """Return the scan with no range in the sector beyond the obstacle."""
        scan, fault = observation, self._fault
        nearest = np.float32(fault.at_m if fault.at_m >= scan.range_min_m else np.nan)
        blocked = beams_between(scan, fault.bearings_deg) & (scan.ranges_m > fault.at_m)
        return replace(scan, ranges_m=np.where(blocked, nearest, scan.ranges_m))


def beams_between(scan: LaserScan, bearings_deg: tuple[float, float]) -> NDArray[np.bool_]:
    """Return which beams (n_beam,) lie between two bearings [deg], both included."""
    first, last = np.deg2rad(bearings_deg)
    slack = abs(scan.angle_increment_rad) * 1e-3  # a beam on the edge belongs to it, despite rounding
    angles = scan.angles_rad
    return (angles >= first - slack) & (angles <= last + slack)


class DeadBeamMask:
    """Beams without readings; a share of them is drawn from `rng` once."""

    def __init__(self, fault: DeadBeams, rng: np.random.Generator) -> None:
        self._fault = fault
        self._rng = rng
        self._reads = np.float32(np.nan if fault.reads == "invalid" else np.inf)
        self._dead: NDArray[np.bool_] | None = None

    def apply(self, observation: LaserScan) -> LaserScan:
        """Return the scan with the dead beams' reading."""
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


class DeadCellMask:
    """Elements of a floor with a constant reading; a share of them is drawn from `rng` once."""

    def __init__(self, fault: DeadCells, rng: np.random.Generator) -> None:
        self._fault = fault
        self._rng = rng
        self._dead: NDArray[np.bool_] | None = None

    def apply(self, observation: FloorFrame) -> FloorFrame:
        """Return the frame with the dead elements' reading."""
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
