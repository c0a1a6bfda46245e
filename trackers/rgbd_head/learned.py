"""What is learned of heads beforehand: which colours are skin, where on a head it is, which colours face and hair have.

Shipped as `heads.npz`; `scripts/learn-heads` makes it anew, from the twin alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from trackers.arrays import Array, Index
from trackers.errors import InputError
from trackers.rgbd_head.colours import COLOURS, SHARES
from trackers.rgbd_head.outline import CELLS
from trackers.rgbd_head.skin import HUES, SATURATIONS, SkinRegion
from trackers.text_file import AnyPath

SHIPPED = Path(__file__).with_name("heads.npz")
_SHAPES = {"skin": (HUES, SATURATIONS), "share": (CELLS[0] * CELLS[1],), "common": (2, COLOURS)}
_EXPECTED = "a file that scripts/learn-heads wrote"


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
    path = Path(path)
    try:
        with np.load(path, allow_pickle=False) as archive:
            arrays = {name: np.asarray(archive[name]) for name in _SHAPES}
    except (OSError, ValueError, KeyError, EOFError) as error:
        raise InputError(f"{path}: cannot be read ({error}); {_EXPECTED} is expected") from error
    for name, shape in _SHAPES.items():
        if arrays[name].shape != shape:
            raise InputError(f"{path}: {name} has shape {arrays[name].shape}; {shape} is expected")
        if not np.isfinite(arrays[name]).all():
            raise InputError(f"{path}: {name} holds NaN or infinity; finite numbers are expected")
    return Learned(
        SkinRegion(arrays["skin"].astype(np.bool_)), arrays["share"].astype(float), arrays["common"].astype(float)
    )
