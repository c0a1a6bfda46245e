"""Which frames are judged, of how many, and that a far stamp costs no more than its row."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings, strategies as st

from trackers.errors import InputError
from trackers.observations import NS_PER_S
from trackers.tracks import Track, TrackFrame
from twin.evaluate import evaluate_with_details
from twin.evaluate.judged_frames import align
from twin.evaluate.report_clock import report_clock, silent_stamps, truth_at as interpolated
from twin.recording.tables import track_table, truth_table
from twin.truth.truth_types import PersonTruth, TruthFrame

FAR_S = (-1.7e9, -3e4, 1e4, 1.7e9, 9e9)


def truth_at(stamps_s, walk=lambda t: (0.1 * t, 0.0)):
    frames = [
        TruthFrame(round(t * NS_PER_S), (PersonTruth(1, *walk(t)), PersonTruth(2, walk(t)[0], 3.0))) for t in stamps_s
    ]
    return truth_table(frames, "truth.csv")


def tracks_at(stamps_s, walk=lambda t: (0.1 * t, 0.0)):
    frames = [TrackFrame(round(t * NS_PER_S), (Track(7, *walk(t)), Track(8, walk(t)[0], 3.0))) for t in stamps_s]
    return track_table(frames, "tracks.csv")


def wanted_in_silence(truth_ns: np.ndarray, track_ns: np.ndarray, period: float, silent: float) -> list[int]:
    """The rule in its plainest form: every period of every silence, step by step."""
    wanted = []
    for before, after in zip(track_ns[:-1].tolist(), track_ns[1:].tolist(), strict=True):
        if after - before > silent:
            wanted += [before + step * period for step in range(1, int((after - before) / period + 0.5))]
    first, last, start, end = track_ns[0], track_ns[-1], truth_ns[0], truth_ns[-1]
    if first - start > silent:
        wanted += [first - step * period for step in range(1, int((first - start) / period + 0.25) + 1)]
    if end - last > silent:
        wanted += [last + step * period for step in range(1, int((end - last) / period + 0.25) + 1)]
    found = set()
    for time in wanted:
        gaps = np.abs(truth_ns - time)
        nearest = int(truth_ns[np.argmin(gaps)])  # the earlier of two alike
        if gaps.min() <= period / 2:
            found.add(nearest)
    return sorted(found - set(track_ns.tolist()))


@settings(max_examples=150, deadline=None)
@given(
    track_gaps=st.lists(st.sampled_from([10, 10, 10, 5, 16, 30, 170]), min_size=1, max_size=25),
    truth_gaps=st.lists(st.sampled_from([10, 5, 3, 20, 400]), min_size=1, max_size=60),
    start=st.integers(-100, 300),
)
def test_silence_is_filled_with_the_truths_stamps(track_gaps, truth_gaps, start) -> None:
    track_ns = np.cumsum([0, *track_gaps]).astype(np.int64) * 1_000_000
    truth_ns = (start + np.cumsum([0, *truth_gaps]).astype(np.int64)) * 1_000_000
    clock = report_clock(track_ns, truth_ns)
    assert clock is not None and clock.period_ns < clock.silence_ns
    found = silent_stamps(truth_ns, track_ns, clock).tolist()
    assert found == wanted_in_silence(truth_ns, track_ns, clock.period_ns, clock.silence_ns)


@pytest.mark.parametrize("far_s", FAR_S)
@pytest.mark.parametrize("where", ["tracks", "truth", "both"])
def test_a_far_stamp_changes_nothing_but_the_n(far_s: float, where: str) -> None:
    stamps = np.arange(0, 10, 0.1)
    with_far = sorted([*stamps, far_s])
    plain = evaluate_with_details(truth_at(stamps), tracks_at(stamps)).metrics
    far = evaluate_with_details(
        truth_at(with_far if where != "tracks" else stamps, walk=lambda t: (0.0, 0.0)),
        tracks_at(with_far if where != "truth" else stamps, walk=lambda t: (0.0, 0.0)),
    ).metrics
    n = {"tracks": (100, 101), "truth": (100, 100), "both": (101, 101)}[where]
    assert (far["judged"]["frames"], far["judged"]["frames_total"]) == n
    assert {name: far[name] for name in ("mota", "misses", "false_positives", "idf1")} == {
        name: plain[name] for name in ("mota", "misses", "false_positives", "idf1")
    }


def test_a_tracker_that_stops_halfway_is_judged_to_the_end_even_after_a_pause_of_the_truth() -> None:
    stamps = np.concatenate([np.arange(0, 5, 0.1), np.arange(65, 70, 0.1)])
    metrics = evaluate_with_details(truth_at(stamps), tracks_at(stamps[:50])).metrics
    assert (metrics["judged"]["frames"], metrics["misses"]) == (100, 100)


@settings(max_examples=40, deadline=None)
@given(
    truth_hz=st.sampled_from([1.0, 2.5, 3.3, 7.5, 30.0]),
    track_hz=st.sampled_from([4.0, 9.97, 25.0]),
    jitter=st.floats(0, 0.15),
    seed=st.integers(0, 2**16),
)
@example(truth_hz=2.5, track_hz=10.0, jitter=0.1, seed=0)
def test_truth_of_any_rate_is_interpolated_between_its_own_rows(truth_hz, track_hz, jitter, seed) -> None:
    rng = np.random.default_rng(seed)
    truth_s = np.arange(0, 10 * truth_hz) / truth_hz
    track_s = np.arange(0.013, truth_s[-1], 1 / track_hz)
    truth_s[1:-1] += rng.uniform(-jitter, jitter, truth_s.size - 2) / truth_hz
    found = evaluate_with_details(truth_at(truth_s), tracks_at(track_s))
    judged = found.metrics["judged"]
    assert (judged["frames"], judged["person_frames"]) == (track_s.size, 2 * track_s.size)
    assert found.metrics["mota"] == 1.0
    # people walk straight on between rows, to the rounding of stamps
    assert found.metrics["motp_m"] == pytest.approx(0, abs=1e-6)


def test_interpolation_over_more_than_a_quarter_of_a_second_is_said() -> None:
    sparse = evaluate_with_details(truth_at(np.arange(0, 10, 0.4)), tracks_at(np.arange(0, 9.5, 0.1) + 0.03))
    assert any("rows come every 0.4 s; between rows at most 1 s apart" in note for note in sparse.notes)
    dense = evaluate_with_details(truth_at(np.arange(0, 10, 0.1)), tracks_at(np.arange(0, 9.8, 0.1) + 0.03))
    assert dense.notes == ()


def test_a_hole_of_several_rows_is_not_interpolated() -> None:
    stamps = [t for t in np.arange(0, 20, 0.4) if not 5 < t < 9]
    found = evaluate_with_details(truth_at(stamps), tracks_at(np.arange(0, 19, 0.1)))
    assert not ((found.stamps_ns > 5 * NS_PER_S) & (found.stamps_ns < 8.8 * NS_PER_S)).any()
    assert any("does not say where people are" in note for note in found.notes)


@pytest.mark.parametrize(("outside", "noted", "little"), [(1, False, False), (5, True, False), (150, True, True)])
def test_frames_that_are_not_judged_are_noted(outside: int, noted: bool, little: bool) -> None:
    truth = truth_at(np.arange(0, 10, 0.1))
    found = evaluate_with_details(truth, tracks_at(np.arange(0, 100 + outside) / 10 - 1e-12))
    said = " ".join(found.notes)
    assert found.metrics["judged"]["frames"] == 100
    assert found.metrics["judged"]["share"] == pytest.approx(100 / (100 + outside))
    assert (f"evaluated in 100 of {100 + outside} frames" in said) == noted
    assert ("less than half" in said) == little


@pytest.mark.parametrize(
    ("of_tracks", "of_truth", "how"),
    [
        (lambda t: 1e3 * t, lambda t: t, "t of the tracks in ms"),
        (lambda t: 1e6 * t, lambda t: t, "t of the tracks in µs"),
        (lambda t: t, lambda t: 1e3 * t, "t of the truth in ms"),
        (lambda t: 1.7e9 + t, lambda t: t, "t of both from their first rows on"),
        (lambda t: t, lambda t: 1.7e9 + t, "t of both from their first rows on"),
        (lambda t: t, lambda t: 0.1 * t, ""),  # another frame rate: at 10 kHz nobody reports
        (lambda t: 40 + t if t < 10 else 1e5 + t * t, lambda t: t, ""),
    ],
)
@pytest.mark.parametrize("start", [0.5, 3.0])
def test_another_unit_or_start_of_t_is_named(of_tracks, of_truth, how, start) -> None:
    stamps = start + np.arange(200) / 10
    truth, tracks = truth_at(map(of_truth, stamps)), tracks_at(map(of_tracks, stamps))
    try:
        (said,) = [note for note in align(truth, tracks).notes if "of less than half" in note]
    except InputError as error:
        said = str(error)
    assert f"; {how} would cover " in said if how else "would cover" not in said


@pytest.mark.parametrize("which", [0, 1])
@pytest.mark.parametrize("n_rows", [10, 40])
def test_rows_without_the_identity_of_anybody_are_told(which: int, n_rows: int) -> None:
    stamps = np.arange(n_rows // 2) / 10
    tables = [truth_at(stamps), tracks_at(stamps)]
    tables[which] = replace(tables[which], id=np.arange(1, 1 + n_rows))
    said = f"{tables[which].source}: no id is in two of {n_rows} rows"
    assert any(each.startswith(said) for each in evaluate_with_details(*tables).notes) == (n_rows > 20)


@pytest.mark.parametrize("off_s", [-0.02, -3.3e-5, 0.0, 3.3e-5, 0.02])
@pytest.mark.parametrize("looked_up", [False, True])
def test_labels_less_than_half_a_period_off_are_those_of_the_nearest_frame(off_s: float, looked_up: bool) -> None:
    """Labels are rounded, and clocks jitter: the first and the last one count, and nobody stays longer than labelled."""
    frames_ns = [round(k / 15 * NS_PER_S) for k in range(40)]
    truth = truth_table(
        [
            TruthFrame(ns + round(off_s * NS_PER_S), tuple(PersonTruth(i, i, 0.1 * k) for i in (1, 2) if k < 40 / i))
            for k, ns in enumerate(frames_ns)
        ]
    )
    if looked_up:
        truth = interpolated(truth, np.array(frames_ns), np.array(frames_ns))
    found = align(truth, tracks_at(np.array(frames_ns) / NS_PER_S))
    assert [frame.person_ids.size for frame in found.frames] == [2] * 20 + [1] * 20
    ys = np.array([frame.person_xy[0, 1] for frame in found.frames])
    np.testing.assert_allclose(ys, 0.1 * np.arange(40), atol=1.5 * abs(off_s) + 1e-6)


@pytest.mark.parametrize("inside", [0, 1, 20])
def test_truth_with_nobody_in_the_area_is_told(inside: int) -> None:
    truth = truth_at(np.arange(20) / 10)
    truth = replace(truth, in_area=np.arange(truth.id.size) < inside)
    notes = evaluate_with_details(truth, tracks_at(np.arange(20) / 10)).notes
    assert any("nobody is in the area in any of 20 frames" in each for each in notes) == (not inside)


def test_truth_that_overlaps_but_covers_no_stamp_is_refused_for_that_reason() -> None:
    truth = truth_table([TruthFrame(ns, (PersonTruth(1, 0, 0),)) for ns in (0, 10**8, 10**10, 10**10 + 10**8)])
    with pytest.raises(InputError, match="between two of them at most 0.25 s apart") as refused:
        align(truth, tracks_at([4.0, 5.0]))
    assert "same clock" not in str(refused.value)


def test_work_goes_with_the_rows_where_all_people_come_once() -> None:
    n = 3000  # people x stamps in an array of their poses would be half a gigabyte
    frames = [TruthFrame(k * NS_PER_S // 10, (PersonTruth(k + 1, 0, 0),)) for k in range(n)]
    tracks = [TrackFrame(k * NS_PER_S // 10, ()) for k in range(n)]
    aligned = align(truth_table(frames), track_table(tracks))
    assert [frame.person_ids.size for frame in aligned.frames] == [1] * n


# --- silences


def owed(truth, tracks) -> tuple[int, int]:
    """Count the frames judged without a track, and all judged frames."""
    frames = align(truth, tracks).frames
    assert all(frame.person_ids.size == 2 for frame in frames)
    return sum(frame.track_ids.size == 0 for frame in frames), len(frames)


def comb(rate_hz: float, phase: float, jitter: float, rng: np.random.Generator, end_s: float = 12.0) -> np.ndarray:
    """Stamps of a sensor [s]: every period from `phase` periods on, each off by up to `jitter` periods."""
    n = int((end_s - 0.5) * rate_hz)
    return (np.arange(n) + phase + rng.uniform(-jitter, jitter, n)) / rate_hz + 0.2


def truth_of(kind: str, sensors_s: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Stamps of the truth from the first to the last of the sensors': the twin's, a motion capture's, a person's labels."""
    if kind == "sensors":
        return np.unique(sensors_s)
    rate_hz, jitter = {"120 Hz": (120.0, 0.0), "25 Hz": (25.0, 0.1), "2.5 Hz": (2.5, 0.3)}[kind]
    first, last = sensors_s.min(), sensors_s.max()
    even = np.linspace(first, last, int((last - first) * rate_hz) + 2)
    even[1:-1] += rng.uniform(-jitter, jitter, even.size - 2) / rate_hz
    return even


