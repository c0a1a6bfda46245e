"""The plain baseline: filterpy's filter, the best of all assignments, rules of birth and death; and as motmetrics counts."""

from __future__ import annotations

from itertools import permutations

import motmetrics
import numpy as np
import pytest
from filterpy.common import Q_discrete_white_noise
from filterpy.kalman import KalmanFilter
from synthetic_room import Walk, empty_room, observe, rig, scan, straight_walk, wandering

from trackers.feeding import track_frames
from trackers.observations import NS_PER_S, LaserScan
from trackers.sort import KalmanTracks, Sort, SortOptions, of_both_axes
from trackers.tracks import TrackFrame

WAIST = rig(knee=False, camera=False).model_copy(update={"area": None})
EMPTY = [each for each in empty_room(np.random.default_rng(1)) if each.sensor == "waist"]
SPEED_M_S = 0.9


def scans(walk: Walk, shown: np.ndarray | None = None, every_s: float = 0.1) -> list[LaserScan]:
    """Scans at waist height of those who are `shown` (n_t, n), everybody by default; nothing else hides them."""
    rng = np.random.default_rng(5)
    shown = np.ones(walk.heading.shape, np.bool_) if shown is None else shown
    return [
        scan(
            Walk(walk.position[:, seen], walk.heading[:, seen], walk.phase[:, seen]) if seen.any() else None,
            k,
            "waist",
            round((1 + every_s * k) * NS_PER_S),
            rng,
        )
        for k, seen in enumerate(shown)
    ]


def frames_of(given: list[LaserScan], **options) -> list[TrackFrame]:
    return list(track_frames(Sort(WAIST, EMPTY, **options), WAIST, given))


# --- against the textbook


class Person:
    """One person's filter, as the paper has it on the ground plane, by filterpy alone."""

    def __init__(self, place: np.ndarray, t: float, options: SortOptions) -> None:
        self.id, self.t, self.hits, self.options = 0, t, 1, options
        self.filter = made = KalmanFilter(dim_x=4, dim_z=2)
        made.x = np.array([place[0], 0, place[1], 0])
        made.P = np.diag([0.01, 1.0, 0.01, 1.0])
        made.H = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0]])
        made.R = np.eye(2) * options.measurement_m**2

    def predict(self, dt: float, was_missed: bool) -> None:
        keep = np.exp(-dt / self.options.slowdown_s) if was_missed else 1.0
        F = np.kron(np.eye(2), [[1, dt], [0, keep]])
        variance = self.options.acceleration_m_s2**2
        self.filter.predict(F=F, Q=Q_discrete_white_noise(2, dt, variance, block_size=2))

    def distance(self, place: np.ndarray) -> float:
        """Mahalanobis, infinite beyond the gates."""
        off, S = place - self.filter.x[::2], self.filter.H @ self.filter.P @ self.filter.H.T + self.filter.R
        away = float(np.sqrt(off @ np.linalg.inv(S) @ off))
        return away if away <= self.options.gate and np.hypot(*off) <= self.options.radius_m else np.inf


def best(cost: np.ndarray) -> list[tuple[int, int]]:
    """Of all one-to-one pairings with the most finite pairs the one of least total cost, by trying them all."""
    n, k = cost.shape
    padded = np.full((n, k + n), np.inf)
    padded[:, :k] = cost
    found: tuple[tuple[float, float], list[tuple[int, int]]] = ((1.0, 0.0), [])
    for columns in permutations(range(k + n), n) if k else ():
        pairs = [(row, column) for row, column in enumerate(columns) if column < k and cost[row, column] < np.inf]
        worth = (-len(pairs), sum(cost[pair] for pair in pairs))
        found = min(found, (worth, pairs))
    return found[1]


def textbook(detections: list[tuple[float, np.ndarray]], options: SortOptions) -> list[list[tuple]]:
    """Tracks (id, x, y, vx, vy, status) at each time, of detections (t, (k, 2))."""
    people: list[Person] = []
    last, n_id, told = 0.0, 0, []
    for t, places in detections:
        for each in people:
            each.predict(t - last, each.t < last)
        free = list(range(len(places)))
        for group in ([each for each in people if each.id], [each for each in people if not each.id]):
            cost = np.array([[each.distance(places[k]) for k in free] for each in group]).reshape(len(group), len(free))
            pairs = [(group[row], free[column]) for row, column in best(cost)]
            for each, k in pairs:
                each.filter.update(places[k])
                each.t, each.hits = t, each.hits + 1
                if not each.id and each.hits == options.track_management.confirm_hits:
                    n_id += 1
                    each.id = n_id
            free = [k for k in free if k not in {taken for _, taken in pairs}]
        people = [
            each for each in people if t - each.t <= (options.track_management.coast_s + 1e-6 if each.id else 0.0)
        ]
        for k in free:
            if all(
                np.hypot(*(each.filter.x[::2] - places[k])) > options.track_management.start_apart_m for each in people
            ):
                people.append(Person(places[k], t, options))
        shown = [each for each in people if each.id and t - each.t <= options.track_management.report_s + 1e-6]
        told.append(
            [(each.id, *each.filter.x[[0, 2, 1, 3]], "confirmed" if each.t == t else "coasting") for each in shown]
        )
        last = t
    return told


