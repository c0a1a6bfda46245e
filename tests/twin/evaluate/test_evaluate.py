"""Two tables in, the figures of metrics.json out: frames, area, gaps, misidentified, lost, heads."""

import json
import tracemalloc
from dataclasses import replace
from math import pi

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from trackers.errors import InputError
from trackers.tracks import Track, TrackFrame
from twin.evaluate.judged_frames import align
from twin.evaluate.summary import evaluate_tracks, evaluate_with_details
from twin.recording.tables import track_table, truth_table
from twin.truth.truth_types import PersonTruth, TruthFrame

PERIOD_NS = 100_000_000


def ns(step: float) -> int:
    return round(step * PERIOD_NS)


def truth_of(paths: dict[int, dict[float, tuple]], steps=None):
    """Truth from {person: {step: (x, y) or (x, y, in_area)}}, a step being 0.1 s."""
    steps = sorted({step for path in paths.values() for step in path} | set(steps or ()))
    frames = []
    for step in steps:
        people = []
        for person, path in paths.items():
            if step in path:
                x, y, *in_area = path[step]
                people.append(PersonTruth(person, x, y, in_area=all(in_area)))
        frames.append(TruthFrame(ns(step), tuple(people)))
    return truth_table(frames)


def tracks_of(paths: dict[int, dict[float, tuple]], steps=None):
    """Tracks from {track: {step: (x, y) or (x, y, status)}}."""
    steps = sorted({step for path in paths.values() for step in path} | set(steps or ()))
    frames = []
    for step in steps:
        tracks = []
        for track, path in paths.items():
            if step in path:
                x, y, *status = path[step]
                tracks.append(Track(track, x, y, status=status[0] if status else "confirmed"))
        frames.append(TrackFrame(ns(step), tuple(tracks)))
    return track_table(frames)


def still(x: float, y: float, steps, *more) -> dict:
    return {step: (x, y, *more) for step in steps}


def shifted(step_range, x: float = 0.0, y: float = 0.0):
    return {step: (x + 0.05 * step, y) for step in step_range}


def test_perfect_tracks():
    paths = {1: shifted(range(30)), 2: shifted(range(30), y=1.5)}
    metrics = evaluate_tracks(truth_of(paths), tracks_of({5: paths[1], 9: paths[2]}))
    assert metrics == {
        "mota": 1.0,
        "motp_m": 0.0,
        "idf1": 1.0,
        "hota": 1.0,
        "hota_cap": 1.0,
        "deta": 1.0,
        "assa": 1.0,
        "gospa_m": 0.0,
        "ospa_m": 0.0,
        "id_switches": 0,
        "false_positives": 0,
        "misses": 0,
        "misidentifications": 0,
        "lost_tracks": 0,
        "errors": {
            "missed": {"unseen": None, "unused": None, "start_up": 0, "seen": 0},  # no sensor is named in this truth
            "false_positive": {"ghost": 0, "ghost_unseen": None, "double": 0, "clutter": 0},
        },
        "accuracy": 1.0,
        "failures": {"person_frames": 60, "missed": 0, "false_location": 0, "identity_wrong": 0},
        "disposal": None,
        "head_error_m": {"x": None, "y": None, "z": None},
        "head_yaw_error_rad": None,
        "head_yaw_median_rad": None,
        "body_height_error_m": None,
        "right_at_end": 1.0,
        "within_radius": None,
        "gate_m": 0.5,
        "at_1m": {"mota": 1.0, "motp_m": 0.0, "idf1": 1.0, "hota": 1.0, "id_switches": 0},
        "judged": {
            "frames": 30,
            "frames_total": 30,
            "share": 1.0,
            "person_frames": 60,
            "matches": 60,
            "heads": 0,
        },
    }
    assert json.loads(json.dumps(metrics, allow_nan=False)) == metrics


