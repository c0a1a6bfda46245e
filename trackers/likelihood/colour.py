"""Likelihoods by pictures: colours and foreground.

Colours: a person's own in the ellipse of a head, skin there, references in windows. Foreground: of points expected on it, and
of ellipses expected to be filled by it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, FiniteFloat, PositiveInt

from trackers.arrays import AnyArray, Array, Bool, Float, Float32, Index, Int, Int32, Mask, Singles
from trackers.configuration import Strict
from trackers.vision.head_colours import COLOURS, SHARES
from trackers.vision.head_outlines import ring_points
from trackers.vision.stereo_picture import IN_PICTURE, SKIN, mean_of, share_of
from trackers.vision.views import ProjectedPoints, WindowOptions

Linear = tuple[FiniteFloat, FiniteFloat]
Share = Annotated[float, Field(ge=0, le=1)]

_NOTHING = 1e-3
"""Floor of a linear weight (eq. 5, 7): with 0, one blocked camera would exclude a correct hypothesis."""


class PersonColourOptions(Strict):
    """Options of a person's own colours of face and hair, by position on the head (ours)."""

    power: float = Field(default=12.0, gt=0, description="what the mean logarithm over the ellipse's pixels counts")

    def log_likelihood(
        self,
        pixels: Int32[AnyArray, "points n"],
        steps: Int32[AnyArray, "points n"],
        tables: Float[Singles, "people entries"],
        heads_per_person: int,
    ) -> Float[Singles, "n"]:
        """Return log-likelihoods of heads by the pixels in their ellipses.

        steps: first entry of the step of s at each point; tables: log-probability of each colour at each step of s
        (`ExpectedColours.tables`); heads: `heads_per_person` of each person in turn, for each camera in turn.
        """
        entry = pixels & (COLOURS - 1)
        entry += steps
        of_person = np.arange(0, tables.size, SHARES * COLOURS, dtype=np.int32)[:, None]
        entry.reshape(-1, len(tables), heads_per_person)[...] += of_person
        return np.float32(self.power) * mean_of(tables.ravel().take(entry))


class SkinShareOptions(Strict):
    """Options of the share of skin in the ellipse (the paper, eq. 4 and 5)."""

    linear: Linear = Field(
        default=(1.0, 1.0), description="a and b of the weight a − b |c̄ − ĉ| (eq. 5; the paper gives neither)"
    )
    front: Share = Field(
        default=0.7, description="ĉ of a head seen from the front, its largest (the paper gives no formula)"
    )
    behind: Share = Field(default=0.05, description="ĉ of a head seen from behind, its smallest")

    def share(self, pixels: Int32[AnyArray, "points n"]) -> Float[Singles, "n"]:
        """Return c̄: the share of skin among the pixels of each ellipse inside the picture."""
        in_picture = np.maximum(share_of(pixels, IN_PICTURE), np.float32(1 / len(pixels)))
        return np.asarray(share_of(pixels, SKIN) / in_picture, np.float32)

    def expected(self, facing: Float[Singles, "*n"]) -> Float[Singles, "*n"]:
        """Return ĉ of a head whose nose points `facing` away from the camera [rad]; largest from the front."""
        share = np.float32(self.behind) + np.float32((self.front - self.behind) / 2) * (1 + np.cos(facing))
        return np.asarray(share, np.float32)

    def log_likelihood(self, share: Float[Singles, "..."], facing: Float[Singles, "..."]) -> Float[Singles, "..."]:
        """Return log-likelihoods of heads by their shares of skin and directions."""
        return linear_log(np.abs(share - self.expected(facing)), self.linear)


def linear_log(off: Float[Singles, "*n"], slope: tuple[float, float]) -> Float[Singles, "*n"]:
    """Return log(a − b · off), with a floor (eq. 5 and 7)."""
    a, b = slope
    return np.log(np.maximum(a - b * off, _NOTHING)).astype(np.float32)


def window_log_likelihood(
    so_far: Float[Array, "k"],
    places: Float[Array, "3 k"],
    look: ProjectedPoints,
    window: WindowOptions,
    references: Sequence[tuple[Float32[Singles, "n padded"], Int[Index, "k"]]],
    strength: float,
) -> Float[Array, "k"]:
    """Add −λ D² (Mori et al., eq. 5) of the colours about positions, in every view, to their log-likelihoods.

    so_far: −∞ for positions already excluded, which are skipped. references: for each view the roots of histograms
    (`padded_roots`), and the index of each position's. strength: λ.
    """
    total = so_far.copy()
    left = ~np.isneginf(total)
    for view, at, here, (reference, number) in zip(look.views, look.pixels, look.seen & left, references, strict=True):
        k = np.flatnonzero(here)
        alike = view.similarity(places[:, k], at[k], window, reference, number[k])
        total[k] += strength * (alike - 1)
    return total


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
    """Options of foreground inside the ellipse of a head and background about it (ours)."""

    power: float = Field(default=6.0, gt=0, description="power of the two shares")
    ring: float = Field(default=1.3, gt=1, description="size of the half ring over the ellipse, in its semi-axes")
    ring_points: PositiveInt = Field(default=8, le=128, description="points looked at on the half ring")
    above: float | None = Field(
        default=None,
        gt=1,
        description="size of an arc of 90° further over the ellipse, in its semi-axes: background over a head, a head over a "
        "shoulder; null: not looked at",
    )
    floor: float = Field(default=0.02, gt=0, lt=1, description="a share counts at least as this")

    def outside(self) -> Float[Array, "k 2"]:
        """Return the points about the unit disc that are looked at: those of the half ring, then those of the arc."""
        ring = ring_points(self.ring_points, self.ring)
        if self.above is None:
            return ring
        return np.concatenate([ring, ring_points(max(self.ring_points // 2, 1), self.above, np.pi / 2)])

    def log_likelihood(self, filled: Float[Singles, "n"], free: Sequence[Float[Singles, "n"]]) -> Float[Singles, "n"]:
        """Return log-likelihoods by the share of foreground in each ellipse, and of background on the ring and on the arc."""
        floor = np.float32(self.floor)
        product = np.maximum(filled, floor)
        for share in free:
            product = product * np.maximum(share, floor)
        return np.float32(self.power) * np.log(product)
