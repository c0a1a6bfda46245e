"""Rules of the paper's own system, and the options of its ablations.

`PAPER_RULES` follows the paper literally; its options are the preset `rgbd-head-paper`. Development seeds of its empirical
values: 1500 to 1504 of both sequences.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from trackers.paper_rules import PaperRule, options_of
from trackers.user_input.plain_data import deep_merge

PAPER_RULES: tuple[PaperRule, ...] = (
    PaperRule("particles", "stated", "section 4.1", "N = 512", {"heads": 512}),
    PaperRule(
        "selection", "stated", "section 2.3, step 1", "in every frame", {"motion": {"resample_below": 1.0, "layers": 1}}
    ),
    PaperRule(
        "directions", "stated", "section 3.1", "each hypothesis has a direction θ", {"motion": {"directions": False}}
    ),
    PaperRule(
        "colours",
        "stated",
        "eq. 4 and 5",
        "the share of skin pixels",
        {"stereo_head": {"person_colour": None, "skin_share": {}}},
    ),
    PaperRule(
        "distances",
        "stated",
        "eq. 6 and 7",
        "mean absolute d − d̂",
        {"stereo_head": {"depth": None, "depth_in_metres": {"most_m": None}}},
    ),
    PaperRule("cues", "stated", "eq. 9", "two cues of a picture and no third", {"stereo_head": {"silhouette": None}}),
    PaperRule(
        "pixels", "stated", "eq. 4 and 7", "pixels of the picture, wherever", {"stereo_head": {"whole_picture": True}}
    ),
    PaperRule("region A", "stated", "section 3.4", "what objects and walls fill", {"environment": {"radius_m": 0.0}}),
    PaperRule(
        "stamps",
        "stated",
        "section 4.1, steps 3 to 6",
        "pictures of a frame count as simultaneous",
        {"own_stamps": False},
    ),
    PaperRule("cameras", "stated", "section 4.1", "cameras are calibrated, all count", {"leave_out": False}),
    PaperRule(
        "points of a head",
        "unstated",
        "eq. 4 and 7",
        "the sum over Ω by 256 points spread over it, about one per pixel: a head is 200 to 700 pixels",
        {"stereo_head": {"points": 256}},
    ),
    PaperRule(
        "cameras that do not show a hypothesis",
        "unstated",
        "eq. 4 to 7",
        "as they stand, no skin pixels (c = 0) and an empty sum of differences; with factors of 1 instead hypotheses leave for "
        "where fewest cameras see them (3 of 3 lost)",
        {"stereo_head": {"out_of_view": None}},
    ),
    PaperRule(
        "motion",
        "unstated",
        "section 2.3",
        "P(x_t given x_t−1): Gaussian diffusion about the expectation's velocity, as in ours; no rule of walking, no jumps; "
        "along z as much as standing up takes: .08 loses 1 of 2 there, .16 none of 5",
        {"motion": {"walking": 0.0, "turned": 0.0, "up_m": 0.16}},
    ),
    PaperRule(
        "foreground",
        "unstated",
        "–",
        "pictures as they come; the foreground serves initiation alone, where no start is known (the paper knows it)",
        {"front_end": {"shadow_region": "everywhere", "exposure_tolerance": 0.0}},
    ),
    PaperRule(
        "expected share of skin",
        "empirical",
        "eq. 5",
        "ĉ between its largest and smallest by the cosine; heads have .60 and .16 (n = 351), by which torsos without any skin "
        "are preferred: 13 of 15 settings of b lost sequence 1, of .72 and .28 none of 5",
        {"stereo_head": {"skin_share": {"front": 0.72, "behind": 0.28}}},
    ),
    PaperRule(
        "a and b",
        "empirical",
        "eq. 5 and 7",
        "of b 2.6 and 2.0, 3.2 and 3.2, 4.0 and 3.2, 3.2 and 5.0, 4.0 and 5.0, which all follow both sequences, those of least "
        "error in Z and direction in sequence 2",
        {"stereo_head": {"skin_share": {"linear": (1.0, 4.0)}, "depth_in_metres": {"linear": (1.0, 3.2)}}},
    ),
)
"""All rules. Other options are as in ours: the ellipsoid's size, region C's heights, the floor of a weight, diffusion."""

PAPER: Mapping[str, Any] = options_of(PAPER_RULES)
"""Options of `rgbd-head-paper`; starts given by `start` are known, others are initiated as ours."""

COLOUR: Mapping[str, Any] = deep_merge(PAPER, {"stereo_head": {"depth_in_metres": None}})
DEPTH: Mapping[str, Any] = deep_merge(PAPER, {"stereo_head": {"skin_share": None}})
NO_ENVIRONMENT: Mapping[str, Any] = deep_merge(PAPER, {"environment": None})
"""The paper's two cues alone (its section 4.3), and both without the environment (4.4)."""
