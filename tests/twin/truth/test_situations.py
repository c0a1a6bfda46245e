"""What counts as a situation, on scans and frames made by hand."""

from __future__ import annotations

from math import nan

import numpy as np
import pytest
from interactions import interactions_of

from twin.recording.tables import truth_table
from twin.truth.frames import PersonTruth, Situation, TruthFrame
from twin.truth.pairs import pairs_within
from twin.truth.situations import Held, OpenSituations, joined_pairs

STEP = np.deg2rad(0.5)


def joined(ranges: list[float], ids: list[int]) -> set[tuple[int, int]]:
    return joined_pairs(np.array(ranges, dtype=np.float32), np.array(ids, dtype=np.int16), STEP)


def test_people_side_by_side_without_a_jump_are_joined():
    assert joined([2.0, 2.0, 2.0, 2.0], [3, 3, 1, 1]) == {(1, 3)}


def test_a_jump_in_range_parts_them():
    # 0.15 m and twice the spacing of the beams, 2 × 2.0 m × 0.5° = 0.035 m: 0.185 m in all
    assert joined([2.0, 2.0, 2.18, 2.18], [1, 1, 2, 2]) == {(1, 2)}
    assert joined([2.0, 2.0, 2.19, 2.19], [1, 1, 2, 2]) == set()


def test_one_beam_may_look_past_between_them():
    assert joined([2.0, 2.0, 5.0, 2.0], [1, 1, 0, 2]) == {(1, 2)}
    assert joined([2.0, 2.0, 5.0, 5.0, 2.0], [1, 1, 0, 0, 2]) == set()


def test_three_in_one_cluster_are_three_pairs():
    assert joined([2.0, 2.0, 2.0], [1, 2, 3]) == {(1, 2), (1, 3), (2, 3)}


def test_beams_without_a_range_join_nobody():
    assert joined([2.0, nan, 2.0], [1, 1, 1]) == set()
    assert joined([nan, nan], [1, 2]) == set()
    assert joined([], []) == set()


def test_a_situation_lasts_from_its_first_frame_to_the_first_without_it():
    open_ = OpenSituations()
    assert open_.update("merged", "waist", 10, {(1, 2): Held("hidden", 0.8)}) == []
    assert open_.update("merged", "waist", 20, {(1, 2): Held("joined", 0.5)}) == []
    assert open_.update("merged", "knee", 20, {(1, 2): Held("joined", 0.5)}) == []
    (ended,) = open_.update("merged", "waist", 30, {})
    assert ended == Situation("merged", 1, 2, "waist", 10, 30, complete=True, how="both", least_m=0.5)
    assert open_.update("merged", "waist", 40, {(1, 2): Held("hidden", 0.9)}) == []
    assert open_.finish(50) == [
        Situation("merged", 1, 2, "knee", 20, 50, complete=False, how="joined", least_m=0.5),
        Situation("merged", 1, 2, "waist", 40, 50, complete=False, how="hidden", least_m=0.9),
    ]
    assert open_.finish(60) == []


def test_pairs_within_a_distance():
    place = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.6]])
    found = pairs_within(np.array([7, 2, 5]), place, 1.5)
    assert found == {(2, 7): 1.0}
    assert pairs_within(np.array([7]), place[:1], 1.5) == {}


def test_interactions_of_a_truth_table():
    def frame(stamp_ns: int, *xs: float) -> TruthFrame:
        return TruthFrame(stamp_ns, tuple(PersonTruth(number, x, 0.0) for number, x in enumerate(xs, start=1)))

    table = truth_table([frame(0, 0, 2), frame(1, 0, 1.4), frame(2, 0, 1.3), frame(3), frame(4, 0, 1), frame(5, 0, 1)])
    first, second = interactions_of(table)
    assert (first.start_ns, first.end_ns, first.complete) == (1, 3, True)
    assert first.least_m == pytest.approx(1.3)
    assert (second.start_ns, second.end_ns, second.complete) == (4, 5, False)
    assert interactions_of(truth_table([])) == []
