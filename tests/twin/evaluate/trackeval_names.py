"""HOTA's scores under the names that TrackEval gives them, with those that follow from the counts."""

from __future__ import annotations

from typing import Any

import numpy as np

from twin.evaluate.hota import HotaScores


def by_trackevals_names(scores: HotaScores) -> dict[str, Any]:
    """Each score, a value a threshold, by TrackEval's name."""
    return {
        "HOTA": scores.hota,
        "DetA": scores.det_a,
        "AssA": scores.ass_a,
        "DetRe": scores.true_positives / np.maximum(1, scores.true_positives + scores.misses),
        "DetPr": scores.true_positives / np.maximum(1, scores.true_positives + scores.false_positives),
        "AssRe": scores.ass_re,
        "AssPr": scores.ass_pr,
        "LocA": scores.loc_a,
        "HOTA_TP": scores.true_positives,
        "HOTA_FN": scores.misses,
        "HOTA_FP": scores.false_positives,
    }