TRUTHS = ("sensors", "120 Hz", "25 Hz", "2.5 Hz")


@settings(max_examples=25, deadline=None)
@given(
    rate_hz=st.sampled_from([4.0, 7.5, 9.97, 10.0, 25.0, 40.0]),
    every=st.integers(5, 25),
    jitter=st.floats(0, 0.05),
    truth=st.sampled_from(TRUTHS),
    seed=st.integers(0, 2**16),
)
@example(rate_hz=10.0, every=10, jitter=0.0, truth="2.5 Hz", seed=0)
@example(rate_hz=10.0, every=10, jitter=0.05, truth="sensors", seed=0)
@example(rate_hz=4.0, every=5, jitter=0.0, truth="2.5 Hz", seed=0)  # truth that is little sparser than the frames
def test_frames_left_out_are_owed_whatever_truth_it_is(rate_hz, every, jitter, truth, seed) -> None:
    rng = np.random.default_rng(seed)
    sensor_s = comb(rate_hz, 0.0, jitter, rng)
    left_out = np.arange(sensor_s.size) % every == every // 2
    left_out[-1] = False
    truth_rows = truth_at(truth_of(truth, sensor_s, rng))
    without = tracks_at(sensor_s[~left_out])
    assert owed(truth_rows, tracks_at(sensor_s)) == (0, sensor_s.size)
    assert owed(truth_rows, without) == (left_out.sum(), sensor_s.size)
    noted = f"reports nothing in {left_out.sum()} of {sensor_s.size} frames"
    assert any(noted in note for note in align(truth_rows, without).notes) == (left_out.mean() > 0.02)


