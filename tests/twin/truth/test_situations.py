"""What counts as a situation, on scans and frames made by hand."""

from __future__ import annotations

from itertools import combinations
from math import nan

import numpy as np
import pytest
from hypothesis import given, strategies as st
from hypothesis.extra import numpy as hnp
from interactions import interactions_of
from scipy.cluster.hierarchy import fcluster, linkage
from scipy.spatial.distance import pdist

from trackers.area import Pose
from trackers.observations import LaserScan
from twin.recording.tables import truth_table
from twin.truth.situations import (
    LINKAGE_M,
    OpenSituations,
    PairState,
    ScanPoints,
    joined_pairs,
    linked_pairs,
    merged_pairs,
    pairs_within,
    scan_points,
)
from twin.truth.truth_types import PersonTruth, Situation, TruthFrame
from twin.truth.visibility import SensorView

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
    assert open_.update("merged", "waist", 10, {(1, 2): PairState("hidden", 0.8)}) == []
    assert open_.update("merged", "waist", 20, {(1, 2): PairState("joined", 0.5)}) == []
    assert open_.update("merged", "knee", 20, {(1, 2): PairState("joined", 0.5)}) == []
    (ended,) = open_.update("merged", "waist", 30, {})
    assert ended == Situation("merged", 1, 2, "waist", 10, 30, complete=True, how="both", least_m=0.5)
    assert open_.update("merged", "waist", 40, {(1, 2): PairState("hidden", 0.9)}) == []
    assert open_.finish(50) == [
        Situation("merged", 1, 2, "knee", 20, 50, complete=False, how="joined", least_m=0.5),
        Situation("merged", 1, 2, "waist", 40, 50, complete=False, how="hidden", least_m=0.9),
    ]
    assert open_.finish(60) == []


S = 1_000_000_000


def merges(*held_s: tuple[float, float], period_s: float = 0.04, end_s: float = 4.0) -> list[Situation]:
    """The merges for the rig of a pair that is merged in these stretches (from, until) [s], up to a run's end."""
    open_, found = OpenSituations(), []
    for t in np.arange(0.0, end_s, period_s):
        holding = {(1, 2): PairState("joined", 0.7)} if any(a <= t + 1e-9 < b for a, b in held_s) else {}
        found += open_.update("merged_rig", "", round(t * S), holding)
    return found + open_.finish(round(end_s * S))


def times(found: list[Situation]) -> list[tuple[float, float, bool]]:
    return [(each.start_ns / S, each.end_ns / S, each.complete) for each in found]


def test_breaks_of_a_merge_are_closed_and_short_ones_dropped():
    assert times(merges((1.0, 1.2), (1.6, 2.0))) == [(1.0, 2.0, True)]  # a break of 0.4 s
    assert times(merges((1.0, 1.2), (1.64, 2.0))) == [(1.0, 1.2, True), (1.64, 2.0, True)]
    assert times(merges((1.0, 1.16), (3.0, 3.2))) == [(3.0, 3.2, True)]  # 0.16 s is none
    assert times(merges((1.0, 1.04), (1.2, 1.24))) == [(1.0, 1.24, True)]  # two that are one
    assert times(merges((3.6, 4.0))) == [(3.6, 4.0, False)]
    assert times(merges((3.0, 3.8))) == [(3.0, 3.8, True)]  # its end was seen, though it might have gone on
    assert times(merges((3.92, 4.0))) == []


