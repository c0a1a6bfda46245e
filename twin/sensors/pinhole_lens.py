"""Which pinhole lenses can be rendered."""

from __future__ import annotations

import numpy as np

from trackers.errors import InputError
from trackers.pinhole import PinholeIntrinsics

MAX_TANGENT = 8.0
"""The farthest a picture may reach from its axis (tangent of the angle): 166° across."""


def check_pinhole(lens: PinholeIntrinsics) -> None:
    """Raise InputError if the picture's edge lies where the distortion has folded back, or too far from the axis."""
    columns, rows = np.linspace(-0.5, lens.width - 0.5, 65), np.linspace(-0.5, lens.height - 0.5, 65)
    edge = np.concatenate(
        [
            *(np.stack([columns, np.full(65, row)], axis=-1) for row in rows[[0, -1]]),
            *(np.stack([np.full(65, column), rows], axis=-1) for column in columns[[0, -1]]),
        ]
    )
    reach = np.abs(lens.unproject(edge)[:, :2])
    if np.isnan(reach).any():
        raise InputError(
            f"distortion {list(lens.distortion)} (k1, k2, p1, p2, k3) folds back inside the "
            f"{lens.width} x {lens.height} picture, so that its edge sees nothing; one that grows up to the edge is valid"
        )
    if reach.max() > MAX_TANGENT:
        raise InputError(
            f"the picture reaches {np.rad2deg(np.arctan(reach.max())):.1f}° from the camera's axis; "
            f"at most {np.rad2deg(np.arctan(MAX_TANGENT)):.1f}° is valid, a fisheye sees farther"
        )
