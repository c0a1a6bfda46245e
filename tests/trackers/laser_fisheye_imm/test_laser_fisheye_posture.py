"""Who sits, who lies down out of every scan, and who is gone."""

from __future__ import annotations

import numpy as np
import pytest
from synthetic_room import empty_room, rig
from test_laser_fisheye_association import detections

from trackers.laser.clusters import Detections
from trackers.laser_fisheye_imm.detection import Seen
from trackers.laser_fisheye_imm.laser_tracks import LegPosture, PostureOptions
from trackers.laser_fisheye_imm.tracker import LaserFisheyeImm
from trackers.likelihood.legs import LegOptions, TrunkOptions, legs_ahead_m, pair_legs
from trackers.observations import NS_PER_S, LaserScan
from trackers.tracking.synced_frames import SyncedFrame

SEAT, ELSEWHERE = (-1.0, 2.4), (1.2, 1.0)
KNEES = ((-1.1, 1.96), (-0.9, 1.96))  # 0.44 m before the trunk, as measured
BEHIND, BESIDE = ((-1.1, 2.42), (-0.9, 2.38)), ((1.1, 1.0), (1.3, 1.0))
UPRIGHT_UNSEEN = 0.05


class Room:
    """The tracker, told what its scanners see at each moment."""

    def __init__(self, monkeypatch, rate_hz=10, waist=True, **options):
        self.rate_hz = rate_hz
        room = [each for each in empty_room(np.random.default_rng(1)) if waist or each.sensor != "waist"]
        self.tracker = LaserFisheyeImm(rig(waist=waist, camera=False), room, None, **options)
        self.n, self.seen = 0, None
        detector = self.tracker._detector
        monkeypatch.setattr(detector, "detect", lambda moment: self.seen)
        monkeypatch.setattr(detector, "missed", lambda moment, points: np.full(points.shape[1:], UPRIGHT_UNSEEN))
        monkeypatch.setattr(detector, "waists_seen", lambda points: np.full(len(points), detector.sees_waists))

    def shows(self, trunks=(), legs=(), times=1) -> list[dict[int, tuple[float, float]]]:
        """Where whom it says at each of so many moments that show the same."""
        told = []
        for _ in range(times):
            found: Detections = detections(*trunks)
            nothing = np.zeros(len(found), np.bool_)
            histograms = np.zeros((len(found), self.tracker._detector.histogram.size))
            self.seen = Seen(found, detections(*legs), np.ones(len(legs), np.bool_), histograms, nothing, nothing)
            self.n += 1
            ns = self.n * NS_PER_S // self.rate_hz
            self.tracker._work(
                SyncedFrame(ns, {"waist": LaserScan("waist", ns, np.empty(0, np.float32), 0, 0.1, 0.1, 9)})
            )
            told.append({each.id: (each.x, each.y) for each in self.tracker.tracks()})
        return told


@pytest.fixture
def room(monkeypatch):
    return Room(monkeypatch)


def test_whoever_sat_and_is_seen_no_more_lies_there_and_gets_up_as_who_they_were(room):
    room.shows([SEAT, ELSEWHERE], [*KNEES, *BESIDE], times=20)
    (chest,) = room.shows([(-1.5, 2.5), ELSEWHERE], BESIDE)
    assert set(chest) == {1, 2}
    for told in room.shows([ELSEWHERE], BESIDE, times=60)[2:]:
        assert set(told) == {1, 2}
        assert np.hypot(*np.subtract(told[1], SEAT)) < 0.1
    for told in room.shows([(-1.7, 2.5), (-0.2, 2.4), ELSEWHERE], BESIDE, times=5):  # head, and legs swung down
        assert set(told) == {1, 2}


def test_whoever_stood_and_is_seen_no_more_is_gone(room):
    room.shows([SEAT, ELSEWHERE], [*BEHIND, *BESIDE], times=20)
    assert [set(told) for told in room.shows([ELSEWHERE], BESIDE, times=6)[3:]] == 3 * [{2}]


