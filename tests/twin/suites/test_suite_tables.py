"""The table of means for a README."""

from __future__ import annotations

import sqlite3
from pathlib import Path

import pytest

from trackers.errors import InputError
from twin.suites.comparison import SuiteOutcome
from twin.suites.metrics import pooled_shares
from twin.suites.result_tables import markdown_table, markdown_verdict
from twin.suites.results import Group, GroupKey, RequirementCheck, Results, pooled
from twin.suites.store import ResultStore


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


@pytest.mark.parametrize("has_truth", [False, True])
def test_bags_without_truth_have_columns_of_tracks_of_which_none_is_best(has_truth: bool) -> None:
    bare = GroupKey("bare", "[]", "ours"), GroupKey("bare", "[]", "sort")
    groups = {key: group({"track_count": 4 + n, "tracks_per_frame": 2.5 + n}) for n, key in enumerate(bare)}
    if has_truth:
        groups[GroupKey("lab", "[]", "ours")] = group({"mota": 0.9, "track_count": 3, "tracks_per_frame": 1.0})
    heads, _, *rows = markdown_table(Results("made-up", {}, (), groups)).splitlines()
    assert heads.endswith("| Tracks | Tracks per frame |") and ("MOTA" in heads) == has_truth
    assert [row.split(" | ")[-2:] for row in rows[:2]] == [["4.0", "2.50 |"], ["5.0", "3.50 |"]]


def test_the_verdict_comes_in_one_line_with_what_is_not_met_below() -> None:
    key = GroupKey("lab", "[]", "ours")
    results = Results("made-up", {}, (), {key: group({"mota": 0.9}, {"mota": 0.8})})
    met, broken = (RequirementCheck(key, "", "mota", bound, 0.85) for bound in (">= 0.8", ">= 0.9"))

    def verdict(*requirements: RequirementCheck) -> str:
        store = ResultStore(sqlite3.connect(":memory:"), Path())
        return markdown_verdict(SuiteOutcome(Path(), store, results, None, None, requirements))

    assert verdict() == "made-up: passed without a baseline: 2 cases done, 0 failed."
    assert verdict(met) == "made-up: passed without a baseline: 1 of 1 requirements met."
    assert verdict(met, broken).splitlines() == [
        "made-up: **FAILED** without a baseline: 1 of 2 requirements met.",
        "- not met: lab, `ours`: MOTA is 0.850, required >= 0.9",
    ]


def test_shares_are_of_all_cases_frames_together_and_the_unseen_are_no_errors() -> None:
    small = {"judged.person_frames": 100, "judged.matches": 80, "errors.missed.unseen": 20, "id_switches": 0}
    large = {
        **{"judged.person_frames": 300, "judged.matches": 290, "errors.missed.start_up": 4, "errors.missed.seen": 6},
        **{"false_positives": 10, "errors.false_positive.ghost": 4, "errors.false_positive.ghost_unseen": 3},
        **{"id_switches": 1, "within_radius.n": 50, "within_radius.95": 0.96, "within_radius.50": 0.5},
    }
    shares = pooled_shares([small, large])
    assert shares["ghosts"] == pytest.approx(7 / 380)
    assert shares["MOTA of the seen"] == pytest.approx(1 - (6 + 4 + 7 + 1) / 380)
    assert shares["after start-up"] == pytest.approx(1 - (6 + 7 + 1) / 376)
    assert shares["within 95 % radius"] == pytest.approx(0.96)
    assert pooled_shares([small])["within 95 % radius"] is None


def test_runs_of_other_seeds_are_pooled_and_a_case_in_two_of_them_is_refused() -> None:
    key = GroupKey("lab", "[]", "ours")
    first, second = (Results("made-up", {}, (), {key: Group("", {seed: {"mota": 0.9}})}) for seed in (1, 2))
    assert pooled([("a", first), ("b", second)]).groups[key].seeds == {1: {"mota": 0.9}, 2: {"mota": 0.9}}
    with pytest.raises(InputError, match="b: lab, seed 1, ours is in another folder too"):
        pooled([("a", first), ("b", first)])
