"""The paper's own value of every rule of `camera-floor-particle`, and the options of its ablations."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

_CHECKS = {"unseen": "drop", "no_foreground": "drop"}

PAPER: Mapping[str, Any] = {
    "body": {
        **_CHECKS,
        "no_load": "drop",
        "floor_smoothing_m": 0.0,
        "under_head_m": 0.0,
        "motion": {"memory": 0.0},
        "window": {"width_px": 30, "height_px": 90, "size_m": None, "pixels": "all"},
    },
    "head": {
        **_CHECKS,
        "motion": {"memory": 0.0},
        "window": {"width_px": 20, "height_px": 20, "size_m": None, "pixels": "all"},
        "pan": "particles",
        "skin": 0.0,
        "parts": (1, 1),
        "references": "nearest",
        "crown_m": 0.0,
        "learning": 0.0,
        "walking": 0.0,
    },
    "exclusion": {"likelier_stays": False},
    "room_margin_m": 0.0,
    "shadows": "everywhere",
    "gain_from": 0.0,
}
"""The options of `camera-floor-particle-paper`. What the paper does not give (λ, α, ω, how people start) is as in ours."""

FLOOR_ONLY: Mapping[str, Any] = {"use_cameras": False}
COLOUR_ONLY: Mapping[str, Any] = {"use_floor": False}
NO_EXCLUSION: Mapping[str, Any] = {"exclusion": {"side_m": 0.0}}
NO_MIXTURE: Mapping[str, Any] = {"head": {"share": 0.0}}