@pytest.mark.parametrize(
    ("away_s", "options", "same"), [(0.6, {}, True), (1.2, {}, False), (1.2, {"clutter_density_m2": None}, True)]
)
def test_the_next_person_in_a_doorway_is_not_the_one_who_left(monkeypatch, away_s, options, same):
    room = Room(monkeypatch, **options)
    room.shows([SEAT, ELSEWHERE], [*BEHIND, *BESIDE], times=20)
    room.shows([ELSEWHERE], BESIDE, times=round(away_s * room.rate_hz))  # where the first stood every look shows nobody
    told = room.shows([SEAT, ELSEWHERE], [*BEHIND, *BESIDE], times=5)[-1]
    assert (set(told) == {1, 2}) == same, told


def test_knees_stand_for_the_trunk_of_whoever_sits_behind_them(room):
    room.shows([SEAT], KNEES, times=20)
    for told in room.shows(legs=KNEES, times=10):
        assert np.hypot(*np.subtract(told[1], SEAT)) < 0.1


def test_knees_that_move_away_from_the_trunk_little_by_little_stay_its_own(room):
    """As somebody sits down: at last they are farther from it than a stranger's legs would be looked for."""
    for ahead_m in np.linspace(0.05, 0.6, 12):
        y = SEAT[1] - ahead_m
        room.shows([SEAT], [(SEAT[0] - 0.1, y), (SEAT[0] + 0.1, y)], times=3)
    people = room.tracker._people
    assert people.posture.seated(people.measured_at, PostureOptions()).tolist() == [True]
    np.testing.assert_allclose(people.posture.knees, [(0.0, -0.6)], atol=0.05)


def test_the_outline_of_who_stands_keeps_an_error_that_further_looks_do_not_average_out(room, monkeypatch):
    room.shows([ELSEWHERE], times=60)
    (stated,) = room.tracker.tracks()
    kept_m = TrunkOptions.standing_m * np.sqrt(-2 * np.log(0.05))
    monkeypatch.setattr(TrunkOptions, "standing_m", 0.0)
    (without,) = room.tracker.tracks()
    assert stated.radius95_m == pytest.approx(np.hypot(without.radius95_m, kept_m), rel=0.02)


def test_a_scanner_four_times_as_fast_makes_nobody_surer(monkeypatch):
    """Gait, clothes and what hides somebody last: what looks in a row tell is not independent."""
    spread, existence = [], []
    for rate_hz in (10, 40):
        room = Room(monkeypatch, rate_hz)
        room.shows([SEAT, ELSEWHERE], times=2 * rate_hz)
        spread.append(room.tracker._people.state.covariance[0, 0, 0, 0])
        room.shows([ELSEWHERE], times=rate_hz // 5)
        existence.append(room.tracker._people.existence[0])
    assert spread[1] == pytest.approx(spread[0], rel=0.3)
    assert existence[1] == pytest.approx(existence[0], rel=0.5)
    assert existence[0] < 0.9


def test_a_leg_that_stands_holds_nobody_back_who_walks_on(monkeypatch):
    """Where legs are all there is to see, one that is seen alone stays behind the body for as long as it stands."""

    def lag_m(**legs: float) -> float:
        room = Room(monkeypatch, rate_hz=25, waist=False, legs={"shanks_lean": False, **legs})
        body = -1.5 + 0.04 * np.arange(33)  # 1 m/s
        for x in body[:25]:
            room.shows(legs=[(x - 0.1, 1.9), (x + 0.1, 2.1)])
        told = room.shows(legs=[(body[24], 2.1)], times=8)
        return float(body[-1] - told[-1][1][0])

    assert lag_m() < 0.2
    assert lag_m(single_leg_s=0.04) > 0.24


def test_nobody_lies_where_somebody_else_is_seen_now():
    options = PostureOptions()
    place = np.array([SEAT])
    posture = LegPosture.upright(1)
    for _ in range(20):
        posture = posture.measured(np.array([0]), place, np.array([[-1.0, 1.9]]), options)
    seated = posture.seated(place, options)
    assert seated.tolist() == [True]
    chance, free = np.array([UPRIGHT_UNSEEN]), np.ones(1, np.bool_)
    for _ in range(5):
        posture, _ = posture.missed(seated, chance, free, 0.1, options)
    assert posture.lying.tolist() == [True]
    posture, unseen = posture.missed(seated, chance, ~free, 0.1, options)
    assert posture.lying.tolist() == [False]
    assert unseen == pytest.approx(chance)


@pytest.mark.parametrize(
    ("trunks", "legs", "options", "starts"),
    [
        ([SEAT], [], {}, True),
        ([], BEHIND, {}, True),
        ([], BEHIND[:1], {}, False),
        ([], BEHIND[:1], {"legs": {"pair_m": 0.0}}, True),
        ([], BEHIND[:1], {"layers": ["knee"]}, True),
    ],
)
def test_where_waists_are_scanned_nobody_starts_by_a_leg_alone(monkeypatch, trunks, legs, options, starts):
    told = Room(monkeypatch, **options).shows(trunks, legs, times=5)[-1]
    assert bool(told) == starts


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 0, 1), (1, 2, 0)])
def test_a_leg_that_two_scanners_show_twice_in_the_first_frame_is_nobody(monkeypatch, order):
    """Three legs within a stride are one person's and a double; two pairs are two people."""
    left, double, right = (-0.2, 2.5), (-0.17, 2.62), (0.05, 2.6)
    legs = [(left, double, right)[k] for k in order]
    assert len(Room(monkeypatch, waist=False).shows(legs=legs, times=10)[-1]) == 1
    pairs = [left, double, (right[0] + 0.3, right[1]), (right[0] + 0.45, right[1])]
    assert len(Room(monkeypatch, waist=False).shows(legs=pairs, times=10)[-1]) == 2
    assert len(Room(monkeypatch, waist=False).shows(legs=[left, (0.8, 2.5)], times=10)[-1]) == 2


