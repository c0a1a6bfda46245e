"""Placement among furniture: who starts in it, or is sent into it, is told so, with what would be valid."""

from __future__ import annotations

import numpy as np
import pytest

from trackers.errors import InputError
from twin.people.crowd.routes import Routes
from twin.room.furniture import Seat
from twin.room.obstacles import Footprints, Obstacle
from twin.scenario import Scenario
from twin.world.placement import check_approach, check_free, check_placement, check_way

ROOM = np.array([[-3.0, -2.0], [3.0, -2.0], [3.0, 2.0], [-3.0, 2.0]])
TABLE = Obstacle("table", np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]]))
FENCE = Obstacle("fence", np.array([[1.5, -2.5], [1.6, -2.5], [1.6, 2.5], [1.5, 2.5]]))
CHAIR = Obstacle("chair", np.array([[-2.2, -0.2], [-1.8, -0.2], [-1.8, 0.2], [-2.2, 0.2]]))


@pytest.fixture(scope="module")
def routes():
    return Routes(ROOM, [TABLE, FENCE, CHAIR])


def scenario(**person):
    sensor = {"kind": "laser", "rate_hz": 10, "mount": {"xyz": [0, 0, 0.5]}}
    return Scenario.model_validate(
        {"name": "test", "room": "lab", "duration_s": 1, "people": {"anna": person}, "sensors": {"low": sensor}}
    )


def check(routes, **person):
    check_placement(scenario(**person), ROOM, ROOM, routes)


def test_who_fits_is_let_be(routes):
    check(routes, start=(-1.0, 1.0), script={"kind": "stand"})
    check(routes, script={"kind": "walk", "waypoints": [(-1.0, 0.0), (1.0, 0.0), (-1.5, 0.0)]})
    check(routes, start=(-1.0, -2.4), script={"kind": "leave", "to": (-1.0, 2.4)})  # in the doors of two walls


@pytest.mark.parametrize(
    ("person", "message"),
    [
        ({"start": (0.1, 0.1), "script": {"kind": "stand"}}, r"people.anna.start: \[0.1, 0.1\] is inside 'table'"),
        ({"start": (-0.6, 0.0)}, r"people.anna.start: \[-0.6, 0\] is only 0.10 m from 'table'"),
        ({"start": (-0.8492, 0.0)}, r"only 0.349 m from 'table'; a place at least 0.35 m from"),
        ({"script": {"kind": "walk", "waypoints": [(-1, 1), (0, 0.2)]}}, r"waypoints.1: \[0, 0.2\] is inside 'table'"),
        ({"script": {"kind": "walk", "waypoints": [(0, 0.2), (-1, 1)]}}, r"waypoints.0: \[0, 0.2\] is inside 'table'"),
        ({"script": {"kind": "walk", "waypoints": [(-1, 1), (2.4, 0)]}}, r"no way from \[-1, 1\] to \[2.4, 0\]"),
        ({"start": (5.0, 0.0)}, "outside the room's walkable area"),
        ({"start": (-1.0, -2.6)}, r"start: .* 0.75 m beyond where people walk .* \[-1, -1.85\] for instance"),
        ({"script": {"kind": "leave", "to": (-1, -2.6)}}, r"to: .* 0.75 m beyond where people walk .* \[-1, -1.85\]"),
    ],
)
def test_who_does_not_is_told(routes, person, message):
    with pytest.raises(InputError, match=message):
        check(routes, **person)


def test_the_place_offered_instead_is_free(routes):
    with pytest.raises(InputError, match="for instance") as raised:
        check_free(np.array([0.1, 0.3]), routes, "here")
    x, y = str(raised.value).split("furniture, [")[1].split("]")[0].split(", ")
    offered = np.array([complex(float(x), float(y))])
    assert Footprints(routes.obstacles).gaps(offered)[1].min() >= 0.32
    check_free(np.array([float(x), float(y)]), routes, "here")


def test_ways_that_furniture_closes(routes):
    check_way(np.array([-1.0, 1.0]), np.array([1.0, 1.0]), routes, "way")
    with pytest.raises(InputError, match="furniture leaves no way"):
        check_way(np.array([-1.0, 1.0]), np.array([2.5, 1.0]), routes, "way")


def test_a_seat_that_faces_something(routes):
    def seat(yaw):
        return Seat("chair", np.array([-2.0, 0.0, 0.45]), yaw, "chair", frozenset(), 0.2)

    check_approach(seat(0.0), [np.array([-1.65, 0.0])], routes, "sit")
    blocked = Routes(ROOM, [CHAIR, Obstacle("desk", TABLE.corners - np.array([1.1, 0.0]))])
    with pytest.raises(
        InputError, match="sit: nobody of this size can come to .* the seat 'chair', 'desk' is in the way"
    ):
        check_approach(seat(0.0), [np.array([-1.55, 0.0])], blocked, "sit")