@pytest.mark.parametrize(
    ("n_person", "seed", "every_s", "options"),
    [
        (2, 1, 0.1, {}),
        (4, 2, 0.1, {}),
        (4, 3, 0.13, {"track_management": {"confirm_hits": 2, "coast_s": 0.6, "report_s": 0.3}}),
        (4, 4, 0.07, {"acceleration_m_s2": 8.0, "measurement_m": 0.04, "gate": 2.0, "radius_m": 0.3}),
        (3, 5, 0.1, {"track_management": {"start_apart_m": 0.1}, "slowdown_s": 2.0}),
    ],
)
def test_tracks_are_those_of_filterpys_filters_and_the_best_of_all_assignments(n_person, seed, every_s, options):
    """To nine places, so that gains, and with them covariances, agree too; a third of what is seen is taken away now and then."""
    rng = np.random.default_rng(seed)
    walk = wandering(n_person, 60, rng)
    shown = rng.random(walk.heading.shape) < np.where(np.arange(60) % 20 < 12, 1.0, 0.6)[:, None]
    tracker, detections, frames = Sort(WAIST, EMPTY, **options), [], []
    for each in scans(walk, shown, every_s):
        frames += tracker.update(each)
        told = tracker.detections()
        detections.append((each.t, np.array([(one.x, one.y) for one in told]).reshape(-1, 2)))
    frames += tracker.finish()
    expected = textbook(detections, SortOptions(**options))
    assert len(frames) == len(expected)
    n_pair = 0
    for frame, textbooks in zip(frames, expected, strict=True):
        assert [(track.id, track.status) for track in frame.tracks] == [(each[0], each[-1]) for each in textbooks]
        for track, each in zip(frame.tracks, textbooks, strict=True):
            np.testing.assert_allclose((track.x, track.y, track.vx, track.vy), each[1:5], rtol=0, atol=1e-9)
            n_pair += 1
    assert n_pair > 40


def test_the_best_assignment_is_not_the_greedy_one():
    """Two stand 0.45 m apart and both step 0.25 m aside: the nearest pair of all would leave the other two without a partner."""
    places = np.array([(0.0, 1.5), (0.45, 1.5)])
    walk = straight_walk(places, [(0.0, 0.0)] * 2, 12)
    walk.position[6:] += (0.25, 0.0)
    frames = frames_of(scans(walk), radius_m=0.3, track_management={"start_apart_m": 0.3})
    for frame in frames[3:]:
        assert [track.status for track in frame.tracks] == ["confirmed"] * 2
    ends = {track.id: track.x for track in frames[-1].tracks}
    assert ends == pytest.approx({1: 0.25, 2: 0.7}, abs=0.06) or ends == pytest.approx({2: 0.25, 1: 0.7}, abs=0.06)
    starts = {track.id: track.x for track in frames[4].tracks}
    assert {number: ends[number] - starts[number] for number in ends} == pytest.approx({1: 0.25, 2: 0.25}, abs=0.06)


def test_who_is_confirmed_chooses_before_who_is_not():
    walk = straight_walk([(0.0, 1.5), (0.45, 1.5), (0.3, 1.5)], [(0.0, 0.0)] * 3, 9)
    k = np.arange(9)
    shown = np.stack([k < 8, (k >= 6) & (k < 8), k == 8], axis=1)
    (last,) = frames_of(scans(walk, shown), radius_m=0.5, track_management={"start_apart_m": 0.3, "confirm_hits": 4})[
        -1
    ].tracks
    assert (last.id, last.status) == (1, "confirmed") and last.x > 0.05


# --- birth and death


def seen_at(n: int, *spans: tuple[int, int]) -> np.ndarray:
    """One person in sight in these spans of n scans."""
    k = np.arange(n)
    return np.any([(first <= k) & (k < end) for first, end in spans], axis=0)[:, None]


def told_of(shown: np.ndarray, **options) -> list[list[tuple[int, str]]]:
    """Ids and states, scan by scan, of somebody who stands."""
    walk = straight_walk([(0.3, 1.5)], [(0.0, 0.0)], len(shown))
    return [[(track.id, track.status) for track in frame.tracks] for frame in frames_of(scans(walk, shown), **options)]


@pytest.mark.parametrize("hits", [1, 2, 3, 5])
def test_so_many_measurements_in_a_row_confirm(hits):
    told = told_of(seen_at(8, (0, 8)), track_management={"confirm_hits": hits})
    # the first scan can only begin somebody
    assert [len(each) for each in told] == [int(k + 1 >= max(hits, 2)) for k in range(8)]
    assert (
        not any(
            told_of(
                seen_at(20, *((k, k + hits - 1) for k in range(0, 20, hits))), track_management={"confirm_hits": hits}
            )
        )
        or hits == 1
    )


