"""Detections of the scans of one frame, in front of the room."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from trackers.arrays import Array, Index, Mask
from trackers.filters.rows import Rows


@dataclass(frozen=True, eq=False)
class Detections(Rows):
    """k detections in front of the room in the scans of one frame; positions are in the room frame."""

    position: Float[Array, "k 2"]  # of the body's or leg's axis [m]
    variance_m2: Float[Array, "k"]  # of the position on each axis, beyond the measurement noise
    n_sample: Int[Index, "k"]  # of all scanners
    width_m: Float[Array, "k"]
    range_m: Float[Array, "k"]  # from the first scanner that detects it to the middle of the samples
    angle: Float[Array, "k 2"]  # of the first sample and the last in that scanner's frame [rad]
    scanner: Bool[Mask, "k s"]  # which of s scanners detect it

    def of_scanner(self, column: int, n_scanner: int) -> Detections:
        """Return the detections as one of several scanners'."""
        scanner = np.zeros((len(self), n_scanner), np.bool_)
        scanner[:, column] = True
        return self.changed(scanner=scanner)

    def sight_lines(self, origins: Float[Array, "s 2"]) -> Float[Array, "k s 2"]:
        """Return unit vectors to the detections from the scanners, at `origins` [m], that detect them; 0 from the others."""
        along = self.position[:, None] - origins
        length_m = np.maximum(np.hypot(along[..., 0], along[..., 1]), 1e-9)
        return along * (self.scanner / length_m)[..., None]

    @classmethod
    def none(cls, n_scanner: int = 1) -> Detections:
        """No detections."""
        nothing, by_none = np.empty(0), np.empty((0, n_scanner), np.bool_)
        return cls(np.empty((0, 2)), nothing, np.empty(0, np.intp), nothing, nothing, np.empty((0, 2)), by_none)
