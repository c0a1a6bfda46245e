"""Scenarios whose people start elsewhere, later and faster by the seed."""

from __future__ import annotations

import numpy as np
import pytest

from trackers.errors import InputError
from twin.people.population import randomized
from twin.scenario import load_scenario
from twin.scenario.behaviour import RecordedPath, Walk
from twin.scenario.load import dump_scenario
from twin.world.world import World

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
