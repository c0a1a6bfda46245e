"""The table of means for a README."""

from __future__ import annotations

from twin.suites.results import Group, GroupKey, Results
from twin.suites.tables import markdown_table


def group(*seeds: dict[str, float | None], variant: str = "") -> Group:
    return Group(variant, dict(enumerate(seeds)))


def test_a_row_a_tracker_with_means_over_seeds_and_the_best_of_each_scenario_in_bold() -> None:
    groups = {
        GroupKey("lab", "[]", "ours"): group(
            {"mota": 0.9, "lost_tracks": 1, "hota": None, "judged.person_frames": 60, "judged.share": 0.97},
            {"mota": 0.8, "lost_tracks": 0, "judged.person_frames": 80, "judged.share": 1.0},
        ),
        GroupKey("lab", "[]", "sort"): group({"mota": 0.6, "lost_tracks": 3}, {"mota": 0.8, "lost_tracks": 4}),
        GroupKey("hall", "[]", "ours"): group({"mota": -0.25, "lost_tracks": 2}),
        GroupKey("hall", "[]", "sort"): group({"mota": 0.5, "lost_tracks": 2}),
    }
    assert markdown_table(Results("made-up", {}, (), groups)).splitlines() == [
        "| scenario | tracker | seeds | person-frames | MOTA | IDF1 | HOTA | Identity switches | Misidentified | Lost |",
        "| --- | --- | --: | --: | --: | --: | --: | --: | --: | --: |",
        "| lab | `ours` | 2 | 140 (97.0% of the frames or more) | **0.850** | – | – | – | – | **0.5** |",
        "|  | `sort` | 2 | – | 0.700 | – | – | – | – | 3.5 |",
        "| hall | `ours` | 1 | – | −0.250 | – | – | – | – | 2.0 |",
        "|  | `sort` | 1 | – | **0.500** | – | – | – | – | 2.0 |",
    ]


def test_a_scenario_s_variants_are_compared_each_by_itself() -> None:
    groups = {
        GroupKey("lab", '["duration_s=3"]', "ours"): group({"idf1": 0.9}, variant="duration_s=3"),
        GroupKey("lab", '["duration_s=9"]', "ours"): group({"idf1": 0.8}, variant="duration_s=9"),
    }
    _, _, *rows = markdown_table(Results("made-up", {}, (), groups)).splitlines()
    assert rows == [
        "| lab (duration_s=3) | `ours` | 1 | – | – | 0.900 | – | – | – | – |",
        "| lab (duration_s=9) | `ours` | 1 | – | – | 0.800 | – | – | – | – |",
    ]
