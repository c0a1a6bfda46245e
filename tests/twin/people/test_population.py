"""The population: repeatable, independent of the order of listing, with a memory of fixed size; randomized by its seed."""

from __future__ import annotations

import numpy as np
import pytest
from people_cast import AREA, FIVE, make_population

from trackers.errors import InputError
from twin.geometry.geom_hull import hull_points
from twin.people.body.person_spec import NQ_PERSON
from twin.people.population import randomized
from twin.people.posture.posture_rows import HISTORY_S, TICK_S
from twin.room.obstacles import KEEP_FROM_FURNITURE_M
from twin.scenario import load_scenario
from twin.scenario.action import RecordedPath
from twin.scenario.behaviour import Stand, Walk
from twin.scenario.load import dump_scenario
from twin.scenario.person import Person
from twin.world.world import World


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
    with pytest.raises(ValueError, match="people are kept"):
        population.qpos(2.0)
    with pytest.raises(ValueError, match="people are kept"):
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


def test_a_crowd_that_fits_is_placed_with_every_seed():
    """Places drawn first may leave none for the last; ten people fit into the area, whatever comes first."""
    for seed in range(20):
        truth = make_population({f"p{number}": Person() for number in range(10)}, seed).truth(0.0)
        place = np.stack([truth.x, truth.y], axis=-1)
        apart = np.linalg.norm(place[:, None] - place, axis=-1) + 9 * np.eye(10)
        assert apart.min() >= 0.7 - 0.05


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


MOVEMENTS = ("movements-crossing", "movements-turning", "movements-going-around", "movements-going-back")


def test_a_scenario_without_it_is_itself():
    scenario = load_scenario("home-cameras")
    assert randomized(scenario) is scenario
    assert "randomize" not in dump_scenario(scenario)


def test_seeds_differ_within_bounds_and_the_same_seed_does_not():
    scenario = load_scenario("movements-crossing")
    runs = [randomized(scenario.model_copy(update={"seed": seed})) for seed in range(40)]
    for name, person in scenario.people.items():
        starts = np.array([run.people[name].start for run in runs]) - np.array(person.start)
        assert (np.abs(starts) <= 0.15).all() and (np.ptp(starts, axis=0) > 0.2).all()
        for number, action in enumerate(person.script):
            assert isinstance(action, Walk) and action.at_s is not None
            drawn = [run.people[name].script[number] for run in runs]
            later = np.array([each.at_s for each in drawn]) - action.at_s
            faster = np.array([each.speed_m_s for each in drawn]) / action.speed_m_s
            assert 0.2 < np.abs(later).max() <= 0.3 and 0.06 < np.abs(faster - 1).max() <= 0.1 + 1e-9
    assert randomized(runs[3]) is runs[3]
    assert randomized(scenario.model_copy(update={"seed": 3})) == runs[3]


def test_a_path_is_moved_as_a_whole_and_walked_at_another_pace():
    scenario = load_scenario("straight-course", ["seed=1000"])
    (before,), (after,) = (each.people["anna"].script for each in (scenario, randomized(scenario)))
    assert isinstance(before, RecordedPath) and isinstance(after, RecordedPath)
    moved = np.array(after.points)[:, 1:] - np.array(before.points)[:, 1:]
    np.testing.assert_allclose(moved, np.broadcast_to(moved[0], moved.shape), atol=1e-12)
    pace = np.diff([t for t, _, _ in after.points][1:]) / np.diff([t for t, _, _ in before.points][1:])
    assert np.ptp(pace) < 1e-9 and 0.9 <= 1 / pace[0] <= 1.1


def test_a_path_comes_earlier_only_as_far_as_its_first_stretch_allows():
    points = ((0.5, 0.0, 1.0), (1.0, 0.5, 1.0), (3.0, 1.5, 1.0))
    scenario = load_scenario("lab-five-people", ["randomize.onset_s=10", "duration_s=1"])
    person = Person(script=(RecordedPath(points=points),))
    delays = []
    for seed in range(1000, 1020):
        (path,) = (
            randomized(scenario.model_copy(update={"people": {"anna": person}, "seed": seed})).people["anna"].script
        )
        assert isinstance(path, RecordedPath)
        RecordedPath(points=path.points)  # what a user could have written: times that grow, at no more than people run
        delays.append(path.points[1][0] - points[1][0])
        assert path.points[2][0] - path.points[1][0] == pytest.approx(2.0)
    assert min(delays) == pytest.approx(-0.4)  # half a metre at 5 m/s
    assert max(delays) > 5


