"""Which filter follows a person: several models or one, ours over velocities or the paper's over heading and speed."""

from __future__ import annotations

import numpy as np

from trackers.filters.heading_motion import HeadingMotion
from trackers.filters.imm import Imm, Motion
from trackers.filters.motion import IMM_MODELS, KALMAN_MODELS, MotionModel, transition_matrix
from trackers.filters.velocity_motion import VelocityModel, VelocityMotion
from trackers.laser_fisheye_imm.options import LaserFisheyeImmOptions


def filter_of(options: LaserFisheyeImmOptions) -> Imm:
    """The filter of these options."""
    motion = _motion(options)
    modes = transition_matrix(motion.n_mode, options.mode_stays)
    return Imm(motion, modes, np.eye(2) * options.measurement_variance_m2)


def _motion(options: LaserFisheyeImmOptions) -> Motion:
    single = options.filter == "kalman"
    if options.motions is not None:
        pairs = (options.kalman_motion,) if single else options.motions
        return VelocityMotion(tuple(VelocityModel(*pair) for pair in pairs))
    if single:
        return _over_headings(KALMAN_MODELS, (options.kalman_variances,))
    return _over_headings(IMM_MODELS, options.imm_variances)


def _over_headings(pattern: tuple[MotionModel, ...], variances: tuple[tuple[float, float], ...]) -> HeadingMotion:
    """The paper's models with other variances."""
    pairs = zip(pattern, variances, strict=True)
    return HeadingMotion(tuple(MotionModel(model.turn_persists, *pair) for model, pair in pairs))
