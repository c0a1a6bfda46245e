"""Crowds: five people in a small area keep apart, stay inside, and keep moving, with stops and turns."""

from __future__ import annotations

import numpy as np
import pytest
from people_cast import AREA, FIVE, make_population

from twin.people.crowd.motion_command import KEEP_APART_M
from twin.people.posture.posture_rows import TICK_S
from twin.room.obstacles import KEEP_FROM_EDGE_M
from twin.scenario.behaviour import Stand, Walk, Wander
from twin.scenario.person import Person

SECONDS = 26.2


def paths(people, seed, seconds=SECONDS, area=AREA):
    """Pelvis (ticks, n, 2) [m] and velocity (ticks, n, 2) [m/s] on the people's clock."""
    population = make_population(people, seed, area)
    places, velocities = [], []
    for tick in range(1, int(seconds / TICK_S)):
        population.advance(tick * TICK_S)
        truth = population.truth(tick * TICK_S)
        places.append(np.stack([truth.x, truth.y], axis=-1))
        velocities.append(np.stack([truth.vx, truth.vy], axis=-1))
    return np.array(places), np.array(velocities)


def least_distance(places):
    apart = np.linalg.norm(places[:, :, None] - places[:, None], axis=-1)
    return (apart + 9 * np.eye(places.shape[1])).min()


def longest_stay(place, within_m=0.1):
    """Longest time [s] spent within a distance of where it began, over one path (ticks, 2)."""
    longest, start = 0, 0
    for tick in range(len(place)):
        while np.linalg.norm(place[tick] - place[start]) > within_m:
            start += 1
        longest = max(longest, tick - start)
    return longest * TICK_S


@pytest.fixture(scope="module", params=[1000, pytest.param(1001, marks=pytest.mark.nightly), 1002])
def run(request, wanderers):
    return paths(wanderers, request.param)


def test_nobody_passes_through_another(run):
    assert least_distance(run[0]) > 0.5


def test_nobody_leaves_the_area(run):
    places = run[0]
    assert (places > AREA.min(axis=0) + 0.05).all()
    assert (places < AREA.max(axis=0) - 0.05).all()


def test_people_keep_moving_with_stops(run):
    places, velocities = run
    speed = np.linalg.norm(velocities, axis=-1)
    assert 0.4 < speed.mean() < 0.8
    assert max(longest_stay(places[:, person]) for person in range(places.shape[1])) < 4.0
    stopped = (speed < 0.1).mean()
    assert 0.03 < stopped < 0.5
    assert speed.max() < 1.6


def test_velocity_is_the_derivative_of_the_place(run):
    places, velocities = run
    measured = (places[2:] - places[:-2]) / (2 * TICK_S)
    error = np.abs(measured - velocities[1:-1])
    assert np.percentile(error, 99) < 0.1
    assert error.mean() < 0.02


def test_people_turn_sharply_now_and_then(run):
    _, velocities = run
    moving = np.linalg.norm(velocities, axis=-1) > 0.3
    direction = np.unwrap(np.arctan2(velocities[..., 1], velocities[..., 0]), axis=0)
    in_a_second = np.abs(direction[40:] - direction[:-40])
    assert (in_a_second[moving[40:] & moving[:-40]] > np.pi / 3).sum() > 50


def test_two_who_meet_head_on_pass_each_other():
    people = {
        "anna": Person(script=(Walk(waypoints=((-1.8, 1.7), (1.8, 1.7)), speed_m_s=1.0),)),
        "bert": Person(script=(Walk(waypoints=((1.8, 1.7), (-1.8, 1.7)), speed_m_s=1.0),)),
    }
    places, _ = paths(people, 0, 10.0)
    assert least_distance(places) > 0.5
    assert places[-1, 0, 0] == pytest.approx(1.8, abs=0.1)
    assert places[-1, 1, 0] == pytest.approx(-1.8, abs=0.1)


def test_walkers_go_around_who_stands():
    people = {
        "anna": Person(script=(Walk(waypoints=((-1.8, 1.7), (1.8, 1.7)), speed_m_s=1.0),)),
        "post": Person(start=(0.0, 1.7), script=(Stand(),)),
    }
    places, _ = paths(people, 0, 10.0)
    assert least_distance(places) > 0.5
    assert np.ptp(places[40:, 1], axis=0).max() < 1e-3
    assert places[-1, 0, 0] == pytest.approx(1.8, abs=0.1)


def test_a_repeated_walk_comes_round_again():
    walk = Walk(waypoints=((-1.0, 1.0), (1.0, 1.0), (1.0, 2.5)), speed_m_s=1.2, repeat=True)
    places, velocities = paths({"anna": Person(script=(walk,))}, 0, 20.0)
    for corner in walk.waypoints:
        near = np.linalg.norm(places[:, 0] - corner, axis=-1) < 0.3
        assert (np.diff(near.astype(int)) == 1).sum() >= 2
    assert np.linalg.norm(velocities[-200:, 0], axis=-1).mean() > 0.6


def test_an_area_with_a_bay_is_stayed_in():
    bay = np.array([[-2, 0], [2, 0], [2, 4], [0.8, 4], [0.8, 2], [-0.8, 2], [-0.8, 4], [-2, 4]], dtype=float)
    people = {name: Person(script=(Wander(stretch_s=4.0),)) for name in FIVE[:3]}
    places, _ = paths(people, 3, 30.0, bay)
    inside_bay = (np.abs(places[..., 0]) < 0.8) & (places[..., 1] > 2.0)
    assert not inside_bay.any()
    assert least_distance(places) > 0.5


def test_constants_are_consistent():
    assert KEEP_APART_M >= 0.5
    assert KEEP_FROM_EDGE_M > 0