@pytest.mark.parametrize("name", [*MOVEMENTS, "pair", "straight-course"])
def test_the_shipped_movements_are_walked_from_the_drawn_start_without_a_collision(name):
    scenario = load_scenario(name, ["seed=2101"])
    world, people = World(scenario), randomized(scenario).people
    paths = []
    for t in np.arange(0.0, scenario.duration_s - 0.5, 0.5):
        world.people.advance(t)
        paths.append(world.people.qpos(t)[:, :2].copy())
    paths = np.array(paths)
    starts = [each.script[0].points[0][1:] if each.start is None else each.start for each in people.values()]
    np.testing.assert_allclose(paths[0], starts, atol=0.03)
    assert (np.ptp(paths, axis=0).max(axis=1) > 0.3).sum() >= min(2, len(people))  # cleo may stand
    gaps = np.linalg.norm(paths[:, :, None] - paths[:, None], axis=3)
    assert (gaps + 9 * np.eye(len(people))).min() > 0.4


@pytest.mark.parametrize("seed", [2100, 2102])
def test_a_world_begins_where_its_seed_has_drawn_people(seed):
    scenario = load_scenario("movements-crossing", [f"seed={seed}"])
    starts = [each.start for each in randomized(scenario).people.values()]
    np.testing.assert_allclose(World(scenario).people.qpos(0.0)[:, :2], starts, atol=0.03)


def test_bounds_are_checked():
    with pytest.raises(InputError, match="randomize.speed"):
        load_scenario("pair", ["randomize.speed=0.9"])


def test_former_names_are_read_in_files_and_overrides_and_named(tmp_path, caplog):
    path = tmp_path / "own.yaml"
    path.write_text(
        "name: own\nextends: lab-faults\nvary: {start_m: 0.1}\nsensors: {waist: {believed: {xyz: [0.1, 0, 0]}}}\n"
    )
    scenario = load_scenario(path, ["sensors.fisheye.believed.xyz=[0.3, 0, 0]", "vary.speed=0.1"])
    assert (scenario.randomize.start_m, scenario.randomize.speed) == (0.1, 0.1)
    moved = {name: sensor.calibration_error for name, sensor in scenario.sensors.items()}
    assert moved["waist"].xyz[0] == 0.1 and moved["fisheye"].xyz[0] == 0.3 and moved["knee"] is None
    assert moved["fisheye"].rpy_deg == load_scenario("lab-faults").sensors["fisheye"].calibration_error.rpy_deg
    for name in ("randomize", "calibration_error"):
        assert f"is now called {name!r}" in caplog.text
    for text in (dump_scenario(scenario),):
        assert "vary" not in text and "believed" not in text


@pytest.mark.parametrize("bag", ["handbag", "shoulder", "backpack"])
def test_what_people_carry_stays_within_the_distance_that_walkers_keep_from_things(bag):
    people = "{kind: walk, waypoints: [[-1.1, -1.2], [1.3, 1.6]], speed_m_s: 1.6}"
    changes = ["people.anna.height_m=1.85", f"people.anna.bag={bag}", f"people.anna.script={people}", "duration_s=3"]
    world = World(load_scenario("straight-course", changes))
    fastest = 0.0
    for t in np.arange(0.0, 3.0, 0.05):
        snapshot = world.snapshot(float(t))
        truth = world.population.truth(float(t))
        corners = hull_points(snapshot.model, snapshot.data, snapshot.model.geom("anna/bag").id)
        assert np.hypot(*(corners[:, :2] - (truth.x[0], truth.y[0])).T).max() < KEEP_FROM_FURNITURE_M + 0.01
        fastest = max(fastest, float(np.hypot(truth.vx[0], truth.vy[0])))
    assert fastest > 1.4
