"""Random places: inside the area, clear of furniture, the same for the same seed."""

from __future__ import annotations

import numpy as np
import pytest

from trackers.area import Area
from trackers.errors import InputError
from twin.people.crowd.ground import free_places, nearest_free
from twin.room.obstacles import Footprints, Obstacle

ROOM = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 3.0], [0.0, 3.0]])
TABLE = Obstacle("table", np.array([[1.0, 1.0], [2.5, 1.0], [2.5, 2.0], [1.0, 2.0]]))


def test_places_are_free_and_fill_the_rest():
    places = free_places(ROOM, Footprints([TABLE]), 500, np.random.default_rng(1))
    assert places.shape == (500, 2)
    assert Area(ROOM).contains(places).all()
    assert Footprints([TABLE]).gaps(places[:, 0] + 1j * places[:, 1])[1].min() >= 0.3
    for corner in ROOM:
        assert np.linalg.norm(places - corner, axis=1).min() < 0.4
    np.testing.assert_array_equal(places, free_places(ROOM, Footprints([TABLE]), 500, np.random.default_rng(1)))


def test_no_obstacles_is_the_whole_area():
    places = free_places(ROOM, Footprints([]), 2000, np.random.default_rng(0))
    np.testing.assert_allclose(places.mean(axis=0), [2.0, 1.5], atol=0.1)


def test_a_full_room_is_refused():
    full = Obstacle("bed", ROOM)
    with pytest.raises(InputError, match="lobby: furniture leaves no place"):
        free_places(ROOM, Footprints([full]), 1, np.random.default_rng(0), source="lobby")


def test_the_nearest_free_place():
    found = nearest_free(np.array([1.1, 1.5]), ROOM, [TABLE], 0.3)
    np.testing.assert_allclose(found, [0.7, 1.5], atol=0.051)
    assert nearest_free(np.array([1.0, 1.0]), ROOM, [Obstacle("bed", ROOM)], 0.3) is None
