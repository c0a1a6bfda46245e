"""The single-model baseline: an extended Kalman filter on model 3 alone, which is an IMM with one mode."""

from __future__ import annotations

from trackers.arrays import Array
from trackers.filters.heading_motion import HeadingMotion
from trackers.filters.imm import Imm
from trackers.filters.motion import KALMAN_MODELS, MotionModel


def kalman(models: tuple[MotionModel] = KALMAN_MODELS, measurement_covariance: Array | None = None) -> Imm:
    """Extended Kalman filter batched over tracks, by default the paper's: model 3 with Q = diag(300, 300)."""
    return Imm(HeadingMotion(models), measurement_covariance=measurement_covariance)