def test_the_gate_decides_what_matches():
    truth, tracks = truth_of({1: still(0, 0, range(10))}), tracks_of({1: still(0.7, 0, range(10))})
    metrics = evaluate_tracks(truth, tracks)
    assert (metrics["misses"], metrics["false_positives"], metrics["mota"]) == (10, 10, -1.0)
    assert metrics["motp_m"] is None
    assert metrics["at_1m"]["mota"] == 1.0
    assert metrics["at_1m"]["motp_m"] == pytest.approx(0.7)
    assert metrics["ospa_m"] == pytest.approx(0.7)
    wide = evaluate_tracks(truth, tracks, gate_m=1.0)
    assert wide["gate_m"] == 1.0
    assert wide["at_1m"] == {name: wide[name] for name in wide["at_1m"]}
    for gate_m, is_told in ((1.0, False), (50.0, True)):
        notes = evaluate_with_details(truth, tracks, gate_m=gate_m).notes
        assert (
            any(each.startswith("gate: 50 m matches tracks with people across a room; metres") for each in notes)
            == is_told
        )


@pytest.mark.parametrize("gate_m", [0.0, -1.0, np.nan, np.inf])
def test_a_gate_that_is_no_distance_is_refused(gate_m):
    with pytest.raises(InputError, match="gate"):
        evaluate_tracks(truth_of({1: still(0, 0, range(3))}), tracks_of({}, range(3)), gate_m)


@pytest.mark.parametrize("share", [1.0, 3.0])  # of the other person's errors
@pytest.mark.parametrize("seed", range(3))
def test_hota_reaches_its_cap_without_errors_of_detection_and_identity(seed, share):
    off = np.random.default_rng(seed).normal(scale=0.05, size=(40, 2))
    paths = {1: shifted(range(40)), 2: shifted(range(40), y=3.0)}
    one, two = (
        {step: (x + of * off[step, 0], y + of * off[step, 1]) for step, (x, y) in path.items()}
        for of, path in zip((1.0, share), paths.values(), strict=True)
    )
    perfect = evaluate_tracks(truth_of(paths), tracks_of({1: one, 2: two}))
    assert perfect["hota"] == pytest.approx(perfect["hota_cap"])
    assert 0.8 < perfect["hota_cap"] < 1.0
    late = range(20, 40)
    swapped = {1: one | {step: two[step] for step in late}, 2: two | {step: one[step] for step in late}}
    exchanged = evaluate_tracks(truth_of(paths), tracks_of(swapped))
    assert exchanged["hota"] < exchanged["hota_cap"] == pytest.approx(perfect["hota_cap"])


def test_hota_in_metres():
    # d = 0.2 m, gate 0.5 m: similarity 0.8, so that 16 of 19 thresholds hold.
    metrics = evaluate_tracks(truth_of({1: still(0, 0, range(10))}), tracks_of({4: still(0.2, 0, range(10))}))
    assert metrics["hota"] == pytest.approx(16 / 19)


# --- misidentified and lost


def test_a_misidentification():
    truth = truth_of({1: still(0, 0, range(20)), 2: still(2, 0, range(20))})
    tracks = tracks_of({7: still(0, 0, range(10)) | still(2, 0, range(10, 20))})
    result = evaluate_with_details(truth, tracks)
    assert result.metrics["misidentifications"] == 1
    assert result.metrics["lost_tracks"] == 0
    assert result.metrics["id_switches"] == 0  # neither person ever changes track
    (event,) = result.events
    assert (event.kind, event.stamp_ns) == ("misidentification", ns(10))
    assert (event.track_id, event.previous_person_id, event.person_id) == (7, 1, 2)