def test_who_is_missed_coasts_in_sight_then_out_of_it_then_ends():
    for gap, number in ((3, 1), (10, 1), (19, 1), (21, 2), (25, 2)):
        told = told_of(seen_at(6 + gap + 6, (0, 6), (6 + gap, 6 + gap + 6)))
        assert told[5] == [(1, "confirmed")]
        assert [bool(each) for each in told[6 : 6 + gap]] == [k < 4 for k in range(gap)]  # 0.4 s
        assert {each for frame in told[6 : 6 + gap] for each in frame} == {(1, "coasting")}
        assert told[-1] == [(number, "confirmed")]


@pytest.mark.parametrize(("away_m", "n"), [(0.5, 1), (0.75, 2)])
def test_nobody_begins_near_somebody(away_m, n):
    walk = straight_walk([(-0.4, 1.5), (-0.4 + away_m, 1.5)], [(0.0, 0.0)] * 2, 14)
    shown = np.ones((14, 2), np.bool_)
    shown[:6, 1] = False
    assert len(frames_of(scans(walk, shown), radius_m=0.3)[-1].tracks) == n


def test_who_is_in_sight_goes_on_and_who_is_missed_is_likelier_to_stop():
    walk = straight_walk([(-1.5, 1.5)], [(SPEED_M_S, 0.0)], 25)
    frames = [frame.tracks for frame in frames_of(scans(walk, seen_at(25, (0, 20))))]
    in_sight = [each.vx for tracks in frames[8:20] for each in tracks]
    assert np.mean(in_sight) == pytest.approx(SPEED_M_S, rel=0.12)
    coasting = [each.vx for tracks in frames[20:] for each in tracks]
    assert len(coasting) == 4 and 0 < coasting[-1] < 0.7 * in_sight[-1]
    assert all(each.status == "coasting" for tracks in frames[20:] for each in tracks)


# --- as others count


def summary(walk: Walk, frames: list[TrackFrame]):
    """motmetrics' figures at 0.5 m, from the tenth scan on."""
    accumulator = motmetrics.MOTAccumulator(auto_id=True)
    for k, frame in enumerate(frames[10:], start=10):
        at = np.array([(track.x, track.y) for track in frame.tracks]).reshape(-1, 2)
        away = np.linalg.norm(walk.position[k][:, None] - at[None], axis=-1)
        numbers = [track.id for track in frame.tracks]
        accumulator.update(list(range(walk.n_person)), numbers, np.where(away < 0.5, away, np.nan))
    names = ["mota", "motp", "idf1", "num_switches", "num_false_positives"]
    return motmetrics.metrics.create().compute(accumulator, metrics=names).iloc[0]


def test_who_cross_at_arms_length_keep_their_ids():
    crossing = straight_walk([(-1.6, 1.0), (1.6, 1.9), (-0.3, 2.6)], [(0.8, 0.0), (-0.8, 0.0), (0.1, 0.0)], 42)
    on = rig(camera=False)
    given = observe(crossing, 7, images=False)
    found = summary(crossing, list(track_frames(Sort(on, empty_room(np.random.default_rng(1))), on, given)))
    assert (found.num_switches, found.num_false_positives) == (0, 0)
    assert found.mota > 0.97 and found.idf1 > 0.98 and found.motp < 0.1


@pytest.mark.parametrize("seed", range(3))
def test_five_who_wander_are_followed_for_the_most_part(seed):
    walk = wandering(5, 80, np.random.default_rng(seed))
    on = rig(camera=False)
    given = observe(walk, seed, images=False)
    found = summary(walk, list(track_frames(Sort(on, empty_room(np.random.default_rng(1))), on, given)))
    assert found.mota > 0.8 and found.motp < 0.12 and found.idf1 > 0.6


def test_filters_worked_together_are_filterpy_s_to_the_bit():
    rng = np.random.default_rng(5)
    places, n, sigma_m = rng.normal(size=(6, 2)), 6, 0.1
    tracks, singles = KalmanTracks.started(places), []
    for place in places:
        one = KalmanFilter(dim_x=4, dim_z=2)
        one.x, one.H, one.R = np.array([place[0], 0, place[1], 0]), np.eye(4)[::2], np.eye(2) * sigma_m**2
        one.P = np.diag([0.01, 1.0] * 2)
        singles.append(one)
    F = np.stack([of_both_axes(np.array([[1, 0.1], [0, keep]])) for keep in rng.uniform(0.5, 1, n)])
    Q = of_both_axes(np.outer([0.005, 0.1], [0.005, 0.1])) * 9.0
    for _ in range(5):
        rows, measured = np.flatnonzero(rng.random(n) < 0.7), rng.normal(size=(n, 2))
        tracks = tracks.predicted(F, Q).updated(rows, measured[rows], sigma_m)
        for k, one in enumerate(singles):
            one.predict(F=F[k], Q=Q)
            if k in rows:
                one.update(measured[k])
    np.testing.assert_array_equal(tracks.mean, [one.x for one in singles])
    np.testing.assert_array_equal(tracks.covariance, [one.P for one in singles])