@settings(max_examples=10, deadline=None)
@given(every=st.sampled_from([3, 4]), rate_hz=st.sampled_from([5.0, 10.0, 40.0]), jitter=st.floats(0, 0.05))
def test_a_third_or_a_fourth_of_the_frames_is_owed_where_the_truth_has_their_stamps(every, rate_hz, jitter) -> None:
    stamps = comb(rate_hz, 0.0, jitter, np.random.default_rng(1))
    left_out = np.arange(stamps.size) % every == 1
    left_out[-1] = False
    assert owed(truth_at(stamps), tracks_at(stamps[~left_out])) == (left_out.sum(), stamps.size)


@settings(max_examples=25, deadline=None)
@given(
    share=st.floats(0.02, 0.2), truth=st.sampled_from(TRUTHS), rate_hz=st.sampled_from([5.0, 10.0]), seed=st.integers(0)
)
def test_frames_left_out_at_random_never_pay(share, truth, rate_hz, seed) -> None:
    rng = np.random.default_rng(seed)
    stamps = comb(rate_hz, 0.0, 0.03, rng)
    truth_rows = truth_at(truth_of(truth, stamps, rng))
    wrong = np.zeros(stamps.size, bool)
    wrong[rng.choice(np.arange(1, stamps.size - 1), int(share * stamps.size), replace=False)] = True
    assert owed(truth_rows, tracks_at(stamps[~wrong])) == (wrong.sum(), stamps.size)