def test_two_tracks_that_swap_are_two_misidentifications_and_two_switches():
    truth = truth_of({1: still(0, 0, range(20)), 2: still(2, 0, range(20))})
    first = still(0, 0, range(10)) | still(2, 0, range(10, 20))
    second = still(2, 0, range(10)) | still(0, 0, range(10, 20))
    metrics = evaluate_tracks(truth, tracks_of({7: first, 8: second}))
    assert (metrics["misidentifications"], metrics["id_switches"], metrics["lost_tracks"]) == (2, 2, 0)
    assert metrics["mota"] == pytest.approx(1 - 2 / 40)
    assert metrics["idf1"] == pytest.approx(0.5)


def test_each_change_of_person_counts():
    truth = truth_of({1: still(0, 0, range(30)), 2: still(2, 0, range(30))})
    path = still(0, 0, range(10)) | still(2, 0, range(10, 20)) | still(0, 0, range(20, 30))
    assert evaluate_tracks(truth, tracks_of({7: path}))["misidentifications"] == 2


def test_a_new_track_on_the_same_person_is_a_switch_and_a_loss_but_no_misidentification():
    truth = truth_of({1: still(0, 0, range(20))})
    result = evaluate_with_details(truth, tracks_of({7: still(0, 0, range(10)), 8: still(0, 0, range(10, 20))}))
    assert result.metrics["misidentifications"] == 0
    assert [(e.kind, e.stamp_ns, e.track_id, e.person_id) for e in result.events] == [
        ("lost", ns(9), 7, 1),
        ("switch", ns(10), 8, 1),
    ]
    assert result.events[1].previous_track_id == 7


def test_the_reference_person_is_the_first_one_matched_while_confirmed():
    truth = truth_of({1: still(0, 0, range(20)), 2: still(2, 0, range(20))})
    unmatched_first = still(9, 9, range(5)) | still(2, 0, range(5, 20))
    assert evaluate_tracks(truth, tracks_of({7: unmatched_first}))["misidentifications"] == 0


def test_a_track_predicted_past_a_person_has_not_taken_them_for_its_person():
    truth = truth_of({1: still(0, 0, range(20)), 2: still(2, 0, range(20))})
    coasting = still(0, 0, range(5)) | still(2, 0, range(5, 8), "coasting") | still(0, 0, range(8, 20))
    assert evaluate_tracks(truth, tracks_of({7: coasting}))["misidentifications"] == 0
    confirmed = {step: place[:2] for step, place in coasting.items()}
    assert evaluate_tracks(truth, tracks_of({7: confirmed}))["misidentifications"] == 2


def test_coasting_tracks_count_as_tracks():
    paths = still(0, 0, range(10), "coasting")
    assert evaluate_tracks(truth_of({1: still(0, 0, range(10))}), tracks_of({7: paths}))["mota"] == 1.0


def test_a_track_that_ends_while_its_person_stays_is_lost():
    truth = truth_of({1: still(0, 0, range(20))})
    metrics = evaluate_tracks(truth, tracks_of({7: still(0, 0, range(10))}, steps=range(20)))
    assert (metrics["lost_tracks"], metrics["misses"]) == (1, 10)


def test_a_track_that_lives_to_the_end_is_not_lost():
    truth = truth_of({1: still(0, 0, range(20))})
    assert evaluate_tracks(truth, tracks_of({7: still(0, 0, range(10, 20))}, steps=range(20)))["lost_tracks"] == 0


@pytest.mark.parametrize(("leaves_at", "lost"), [(10, 0), (14, 0), (15, 1)])
def test_a_person_about_to_leave_is_not_lost(leaves_at, lost):
    # The track is seen last at 0.9 s; the grace of 0.5 s holds the frames up to 1.4 s.
    truth = truth_of({1: still(0, 0, range(leaves_at)) | still(0, 0, range(leaves_at, 30), False)})
    tracks = tracks_of({7: still(0, 0, range(10))}, steps=range(30))
    assert evaluate_tracks(truth, tracks)["lost_tracks"] == lost


