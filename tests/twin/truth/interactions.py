"""Interactions found in a table of the truth, to hold against those that a run found."""

from __future__ import annotations

import numpy as np

from twin.recording.tables import TruthTable
from twin.truth.situations import INTERACTION_M, OpenSituations, PairState, pairs_within
from twin.truth.truth_types import Situation


def interactions_of(truth: TruthTable) -> list[Situation]:
    """The interactions that a truth table holds, in the order in which they end; the run's end is its last moment."""
    found, open_ = [], OpenSituations()
    first = np.searchsorted(truth.stamps_ns, truth.frame_stamps_ns, side="left").tolist()
    last = np.searchsorted(truth.stamps_ns, truth.frame_stamps_ns, side="right").tolist()
    stamps_ns = truth.frame_stamps_ns.tolist()
    for stamp_ns, frame in zip(stamps_ns, map(slice, first, last), strict=True):
        place_m = np.stack([truth.x[frame], truth.y[frame]], axis=1)
        near = pairs_within(truth.id[frame], place_m, INTERACTION_M)
        holding = {pair: PairState(least_m=distance) for pair, distance in near.items()}
        found += open_.update("interaction", "", stamp_ns, holding)
    return found + (open_.finish(stamps_ns[-1]) if stamps_ns else [])