@pytest.mark.parametrize("truth", TRUTHS)
@pytest.mark.parametrize(
    "sensors",
    [
        [(10.0, 0.0), (25.0, 0.0)],
        [(10.0, 0.0), (10.0, 0.3)],
        [(10.0, 0.0), (5.0, 0.25)],
        [(10.0, 0.0), (1.0, 0.03)],
        [(30.0, 0.0), (10.0, 0.5)],
        [(7.5, 0.0), (12.0, 0.4)],
        [(40.0, 0.0), (4.0, 0.2)],
    ],
    ids=str,
)
def test_sensors_of_unlike_rates_owe_nothing(sensors, truth) -> None:
    rng = np.random.default_rng(5)
    stamps = np.unique(np.round(np.concatenate([comb(rate, phase, 0.0, rng) for rate, phase in sensors]), 6))
    assert owed(truth_at(truth_of(truth, stamps, rng)), tracks_at(stamps)) == (0, stamps.size)
    # and one of them alone owes nothing of the other's stamps
    own = np.round(comb(sensors[0][0], sensors[0][1], 0.0, rng), 6)
    truth_s = truth_of(truth, stamps, rng)
    truth_s = truth_s[truth_s <= own[-1]]
    assert owed(truth_at(truth_s), tracks_at(own))[0] == 0