def test_with_slow_frames_the_grace_holds_the_next_frame():
    truth = truth_of({1: {0: (0, 0), 10: (0, 0), 20: (0, 0, False), 30: (0, 0, False)}})
    assert evaluate_tracks(truth, tracks_of({7: still(0, 0, (0, 10))}, steps=(0, 10, 20, 30)))["lost_tracks"] == 0


def test_a_person_whose_truth_ends_has_left():
    truth = truth_of({1: still(0, 0, range(12))}, steps=range(20))
    tracks = tracks_of({7: still(0, 0, range(11))}, steps=range(20))
    assert evaluate_tracks(truth, tracks)["lost_tracks"] == 0


def test_a_track_that_follows_a_person_out_and_ends_there_is_not_lost():
    truth = truth_of({1: still(0, 0, range(10)) | still(1, 0, range(10, 30), False)})
    tracks = tracks_of({7: still(0, 0, range(10)) | still(1, 0, range(10, 15))}, steps=range(30))
    metrics = evaluate_tracks(truth, tracks)
    assert (metrics["lost_tracks"], metrics["false_positives"], metrics["misses"]) == (0, 0, 0)


def test_a_track_that_never_had_a_person_cannot_be_lost():
    truth = truth_of({1: still(0, 0, range(20))})
    metrics = evaluate_tracks(truth, tracks_of({7: still(0, 0, range(20)), 8: still(4, 4, range(5))}))
    assert (metrics["lost_tracks"], metrics["false_positives"]) == (0, 5)


# --- the tracked area


def test_people_outside_the_area_are_not_owed():
    truth = truth_of({1: still(0, 0, range(10)), 2: still(5, 0, range(10), False)})
    metrics = evaluate_tracks(truth, tracks_of({7: still(0, 0, range(10))}))
    assert (metrics["mota"], metrics["hota"], metrics["gospa_m"]) == (1.0, 1.0, 0.0)


def test_a_track_on_a_person_outside_the_area_is_not_punished():
    truth = truth_of({1: still(0, 0, range(10)), 2: still(5, 0, range(10), False)})
    tracks = tracks_of({7: still(0, 0, range(10)), 8: still(5.1, 0, range(10))})
    metrics = evaluate_tracks(truth, tracks)
    assert (metrics["mota"], metrics["idf1"], metrics["hota"], metrics["ospa_m"]) == (1.0, 1.0, 1.0, 0.0)


def test_a_track_on_no_person_outside_the_area_is_a_false_positive():
    truth = truth_of({1: still(0, 0, range(10)), 2: still(5, 0, range(10), False)})
    metrics = evaluate_tracks(truth, tracks_of({7: still(0, 0, range(10)), 8: still(6, 0, range(10))}))
    assert metrics["false_positives"] == 10


def test_only_people_outside():
    metrics = evaluate_tracks(truth_of({2: still(5, 0, range(10), False)}), tracks_of({8: still(5, 0, range(10))}))
    assert (metrics["mota"], metrics["idf1"], metrics["hota"], metrics["motp_m"]) == (None, None, None, None)
    assert (metrics["gospa_m"], metrics["ospa_m"], metrics["false_positives"]) == (0.0, 0.0, 0)


# --- which frames


def test_frames_in_which_no_person_is_tracked_count():
    truth = truth_of({1: still(0, 0, range(10))})
    metrics = evaluate_tracks(truth, tracks_of({7: still(0, 0, range(8))}, steps=range(10)))
    assert (metrics["misses"], metrics["mota"]) == (2, pytest.approx(0.8))


def test_no_tracks_at_all():
    truth = truth_of({1: still(0, 0, range(10))})
    for tracks in (tracks_of({}), tracks_of({}, steps=range(10))):
        metrics = evaluate_tracks(truth, tracks)
        assert (metrics["mota"], metrics["misses"], metrics["hota"], metrics["idf1"]) == (0.0, 10, 0.0, 0.0)
        assert (metrics["gospa_m"], metrics["ospa_m"]) == (pytest.approx(0.5**0.5), 1.0)


