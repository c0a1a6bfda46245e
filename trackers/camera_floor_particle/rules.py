"""The paper's own value of every rule of `camera-floor-particle`, and the options of its ablations."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

PAPER: Mapping[str, Any] = {
    "load": {"no_load": "drop", "smoothing_m": 0.0},
    "body": {
        "checks": "drop",
        "under_head_m": 0.0,
        "motion": {"memory": 0.0},
        "window": {"size_px": (30, 90), "size_m": None, "pixels": "all"},
    },
    "head": {
        "checks": "drop",
        "motion": {"memory": 0.0},
        "window": {"size_px": (20, 20), "size_m": None, "pixels": "all"},
        "facing": None,
        "references": "nearest",
        "covered": 0.0,
    },
    "exclusion": {"likelier_stays": False},
    "track_management": {"area_margin_m": 0.0},
    "front_end": {"shadow_region": "everywhere", "exposure_tolerance": 0.0},
}
"""The options of `camera-floor-particle-paper`. What the paper does not give (λ, α, ω, initiation) is as in ours."""

FLOOR_ONLY: Mapping[str, Any] = {"use_cameras": False}
COLOUR_ONLY: Mapping[str, Any] = {"use_floor": False}
NO_EXCLUSION: Mapping[str, Any] = {"exclusion": {"side_m": 0.0}}
NO_MIXTURE: Mapping[str, Any] = {"head": {"share": 0.0}}
