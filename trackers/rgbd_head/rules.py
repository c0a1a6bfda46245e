"""The paper's own value of every rule of `rgbd-head`, and the options of its ablations."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

_CUES: Mapping[str, Any] = {
    "person_colour": None,
    "skin_share": {"linear": (1.0, 1.0), "front": 0.7, "behind": 0.05},
    "depth": None,
    "depth_in_metres": {"linear": (1.0, 2.0), "most_m": 0.45},
    "silhouette": None,
}
PAPER: Mapping[str, Any] = {
    "heads": 512,
    "stereo_head": _CUES,
    "front_end": {"shadow_region": "everywhere", "exposure_tolerance": 0.0},
    "environment": {"radius_m": 0.0},
    "leave_out": False,
    "motion": {"directions": False, "walking": 0.0, "turned": 0.0, "layers": 1},
}
"""The options of `rgbd-head-paper`. What the paper does not give (a, b, the motion model) is as in ours; the start is known
where `start` says it, and initiated as ours is where it does not."""

COLOUR: Mapping[str, Any] = {**PAPER, "stereo_head": {**_CUES, "depth_in_metres": None}}
DEPTH: Mapping[str, Any] = {**PAPER, "stereo_head": {**_CUES, "skin_share": None}}
NO_ENVIRONMENT: Mapping[str, Any] = {**PAPER, "environment": None}
"""The paper's two cues alone (its section 4.3), and both without the environment (4.4)."""
