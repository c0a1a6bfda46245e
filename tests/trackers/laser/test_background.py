"""Which samples stand in front of the room."""

from dataclasses import replace

import numpy as np
import pytest

from trackers.errors import InputError
from trackers.laser.background import BackgroundOptions, KnownBackground, LearnedBackground
from trackers.laser.bearings import returns
from trackers.observations import NS_PER_S, LaserScan

N_BEAM = 60
WALL_M = 4.0


def scan(t: float, ranges=WALL_M, **changes) -> LaserScan:
    values = np.broadcast_to(np.asarray(ranges, np.float32), N_BEAM).copy()
    given = LaserScan("scan", round(t * NS_PER_S), values, -0.5, 1.0 / N_BEAM, 0.05, 8.0)
    return replace(given, **changes)


def with_object(beams: slice, range_m: float, room=WALL_M) -> np.ndarray:
    ranges = np.full(N_BEAM, room, np.float32)
    ranges[beams] = range_m
    return ranges


class TestKnown:
    def test_only_what_stands_in_front_is_foreground(self):
        rng = np.random.default_rng(0)
        background = KnownBackground([scan(k, WALL_M + rng.normal(0, 0.01, N_BEAM)) for k in range(20)])
        found = background.foreground(scan(30, with_object(slice(10, 14), 2.0)))
        np.testing.assert_array_equal(np.flatnonzero(found), [10, 11, 12, 13])
        assert not background.foreground(scan(31, with_object(slice(10, 14), 5.0))).any()  # a door opened
        assert not background.foreground(scan(32, WALL_M - 0.05)).any()

    def test_a_noisy_beam_needs_more(self):
        rng = np.random.default_rng(1)
        noisy = np.full((50, N_BEAM), WALL_M)
        noisy[:, 5] += rng.normal(0, 0.2, 50)
        background = KnownBackground([scan(k, row) for k, row in enumerate(noisy)])
        found = background.foreground(scan(99, with_object(slice(5, 6), WALL_M - 0.5)))
        assert not found.any()
        found = background.foreground(scan(100, with_object(slice(6, 7), WALL_M - 0.5)))
        np.testing.assert_array_equal(np.flatnonzero(found), [6])
        assert background.foreground(scan(101, WALL_M - 0.5)).all()  # it goes on what stands on either side

    @pytest.mark.parametrize("mirrored", [False, True])
    def test_a_beam_on_an_edge_goes_on_what_stands_beside_it(self, mirrored: bool):
        empty = np.full((20, N_BEAM), WALL_M)
        empty[:, 20:30] = 1.0  # a cupboard
        empty[:, 19] = np.linspace(1.0, WALL_M, 20)  # a beam half on its edge
        side = slice(None, None, -1) if mirrored else slice(None)
        background = KnownBackground([scan(k, row[side]) for k, row in enumerate(empty)])

        def found(*beams: int, edge_m: float) -> list[int]:
            ranges = np.where(np.isin(np.arange(N_BEAM), beams), 2.5, empty[-1])
            ranges[19] = edge_m
            return np.flatnonzero(background.foreground(scan(50, ranges[side]))[side]).tolist()

        assert found(17, 18, edge_m=2.55) == [17, 18, 19]
        assert found(17, 18, edge_m=1.5) == [17, 18]  # mixed with the cupboard
        assert found(17, edge_m=2.5) == [17]  # the wall is seen between
        assert found(edge_m=2.5) == []

    @pytest.mark.parametrize("mixed_m", [1.3, 2.5, 3.9])
    def test_a_beam_on_an_edge_may_read_either_side_that_no_empty_scan_showed(self, mixed_m: float):
        empty = with_object(slice(20, 30), 1.0)
        empty[[19, 30]] = mixed_m  # between the cupboard and the wall, in every scan of the empty room
        background = KnownBackground([scan(k, empty) for k in range(10)])
        for now_m in (1.0, 1.2, mixed_m, 3.0, WALL_M):
            now = empty.copy()
            now[[19, 30]] = now_m
            assert not background.foreground(scan(50, now)).any(), now_m

    def test_anything_is_in_front_of_nothing(self):
        background = KnownBackground([scan(0, np.inf)])
        np.testing.assert_array_equal(background.foreground(scan(1, 7.9)), True)

    def test_an_edge_seen_now_and_then_belongs_to_the_room(self):
        ranges = np.full((20, N_BEAM), WALL_M)
        ranges[::3, 7] = 1.0
        background = KnownBackground([scan(k, row) for k, row in enumerate(ranges)])
        assert not background.foreground(scan(50, with_object(slice(7, 8), 1.0)))[7]

    @pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 0.0, 9.0])
    def test_no_return_is_no_foreground(self, value):
        background = KnownBackground([scan(0)])
        assert not background.foreground(scan(1, value)).any()

    def test_wrong_input_is_named(self):
        with pytest.raises(InputError, match="at least one"):
            KnownBackground([])


