"""Identity scores: for how many positions one fixed pairing of persons and tracks is right.

Ristani et al., "Performance measures and a data set for multi-target, multi-camera tracking", 2016.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from twin.evaluate.clear import PairMatrix


@dataclass(frozen=True)
class IdentityScores:
    """Identity counts of one run, or of several added together."""

    true_positives: int
    misses: int
    false_positives: int

    def __add__(self, other: IdentityScores) -> IdentityScores:
        return IdentityScores(
            self.true_positives + other.true_positives,
            self.misses + other.misses,
            self.false_positives + other.false_positives,
        )

    @property
    def idf1(self) -> float | None:
        """Harmonic mean of identity precision and recall; None where nobody was there and nobody tracked."""
        total = 2 * self.true_positives + self.misses + self.false_positives
        return 2 * self.true_positives / total if total else None

    @property
    def precision(self) -> float | None:
        """Share of reported positions with the right identity (IDP)."""
        reported = self.true_positives + self.false_positives
        return self.true_positives / reported if reported else None

    @property
    def recall(self) -> float | None:
        """Share of true positions with the right identity (IDR)."""
        persons = self.true_positives + self.misses
        return self.true_positives / persons if persons else None


def identity(frames: Sequence[PairMatrix], gate: float) -> IdentityScores:
    """Identity scores of one run; a position counts for a pair where person and track are at most `gate` apart."""
    n_person, n_track = (sum(ids.size for ids in all_ids) for all_ids in _ids(frames))
    persons, tracks = (np.unique(np.concatenate(all_ids)) if all_ids else np.zeros(0) for all_ids in _ids(frames))
    together = np.zeros((persons.size, tracks.size))
    for frame in frames:
        rows, columns = np.nonzero(frame.values <= gate)
        # Ids do not repeat within a frame, so that plain indexing adds each pair.
        together[
            np.searchsorted(persons, frame.person_ids[rows]), np.searchsorted(tracks, frame.track_ids[columns])
        ] += 1
    # Fewest misses and false positives = most positions in pairs; a pair never together adds nothing.
    true_positives = int(together[linear_sum_assignment(together, maximize=True)].sum())
    return IdentityScores(true_positives, n_person - true_positives, n_track - true_positives)


def _ids(frames: Sequence[PairMatrix]) -> tuple[list, list]:
    return [frame.person_ids for frame in frames], [frame.track_ids for frame in frames]
