"""HOTA's scores under the names that TrackEval gives them."""

from __future__ import annotations

from typing import Any

from twin.evaluate.hota import NDArray


def by_trackevals_names(scores: NDArray) -> dict[str, Any]:
    """Each score, a value a threshold, by TrackEval's name."""
    return {
        "HOTA": scores.hota,
        "DetA": scores.det_a,
        "AssA": scores.ass_a,
        "DetRe": scores.det_re,
        "DetPr": scores.det_pr,
        "AssRe": scores.ass_re,
        "AssPr": scores.ass_pr,
        "LocA": scores.loc_a,
        "HOTA_TP": scores.true_positives,
        "HOTA_FN": scores.misses,
        "HOTA_FP": scores.false_positives,
    }
