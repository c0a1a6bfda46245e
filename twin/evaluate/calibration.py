"""Calibration of stated radii: how often a person is within the radius that a tracker states for 95 %.

A track's person is its match (CLEAR correspondence). Remaining tracks get the nearest remaining people by optimal assignment
without a gate, so that a person beyond the gate but within a wide radius counts as within it; a track without a remaining
person has it nowhere. For other probabilities the radius is that of a circular normal distribution, whose distance from the
centre has the distribution function F(d) = 1 − exp(−d² / 2σ²): r(p) = r₉₅ √(ln(1 − p) / ln 0.05). A tracker is calibrated if
the share found within r(p) is p (A. P. Dawid, "The well-calibrated Bayesian", J. American Statistical Association 77, 1982).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.evaluate.clear import FrameMatches, assign
from twin.evaluate.judged_frames import Frame

CLAIMED_PERCENT = (10, 20, 30, 40, 50, 60, 70, 80, 90, 95, 99)
"""Probabilities of a calibration curve."""
WITHIN = "within_radius"


def within_radius(judged: Sequence[Frame], matches: Sequence[FrameMatches]) -> dict[str, Any] | None:
    """Compute `within_radius` of `metrics.json`: by probability, in per cent, the share found, and `n` tracks in all frames.

    None where no track states a radius. `judged`, `matches`: frames inside the area and their correspondence.
    """
    share = claimed_at_person(judged, matches)
    if share.size == 0:
        return None
    return {"n": int(share.size)} | {str(each): float((share <= each / 100).mean()) for each in CLAIMED_PERCENT}


def claimed_at_person(judged: Sequence[Frame], matches: Sequence[FrameMatches]) -> NDArray[np.float64]:
    """Compute the probability of the circle through its person under each of n stated radii; 1 without a person.

    Uniform from 0 to 1 for a calibrated tracker.
    """
    distance, radius = [np.empty(0)], [np.empty(0)]
    for frame, pairs in zip(judged, matches, strict=True):
        states = ~np.isnan(frame.radius95_m)
        if not states.any():
            continue
        gap = np.full(frame.track_ids.size, np.inf)
        gap[pairs.columns] = pairs.distances
        left = np.ones((frame.person_ids.size, frame.track_ids.size), np.bool_)
        left[pairs.rows] = left[:, pairs.columns] = False
        rows, columns = assign(frame.distances_m, left)
        gap[columns] = frame.distances_m[rows, columns]
        distance.append(gap[states])
        radius.append(frame.radius95_m[states])
    return 1 - 0.05 ** np.square(np.concatenate(distance) / np.concatenate(radius))


def calibration_curve(metrics: Mapping[str, Any]) -> list[tuple[float, float]]:
    """Return the stated and found shares of a tracker's metrics, flattened or not; empty without radii."""
    nested = metrics.get(WITHIN) or {}
    found = [(each, metrics.get(f"{WITHIN}.{each}", nested.get(str(each)))) for each in CLAIMED_PERCENT]
    return [(each / 100, share) for each, share in found if share is not None]
