"""Likelihoods by the foreground of pictures: of points expected on it, and of ellipses expected to be filled by it."""

from __future__ import annotations

from typing import Literal

import numpy as np
from jaxtyping import Bool, Float
from pydantic import Field, PositiveInt

from trackers.arrays import Array, Mask, Singles
from trackers.configuration import Strict

_OFF_FOREGROUND = -4.0
"""Log-likelihood of a point off the foreground, per camera that sees it: masks have holes."""


def point_log_likelihood(
    seen: Bool[Mask, "cameras k"],
    on_foreground: Bool[Mask, "cameras k"],
    checks: Literal["soft", "drop"],
    unlike: float,
) -> Float[Array, "k"]:
    """Return log-likelihoods of points by the cameras that see them, and their foreground there.

    checks: "drop": a point outside a camera's view or foreground is impossible (Mori et al.); "soft": it is less likely.
    unlike: log-likelihood of completely different colours, which also applies to points outside a camera's view, so that
    hypotheses do not drift out of view.
    """
    off_view, off_foreground = (-np.inf, -np.inf) if checks == "drop" else (unlike, _OFF_FOREGROUND)
    by_view = np.where(seen, 0.0, off_view).sum(axis=0)
    return by_view + np.where(on_foreground | ~seen, 0.0, off_foreground).sum(axis=0)


class SilhouetteOptions(Strict):
    """Options of foreground inside the ellipse of a head and background over it (ours)."""

    power: float = Field(default=6.0, gt=0, description="power of the two shares")
    ring: float = Field(default=1.3, gt=1, description="size of the half ring over the ellipse, in its semi-axes")
    ring_points: PositiveInt = Field(default=8, le=128, description="points looked at on the half ring")
    floor: float = Field(default=0.02, gt=0, lt=1, description="a share counts at least as this")

    def log_likelihood(self, filled: Float[Singles, "n"], free: Float[Singles, "n"]) -> Float[Singles, "n"]:
        """Return log-likelihoods by the share of foreground in each ellipse and of background in the half ring."""
        floor = np.float32(self.floor)
        both = np.maximum(filled, floor) * np.maximum(free, floor)
        return np.float32(self.power) * np.log(both)
