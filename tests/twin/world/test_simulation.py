"""A scenario in motion: the same seed gives the same bits, and nothing depends on what it should not."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from trackers.errors import InputError
from trackers.observations import LaserScan, Observation
from twin.scenario import Scenario, load_scenario
from twin.scenario.housings import assumed_rig
from twin.scenario.load import dump_scenario
from twin.truth.truth_types import TruthFrame
from twin.world.simulation import Simulation

SHORT = ["duration_s=1.0", "background_frames=2"]


def scenario(*changes: str) -> Scenario:
    return load_scenario("lab-five-people", [*SHORT, *changes])


def simulate(described: Scenario, images: bool = False) -> tuple[list[Observation], list[TruthFrame]]:
    truth: list[TruthFrame] = []
    with Simulation(described, images=images, on_truth=truth.append) as simulation:
        return list(simulation), truth


def same(first: Sequence[Observation], second: Sequence[Observation]) -> bool:
    def content(each: Observation) -> np.ndarray:
        return each.ranges_m if isinstance(each, LaserScan) else each.rgb

    return len(first) == len(second) and all(
        a.sensor == b.sensor and a.stamp_ns == b.stamp_ns and np.array_equal(content(a), content(b), equal_nan=True)
        for a, b in zip(first, second, strict=True)
        if isinstance(a, LaserScan)
    )


def of(observations: Sequence[Observation], sensor: str) -> list[Observation]:
    return [each for each in observations if each.sensor == sensor]


def test_same_seed_same_bits_other_seed_other_bits() -> None:
    first, first_truth = simulate(scenario())
    second, second_truth = simulate(scenario())
    other, _ = simulate(scenario("seed=1"))
    assert same(first, second)
    assert first_truth == second_truth
    assert not same(first, other)


@pytest.mark.parametrize("name", ["lab-five-people", "home-three-people"])
def test_what_is_worked_out_ahead_is_told_as_if_one_stamp_came_after_the_other(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    described = load_scenario(name, ["duration_s=2.4", "background=none", "faults={}"])

    def told() -> list[object]:
        what: list[object] = []
        with Simulation(described, images=False, on_truth=what.append, on_detail=what.append) as simulation:
            for delivered in simulation.deliveries():
                what.append((delivered.arrival_ns, bytes(delivered.encoded.data)))
        return what

    ahead = told()
    monkeypatch.setattr("twin.world.simulation.AHEAD_S", 0.0)
    assert told() == ahead


def test_images_too_are_the_same_for_the_same_seed() -> None:
    first, _ = simulate(scenario("duration_s=0.2"), images=True)
    second, _ = simulate(scenario("duration_s=0.2"), images=True)
    for a, b in zip(of(first, "fisheye"), of(second, "fisheye"), strict=True):
        assert np.array_equal(a.rgb, b.rgb)


def test_a_sensor_more_changes_no_other() -> None:
    alone, alone_truth = simulate(scenario("sensors.knee=null"))
    beside, beside_truth = simulate(scenario())
    assert same(of(alone, "waist"), of(beside, "waist"))
    assert [[(p.x, p.y) for p in frame.people] for frame in alone_truth] == [
        [(p.x, p.y) for p in frame.people] for frame in beside_truth
    ]


def test_the_order_in_which_people_are_listed_changes_only_their_ids() -> None:
    described = scenario()
    turned = described.model_copy(update={"people": dict(reversed(described.people.items()))})
    first, first_truth = simulate(described)
    second, second_truth = simulate(turned)
    assert same(first, second)
    count = len(described.people)
    for a, b in zip(first_truth, second_truth, strict=True):
        assert {p.id: (p.x, p.y) for p in a.people} == {count + 1 - p.id: (p.x, p.y) for p in b.people}


def test_truth_comes_at_every_stamp_also_of_lost_observations() -> None:
    observations, truth = simulate(scenario("sensors.waist.dropout=1", "sensors.knee.phase_s=0.05"))
    assert not of(observations, "waist")
    assert [frame.stamp_ns for frame in truth] == [50_000_000 * k for k in range(20)]


def test_observations_come_in_order_of_arrival() -> None:
    described = scenario("sensors.waist.delay_s=0.13")
    with Simulation(described, images=False) as simulation:
        arrivals = [(each.arrival_ns, each.encoded.observation) for each in simulation.deliveries()]
    assert [arrival for arrival, _ in arrivals] == sorted(arrival for arrival, _ in arrivals)
    waist = [(arrival, each.stamp_ns) for arrival, each in arrivals if each.sensor == "waist"]
    assert all(arrival - stamp == 130_000_000 for arrival, stamp in waist)


def test_the_background_holds_nobody_and_can_be_left_out() -> None:
    with Simulation(scenario(), images=False) as simulation:
        background = simulation.background()
        observed = list(simulation)
    assert {each.sensor for each in background} == {"waist", "knee"}
    assert len(background) == 4
    nearest = min(float(np.nanmin(each.ranges_m)) for each in background if isinstance(each, LaserScan))
    assert nearest > 1.5  # people walk nearer than the furniture stands
    assert min(float(np.nanmin(each.ranges_m)) for each in observed if isinstance(each, LaserScan)) < 1.5
    with Simulation(scenario("background=none"), images=False) as simulation:
        assert simulation.background() == []


def test_a_room_without_people() -> None:
    observations, truth = simulate(scenario().model_copy(update={"people": {}}))
    assert len(observations) == 20
    assert all(frame.people == () for frame in truth)


def test_who_stands_behind_another_is_hidden() -> None:
    people = ["people=null", "people.near={start: [0, 1.2], script: {kind: stand}, height_m: 1.8, build: 1.2}"]
    far = "people.far={start: [0, 2.4], heading_deg: 90, script: {kind: stand}, height_m: 1.6, build: 0.8}"
    _, truth = simulate(scenario(*people, far))
    near, behind = truth[0].people
    assert near.visible["waist"] == 1.0
    assert behind.visible["waist"] < 0.3
    assert near.visible["knee"] > 0.9


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ("people.white.start=[9, 9]", r"people\.white\.start: \[9, 9\] is outside the room's walkable area"),
        ("sensors.waist.mount.xyz=[0, 4.5, 1]", r"sensors\.waist\.mount\.xyz: \[0, 4\.5, 1\] is inside"),
        ("sensors.waist.mount.xyz=[0, 1, -0.5]", r"sensors\.waist\.mount\.xyz: hangs 0\.5 m below the floor"),
        ("room=moon", "there is no room 'moon'"),
    ],
)
def test_what_cannot_be_is_refused(change: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        Simulation(scenario(change), images=False)


def test_people_in_each_other_are_refused() -> None:
    overlapping = ["people.white.start=[0, 1.5]", "people.black.start=[0.2, 1.5]"]
    with pytest.raises(InputError, match=r"people\.black\.start: \[0\.2, 1\.5\] is 0\.20 m from 'white'"):
        Simulation(scenario(*overlapping), images=False)


def test_the_main_sensor_that_a_scenario_states_is_the_rigs() -> None:
    stated = load_scenario("lab-five-people", [*SHORT, "main_sensor=knee"])
    with Simulation(stated, images=False) as simulation:
        assert simulation.rig.main_sensor == simulation.true_rig.main_sensor == "knee"
        assert assumed_rig(stated, simulation.rig.area or ()).main_sensor == "knee"
    with Simulation(load_scenario("lab-five-people", [*SHORT, "main_sensor=fisheye"]), images=False) as simulation:
        assert simulation.rig.main_sensor == "waist"  # the camera is left out


def test_what_no_scenario_states_is_not_written_into_recordings() -> None:
    plain = scenario()
    assert "main_sensor" not in dump_scenario(plain)
    with Simulation(plain, images=False) as simulation:
        assert "main:" not in simulation.rig.dump_yaml()
    with pytest.raises(
        InputError, match="main_sensor: 'wrist' is no sensor; did you mean 'waist'\\? valid are waist, knee, fisheye"
    ):
        scenario("main_sensor=wrist")