def test_who_is_gone_in_plain_sight_holds_no_newcomer_back(room):
    room.shows([SEAT, ELSEWHERE], times=20)
    room.shows([ELSEWHERE], times=4)
    told = room.shows([(SEAT[0] + 0.5, SEAT[1]), ELSEWHERE], times=4)[-1]
    assert set(told) == {2, 3}
    assert told[3] == pytest.approx((SEAT[0] + 0.5, SEAT[1]), abs=0.02)


def test_a_hidden_track_goes_on_by_a_single_leg_once_that_is_confirmed(monkeypatch):
    """Legs that last are the hidden person's; a leg seen once takes nobody away."""
    room = Room(monkeypatch, waist=False)
    monkeypatch.setattr(room.tracker._detector, "missed", lambda moment, points: np.full(points.shape[1:], 0.95))
    room.shows(legs=[(-1.6, 2.5), (-1.4, 2.5)], times=10)
    room.shows(times=10)
    once = room.shows(legs=[(-0.5, 2.5)])[-1]
    assert all(abs(x + 1.5) < 0.5 for x, _ in once.values())
    told = room.shows(legs=[(-0.5, 2.5)], times=4)[-1]
    assert told.keys() == {1}
    assert told[1] == pytest.approx((-0.5, 2.5), abs=0.1)


def test_shanks_lean_the_more_the_higher_and_the_faster():
    speed = np.array([0.0, 0.4, 0.8, 2.0])
    low, high = (legs_ahead_m(speed, height_m, LegOptions()) for height_m in (0.35, 0.45))
    assert (low > 0).all() and low[0] < high[0]  # knees of who stands are bent a little
    assert (high[1:] > low[1:]).all()
    assert (np.diff(high) >= 0).all()
    assert high[2] == high[3]
    assert not legs_ahead_m(speed, 0.45, LegOptions(shanks_lean=False)).any()


def test_the_leg_that_a_single_one_hides_is_behind_it():
    legs, expected = detections((1.0, 2.0)), np.array([[1.0, 2.1]])
    still, nobody = np.zeros((1, 2)), np.empty((0, 2))
    args = legs, np.ones(1, np.bool_), nobody, expected, still, 0.3, 0.6, LegOptions()
    behind = pair_legs(*args, lines=legs.sight_lines(np.zeros((1, 2)))).position - pair_legs(*args).position
    assert behind[0] / np.hypot(*behind[0]) == pytest.approx(legs.position[0] / np.hypot(*legs.position[0]))
