"""Where a run's scans hit, added up on a fine grid: the room as a robot's bag shows it, without a plan of the room."""

from __future__ import annotations

import base64

import cv2
import numpy as np
from numpy.typing import NDArray

from trackers.observations import LaserScan
from trackers.rig import Rig
from twin.report.birdseye import FloorView, Polygon, ScannerOnFloor

_OFFSET = 1 << 20  # cells are numbered from −2^20 to 2^20 on either axis
_BUFFER = 200_000
_RGB = (118, 134, 158)  # reads on a light page and on a dark one


class ScanDensity:
    """Counts returns in cells of `cell_m`; memory grows with the floor that was hit, not with the duration."""

    def __init__(self, rig: Rig, cell_m: float = 0.02) -> None:
        self._scanners = {name: ScannerOnFloor(laser.room_from_sensor) for name, laser in rig.lasers().items()}
        self._cell_m = cell_m
        self._cells = np.zeros(0, dtype=np.int64)
        self._counts = np.zeros(0, dtype=np.int64)
        self._buffer: list[NDArray[np.int64]] = []
        self._buffered = 0

    def add(self, scan: LaserScan) -> None:
        """Count the returns of a scan of one of the rig's scanners."""
        index = np.floor(self._scanners[scan.sensor].points(scan) / self._cell_m).astype(np.int64)
        index = index[(np.abs(index) < _OFFSET).all(axis=1)] + _OFFSET
        self._buffer.append(index[:, 0] * 2 * _OFFSET + index[:, 1])
        self._buffered += len(index)
        if self._buffered > _BUFFER:
            self._merge()

    def cells(self) -> tuple[Polygon, NDArray[np.int64]]:
        """The middles (n, 2) [m, room frame] of the cells that were hit, and how often, (n,)."""
        self._merge()
        index = np.stack([self._cells // (2 * _OFFSET), self._cells % (2 * _OFFSET)], axis=-1) - _OFFSET
        return (index.astype(np.float64) + 0.5) * self._cell_m, self._counts

    def png(self, view: FloorView) -> str:
        """The hits as a transparent PNG over a view of the floor (a data URI), denser the more often hit."""
        middles, counts = self.cells()
        pixels = view.pixels(middles)
        inside = view.inside(pixels)
        x, y = np.floor(pixels[inside]).astype(np.intp).T
        density = np.zeros((view.height_px, view.width_px), dtype=np.float32)
        np.add.at(density, (y, x), counts[inside])
        # A cell is a few pixels wide; the logarithm keeps walls, hit in every scan, from hiding what moved.
        strength = np.log1p(cv2.dilate(density, np.ones((3, 3), np.uint8)))
        alpha = 0.9 * strength / max(float(strength.max()), 1e-9)
        bgra = np.empty((*density.shape, 4), dtype=np.uint8)
        bgra[..., :3] = _RGB[::-1]
        bgra[..., 3] = np.round(255 * alpha)
        done, png = cv2.imencode(".png", bgra, [cv2.IMWRITE_PNG_COMPRESSION, 9])
        if not done:
            raise RuntimeError("OpenCV could not encode a PNG")
        return "data:image/png;base64," + base64.b64encode(png.tobytes()).decode()

    def _merge(self) -> None:
        if not self._buffer:
            return
        fresh, counts = np.unique(np.concatenate(self._buffer), return_counts=True)
        cells, inverse = np.unique(np.concatenate([self._cells, fresh]), return_inverse=True)
        weights = np.concatenate([self._counts, counts])
        self._cells, self._counts = cells, np.bincount(inverse, weights=weights, minlength=cells.size).astype(np.int64)
        self._buffer, self._buffered = [], 0
