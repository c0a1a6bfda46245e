"""The population: repeatable, independent of the order of listing, with a memory of fixed size."""

from __future__ import annotations

import numpy as np
import pytest
from people_cast import AREA, FIVE, make_population

from trackers.errors import InputError
from twin.people.body.person_spec import NQ_PERSON
from twin.people.poses import HISTORY_S, TICK_S
from twin.scenario.behaviour import Stand, Walk
from twin.scenario.person import Person


def test_same_seed_same_bits(wanderers):
    first, second = make_population(wanderers, 5), make_population(wanderers, 5)
    first.advance(4.0)
    for t in np.arange(0.1, 4.0, 0.1):
        second.advance(t)
    second.advance(4.0)
    for t in (3.0, 3.337, 4.0):
        np.testing.assert_array_equal(first.qpos(t), second.qpos(t))


def test_another_seed_another_run(wanderers):
    first, second = make_population(wanderers, 5), make_population(wanderers, 6)
    assert not np.allclose(first.qpos(0.0), second.qpos(0.0))


def test_the_order_of_listing_changes_nothing(wanderers):
    turned = {name: wanderers[name] for name in reversed(FIVE)}
    first, second = make_population(wanderers, 5), make_population(turned, 5)
    assert first.names == second.names == tuple(sorted(FIVE))
    first.advance(5.0)
    second.advance(5.0)
    np.testing.assert_array_equal(first.qpos(5.0), second.qpos(5.0))


def test_coordinates_and_truth_agree(wanderers):
    population = make_population(wanderers, 2)
    population.advance(3.0)
    coordinates, truth = population.qpos(2.013), population.truth(2.013)
    assert coordinates.shape == (5, NQ_PERSON)
    np.testing.assert_allclose(coordinates[:, :3], np.stack([truth.x, truth.y, truth.z], axis=-1), atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(coordinates[:, 3:7], axis=1), 1.0, atol=1e-12)
    yaw = 2 * np.arctan2(coordinates[:, 6], coordinates[:, 3])
    turn = (yaw - truth.yaw + np.pi) % (2 * np.pi) - np.pi
    assert np.abs(turn).max() < 0.2  # the pelvis turns a little with each step
    assert population.feet(2.013).load_n.shape == (5, 2)


def test_poses_between_ticks_lie_between(wanderers):
    population = make_population(wanderers, 2)
    population.advance(6.0)
    for tick in range(160, 230):
        early, middle, late = (population.qpos((tick + share) * TICK_S)[:, :3] for share in (0, 0.5, 1))
        np.testing.assert_allclose(middle, (early + late) / 2, atol=0.005)


def test_the_past_is_kept_for_a_while_and_no_longer(wanderers):
    population = make_population(wanderers, 2)
    population.advance(HISTORY_S + 4.0)
    population.qpos(4.5)
    with pytest.raises(ValueError, match="advance"):
        population.qpos(2.0)
    with pytest.raises(ValueError, match="advance"):
        population.qpos(HISTORY_S + 5.0)


def test_advancing_again_to_the_past_does_nothing(wanderers):
    population = make_population(wanderers, 2)
    population.advance(2.0)
    before = population.qpos(2.0)
    population.advance(1.0)
    np.testing.assert_array_equal(population.qpos(2.0), before)


def test_an_empty_room_and_a_lonely_person():
    nobody = make_population({}, 0)
    nobody.advance(1.0)
    assert nobody.qpos(1.0).shape == (0, NQ_PERSON)
    assert nobody.truth(1.0).x.shape == (0,)
    one = make_population({"anna": Person()}, 0)
    one.advance(5.0)
    assert np.isfinite(one.qpos(5.0)).all()


def test_starts_are_apart_and_inside(wanderers):
    for seed in range(20):
        truth = make_population(wanderers, seed).truth(0.0)
        place = np.stack([truth.x, truth.y], axis=-1)
        apart = np.linalg.norm(place[:, None] - place, axis=-1) + 9 * np.eye(5)
        assert apart.min() >= 0.7 - 0.05
        assert (place > AREA.min(axis=0)).all()
        assert (place < AREA.max(axis=0)).all()


def test_a_start_is_where_it_was_asked_for():
    people = {
        "anna": Person(start=(1.0, 1.0), heading_deg=90.0),
        "bert": Person(script=(Walk(waypoints=((-1.0, 2.0), (1.0, 2.0))),)),
        "cleo": Person(start=(0.0, 1.5), script=(Stand(),)),
    }
    truth = make_population(people, 0).truth(0.0)
    np.testing.assert_allclose(truth.x, [1.0, -1.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(truth.y, [1.0, 2.0, 1.5], atol=1e-9)
    assert truth.yaw[0] == pytest.approx(np.pi / 2)
    assert truth.yaw[1] == pytest.approx(0.0)


def test_too_many_people_or_too_small_an_area_teach():
    with pytest.raises(InputError, match=r"from everybody else"):
        make_population({f"p{number}": Person() for number in range(40)}, 0)
    sliver = np.array([[0, 0], [4, 0], [4, 0.3], [0, 0.3]])
    with pytest.raises(InputError, match="too narrow"):
        make_population({"anna": Person()}, 0, sliver)
