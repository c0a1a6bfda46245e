"""Rules of the system of Song and others as a table: the fused system, its laser half, and the vision-only baseline.

`PAPER_RULES` follows the paper literally; its options are the preset `laser-vision-learning-paper`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from trackers.paper_rules import PaperRule, options_of

LASER_RULES: tuple[PaperRule, ...] = (
    PaperRule(
        "situations",
        "stated",
        "VI",
        "training below 1.5 m, challenging below 0.3 m, taken as the gap between bodies",
        {"situations": {"interacting_m": 1.5, "correlated_m": 0.3}},
    ),
    PaperRule(
        "independent trackers",
        "stated",
        "IV.A",
        "a particle filter per person; a two-feet walking model proposes, laser points near the predicted feet weigh (the "
        "constants are those of its reference 2, not given here: as ours)",
    ),
    PaperRule(
        "a point near two persons",
        "unstated",
        "–",
        "measures both, by its distance from either: no word of who is surer",
        {"points": {"own_m": 0.0}},
    ),
    PaperRule(
        "missing persons",
        "unstated",
        "–",
        "one time for all, in sight or behind others, and no re-identification over a distance that grows",
        {"track_management": {"coast_hidden_s": 1.0, "reid_speed_m_s": None}},
    ),
    PaperRule(
        "two persons in one place",
        "unstated",
        "–",
        "independent trackers: nothing keeps two filters off one person",
        {"walking": {"apart_m": 0.0}},
    ),
    PaperRule("particles", "empirical", "–", "500 a person, as ours", {"particles": 500}),
)
"""Rules of the laser half, also the baseline `laser-vision-learning-paper-laser`."""

PAPER_RULES: tuple[PaperRule, ...] = (
    *LASER_RULES,
    PaperRule(
        "samples",
        "stated",
        "IV.A, IV.B",
        "random patches by RGB and edge orientations; negative ones of possibly confused targets alone: neither the height on "
        "the body nor patches of the room",
        {"looks": {"kinds": ("rgb", "edges"), "height": False, "background": 0}},
    ),
    PaperRule(
        "learning",
        "stated",
        "figure 7",
        "M trees in the first frame, K of them kept in each new one, for every target that may interact: no budget",
        {"looks": {"by": "classifier", "boosting": {"first_a_frame": None}, "classifiers_a_frame": 100}},
    ),
    PaperRule(
        "correlated targets",
        "stated",
        "V.A, eq. 1",
        "score maps draw the particles of all correlated targets, whether a scanner shows them or not. 0.60 of identities are "
        "right after merges, and 0.67 without the maps (`library-hall-groups`, seeds 1100–1102 and 1104, 112 merges)",
        {"recognition": {"drawn": "all"}},
    ),
    PaperRule(
        "split",
        "stated",
        "V.B",
        "the classifiers identify the targets of a split together, however narrow their verdict; no target is another without "
        "a merge, and a new target is nobody who was there before",
        {"identities": {"margin": 0.0, "jointly": True}, "recognition": {"remember_s": 0.0}},
    ),
    PaperRule(
        "merge",
        "stated",
        "V.B",
        "merged targets are one target, which has one place for all its members; `identity_after` judges the split, one "
        "second after it. So classifiers alone say who is who: 0.67 are right without score maps, and 0.82 by the laser half, "
        "which follows each member through the merge (the same 112 merges)",
        {"situations": {"merged": "one"}},
    ),
    PaperRule(
        "place of a merged target",
        "unstated",
        "–",
        "particles moved by the walking model and weighed by the middle of the group's cluster of points; a split gives each "
        "cluster one member, the widest the remaining ones",
    ),
    PaperRule(
        "members who come up elsewhere",
        "unstated",
        "–",
        "a new target is a split where a member of a merged one may be: within 1.5 m of it, and 1 m further for each second of "
        "the merge. Otherwise a person hidden as a group parted is two people ever after, one of them in the group: 45 "
        "targets of 13 people after 58 s (`library-hall-groups` when it had thirteen people, seed 1000)",
    ),
    PaperRule(
        "persons whom no scanner shows",
        "stated",
        "V",
        "images serve learned classifiers alone: no detector of people measures anybody",
        {"pictures": {"detections": False}},
    ),
    PaperRule("β of negative scores", "unstated", "eq. 1", "0: a patch of another is no evidence against a place"),
    PaperRule(
        "levels",
        "unstated",
        "V.A",
        "three of re-weighting and re-sampling a picture",
        {"looks": {"maps": {"levels": 3}}},
    ),
    PaperRule(
        "pictures of a split",
        "unstated",
        "V.B, figure 9",
        "the first picture that shows the targets apart again decides. By one, two and three pictures 0.69, 0.70 and 0.65 of "
        "identities are right after merges (`library-hall-groups`, seeds 1000–1005, when its merges took half a second)",
        {"identities": {"pictures": 1}},
    ),
    PaperRule(
        "classifiers",
        "empirical",
        "IV.B",
        "M 100, K 99: where a frame replaces many trees, few are left that know others than its people. Accuracy in "
        "groups is 0.82 with M 30, K 29 and 0.87 with M 100, K 99 (`library-hall-groups`, seeds 1000–1005, when its merges took "
        "half a second). 40 patches of 0.2 m, "
        "chosen on seed 1003 from 20 to 80 of 0.12 to 0.3 m (the table of choices of `twin reproduce laser-vision-learning`)",
        {"looks": {"boosting": {"trees": 100, "kept": 99}, "patch_count": 40, "patch_m": 0.2}},
    ),
    PaperRule("σ of a score map", "empirical", "eq. 1", "one side of a patch", {"looks": {"maps": {"deviation": 1.0}}}),
)
"""The rules of the fused system."""

VISION_RULES: tuple[PaperRule, ...] = (
    PaperRule(
        "PD-PF",
        "unstated",
        "VI, reference 18",
        "cited, not described: particles drawn to a person detector's detections, as ours; colours weigh but never forbid",
        {"association": {"foreign_above": 1.0}},
    ),
)
"""The rules of the baseline by one camera."""

PAPER: Mapping[str, Any] = options_of(PAPER_RULES)
PAPER_LASER: Mapping[str, Any] = {"camera": False, **options_of(LASER_RULES)}
PAPER_VISION: Mapping[str, Any] = options_of(VISION_RULES)