def test_an_empty_room():
    truth = truth_of({}, steps=range(10))
    assert evaluate_tracks(truth, tracks_of({}, steps=range(10)))["ospa_m"] == 0.0
    assert evaluate_tracks(truth, tracks_of({3: still(0, 0, range(10))}))["false_positives"] == 10


def test_truth_denser_than_the_tracks_is_judged_at_their_stamps():
    path = {step / 4: (0.01 * step, 0.0) for step in range(80)}
    result = evaluate_with_details(
        truth_of({1: path}), tracks_of({7: {step: (0.04 * step, 0.0) for step in range(20)}})
    )
    assert result.stamps_ns.tolist() == [ns(step) for step in range(20)]
    assert result.metrics["motp_m"] == pytest.approx(0, abs=1e-12)


def test_truth_is_interpolated_between_near_rows():
    truth = truth_of({1: {0: (0.0, 0.0), 2: (1.0, 2.0), 4: (2.0, 4.0)}})
    result = evaluate_with_details(truth, tracks_of({7: {0.5: (0.25, 0.5), 1.5: (0.75, 1.5), 2.5: (1.25, 2.5)}}))
    np.testing.assert_allclose(result.match_distances_m, 0, atol=1e-12)
    assert result.match_stamps_ns.tolist()[:3] == [ns(0.5), ns(1.5), ns(2.5)]


def test_yaw_is_interpolated_the_shorter_way_round():
    people = [PersonTruth(1, 0, 0, head_x=0, head_y=0, head_z=1.6, head_yaw=yaw) for yaw in (pi - 0.1, -pi + 0.1)]
    truth = truth_table([TruthFrame(ns(0), (people[0],)), TruthFrame(ns(2), (people[1],))])
    (frame,) = align(truth, tracks_of({7: {1: (0, 0)}})).frames
    assert abs(frame.person_pose[0, 3]) == pytest.approx(pi)


def test_truth_is_not_interpolated_across_a_wide_gap():
    truth = truth_of({1: {0: (0, 0), 3: (0, 0)}, 2: still(2, 0, range(4))})
    frames = align(truth, tracks_of({7: still(0, 0, range(4))})).frames
    assert [frame.person_ids.tolist() for frame in frames] == [[1, 2], [2], [2], [1, 2]]


def test_stamps_at_which_the_truth_is_unknown_are_not_judged():
    truth = truth_of({1: {0: (0, 0), 1: (0, 0), 9: (0, 0), 10: (0, 0)}})
    result = evaluate_with_details(truth, tracks_of({7: still(0, 0, range(-5, 15))}))
    assert result.stamps_ns.tolist() == [ns(step) for step in (0, 1, 9, 10)]
    assert result.metrics["false_positives"] == 0


@pytest.mark.parametrize(
    ("reported", "missed"),
    [
        ([*range(10), *range(15, 30)], [10, 11, 12, 13, 14]),
        (range(5, 30), [0, 1, 2, 3, 4]),
        (range(25), [25, 26, 27, 28, 29]),
        (range(1, 29), []),  # within one and a half periods of both ends
        ([*range(10), *np.arange(10.4, 30)], []),  # late, not silent
    ],
)
def test_a_silent_tracker_misses_all_people(reported, missed):
    steps = np.arange(0, 30, 0.5).tolist()  # the truth is twice as dense
    truth = truth_of({1: still(0, 0, [*steps, *(s for s in reported if s not in steps)])})
    result = evaluate_with_details(truth, tracks_of({7: still(0, 0, reported)}))
    assert result.stamps_ns[result.misses > 0].tolist() == [ns(step) for step in missed]


def test_one_single_frame_of_tracks():
    truth = truth_of({1: still(0, 0, range(10))})
    metrics = evaluate_tracks(truth, tracks_of({7: {4: (0, 0)}}))
    assert metrics["misses"] == 9


