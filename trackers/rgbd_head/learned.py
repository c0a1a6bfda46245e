"""What is learned of heads beforehand: which colours are skin, where on a head it is, which colours face and hair have.

Shipped as `heads.npz`; `scripts/learn-heads` makes it anew, from the twin alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from trackers.array_files import ArraySpec, read_arrays
from trackers.arrays import Array, Index
from trackers.errors import InputError
from trackers.rgbd_head.colours import COLOURS, SHARES
from trackers.rgbd_head.outline import CELLS
from trackers.rgbd_head.skin import HUES, SATURATIONS, SkinRegion
from trackers.text_file import AnyPath

SHIPPED = Path(__file__).with_name("heads.npz")
_ARRAYS = {
    "skin": ArraySpec("b", (HUES, SATURATIONS)),
    "share": ArraySpec("f", (CELLS[0] * CELLS[1],), 0, 1),
    "common": ArraySpec("f", (2, COLOURS), 0, 1),
}


@dataclass(frozen=True, eq=False)
class Learned:
    """skin: the region of hue and saturation. share: s of each cell. common: how often each colour is face, and hair."""

    skin: SkinRegion
    share: Float[Array, "cells"]
    common: Float[Array, "2 colours"]

    @cached_property
    def share_steps(self) -> Int[Index, "cells"]:
        """The step of s of each cell."""
        return np.rint(self.share * (SHARES - 1)).astype(np.intp)


@lru_cache(maxsize=4)
def load_learned(path: AnyPath) -> Learned:
    """What a file holds; raises InputError for one that is missing, damaged or of something else."""
    arrays = read_arrays(path, _ARRAYS, "a file that scripts/learn-heads wrote")
    sums = arrays["common"].sum(axis=1, dtype=float)
    if not np.allclose(sums, 1, atol=1e-3):
        raise InputError(f"{path}: common has rows that sum to {sums}; shares that sum to 1 are expected")
    return Learned(SkinRegion(arrays["skin"]), arrays["share"].astype(float), arrays["common"].astype(float))
