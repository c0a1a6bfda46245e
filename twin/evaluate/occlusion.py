"""Who is hidden from every scanner, and for how long: what no tracker can bridge that coasts for less."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trackers.observations import NS_PER_S
from twin.recording.tables import TruthTable


@dataclass(frozen=True)
class Occlusion:
    """Somebody in the area whom no ray of the sensors reaches, from the first such moment to the last [s]."""

    person_id: int
    start_s: float
    end_s: float

    @property
    def duration_s(self) -> float:
        """How long it lasts [s]."""
        return self.end_s - self.start_s


def long_occlusions(truth: TruthTable, sensors: Sequence[str], longer_than_s: float) -> tuple[Occlusion, ...]:
    """The occlusions from all of these sensors at once that last longer than this, by start, then person.

    Hidden: the share of the body that `visible_<sensor>` gives is 0 for every one of them. Moments at which a person is
    outside the area, or not there, end an occlusion. Raises KeyError for a sensor that the truth says nothing of.
    """
    hidden = truth.in_area.copy()
    for sensor in sensors:
        hidden &= truth.visible[sensor] == 0
    frame = np.searchsorted(truth.frame_stamps_ns, truth.stamps_ns)
    found = []
    for person in np.unique(truth.id).tolist():
        frames = frame[hidden & (truth.id == person)]
        for run in np.split(frames, np.flatnonzero(np.diff(frames) > 1) + 1):
            if run.size:
                start_s, end_s = (truth.frame_stamps_ns[run[[0, -1]]] / NS_PER_S).tolist()
                if end_s - start_s > longer_than_s:
                    found.append(Occlusion(person, start_s, end_s))
    return tuple(sorted(found, key=lambda each: (each.start_s, each.person_id)))