def test_memory_goes_by_rows_not_by_the_most_crowded_frame_or_the_number_of_ids():
    crowd = {100 + n: {300: (20.0 + n % 20, n // 20)} for n in range(200)}
    brief = {1000 + n: {n: (0.0, 0.0), n + 1: (0.05, 0.0)} for n in range(0, 600, 2)}
    truth, tracks = truth_of(crowd | brief), tracks_of(crowd | brief)
    tracemalloc.start()
    metrics = evaluate_tracks(truth, tracks)
    (_, peak), _ = tracemalloc.get_traced_memory(), tracemalloc.stop()
    assert (metrics["mota"], metrics["accuracy"]) == (1.0, 1.0)
    assert peak < 40e6


@pytest.mark.parametrize("bound", ["MOST_PAIRS", "MOST_IN_FRAME", "MOST_OF_IDS"])
def test_tables_that_no_memory_holds_are_refused(bound, monkeypatch):
    paths = {1: shifted(range(3)), 2: shifted(range(3), y=1.5)}
    monkeypatch.setattr(f"twin.evaluate.summary.{bound}", 3)
    with pytest.raises(InputError, match=r"tracks: .* pairs of a person .*; at most 3, or --no-limits, is expected"):
        evaluate_tracks(truth_of(paths), tracks_of(paths))


def test_tables_on_different_clocks_are_refused():
    truth = truth_of({1: still(0, 0, range(10))})
    with pytest.raises(InputError, match=r"same clock"):
        evaluate_tracks(truth, tracks_of({7: still(0, 0, range(1000, 1010))}))


def test_truth_without_any_row_is_refused():
    with pytest.raises(InputError, match="no rows"):
        evaluate_tracks(truth_of({}), tracks_of({}))


# --- heads


def test_head_errors_per_axis_where_estimated():
    person = PersonTruth(1, 0, 0, z=0.9, head_x=0.0, head_y=0.0, head_z=1.6, head_yaw=pi - 0.1)
    truth = truth_table([TruthFrame(ns(step), (person,)) for step in range(4)])
    guess = Track(7, 0, 0, head_x=0.1, head_y=-0.2, head_z=1.9, head_yaw=-pi + 0.2)
    frames = [TrackFrame(ns(step), (guess,)) for step in range(3)]
    frames.append(TrackFrame(ns(3), (replace(guess, head_x=0.3, head_yaw=float("nan")),)))
    frames[1] = TrackFrame(ns(1), (replace(guess, head_yaw=pi - 0.1, z=1.0),))
    metrics = evaluate_tracks(truth, track_table(frames))
    assert metrics["head_error_m"] == pytest.approx({"x": 0.15, "y": 0.2, "z": 0.3})
    assert metrics["head_yaw_error_rad"] == pytest.approx(0.2)
    assert metrics["head_yaw_median_rad"] == pytest.approx(0.3)
    assert metrics["body_height_error_m"] == pytest.approx(0.1)


def test_who_is_right_at_the_end():
    """Of three people one has another's track at last, one a track of nobody before, one their own after a detour."""
    places = (0.0, 2.0, 4.0)
    truth = truth_of({k: still(x, 0, range(10)) for k, x in enumerate(places, start=1)})
    exchanged = {
        5: {**still(0, 0, range(5)), **still(2.0, 0, range(5, 10))},
        6: still(4.0, 0, [0, 1, 2, 6, 7, 8, 9]),
        7: still(2.0, 0, range(5)),
        8: still(0.0, 0, range(5, 10)),
    }
    assert evaluate_tracks(truth, tracks_of(exchanged))["right_at_end"] == pytest.approx(1 / 3)
    assert evaluate_tracks(truth, tracks_of({5: still(0, 0, range(10))}))["right_at_end"] == pytest.approx(1 / 3)
    assert evaluate_tracks(truth_of({}, range(10)), tracks_of({}, range(10)))["right_at_end"] is None


# --- properties


@st.composite
def runs(draw):
    """A few people on random walks, their tracks with errors, drop-outs and stolen identities."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    n, steps = int(rng.integers(1, 5)), int(rng.integers(2, 25))
    walks = rng.uniform(0, 2, (n, 1, 2)) + rng.normal(0, 0.15, (n, steps, 2)).cumsum(axis=1)
    labels = np.arange(1, n + 1)
    truth: dict[int, dict] = {p + 1: {} for p in range(n)}
    tracks: dict[int, dict] = {t: {} for t in range(1, n + 2)}
    for step in range(steps):
        if rng.random() < 0.2:
            rng.shuffle(labels)
        for p in range(n):
            x, y = walks[p, step].tolist()
            truth[p + 1][step] = (x, y, bool(rng.random() < 0.9))
            if rng.random() < 0.85:
                status = "confirmed" if rng.random() < 0.8 else "coasting"
                tracks[int(labels[p])][step] = (x + rng.normal(0, 0.15), y + rng.normal(0, 0.15), status)
        if rng.random() < 0.2:
            tracks[n + 1][step] = (*rng.uniform(0, 2, 2).tolist(), "confirmed")
    return truth, tracks, range(steps), rng


@settings(max_examples=40, deadline=None)
@given(runs())
def test_names_do_not_matter(run):
    truth, tracks, steps, rng = run
    metrics = evaluate_tracks(truth_of(truth, steps), tracks_of(tracks, steps))
    persons = dict(zip(truth, (10 + rng.permutation(len(truth))).tolist(), strict=True))
    names = dict(zip(tracks, (10 + rng.permutation(len(tracks))).tolist(), strict=True))
    renamed = evaluate_tracks(
        truth_of({persons[p]: path for p, path in truth.items()}, steps),
        tracks_of({names[t]: path for t, path in tracks.items()}, steps),
    )
    at_1m, renamed_at_1m = metrics.pop("at_1m"), renamed.pop("at_1m")
    for whole in ("head_error_m", "failures", "errors", "judged"):
        assert renamed.pop(whole) == metrics.pop(whole)
    assert renamed == pytest.approx(metrics)
    assert renamed_at_1m == pytest.approx(at_1m)


@settings(max_examples=25, deadline=None)
@given(runs())
def test_perfect_tracks_of_any_run(run):
    truth, _, steps, _ = run
    inside = {p: {step: place[:2] for step, place in path.items()} for p, path in truth.items()}
    metrics = evaluate_tracks(truth_of(inside, steps), tracks_of(inside, steps))
    assert (metrics["mota"], metrics["idf1"], metrics["gospa_m"], metrics["ospa_m"]) == (1.0, 1.0, 0.0, 0.0)
    assert metrics["hota"] == pytest.approx(1.0)
    assert metrics["misidentifications"] == metrics["lost_tracks"] == metrics["id_switches"] == 0


@settings(max_examples=25, deadline=None)
@given(runs())
def test_details_add_up_to_the_figures(run):
    truth, tracks, steps, _ = run
    result = evaluate_with_details(truth_of(truth, steps), tracks_of(tracks, steps))
    metrics = result.metrics
    assert (int(result.misses.sum()), int(result.false_positives.sum())) == (
        metrics["misses"],
        metrics["false_positives"],
    )
    kinds = [event.kind for event in result.events]
    assert kinds.count("switch") == metrics["id_switches"]
    assert kinds.count("misidentification") == metrics["misidentifications"]
    assert kinds.count("lost") == metrics["lost_tracks"]
    assert (result.match_distances_m <= 0.5).all()
    if result.match_distances_m.size:
        assert result.match_distances_m.mean() == pytest.approx(metrics["motp_m"])
    assert [event.stamp_ns for event in result.events] == sorted(event.stamp_ns for event in result.events)