def test_a_long_silence_weighs_its_time_under_sparse_truth_too() -> None:
    stamps = np.arange(0, 20, 0.1)
    silent = (stamps > 5) & (stamps < 15)
    metrics = evaluate_with_details(truth_at(np.arange(0, 20.3, 0.4)), tracks_at(stamps[~silent])).metrics
    assert (metrics["misses"], metrics["judged"]["frames"]) == (2 * silent.sum(), stamps.size)


mixes = st.lists(st.tuples(st.floats(3, 40), st.floats(0, 1)), min_size=1, max_size=6)


def mix(sensors: list[tuple[float, float]], jitter: float, rng: np.random.Generator) -> np.ndarray:
    """Stamps of sensors of these rates [Hz] and phases, each frame off by up to `jitter` periods [s]."""
    return np.unique(np.round(np.concatenate([comb(rate, phase, jitter, rng) for rate, phase in sensors]), 6))


@settings(max_examples=40, deadline=None)
@given(sensors=mixes, jitter=st.floats(0, 0.1), truth=st.sampled_from(TRUTHS[:3]), seed=st.integers(0, 2**16))
def test_any_mix_of_rates_owes_nothing(sensors, jitter, truth, seed) -> None:
    rng = np.random.default_rng(seed)
    stamps = mix(sensors, jitter, rng)
    assert owed(truth_at(truth_of(truth, stamps, rng)), tracks_at(stamps))[0] <= 0.01 * stamps.size


@settings(max_examples=40, deadline=None)
@given(sensors=mixes, jitter=st.floats(0, 0.1), truth=st.sampled_from(TRUTHS[:3]), seed=st.integers(0, 2**16))
def test_two_silent_seconds_are_owed_by_any_mix_of_rates(sensors, jitter, truth, seed) -> None:
    rng = np.random.default_rng(seed)
    stamps = mix(sensors, jitter, rng)
    reported = stamps[(stamps < 5) | (stamps >= 7)]
    frames = align(truth_at(truth_of(truth, stamps, rng)), tracks_at(reported)).frames
    without = np.array([frame.stamp_ns / NS_PER_S for frame in frames if frame.track_ids.size == 0])
    before, after = reported[reported < 5][-1], reported[reported > 5][0]
    in_silence = np.count_nonzero((without > before) & (without < after))
    expected = (after - before) / np.diff(reported[reported < 5]).mean()
    # sensors of one phase have stamps at few of the times due
    least = expected if truth != "sensors" else (after - before) * max(rate for rate, _ in sensors)
    assert 0.7 * least - 1 <= in_silence <= 1.3 * expected + 1
    assert without.size - in_silence <= 0.01 * stamps.size