def fed(background: LearnedBackground, seconds: float, ranges, t0: float) -> float:
    """Feed the same ranges at 10 Hz; returns the time after."""
    for k in range(round(seconds * 10)):
        background.foreground(scan(t0 + k / 10, ranges))
    return t0 + seconds


class TestLearned:
    def test_the_first_scan_is_the_room(self):
        background = LearnedBackground()
        assert not background.foreground(scan(0, with_object(slice(5, 9), 2.0))).any()
        found = background.foreground(scan(0.1, with_object(slice(20, 24), 2.0)))
        np.testing.assert_array_equal(np.flatnonzero(found), [20, 21, 22, 23])

    def test_a_person_there_from_the_start_is_seen_once_they_walk_on(self):
        background = LearnedBackground()
        standing = with_object(slice(20, 24), 2.0, room=np.inf)  # nothing behind: only their leaving shows the room
        t = fed(background, 5.0, standing, 0.0)
        t = fed(background, 2.0, np.inf, t)
        found = background.foreground(scan(t, with_object(slice(20, 24), 3.0, room=np.inf)))
        np.testing.assert_array_equal(np.flatnonzero(found), [20, 21, 22, 23])
        t = fed(background, 10.0, np.inf, t + 0.1)
        assert background.foreground(scan(t, standing))[20:24].all()

    def test_a_standing_person_is_not_learned_quickly_but_furniture_is_in_the_end(self):
        background = LearnedBackground()
        t = fed(background, 30.0, WALL_M, 0.0)
        standing = with_object(slice(20, 24), 2.0)
        t = fed(background, 20.0, standing, t)
        assert background.foreground(scan(t, standing))[20:24].all()
        t = fed(background, 120.0, standing, t + 0.1)
        assert not background.foreground(scan(t, standing)).any()

    def test_however_long_the_room_was_seen_what_comes_into_it_is_learned_as_soon(self):
        background = LearnedBackground(BackgroundOptions(memory_s=10.0))
        t = fed(background, 100.0, WALL_M, 0.0)
        standing = with_object(slice(20, 24), 2.0)
        t = fed(background, 5.0, standing, t)
        assert background.foreground(scan(t, standing))[20:24].all()
        t = fed(background, 5.0, standing, t + 0.1)
        assert not background.foreground(scan(t, standing)).any()

    @pytest.mark.parametrize("seconds", [0.1, 5.0])
    def test_something_was_measured_behind_a_place_before_a_wall_and_not_before_the_open(self, seconds: float):
        background, room = LearnedBackground(), np.where(np.arange(N_BEAM) < N_BEAM // 2, WALL_M, np.inf)
        bearings = scan(0).angles_rad
        assert not background.seen_behind(bearings, np.full(N_BEAM, 2.0)).any()  # before the first scan
        fed(background, seconds, room, 0.0)
        np.testing.assert_array_equal(background.seen_behind(bearings, np.full(N_BEAM, 2.0)), room == WALL_M)
        assert not background.seen_behind(bearings, np.full(N_BEAM, WALL_M)).any()
        assert not background.seen_behind(bearings + np.pi, np.full(N_BEAM, 2.0)).any()  # where no beam looks

    def test_the_wall_is_not_forgotten_behind_a_person(self):
        background = LearnedBackground()
        t = fed(background, 10.0, WALL_M, 0.0)
        t = fed(background, 15.0, with_object(slice(20, 24), 2.0), t)
        assert not background.foreground(scan(t)).any()

    def test_a_flickering_edge_is_the_room(self):
        background, rng = LearnedBackground(), np.random.default_rng(0)
        late = []
        for k in range(600):
            near = rng.random() < 0.4
            found = background.foreground(scan(k / 10, with_object(slice(7, 8), 2.5 if near else WALL_M)))
            late.append(found[7] and k > 300)
        assert not any(late)

    def test_somebody_who_stops_when_little_is_learned_yet_is_no_flickering_edge(self):
        """Their stay is short, but it is the first: nothing has come back yet."""
        background = LearnedBackground()
        background.foreground(scan(0))
        for k in range(1, 9):
            assert background.foreground(scan(k / 10, with_object(slice(20, 24), 2.0)))[20:24].all()

    def test_passers_by_never_become_the_room(self):
        background = LearnedBackground()
        background.foreground(scan(-0.1))
        for k in range(1200):  # someone crosses in front every 3 s
            place = slice(2 * (k % 30), 2 * (k % 30) + 2)
            assert background.foreground(scan(k / 10, with_object(place, 2.0)))[place].all()

    def test_dropped_readings_teach_nothing(self):
        background = LearnedBackground()
        t = fed(background, 5.0, WALL_M, 0.0)
        t = fed(background, 60.0, np.nan, t)
        assert background.foreground(scan(t, with_object(slice(3, 5), 2.0)))[3:5].all()
        assert not background.foreground(scan(t + 0.1)).any()

    @pytest.mark.parametrize("coded", [np.nan, 0.0, 0.01, 65.533])
    @pytest.mark.parametrize("share", [0.0, 0.1, 0.3])
    def test_whatever_a_driver_writes_for_no_return_people_in_the_open_are_foreground(self, coded, share):
        """As where it is inf; readings dropped at random, a share of them, tell of nothing open."""
        rng = np.random.default_rng(0)
        as_inf, as_coded = LearnedBackground(), LearnedBackground()
        for k in range(100):
            ranges = with_object(slice(k % 50, k % 50 + 3), 2.0)
            ranges[30:][ranges[30:] == WALL_M] = np.inf  # the room is open there
            ranges[rng.random(N_BEAM) < share] = np.nan
            expected = as_inf.foreground(scan(k / 10, ranges))
            found = as_coded.foreground(scan(k / 10, np.where(ranges == np.inf, coded, ranges)))
            np.testing.assert_array_equal(found[:30], expected[:30])
            if k > 15:
                np.testing.assert_array_equal(found, expected)
        assert expected.any() == (not np.isnan(ranges[k % 50 : k % 50 + 3]).all())

    def test_a_duplicate_or_older_scan_teaches_nothing(self):
        once, twice = LearnedBackground(), LearnedBackground()
        for k in range(50):
            given = scan(k / 10, with_object(slice(k % 50, k % 50 + 2), 2.0))
            once.foreground(given)
            twice.foreground(given)
            twice.foreground(given)
        probe = scan(6.0, with_object(slice(0, 60), 2.0))
        np.testing.assert_array_equal(once.foreground(probe), twice.foreground(probe))

    def test_long_runs_stay_finite_and_the_same(self):
        background = LearnedBackground(BackgroundOptions(memory_s=2.0))  # the weights are renormalised several times
        t = fed(background, 150.0, WALL_M, 0.0)
        assert not background.foreground(scan(t)).any()
        assert background.foreground(scan(t + 0.1, with_object(slice(3, 5), 2.0)))[3:5].all()


class TestWithoutALimit:
    """Some drivers write 1e6 m or infinity where a scanner names no limit."""

    @pytest.mark.parametrize("range_max_m", [1e6, np.inf])
    def test_a_room_is_learned_as_with_one(self, range_max_m):
        limited, unlimited = LearnedBackground(), LearnedBackground()
        for k in range(30):
            ranges = with_object(slice(10 + k, 14 + k), 2.0)
            ranges[50] = np.inf
            expected = limited.foreground(scan(0.1 * k, ranges))
            found = unlimited.foreground(scan(0.1 * k, ranges, range_max_m=range_max_m))
            np.testing.assert_array_equal(found, expected)
        assert expected.any()

    def test_what_is_farther_than_people_are_followed_is_learned_too(self):
        background = LearnedBackground()
        for k in range(30):
            background.foreground(scan(0.1 * k, 5000.0, range_max_m=1e6))
        found = background.foreground(scan(3.0, with_object(slice(10, 14), 2.0, 5000.0), range_max_m=1e6))
        np.testing.assert_array_equal(np.flatnonzero(found), [10, 11, 12, 13])

    def test_nothing_met_is_no_return(self):
        background = KnownBackground([scan(0, range_max_m=np.inf)])
        assert not background.foreground(scan(1, np.inf, range_max_m=np.inf)).any()
        ranges, hit, missed = returns(scan(1, np.inf, range_max_m=np.inf))
        assert missed.all()
        assert not hit.any()

    def test_beams_without_number_are_refused(self):
        with pytest.raises(InputError, match=r"300000 beams of 1001 range bins.*farthest_m"):
            LearnedBackground().foreground(
                scan(0, ranges_m=np.ones(300_000, np.float32), range_max_m=np.inf, angle_increment_rad=1e-5)
            )
