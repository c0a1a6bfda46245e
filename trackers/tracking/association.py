"""Association in stages: in each, some tracks and the free measurements are paired one to one at least total cost."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from trackers.arrays import Array, Index, Mask
from trackers.filters.gating import global_nearest_neighbour, max_weight_assignment


@dataclass(frozen=True, eq=False)
class Stage:
    """Participating tracks; costs of the pairs, summed; a pair in any veto mask is forbidden.

    unpaired: cost of each track without a measurement; None: as many pairs as possible, at any cost.
    """

    tracks: Bool[Mask, "n"]
    terms: Sequence[Float[Array, "n k"]]
    vetoes: Sequence[Bool[Mask, "n k"]] = ()
    unpaired: Float[Array, "n"] | None = None


def associate(stages: Sequence[Stage]) -> tuple[Int[Index, "p"], Int[Index, "p"]]:
    """Return pairs (tracks, measurements) by the global nearest neighbour of each stage in turn.

    Tracks and measurements paired in one stage are excluded from later ones. Pairs are in the order of their stages.
    """
    rows, columns = np.empty(0, np.intp), np.empty(0, np.intp)
    for stage in stages:
        if not stage.tracks.any():
            continue
        allowed = np.repeat(stage.tracks[:, None], stage.terms[0].shape[1], axis=1)
        for veto in stage.vetoes:
            allowed &= ~veto
        allowed[rows] = allowed[:, columns] = False
        cost = sum(stage.terms[1:], start=stage.terms[0])
        if stage.unpaired is None:
            more_rows, more_columns = global_nearest_neighbour(cost, allowed)
        else:
            more_rows, more_columns = max_weight_assignment(np.where(allowed, stage.unpaired[:, None] - cost, 0.0))
        rows, columns = np.concatenate([rows, more_rows]), np.concatenate([columns, more_columns])
    return rows, columns


def left_over(n: int, taken: Int[Index, "p"]) -> Int[Index, "rest"]:
    """Return the indices below n that are not `taken`."""
    is_taken = np.zeros(n, np.bool_)
    is_taken[taken] = True
    return (~is_taken).nonzero()[0]