@settings(max_examples=25, deadline=None)
@given(sensors=mixes, lost=st.floats(0.01, 0.2), truth=st.sampled_from(TRUTHS[:3]), seed=st.integers(0, 2**16))
@example(sensors=[(3.25, 0.0), (10.125, 0.0)], lost=0.0625, truth="sensors", seed=45)
def test_a_mix_with_frames_left_out_owes_no_more_than_these_or_than_their_time(sensors, lost, truth, seed) -> None:
    """Frames of a mix are left out where they are seldom rather than where they crowd: their time is worth more of the mean."""
    rng = np.random.default_rng(seed)
    stamps = mix(sensors, 0.05, rng)
    left_out = rng.random(stamps.size) < lost
    left_out[[0, -1]] = False
    reported = stamps[~left_out]
    silent, _ = owed(truth_at(truth_of(truth, stamps, rng)), tracks_at(reported))
    after = np.unique(np.searchsorted(reported, stamps[left_out]))
    periods = (reported[after] - reported[after - 1]) / np.diff(stamps).mean()
    assert silent <= max(left_out.sum(), (periods - 1).sum()) + 0.01 * stamps.size


@settings(max_examples=25, deadline=None)
@given(
    slow=st.floats(5, 20),
    faster=st.floats(1.02, 1.4),
    phase=st.floats(0, 1),
    apart=st.floats(0.3, 0.45),
    seed=st.integers(0),
)
@example(slow=10.0, faster=1.27, phase=0.0, apart=0.41, seed=0)
def test_a_tracker_that_joins_scans_of_close_rates_owes_nothing(slow, faster, phase, apart, seed) -> None:
    rng = np.random.default_rng(seed)
    first, second = comb(slow, 0.0, 0.01, rng), comb(slow * faster, phase, 0.01, rng)
    far = np.abs(second[:, None] - first).min(axis=1) > apart / slow  # nearer ones join the frame of the slower scanner
    stamps = np.unique(np.round(np.concatenate([first, second[far]]), 6))
    truth = truth_at(np.unique(np.round(np.concatenate([first, second]), 6)))
    assert owed(truth, tracks_at(stamps))[0] == 0


@pytest.mark.parametrize(("unit", "per_s"), [("ms", 1e3), ("µs", 1e6)])
@pytest.mark.parametrize("truth_hz", [2.5, 10.0, 30.0])
def test_truth_from_0_in_another_unit_is_told_with_it(unit: str, per_s: float, truth_hz: float) -> None:
    tracks = tracks_at(np.arange(0.1, 20, 0.1))
    notes = align(truth_at(np.arange(0, 20, 1 / truth_hz) * per_s, walk=lambda t: (0.0, 0.0)), tracks).notes
    assert sum(f"t in s is expected, and in {unit} the two would span about the same" in each for each in notes) == 1
    seldom = align(truth_at(np.arange(0, 20.1, 2.0)), tracks).notes
    assert len(seldom) == 1 and "span" not in seldom[0]


@settings(max_examples=10, deadline=None)
@given(n_reported=st.integers(0, 3), rate_hz=st.sampled_from([4.0, 10.0, 40.0]))
def test_a_rhythm_is_named_only_of_tracks_that_have_two_frames(n_reported, rate_hz) -> None:
    stamps = np.arange(20) / rate_hz
    (note,) = (each for each in align(truth_at(stamps), tracks_at(stamps[:n_reported])).notes if "nothing in" in each)
    assert ("though it reports every" in note) == (n_reported > 1)
