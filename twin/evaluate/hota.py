"""HOTA: detection and association in one score, averaged over localisation thresholds.

Luiten et al., "HOTA: a higher order metric for evaluating multi-object tracking", 2021, in the convention of TrackEval.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trackers.scipy_functions import linear_sum_assignment
from twin.evaluate.clear import PairMatrix

THRESHOLDS = np.arange(1, 20) * 0.05  # similarity, 0.05 to 0.95
_EPS = float(np.finfo(np.float64).eps)


@dataclass(frozen=True, eq=False)
class HotaScores:
    """HOTA of one run, or of several added together; one element per threshold (19,)."""

    true_positives: NDArray[np.float64]
    misses: NDArray[np.float64]
    false_positives: NDArray[np.float64]
    association_sum: NDArray[np.float64]  # AssA, AssRe, AssPr times true positives
    association_recall_sum: NDArray[np.float64]
    association_precision_sum: NDArray[np.float64]
    similarity_sum: NDArray[np.float64]  # of all true positives

    def __add__(self, other: HotaScores) -> HotaScores:
        return HotaScores(*(getattr(self, name) + getattr(other, name) for name in self.__dataclass_fields__))

    @property
    def applies(self) -> bool:
        """False without any person and any track."""
        return bool((self.true_positives + self.misses + self.false_positives).any())

    @property
    def det_a(self) -> NDArray[np.float64]:
        """Detection accuracy."""
        return self.true_positives / np.maximum(1, self.true_positives + self.misses + self.false_positives)

    @property
    def ass_a(self) -> NDArray[np.float64]:
        """Association accuracy; 0 without true positives."""
        return self.association_sum / np.maximum(1, self.true_positives)

    @property
    def ass_re(self) -> NDArray[np.float64]:
        """Association recall."""
        return self.association_recall_sum / np.maximum(1, self.true_positives)

    @property
    def ass_pr(self) -> NDArray[np.float64]:
        """Association precision."""
        return self.association_precision_sum / np.maximum(1, self.true_positives)

    @property
    def loc_a(self) -> NDArray[np.float64]:
        """Mean similarity of the true positives; 1 without any."""
        return np.where(self.true_positives > 0, self.similarity_sum / np.maximum(1, self.true_positives), 1.0)

    @property
    def hota(self) -> NDArray[np.float64]:
        """√(DetA · AssA)."""
        return np.sqrt(self.det_a * self.ass_a)


def hota(frames: Sequence[PairMatrix]) -> HotaScores:
    """Compute HOTA of one run; the values of a frame are similarities from 0 to 1."""
    persons, person_counts = _count([frame.person_ids for frame in frames])
    tracks, track_counts = _count([frame.track_ids for frame in frames])
    indices = [(np.searchsorted(persons, f.person_ids), np.searchsorted(tracks, f.track_ids)) for f in frames]
    either = person_counts[:, None] + track_counts  # (n_person, n_track)
    overlap = np.zeros(either.shape)
    for frame, (rows, columns) in zip(frames, indices, strict=True):
        overlap[rows[:, None], columns] += _shared_similarity(frame.values)
    alignment = overlap / (either - overlap)

    # One assignment per frame serves all thresholds: it favours pairs that are together over the whole run.
    pairs, similarities = [np.zeros(0, dtype=np.intp)], [np.zeros(0)]
    for frame, (rows, columns) in zip(frames, indices, strict=True):
        chosen_rows, chosen_columns = linear_sum_assignment(
            alignment[rows[:, None], columns] * frame.values, maximize=True
        )
        pairs.append(rows[chosen_rows] * tracks.size + columns[chosen_columns])
        similarities.append(frame.values[chosen_rows, chosen_columns])
    pair, similarity = np.concatenate(pairs), np.concatenate(similarities)

    sums = np.zeros((4, THRESHOLDS.size))
    matched = [similarity >= threshold - _EPS for threshold in THRESHOLDS]
    for number, hit in enumerate(matched):  # one at a time: a matrix of all ids is large
        together = np.bincount(pair[hit], minlength=either.size).reshape(either.shape)
        denominators = (either - together, person_counts[:, None], track_counts)
        sums[0, number] = together.sum()
        sums[1:, number] = [(together * together / np.maximum(1, each)).sum() for each in denominators]
    true_positives, association, recall, precision = sums

    return HotaScores(
        true_positives=true_positives,
        misses=person_counts.sum() - true_positives,
        false_positives=track_counts.sum() - true_positives,
        association_sum=association,
        association_recall_sum=recall,
        association_precision_sum=precision,
        similarity_sum=np.array([similarity[hit].sum() for hit in matched]),
    )


def hota_cap(similarities: NDArray[np.float64], person_ids: NDArray[np.int64]) -> float | None:
    """Compute the HOTA of perfect detection and identities with the similarities of k matches, each of a person (k,).

    None without any. A pair below a threshold is a miss and a false positive, of the right person each time: with the share
    p of pairs at or above it DetA is p / (2 - p), and so is A of each person with their own share.
    """
    if not similarities.size:
        return None
    hit = similarities[:, None] >= THRESHOLDS - _EPS
    _, of_person, n_pair = np.unique(person_ids, return_inverse=True, return_counts=True)
    n_hit = np.zeros((n_pair.size, THRESHOLDS.size))
    np.add.at(n_hit, of_person, hit)
    share, of_each = hit.mean(axis=0), n_hit / n_pair[:, None]
    det_a = share / (2 - share)
    ass_a = (n_hit * of_each / (2 - of_each)).sum(axis=0) / np.maximum(n_hit.sum(axis=0), 1)
    return float(np.sqrt(det_a * ass_a).mean())


def _count(ids: list[NDArray[np.int64]]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    unique, counts = np.unique(np.concatenate(ids) if ids else np.zeros(0, dtype=np.int64), return_counts=True)
    return unique, counts.astype(np.float64)


def _shared_similarity(similarity: NDArray[np.float64]) -> NDArray[np.float64]:
    """Compute each pair's similarity as a share of the sum over its person and its track in this frame, (n, m)."""
    total = similarity.sum(axis=0) + similarity.sum(axis=1)[:, None] - similarity
    return np.divide(similarity, total, out=np.zeros(similarity.shape), where=total > _EPS)
