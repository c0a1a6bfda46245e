"""Disposal of what makes tracking hard (Song et al., table I): it came up, and no failure was there.

Correlated: counted per pair and frame, disposed of where both people are right in that frame. Merge/split: counted per merge
for the rig whose end, and the second after it, the run has seen; disposed of where both people are right from its start to
1 s after its end. Right: see `twin.evaluate.accuracy`. Frames in which one of the two is outside the tracked area are not
counted; a merge counts where both are inside in at least one of its frames.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from trackers.observations import NS_PER_S
from twin.evaluate.accuracy import PersonFrames
from twin.recording.situation_table import SituationTable

AFTER_S = 1.0


def disposal(people: PersonFrames, stamps_ns: NDArray[np.int64], situations: SituationTable) -> dict[str, Any]:
    """`disposal` of `metrics.json`: of each kind how many there were, and which share was disposed of (None: of none).

    stamps_ns (f,): of the judged frames, in order.
    """
    correlated = situations.select("correlated")
    both, right = _of_pairs(people, correlated)
    holding = correlated.frames(stamps_ns) & both
    merged = situations.select("merged_rig")
    both, right_too = _of_pairs(people, merged)
    during, until_after = merged.frames(stamps_ns) & both, merged.frames(stamps_ns, AFTER_S) & both
    last_ns = stamps_ns[-1] if stamps_ns.size else 0
    seen = merged.complete & (merged.end_ns + round(AFTER_S * NS_PER_S) <= last_ns) & during.any(axis=1)
    return {
        "correlated": _share(holding.sum(), (holding & right).sum()),
        "merge_split": _share(seen.sum(), (seen & ~(until_after & ~right_too).any(axis=1)).sum()),
    }


def _of_pairs(people: PersonFrames, situations: SituationTable) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """For each situation and judged frame, (n, f): whether both people are judged, and whether both are right."""
    known = np.isin(situations.first_id, people.person_ids) & np.isin(situations.second_id, people.person_ids)
    judged, right = (np.zeros((len(situations), people.judged.shape[1]), dtype=np.bool_) for _ in range(2))
    first, second = (
        np.searchsorted(people.person_ids, ids[known]) for ids in (situations.first_id, situations.second_id)
    )
    judged[known] = people.judged[first] & people.judged[second]
    right[known] = people.right[first] & people.right[second]
    return judged, right


def _share(total: np.integer, disposed: np.integer) -> dict[str, Any]:
    return {"total": int(total), "disposed": int(disposed), "share": float(disposed / total) if total else None}
