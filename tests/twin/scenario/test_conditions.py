"""What a report says of what a scenario did to its sensors and its light."""

from __future__ import annotations

from twin.scenario import load_scenario
from twin.scenario.conditions import conditions_of


def test_a_scenario_that_does_nothing_to_them_is_passed_over() -> None:
    assert conditions_of(load_scenario("lab-five-people")) == []


def test_faults_and_beliefs_are_named_with_their_times() -> None:
    faults, misled = conditions_of(load_scenario("lab-faults"))
    assert faults.startswith("Faults: dead beams of waist throughout; dropout of knee from 3 to 6 s; ")
    assert "delay of knee and fisheye from 7 to 9 s" in faults and "occlusion of fisheye from 19 s on" in faults
    assert misled == "Trackers believe another pose, lens or clock than the true one of: fisheye."


def test_changes_of_the_light_are_named_with_their_times() -> None:
    dim = load_scenario("lab-five-people", ['lights=[{"at_s": 5, "brightness": 0.1, "over_s": 2}]'])
    assert conditions_of(dim) == ["Light: all to 0.1 from 5 s."]
