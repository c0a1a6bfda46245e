"""What is ours and not the paper's in `laser-fisheye-imm`, rule by rule, and the options that switch each off.

`PAPER` switches all of them off: the preset `laser-fisheye-imm-paper`. The suite `ablation` switches off one at a time.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from trackers.deep_merge import deep_merge

RULES: Mapping[str, Mapping[str, Any]] = {
    "body-depth": {"waist": {"half_depth_m": 0.0, "side_half_depth_m": None}, "knee": {"half_depth_m": 0.0}},
    "completed-clusters": {
        "waist": {"body_width_m": None, "hidden_variance_m2": 0.0},
        "knee": {"hidden_variance_m2": 0.0},
    },
    "arms": {"waist": {"satellite_width_m": None}},
    "leg-pairs": {"knee": {"pair_m": 0.0}},
    "measured-noise": {"measurement_variance_m2": 0.01, "knee": {"legs_variance_m2": 0.0}},
    "motions": {"motions": None},
    "likelihood-ratio": {"new_density_m2": None, "colour_weight": 10.0, "even_at": 0.0, "wrong_look": 0.0},
    "lone-legs": {"lone_leg_density_m2": 1e-3},
    "heavy-tails": {"degrees_of_freedom": None},
    "single-legs": {"knee": {"single_leg_variance_m2": 0.0}},
    "weak-legs": {"knee": {"weak_samples": None}},
    "knees-alone": {"knee": {"radius_alone_m": 0.5, "single_leg_s": 0.1}},
    "half-seen": {"knee": {"half_seen_m2": 0.0}},
    "shared-legs": {"knee": {"shared": False}},
    "negative-evidence": {"waist": {"free_space": {"detected": 0.0}}, "knee": {"free_space": {"detected": 0.0}}},
    "detection-by-beams": {"knee": {"free_space": {"width_m": None}}},
    "clear-looks": {"torso": {"learn_width_m": 0.0, "max_overlap": 1.0}},
    "deviation-gate": {"max_deviations": None},
    "re-identification": {"track_management": {"reid_speed_m_s": None}},
    "no-start-by-a-leg": {"start_by_single_legs": True},
    "early-confirmation": {"track_management": {"confirm_s": 0.5}},
    "moved-confirmation": {"track_management": {"confirm_moved_m": 0.0}},
    "existence": {"track_management": {"survival_s": None}},
    "stated-radius": {"track_management": {"within_m": None}},
    "postures": {"posture": {"seated_m": None}},
    "bodies-apart": {"track_management": {"apart_m": 0.0}},
    "body-spacing": {"track_management": {"start_apart_m": 0.0}},
}
"""Rule → the options without it."""


def without(*rules: str) -> dict[str, Any]:
    """The options that switch off these rules. Raises KeyError for a rule that there is not."""
    options: dict[str, Any] = {}
    for rule in rules:
        options = deep_merge(options, RULES[rule])
    return options


PAPER: Mapping[str, Any] = without(*RULES)
"""The options of `laser-fisheye-imm-paper`."""
