"""Whether the light has changed, so that nobody's clothes look as they are remembered."""

from __future__ import annotations

import numpy as np

from trackers.filters.gating import distances
from trackers.laser_fisheye_imm.detection import Seen
from trackers.laser_fisheye_imm.people import People

_FEWEST = 2
"""Of one alone it cannot be told whether they or the light are others."""


def light_changed(people: People, seen: Seen, near_m: float, unlike: float) -> bool:
    """Whether most of those in sight look unlike themselves, by more than `unlike` (E).

    people: predicted to this moment; near_m: how near the prediction of somebody measured last a trunk is surely theirs [m].
    """
    measured_ns = people.roster.measured_ns
    in_sight = ((measured_ns == measured_ns.max(initial=0)) & people.clothes.known & people.confirmed).nonzero()[0]
    E = people.clothes.select(in_sight).distance(seen.histograms, seen.comparable)
    if E is None:
        return False
    apart = distances(people.positions[in_sight], seen.trunks.position)
    nearest = apart.argmin(axis=1)
    row = np.arange(in_sight.size)
    own = E[row, nearest][apart[row, nearest] < near_m]
    own = own[~np.isnan(own)]
    return own.size >= _FEWEST and bool(np.count_nonzero(own > unlike) > own.size / 2)
