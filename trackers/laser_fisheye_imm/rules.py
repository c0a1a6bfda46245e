"""Rules of `laser-fisheye-imm` that are ours and not the paper's, and the options that switch each off.

`PAPER` switches all of them off: the preset `laser-fisheye-imm-paper`. The suite `ablation` switches off one at a time.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from trackers.plain_data import deep_merge

RULES: Mapping[str, Mapping[str, Any]] = {
    "body-axis": {
        "waist": {"half_depth_m": 0.0, "side_half_depth_m": None, "body_width_m": None, "hidden_variance_m2": 0.0},
        "knee": {"half_depth_m": 0.0, "hidden_variance_m2": 0.0},
    },
    "arms": {"waist": {"arm_width_m": None}},
    "leg-pairs": {"legs": {"pair_m": 0.0}},
    "weak-legs": {"knee": {"weak_samples": None}},
    "knees-alone": {"legs": {"gate_alone_m": 0.5, "single_leg_s": 0.1}},
    "measured-noise": {"trunk": {"variance_m2": 0.01}, "legs": {"variance_m2": 0.01, "single_leg_variance_m2": 0.0}},
    "velocities": {"motion": "headings"},
    "likelihood-ratio": {"clutter_density_m2": None, "appearance": {"weight": 10.0}},
    "negative-information": {"waist": {"p_detect": 0.0}, "knee": {"p_detect": 0.0}},
    "clear-looks": {"appearance": {"learn_width_m": 0.0, "max_overlap": 1.0}},
    "re-identification": {"track_management": {"reid_speed_m_s": None}},
    "confirmation": {"track_management": {"confirm_s": 0.5, "confirm_moved_m": 0.0}},
    "existence": {"track_management": {"survival_s": None, "within_m": None}},
    "postures": {"posture": {"seated_m": None}},
    "bodies-apart": {"track_management": {"apart_m": 0.0, "start_apart_m": 0.0}},
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
