"""Accuracy and disposal: what each kind of failure is, and the same figures from loops over people, tracks and frames."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from test_evaluate import ns, runs, still, tracks_of, truth_of

from twin.evaluate.judged_frames import align, match_all_people
from twin.evaluate.summary import evaluate_tracks
from twin.recording.situation_table import SituationTable, situation_table
from twin.recording.tables import TrackTable, TruthTable
from twin.truth.truth_types import Situation

GATE_M = 0.5


def failures(truth: TruthTable, tracks: TrackTable) -> tuple[int, int, int, int]:
    """People summed over frames, missed, false locations, identity wrong."""
    kinds = evaluate_tracks(truth, tracks)["failures"]
    return kinds["person_frames"], kinds["missed"], kinds["false_location"], kinds["identity_wrong"]


TWO = {1: still(0, 0, range(10)), 2: still(2, 0, range(10))}


def test_a_person_without_a_track_is_missed():
    tracks = tracks_of({7: still(0, 0, range(10)), 8: still(2, 0, range(6))}, range(10))
    assert failures(truth_of(TWO), tracks) == (20, 4, 0, 0)
    assert evaluate_tracks(truth_of(TWO), tracks)["accuracy"] == pytest.approx(0.8)


def test_a_track_far_from_people_is_a_false_location_and_its_person_is_not_missed_too():
    astray = {**still(2, 0, range(6)), **still(3, 0, range(6, 10))}
    assert failures(truth_of(TWO), tracks_of({7: still(0, 0, range(10)), 8: astray})) == (20, 0, 4, 0)
    ghost = tracks_of({7: still(0, 0, range(10)), 8: still(2, 0, range(10)), 9: still(5, 5, range(3))})
    assert failures(truth_of(TWO), ghost) == (20, 0, 3, 0)


def test_after_a_swap_both_are_wrong_until_the_tracks_swap_back():
    back = [*range(4), 8, 9]
    seven = {**still(0, 0, back), **still(2, 0, range(4, 8))}
    eight = {**still(2, 0, back), **still(0, 0, range(4, 8))}
    assert failures(truth_of(TWO), tracks_of({7: seven, 8: eight})) == (20, 0, 0, 8)


def test_of_tracks_at_one_place_the_persons_own_is_the_nearest():
    """As of merged people, whom a tracker follows as one target."""
    seven, eight = (
        {**still(*own, range(4)), **still(1, 0, range(4, 7)), **still(*own, range(7, 10))}
        for own in ((0.7, 0), (1.3, 0))
    )
    pair = {1: still(0.7, 0, range(10)), 2: still(1.3, 0, range(10))}
    assert failures(truth_of(pair), tracks_of({7: seven, 8: eight}, range(10))) == (20, 0, 0, 0)


def test_who_is_lost_and_found_under_a_new_track_was_missed_and_counts_one_switch():
    tracks = tracks_of({7: still(0, 0, range(10)), 8: still(2, 0, range(4)), 9: still(2, 0, range(6, 10))})
    assert failures(truth_of(TWO), tracks) == (20, 2, 0, 1)


def test_a_track_belongs_to_the_person_it_was_confirmed_on():
    coasts = {**still(0, 0, range(5), "coasting"), **still(2, 0, range(5, 10))}
    # nobody's until it is confirmed on the second, whose it is then: before that the first had another's track
    assert failures(truth_of(TWO), tracks_of({7: coasts})) == (20, 10, 0, 5)
    only = tracks_of({7: still(0, 0, range(10), "coasting"), 8: still(2, 0, range(10))})
    assert failures(truth_of(TWO), only) == (20, 0, 0, 0)


def test_people_outside_the_area_are_not_owed_and_their_tracks_not_punished():
    outside = {1: still(0, 0, range(10)), 2: {**still(2, 0, range(5), False), **still(2, 0, range(5, 10))}}
    both = tracks_of({7: still(0, 0, range(10)), 8: still(2, 0, range(10))})
    assert failures(truth_of(outside), both) == (15, 0, 0, 0)
    # a track that was confirmed on the second outside stays theirs
    moves = tracks_of({7: still(0, 0, range(5)), 8: {**still(2, 0, range(5)), **still(0, 0, range(5, 10))}}, range(10))
    assert failures(truth_of(outside), moves) == (15, 5, 0, 5)
    assert evaluate_tracks(truth_of({1: still(0, 0, range(3), False)}), tracks_of({}, range(3)))["accuracy"] is None


# --- disposal


def pair(kind: str, first: float, last: float, complete: bool = True) -> Situation:
    return Situation(kind, 1, 2, "", ns(first), ns(last), complete)  # pyright: ignore[reportArgumentType]


def disposed(situations: list[Situation], tracks: TrackTable, steps: int = 40) -> dict[str, tuple[int, int]]:
    truth = truth_of({1: still(0, 0, range(steps)), 2: still(0.7, 0, range(steps))})
    found = evaluate_tracks(truth, tracks, situations=situation_table(situations))["disposal"]
    return {kind: (each["total"], each["disposed"]) for kind, each in found.items()}


def tracks_that_fail(*steps: int) -> TrackTable:
    """Both are followed, but in these steps the second is missed."""
    return tracks_of({7: still(0, 0, range(40)), 8: still(0.7, 0, [step for step in range(40) if step not in steps])})


def test_correlated_is_counted_per_pair_and_frame():
    situations = [pair("correlated", 5, 15), pair("correlated", 20, 22)]
    assert disposed(situations, tracks_that_fail())["correlated"] == (12, 12)
    assert disposed(situations, tracks_that_fail(5, 14, 15, 30))["correlated"] == (12, 10)


def test_a_merge_is_disposed_of_until_a_second_after_its_end():
    situations = [pair("merged_rig", 5, 10)]
    assert disposed(situations, tracks_that_fail())["merge_split"] == (1, 1)
    assert disposed(situations, tracks_that_fail(4))["merge_split"] == (1, 1)
    assert disposed(situations, tracks_that_fail(5))["merge_split"] == (1, 0)
    assert disposed(situations, tracks_that_fail(19))["merge_split"] == (1, 0)
    assert disposed(situations, tracks_that_fail(20))["merge_split"] == (1, 1)


def test_the_identity_after_a_merge_is_judged_one_second_after_its_end():
    situations = [pair("merged_rig", 5, 10)]
    assert disposed(situations, tracks_that_fail(7, 19))["identity_after"] == (1, 1)
    assert disposed(situations, tracks_that_fail(20))["identity_after"] == (1, 0)


def test_a_merge_whose_end_is_not_seen_is_not_counted():
    assert disposed([pair("merged_rig", 5, 39, complete=False)], tracks_that_fail())["merge_split"] == (0, 0)
    assert disposed([pair("merged_rig", 5, 30)], tracks_that_fail())["merge_split"] == (
        0,
        0,
    )  # the last frame is the 39th
    assert disposed([pair("merged_rig", 5, 29)], tracks_that_fail())["merge_split"] == (1, 1)
    assert disposed([pair("merged", 5, 10)], tracks_that_fail())["merge_split"] == (0, 0)  # of one scanner


def test_disposal_outside_the_area_is_not_counted():
    truth = truth_of({1: still(0, 0, range(40)), 2: still(0.7, 0, range(40), False)})
    situations = situation_table([pair("correlated", 5, 15), pair("merged_rig", 5, 15)])
    found = evaluate_tracks(truth, tracks_that_fail(), situations=situations)["disposal"]
    assert [each["total"] for each in found.values()] == [0, 0, 0]
    assert [each["share"] for each in found.values()] == [None, None, None]


# --- the same from loops


def by_loops(truth: TruthTable, tracks: TrackTable, situations: SituationTable) -> dict:
    frames = align(truth, tracks).frames
    owner: dict[int, int] = {}
    for frame, pairs in zip(frames, match_all_people(frames, GATE_M), strict=True):
        for row, column in zip(pairs.rows, pairs.columns, strict=True):
            if frame.confirmed[column]:
                owner.setdefault(int(frame.track_ids[column]), int(frame.person_ids[row]))
    verdicts: dict[tuple[int, int], str] = {}
    had: dict[int, set[int]] = {}
    false_locations = 0
    for frame in frames:
        distance = frame.distances_m
        tracks_here = frame.track_ids.tolist()
        nowhere = [track for k, track in enumerate(tracks_here) if all(not d <= GATE_M for d in distance[:, k])]
        false_locations += len(nowhere)
        for row, person in enumerate(frame.person_ids.tolist()):
            near = [(distance[row, k], track) for k, track in enumerate(tracks_here) if distance[row, k] <= GATE_M]
            if not near:
                verdict = "astray" if any(owner.get(track) == person for track in nowhere) else "missed"
            else:
                track = min(near)[1]
                verdict = "right" if owner.get(track, person) == person else "wrong"
                if owner.get(track) == person:
                    known = had.setdefault(person, set())
                    if known and track not in known:
                        verdict = "wrong"
                    known.add(track)
            if frame.in_area[row]:
                verdicts[frame.stamp_ns, person] = verdict
    kinds = list(verdicts.values())
    stamps = [frame.stamp_ns for frame in frames]
    counted = {"correlated": [0, 0], "merge_split": [0, 0], "identity_after": [0, 0]}
    for k in range(len(situations)):
        start, end = int(situations.start_ns[k]), int(situations.end_ns[k])
        pair = int(situations.first_id[k]), int(situations.second_id[k])
        frames_of = {t: [verdicts.get((t, each)) for each in pair] for t in stamps}
        if situations.kind[k] == "correlated":
            for t in stamps:
                if start <= t < end and None not in frames_of[t]:
                    counted["correlated"][0] += 1
                    counted["correlated"][1] += frames_of[t] == ["right", "right"]
        elif situations.complete[k] and end + ns(10) <= stamps[-1]:
            if not any(start <= t < end and None not in frames_of[t] for t in stamps):
                continue
            after = next(frames_of[t] for t in stamps if t >= end + ns(10))
            counted["identity_after"][0] += None not in after
            counted["identity_after"][1] += after == ["right", "right"]
            counted["merge_split"][0] += 1
            counted["merge_split"][1] += all(
                frames_of[t] == ["right", "right"]
                for t in stamps
                if start <= t < end + ns(10) and None not in frames_of[t]
            )
    return {
        "failures": (len(kinds), kinds.count("missed"), false_locations, kinds.count("wrong")),
        "disposal": {kind: tuple(each) for kind, each in counted.items()},
    }


@st.composite
def judged_runs(draw):
    """A run, and situations of its people."""
    truth, tracks, steps, rng = draw(runs())
    situations = []
    for _ in range(rng.integers(0, 5) if len(truth) > 1 else 0):
        first, second = sorted(rng.choice(list(truth), 2, replace=False).tolist())
        start, length = rng.integers(0, len(steps)), rng.integers(1, 9)
        kind = ("correlated", "merged_rig")[rng.integers(2)]
        situations.append(Situation(kind, first, second, "", ns(start), ns(start + length), bool(rng.random() < 0.8)))
    return truth_of(truth, steps), tracks_of(tracks, steps), situation_table(situations)


@settings(max_examples=150, deadline=None)
@given(judged_runs())
def test_the_figures_are_those_of_loops_over_people_tracks_and_frames(run):
    truth, tracks, situations = run
    metrics = evaluate_tracks(truth, tracks, situations=situations)
    expected = by_loops(truth, tracks, situations)
    assert tuple(metrics["failures"].values()) == expected["failures"]
    assert {kind: (each["total"], each["disposed"]) for kind, each in metrics["disposal"].items()} == expected[
        "disposal"
    ]
    count, *kinds = expected["failures"]
    assert metrics["accuracy"] == (None if not count else pytest.approx(1 - sum(kinds) / count))


@settings(max_examples=40, deadline=None)
@given(judged_runs())
def test_perfect_tracks_are_right_everywhere(run):
    truth, _, situations = run
    inside = {int(p): {} for p in np.unique(truth.id)}
    for t, person, x, y in zip(truth.stamps_ns, truth.id, truth.x, truth.y, strict=True):
        inside[int(person)][t / ns(1)] = (x, y)
    metrics = evaluate_tracks(truth, tracks_of(inside, (truth.frame_stamps_ns / ns(1)).tolist()), situations=situations)
    kinds = metrics["failures"]
    apart_enough = kinds["identity_wrong"] == 0  # two people in one place have the track of either
    assert (kinds["missed"], kinds["false_location"]) == (0, 0)
    if apart_enough:
        assert metrics["accuracy"] in (1.0, None)
        assert all(each["total"] == each["disposed"] for each in metrics["disposal"].values())
