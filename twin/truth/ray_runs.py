"""Which people the beams of a scan meet, as runs of beams."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from twin.truth.frames import RayRun


def person_runs(person_of_ray: NDArray[np.int16]) -> tuple[RayRun, ...]:
    """Runs of equal ids in (n_beam,) ids by beam, those of the room (0) left out."""
    if person_of_ray.size == 0:
        return ()
    starts = np.flatnonzero(np.diff(person_of_ray, prepend=np.int16(-1)))
    stops = np.append(starts[1:], person_of_ray.size)
    ids = person_of_ray[starts]
    met = ids > 0
    runs = zip(ids[met].tolist(), starts[met].tolist(), (stops[met] - 1).tolist(), strict=True)
    return tuple(RayRun(*run) for run in runs)
