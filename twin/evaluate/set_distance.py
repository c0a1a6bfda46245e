"""OSPA and GOSPA: distances between the set of people and the set of tracks of one frame.

OSPA: Schuhmacher, Vo and Vo, "A consistent metric for performance evaluation of multi-object filters", 2008.
GOSPA: Rahmathullah, García-Fernández and Svensson, "Generalized optimal sub-pattern assignment metric", 2017.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment


@dataclass(frozen=True)
class Gospa:
    """GOSPA [m] with α = 2, and its parts [m^p]: distance = (localisation + missed + false)^(1/p)."""

    distance: float
    localisation: float
    missed: float
    false: float


def ospa(distances: NDArray[np.float64], cutoff: float, order: float) -> float:
    """Compute OSPA [m] of distances (n, m) [m] between people and tracks; 0 for two empty sets.

    Each distance counts `cutoff` at most, each surplus person or track `cutoff`; averaged over the larger of the two sets.
    """
    n, m = distances.shape
    if max(n, m) == 0:
        return 0.0
    costs = np.minimum(distances, cutoff) ** order
    total = costs[linear_sum_assignment(costs)].sum() + cutoff**order * abs(n - m)
    return float((total / max(n, m)) ** (1 / order))


def gospa(distances: NDArray[np.float64], cutoff: float, order: float) -> Gospa:
    """Compute GOSPA with α = 2 of distances (n, m) [m]; not averaged.

    Pairs nearer than `cutoff` cost their distance, every unpaired person and track half a cut-off, to the power of `order`.
    """
    n, m = distances.shape
    costs = np.minimum(distances, cutoff) ** order
    rows, columns = linear_sum_assignment(costs)
    paired = distances[rows, columns] < cutoff
    n_paired = int(np.count_nonzero(paired))
    half = cutoff**order / 2
    localisation = float(costs[rows, columns][paired].sum())
    missed, false = half * (n - n_paired), half * (m - n_paired)
    return Gospa(float((localisation + missed + false) ** (1 / order)), localisation, missed, false)
