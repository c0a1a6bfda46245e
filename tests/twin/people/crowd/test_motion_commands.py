"""Commands to a crowd: headings held, running, paths that are given, people who come and go."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from twin.people.crowd.crowd import LATERAL_M_S, NEAR_M, TURN_RATE, Crowd
from twin.people.crowd.motion_command import KEEP_APART_M, MotionCommand
from twin.room.obstacles import KEEP_FROM_EDGE_M, KEEP_FROM_FURNITURE_M, Footprints, Obstacle

TICK_S = 0.025
SQUARE = np.array([[-3.0, -3.0], [3.0, -3.0], [3.0, 3.0], [-3.0, 3.0]])
TABLE = Obstacle("table", np.array([[-0.6, -0.4], [0.6, -0.4], [0.6, 0.4], [-0.6, 0.4]]))
POST = Obstacle("post", np.array([[1.5, 1.5], [1.7, 1.5], [1.6, 1.7]]))


def make_crowd(places, headings=None, area=SQUARE, obstacles=(), immovable=()):
    count = len(places)
    headings = np.zeros(count) if headings is None else np.array(headings, dtype=float)
    crowd = Crowd(np.array(places, dtype=complex), headings, [area] * count, obstacles)
    for person in immovable:
        crowd.command(person, MotionCommand(None, immovable=True))
    return crowd


def walk(crowd, seconds):
    """Places (ticks, n) and velocities (ticks, n) over the next seconds."""
    places, velocities = [], []
    for _ in range(round(seconds / TICK_S)):
        crowd.step(TICK_S)
        places.append(crowd.place.copy())
        velocities.append(crowd.velocity.copy())
    return np.array(places), np.array(velocities)


@pytest.mark.parametrize("turn", [np.pi, np.pi / 2, -np.pi / 2])
def test_who_holds_a_heading_steps_backwards_and_sideways(turn):
    crowd = make_crowd([0.0], [turn])
    crowd.command(0, MotionCommand((1.5, 0.0), 1.4, arrive_m=0.05, halt=True, heading=turn))
    _, velocities = walk(crowd, 4.0)
    assert crowd.arrived()[0]
    assert crowd.heading[0] == pytest.approx(turn, abs=1e-6)
    assert np.abs(velocities).max() == pytest.approx(LATERAL_M_S, rel=0.1)


def test_who_stands_turns_on_the_spot_to_a_heading():
    crowd = make_crowd([0.0], [0.3])
    crowd.command(0, MotionCommand(None, heading=-2.5))
    rates = []
    for _ in range(80):
        crowd.step(TICK_S)
        rates.append(abs(crowd.turn_rate[0]))
    assert max(rates) <= TURN_RATE + 1e-9
    assert crowd.heading[0] == pytest.approx(-2.5, abs=0.01)
    assert abs(crowd.place[0]) < 1e-9


def test_runners_run_and_come_to_a_halt_at_their_goal():
    crowd = make_crowd([-18.0], area=20 * SQUARE)
    crowd.command(0, MotionCommand((20.0, 0.0), 5.0, arrive_m=0.1, halt=True))
    places, velocities = walk(crowd, 14.0)
    assert np.abs(velocities).max() == pytest.approx(5.0, rel=0.02)
    assert crowd.arrived()[0]
    assert places.real.max() < 20.05
    slowing = -np.diff(np.abs(velocities[:, 0])) / TICK_S
    assert slowing.max() < 4.1


def test_runners_stop_before_a_wall_and_before_somebody():
    crowd = make_crowd([-2.5, 0.0], immovable=[1])
    crowd.command(0, MotionCommand((0.0, 0.0), 4.0))
    places, _ = walk(crowd, 5.0)
    assert np.abs(places[:, 1] - places[:, 0]).min() > KEEP_APART_M - 0.01
    crowd = make_crowd([-2.5])
    crowd.command(0, MotionCommand((9.0, 0.0), 5.0))
    places, _ = walk(crowd, 5.0)
    assert places.real.max() < 3.0 - KEEP_FROM_EDGE_M + 0.01


@pytest.mark.parametrize("clearance_m", [KEEP_FROM_FURNITURE_M, 0.38])
def test_walkers_keep_their_clearance_from_things(clearance_m):
    crowd = Crowd(
        np.array([-2.0 + 0.5j, 2.0 + 0.8j, 1.0 - 2.5j]), np.array([0.0, np.pi, 0.0]), [SQUARE] * 3, [TABLE], clearance_m
    )
    for person, goal in enumerate([(2.0, -0.7), (-2.0, -0.7), (0.0, 0.0)]):
        crowd.command(person, MotionCommand(goal, 1.4))
    places, _ = walk(crowd, 6.0)
    gaps = Footprints([TABLE]).gaps(places.ravel())[1]
    assert clearance_m - 1e-3 < gaps.min() < clearance_m + 0.02


def test_driven_people_keep_their_path_exactly_and_others_make_way():
    crowd = make_crowd([-2.5 + 0.1j, 0.0], [0.0, np.pi])
    crowd.driven[0] = True
    apart = []
    for tick in range(1, 140):
        place = np.array([-2.5 + 0.1j + 1.3 * TICK_S * tick, 0.0])
        crowd.drive(place, np.array([1.3, 0.0], dtype=complex))
        crowd.step(TICK_S)
        assert crowd.place[0] == place[0]
        assert crowd.velocity[0] == 1.3
        apart.append(abs(crowd.place[1] - crowd.place[0]))
    assert min(apart) > KEEP_APART_M - 0.1
    assert abs(crowd.place[1]) > 0.2


def test_the_heading_of_driven_people_follows_their_way_at_a_limited_rate():
    crowd = make_crowd([0.0], [0.0])
    crowd.driven[0] = True
    for tick in range(1, 100):
        crowd.drive(np.array([1j * TICK_S * tick]), np.array([1j]))
        before = crowd.heading[0]
        crowd.step(TICK_S)
        assert abs(crowd.heading[0] - before) <= TURN_RATE * TICK_S + 1e-9
    assert crowd.heading[0] == pytest.approx(np.pi / 2, abs=0.02)
    slow = crowd.heading[0]
    for tick in range(1, 40):
        crowd.drive(np.array([2.5j + 0.1 * TICK_S * tick]), np.array([0.1 + 0j]))
        crowd.step(TICK_S)
    assert crowd.heading[0] == pytest.approx(slow, abs=0.05)


def test_absent_people_are_not_felt_and_do_not_move():
    alone, among = make_crowd([-2.0]), make_crowd([-2.0, 0.0, 0.5])
    among.present[1:] = False
    for crowd in (alone, among):
        crowd.command(0, MotionCommand((2.0, 0.0), 1.3, halt=True))
    among.command(1, MotionCommand((-2.0, 0.0), 1.0))
    places, _ = walk(among, 3.0)
    np.testing.assert_array_equal(places[:, 0], walk(alone, 3.0)[0][:, 0])
    assert (places[:, 1] == 0.0).all()
    among.enter(1, 2.5 + 1j, np.pi, -1.0)
    among.command(1, MotionCommand((-2.0, 1.0), 1.0))
    places, _ = walk(among, 2.0)
    assert places[-1, 1].real < 1.5
    assert among.place[2] == 0.5


def test_an_empty_room_steps():
    crowd = make_crowd([0.0, 1.0], obstacles=[POST])
    crowd.present[:] = False
    crowd.step(TICK_S)
    assert (crowd.place == [0.0, 1.0]).all()


def test_firm_people_do_not_give_way():
    crowd = make_crowd([-1.0, 0.0])
    crowd.command(0, MotionCommand((0.0, 0.0), 1.0))
    crowd.command(1, MotionCommand(None, immovable=True))
    walk(crowd, 3.0)
    assert crowd.place[1] == 0.0
    crowd.command(1, MotionCommand((2.0, 0.0), 1.0))
    walk(crowd, 2.0)
    assert abs(crowd.place[1]) > 0.4


def test_a_goal_is_taken_while_somebody_stands_there():
    crowd = make_crowd([-0.9, 0.3j, 2.0], immovable=[1])
    crowd.command(0, MotionCommand((0.0, 0.0), 1.0, halt=True))
    crowd.command(2, MotionCommand((2.0, 2.0), 1.0, halt=True))
    crowd.step(TICK_S)
    assert crowd.taken().tolist() == [True, False, False]
    crowd.command(0, MotionCommand((0.0, 0.0), 1.0))  # who only passes there does not mind
    crowd.step(TICK_S)
    assert not crowd.taken().any()
    crowd.command(0, MotionCommand((0.0, 0.0), 1.0, halt=True))
    crowd.step(TICK_S)
    assert crowd.taken()[0]
    crowd.present[1] = False
    assert not crowd.taken().any()


def test_people_come_near_only_where_they_may():
    footprint = Footprints([TABLE])
    for near, least in ((frozenset(), KEEP_FROM_FURNITURE_M), (frozenset({"table"}), NEAR_M)):
        crowd = make_crowd([-2.0], obstacles=[TABLE])
        crowd.command(0, MotionCommand((-0.6 - least - 0.01, 0.0), 1.0, arrive_m=0.03, halt=True, near=near))
        places, _ = walk(crowd, 6.0)
        assert crowd.arrived()[0]
        assert footprint.gaps(places[:, 0])[1].min() >= least - 1e-3
    with pytest.raises(ValueError, match="sofa"):
        make_crowd([0.0], obstacles=[TABLE]).command(0, MotionCommand(None, near=frozenset({"sofa"})))


def test_who_stands_by_a_wall_stays():
    crowd = make_crowd([2.8, -0.95], obstacles=[TABLE])
    walk(crowd, 5.0)
    np.testing.assert_allclose(crowd.place, [2.8, -0.95], atol=1e-6)


orders = st.tuples(
    st.floats(-4, 4), st.floats(-4, 4), st.floats(0.3, 5.0), st.booleans(), st.none() | st.floats(-3.1, 3.1)
)


@settings(max_examples=30, deadline=None)
@given(
    st.lists(orders, min_size=4, max_size=4),
    st.lists(orders, min_size=4, max_size=4),
    st.integers(0, 3),
)
def test_nobody_enters_obstacles_or_another_or_leaves_whatever_the_orders(first, second, absent):
    obstacles = [TABLE, POST]
    crowd = make_crowd([-2.0 - 2j, 2.0 - 2j, 2.5 + 2.5j, -2.0 + 2j], [0.0, 1.0, 2.0, 3.0], obstacles=obstacles)
    if absent:
        crowd.present[absent] = False
    footprints = Footprints(obstacles)
    for batch in (first, second):
        for person, (x, y, speed, halt, heading) in enumerate(batch):
            crowd.command(person, MotionCommand((x, y), speed, halt=halt, heading=heading))
        places, velocities = walk(crowd, 2.0)
        shown = places[:, crowd.present]
        assert footprints.gaps(shown.ravel())[1].min() > KEEP_FROM_FURNITURE_M - 0.01
        assert np.abs(shown.real).max() < 3.0 - KEEP_FROM_EDGE_M + 0.01
        assert np.abs(shown.imag).max() < 3.0 - KEEP_FROM_EDGE_M + 0.01
        apart = np.abs(shown[:, :, None] - shown[:, None]) + 9 * np.eye(shown.shape[1])
        assert apart.min() > KEEP_APART_M - 0.01
        assert np.abs(velocities).max() < 5.1


def test_the_same_orders_give_the_same_bits():
    runs = []
    for _ in range(2):
        crowd = make_crowd([-2.0 - 2j, 2.0 - 2j, 2.0 + 2j], obstacles=[TABLE, POST])
        for person in range(3):
            crowd.command(person, MotionCommand((-crowd.place[person].real, -crowd.place[person].imag), 1.2))
        runs.append(walk(crowd, 4.0)[0])
    np.testing.assert_array_equal(*runs)