def test_while_a_merge_may_go_on_its_end_is_not_told():
    open_ = OpenSituations()
    assert open_.first_break_ns is None
    open_.update("merged_rig", "", 0, {(1, 2): PairState("joined", 0.7), (1, 3): PairState("hidden", 0.9)})
    open_.update("merged_rig", "", S // 10, {(1, 3): PairState("hidden", 0.9)})
    open_.update("merged_rig", "", S // 5, {})
    assert open_.first_break_ns == S // 10
    assert [each.second_id for each in open_.update("merged_rig", "", S // 2, {})] == []  # 0.1 s long
    (ended,) = open_.update("merged_rig", "", 6 * S // 10, {})
    assert (ended.second_id, ended.end_ns) == (3, S // 5)
    assert open_.first_break_ns is None


def look(stamp_ns: int = 0, unmet: frozenset[int] = frozenset(), **points: list[tuple[float, float]]) -> ScanPoints:
    """What a scanner meets: points [m] of each person, p1, p2, ..."""
    ids = [int(name[1:]) for name, own in points.items() for _ in own]
    places = np.array([place for own in points.values() for place in own], dtype=float).reshape(-1, 2)
    return ScanPoints(stamp_ns, places, np.array(ids, dtype=np.int16), unmet)


def merged(
    looks: dict[str, ScanPoints], near: dict[tuple[int, int], float], stamp_ns: int = 0
) -> dict[tuple[int, int], str]:
    places = {number: np.array([number, 0.0]) for number in range(1, 5)}
    return {pair: held.how for pair, held in merged_pairs(looks, stamp_ns, near, places).items()}


def test_the_rig_merges_whom_points_of_all_its_scanners_link():
    west, east = look(p1=[(0.0, 0.0)]), look(p2=[(0.4, 0.0)])
    assert merged({"west": west, "east": east}, {(1, 2): 0.6}) == {(1, 2): "joined"}
    assert merged({"west": west, "east": look(p2=[(0.41, 0.0)])}, {(1, 2): 0.6}) == {}
    # a third between them, or a foot of theirs, links them
    chain = {"west": look(p1=[(0.0, 0.0)], p3=[(0.35, 0.0)]), "east": look(p2=[(0.7, 0.0)])}
    assert merged(chain, {}) == {(1, 2): "joined", (1, 3): "joined", (2, 3): "joined"}
    feet = {"west": look(p1=[(0.0, 0.0)], p3=[(0.35, 0.0), (0.8, 0.0)]), "east": look(p2=[(1.1, 0.0)])}
    assert merged(feet, {}) == {(1, 3): "joined", (2, 3): "joined"}


def test_the_rig_merges_whom_no_scanner_meets_with_who_is_near():
    near = {(1, 2): 1.0}
    unmet = look(unmet=frozenset({2}), p1=[(1.0, 0.0)])
    assert merged({"west": unmet, "east": look(unmet=frozenset({2}))}, near) == {(1, 2): "hidden"}
    assert merged({"west": unmet, "east": look(p2=[(2.0, 0.0)])}, near) == {}  # the other scanner sees them
    assert merged({"west": look(p1=[(1.0, 0.0)])}, near) == {}  # in no scanner's plane and field
    assert merged({"west": unmet}, {}) == {}  # nobody is near
    assert merged({"west": look(unmet=frozenset({1, 2}))}, near) == {}  # neither is met


def test_a_scan_of_long_ago_says_nothing():
    looks = {"west": look(0, p1=[(0.0, 0.0)]), "east": look(S // 4, p2=[(0.3, 0.0)])}
    assert merged(looks, {}, S // 4) == {(1, 2): "joined"}
    assert merged(looks, {}, S // 4 + 1) == {}


def test_who_has_left_since_a_scan_is_in_no_pair():
    assert merged({"west": look(p1=[(0.0, 0.0)], p9=[(0.3, 0.0)])}, {}) == {}


@given(hnp.arrays(float, st.tuples(st.integers(0, 12), st.just(2)), elements=st.floats(-1, 1)), st.integers(0, 9))
def test_linked_pairs_are_those_of_scipys_single_linkage(points: np.ndarray, seed: int):
    ids = np.random.default_rng(seed).integers(1, 4, len(points)).astype(np.int16)
    expected = set()
    if len(points) > 1:
        cluster = fcluster(linkage(pdist(points), "single"), LINKAGE_M, "distance")
        for one, other in combinations(range(len(points)), 2):
            if cluster[one] == cluster[other] and ids[one] != ids[other]:
                expected.add((min(ids[one], ids[other]), max(ids[one], ids[other])))
    assert linked_pairs(points, ids) == expected


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


def test_the_points_of_a_look_lie_in_the_room():
    pose = Pose(xyz=(1.0, 2.0, 0.5), rpy=(0.0, 0.0, np.pi / 2))  # looks along y, its left is −x
    view = SensorView(pose.translation, pose.rotation, np.pi, 8.0)
    scan = LaserScan("knee", 0, np.array([3.0, 2.0, np.inf, 1.0], np.float32), -np.pi / 2, np.pi / 2, 0.05, 8.0)
    look = scan_points(scan, np.array([0, 7, 7, 9], np.int16), view, frozenset())
    assert look.ids.tolist() == [7, 9]
    np.testing.assert_allclose(look.points, [(1.0, 4.0), (1.0, 1.0)], atol=1e-6)
