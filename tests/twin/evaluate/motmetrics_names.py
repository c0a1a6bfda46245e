"""CLEAR and identity scores under the names that py-motmetrics gives them, those too that `twin` does not report."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple, dataclass

import numpy as np

from twin.evaluate.clear import ClearScores, IdentityScores, PairMatrix, match_frames

MOSTLY_TRACKED_SHARE = 0.8
MOSTLY_LOST_SHARE = 0.2


@dataclass(frozen=True)
class Histories:
    """Counts over the people of one run, or of several added together, by when they are matched."""

    fragmentations: int  # how often a matched person becomes unmatched and is matched again later
    mostly_tracked: int  # persons matched in at least 80 % of their frames
    partially_tracked: int
    mostly_lost: int  # persons matched in less than 20 % of their frames

    def __add__(self, other: Histories) -> Histories:
        return Histories(*(mine + theirs for mine, theirs in zip(astuple(self), astuple(other), strict=True)))


def histories(frames: Sequence[PairMatrix], gate: float) -> Histories:
    matched: dict[int, list[bool]] = {}
    for frame, pairs in zip(frames, match_frames(frames, gate), strict=True):
        flags = np.isin(np.arange(frame.person_ids.size), pairs.rows)
        for person, flag in zip(frame.person_ids.tolist(), flags.tolist(), strict=True):
            matched.setdefault(person, []).append(flag)
    shares = np.array([np.mean(flags) for flags in matched.values()])
    tracked, lost = np.count_nonzero(shares >= MOSTLY_TRACKED_SHARE), np.count_nonzero(shares < MOSTLY_LOST_SHARE)
    fragmentations = sum(np.count_nonzero(np.diff(np.flatnonzero(flags)) > 1) for flags in matched.values())
    return Histories(int(fragmentations), int(tracked), len(matched) - int(tracked) - int(lost), int(lost))


def by_motmetrics_names(
    scores: ClearScores, followed: Histories, identities: IdentityScores
) -> dict[str, float | None]:
    """Each score of a run with people and tracks, by py-motmetrics's name."""
    right = identities.true_positives
    return {
        "mota": scores.mota,
        "motp": scores.motp,
        "recall": scores.matches / scores.persons,
        "precision": scores.matches / (scores.matches + scores.false_positives),
        "num_false_positives": scores.false_positives,
        "num_misses": scores.misses,
        "num_switches": scores.id_switches,
        "num_fragmentations": followed.fragmentations,
        "mostly_tracked": followed.mostly_tracked,
        "partially_tracked": followed.partially_tracked,
        "mostly_lost": followed.mostly_lost,
        "num_unique_objects": followed.mostly_tracked + followed.partially_tracked + followed.mostly_lost,
        "idf1": identities.idf1,
        "idp": right / (right + identities.false_positives),
        "idr": right / (right + identities.misses),
    }
