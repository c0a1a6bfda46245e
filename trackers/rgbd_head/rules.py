"""The paper's own value of every rule of `rgbd-head`, and the options of its ablations."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

PAPER: Mapping[str, Any] = {
    "heads": 512,
    "weights": {
        "colour": {"by_person": False, "directions": False},
        "depth": {"by_range": False},
        "silhouette": {"power": 0.0},
        "shadows": "everywhere",
        "gain_from": 0.0,
    },
    "environment": {"radius_m": 0.0},
    "leave_out": False,
    "motion": {"walking": 0.0, "turned": 0.0, "layers": 1},
}
"""The options of `rgbd-head-paper`. What the paper does not give (a, b, the motion model) is as in ours; the start is known
where `start` says it, and found as ours is where it does not."""

COLOUR: Mapping[str, Any] = {**PAPER, "weights": {**PAPER["weights"], "depth": {"by_range": False, "used": False}}}
DEPTH: Mapping[str, Any] = {
    **PAPER,
    "weights": {**PAPER["weights"], "colour": {"by_person": False, "directions": False, "used": False}},
}
NO_ENVIRONMENT: Mapping[str, Any] = {**PAPER, "environment": {**PAPER["environment"], "used": False}}
"""The paper's two cues alone (its section 4.3), and both without the environment (4.4)."""
