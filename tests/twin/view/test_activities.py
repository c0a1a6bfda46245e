"""What people do in a run, and when it is seen best."""

from __future__ import annotations

import pytest

from trackers.configuration import validate
from twin.scenario import Scenario, load_scenario
from twin.view.activities import BACKWARDS, SIDEWAYS, Activity, activities
from twin.world.scene import build_scene, populate

pytestmark = pytest.mark.slow

SCANNER = {"low": {"kind": "laser", "rate_hz": 10, "mount": {"xyz": [0, 0, 0.4]}}}
EVERYTHING = {
    "wanders", "stands", "walks", "turns", "sits", "lies", "bends", "reaches", "looks", "follows", "meets", "leaves",
    SIDEWAYS, BACKWARDS,
}  # fmt: skip


def found(scenario: Scenario) -> list[Activity]:
    return activities(populate(scenario, build_scene(scenario)), scenario.duration_s)


@pytest.fixture(scope="module")
def everyday_and_present() -> tuple[list[Activity], list[int]]:
    """Activities of the everyday people, and how many were there at each time looked at."""
    scenario = load_scenario("everyday")
    population = populate(scenario, build_scene(scenario))
    advance, present = population.advance, []

    def counted(t: float) -> None:
        advance(t)
        present.append(int(population.present(t).sum()))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(population, "advance", counted)
        return activities(population, scenario.duration_s), present


@pytest.fixture(scope="module")
def everyday(everyday_and_present: tuple[list[Activity], list[int]]) -> list[Activity]:
    return everyday_and_present[0]


def one(script, seconds: float = 8.0) -> dict[str, float]:
    people = {"anna": {"start": [0.0, 0.0], "heading_deg": 0, "script": script}}
    content = {"name": "one", "room": "sensing_room", "people": people, "sensors": SCANNER, "duration_s": seconds}
    return {each.verb: each.t for each in found(validate(Scenario, content, "test"))}


def test_the_everyday_people_do_everything_but_run(everyday):
    assert {each.verb for each in everyday} == EVERYTHING


def test_the_runners_run():
    runs = [each.person for each in found(load_scenario("plaza-runners")) if each.verb == "runs"]
    assert runs == ["gina", "hugo"]


def test_activities_come_by_person_in_order_of_time(everyday):
    assert [each.person for each in everyday] == sorted(each.person for each in everyday)
    for name in {each.person for each in everyday}:
        times = [each.t for each in everyday if each.person == name]
        assert times == sorted(times)
    assert len({(each.person, each.verb) for each in everyday}) == len(everyday)


def test_a_posture_is_shown_when_it_is_reached(everyday):
    scenario = load_scenario("everyday")
    world = populate(scenario, build_scene(scenario))
    sits = next(each for each in everyday if each.person == "anna" and each.verb == "sits")
    world.advance(sits.t)
    truth = world.truth(sits.t)
    place = world.names.index("anna")
    assert truth.present[place] and truth.z[place] < 0.65
    assert world.doing[place] == "sit"


def test_who_is_still_on_the_way_to_a_seat_does_not_sit():
    def sitter(seconds: float) -> set[str]:
        people = {"ben": {"start": [-0.9, -0.6], "script": {"kind": "sit", "seat": "chair_left"}}}
        content = {"name": "one", "room": "sensing_room", "people": people, "sensors": SCANNER, "duration_s": seconds}
        return {each.verb for each in found(validate(Scenario, content, "test"))}

    assert sitter(1.5) == {"goes to sit"}
    assert sitter(12.0) == {"sits"}


def test_the_moment_is_in_the_middle():
    stands = one([{"kind": "stand", "for_s": 4}, {"kind": "walk", "waypoints": [[1.0, -0.6]]}])
    assert stands["stands"] == pytest.approx(2.0, abs=1.5)
    assert 4.0 < stands["walks"] < 6.0


def test_steps_sideways_and_backwards_are_told_apart():
    sideways = one({"kind": "walk", "waypoints": [[0.0, -1.0]], "speed_m_s": 0.6, "face": [3.0, -0.5]}, 4.0)
    backwards = one({"kind": "walk", "waypoints": [[-1.2, 0.0]], "speed_m_s": 0.6, "face": [3.0, 0.0]}, 4.0)
    assert SIDEWAYS in sideways and "walks" not in sideways
    assert BACKWARDS in backwards and "walks" not in backwards


def test_a_label_says_who_what_and_when():
    assert str(Activity("anna", "sits", 12.34)) == "anna sits, 12.3 s"


def test_at_most_four_are_in_the_everyday_room_at_once(everyday_and_present):
    present = everyday_and_present[1]
    assert len(present) > 100
    assert max(present) <= 4
