"""What people do: what a scenario may say, and what a user is told when it says something else."""

from __future__ import annotations

from typing import Any

import pytest
from pydantic import ValidationError

from trackers.errors import InputError
from twin.people.script.recorded import describe_late_actions
from twin.scenario import load_scenario
from twin.scenario.action import RecordedPath, WaitCondition
from twin.scenario.behaviour import Turn, TurnHead, endless
from twin.scenario.person import Person
from twin.scenario.scenario import describe_circles


def person(*script: dict[str, Any], **more: Any) -> Person:
    return Person.model_validate({"script": list(script), **more})


def test_one_action_needs_no_brackets() -> None:
    assert Person.model_validate({"script": {"kind": "stand"}}) == person({"kind": "stand"})


def test_every_action_is_read() -> None:
    script = person(
        {"kind": "wander", "for_s": 2},
        {"kind": "walk", "waypoints": [[0, 1], [1, 1]], "face": [0, 0]},
        {"kind": "run", "waypoints": [[3, 1]], "speed_m_s": 4},
        {"kind": "stand", "for_s": 1, "at_s": 20},
        {"kind": "turn", "by_deg": -90},
        {"kind": "sit", "seat": "chair", "for_s": 5, "when": {"near": [0, 0], "within_m": 2}},
        {"kind": "lie", "bed": "bed", "for_s": 5},
        {"kind": "bend", "angle_deg": 40},
        {"kind": "reach", "point": [1, 1, 1.2]},
        {"kind": "look", "yaw_deg": 40},
        {"kind": "follow", "person": "bob", "for_s": 3},
        {"kind": "meet", "person": "bob"},
        {"kind": "leave", "to": [0, 3]},
    ).script
    assert [action.kind for action in script] == [
        "wander", "walk", "run", "stand", "turn", "sit", "lie", "bend", "reach", "look", "follow", "meet", "leave",
    ]  # fmt: skip
    assert [endless(action) for action in script] == [False] * 12 + [True]


@pytest.mark.parametrize(
    ("script", "said"),
    [
        ([{"kind": "stand"}, {"kind": "bend"}], "stand never ends"),
        ([{"kind": "walk", "waypoints": [[0, 0], [1, 0]], "repeat": True}, {"kind": "bend"}], "walk never ends"),
        (
            [{"kind": "walk", "waypoints": [[0, 0]], "repeat": True}],
            r"repeat: \[0.0, 0.0\] is the only waypoint; two or more",
        ),
        (
            [{"kind": "run", "waypoints": [[0, 0], [0, 0]], "repeat": True}],
            r"repeat: \[0.0, 0.0\] is the only waypoint",
        ),
        ([{"kind": "turn"}], "exactly one of to_deg, by_deg and towards"),
        ([{"kind": "turn", "to_deg": 1, "by_deg": 1}], "exactly one of"),
        ([{"kind": "look", "at": [0, 0], "yaw_deg": 3}], "both at and yaw_deg"),
        ([{"kind": "bend", "for_s": -1}], "greater than or equal to 0"),
        ([{"kind": "run", "waypoints": [[0, 0]], "speed_m_s": 9}], "less than or equal to 5"),
        ([{"kind": "dance"}], "expected tags: 'wander'"),
        ([{"kind": "bend", "when": {"near": "bob"}}], "is not a condition"),
        ([{"kind": "path", "points": [[0, 0, 0], [0, 1, 0]]}], "growing times"),
        ([{"kind": "path", "points": [[0, 0, 0], [1, 20, 0]]}], "a jump of 20.0 m/s"),
        ([{"kind": "path", "points": [[0, 0, 0], [1, float("nan"), 0]]}], "finite number"),
        ([{"kind": "path", "points": [[-2, 0, 0], [-1, 1, 0]]}], "before the start"),
        ([{"kind": "path", "points": [[0, 0, 0], [1, 1, 0]]}, {"kind": "stand"}], "never ends"),
        ([{"kind": "bend"}, {"kind": "path", "points": [[0, 0, 0], [1, 1, 0]]}], "a path says where and when"),
    ],
)
def test_what_cannot_be_done_teaches(script: list[dict[str, Any]], said: str) -> None:
    with pytest.raises(ValidationError, match=said):
        person(*script)


def test_a_path_has_its_own_start() -> None:
    with pytest.raises(ValidationError, match="a path says where and when"):
        person({"kind": "path", "points": [[0, 0, 0], [1, 1, 0]]}, start=[0, 0])


@pytest.mark.parametrize(
    ("override", "said"),
    [
        ("people.white.script={kind: look, at: nobody}", "script.0.at: 'nobody' is nobody in people; valid are black"),
        ("people.white.script={kind: follow, person: white}", "is the person themselves"),
        ("people.white.script={kind: bend, when: {person: bob, does: sit}}", "script.0.when.person: 'bob'"),
        ("people.white.script={kind: bend, when: {near: bob, within_m: 2}}", "script.0.when.near: 'bob'"),
        ("people.white.height_m=-1", "people.white.height_m"),
        (
            "people.white.script={kind: bend, when: {person: blue, does: sit}}",
            "'blue' never does 'sit'; valid are wander, stand",
        ),
        (
            "people.white.script={kind: bend, when: {near: blue, within_m: 0.1}}",
            "closer than people come to each other",
        ),
        ("people.white.script={kind: walk, waypoint: [[0, 0]]}", "did you mean 'waypoints'"),
    ],
)
def test_a_scenario_names_who_is_there(override: str, said: str) -> None:
    with pytest.raises(InputError, match=said.replace(".", r"\.").replace("[", r"\[")):
        load_scenario("lab-five-people", [override])


def test_conditions_say_one_thing() -> None:
    assert WaitCondition(near="bob", within_m=1.0).near == "bob"
    assert WaitCondition(person="bob", does="sit").does == "sit"
    for wrong in (
        {},
        {"near": "bob"},
        {"person": "bob"},
        {"near": "bob", "within_m": 1, "person": "bob", "does": "sit"},
    ):
        with pytest.raises(ValidationError, match="is not a condition"):
            WaitCondition.model_validate(wrong)


def test_shown_values_are_those_given() -> None:
    assert TurnHead(at="bob").at == "bob"
    assert Turn(towards=(1.0, 2.0)).towards == (1.0, 2.0)
    assert RecordedPath(points=((0, 0, 0), (1, 1, 0))).points[1] == (1, 1, 0)


def test_what_comes_after_the_end_is_told() -> None:
    changes = ["people.white.arrive_s=100", "people.black.script={kind: bend, at_s: 500}"]
    late = describe_late_actions(load_scenario("lab-five-people", changes).people, 26.2)
    assert [each.split(":")[0] for each in late] == ["people.white.arrive_s", "people.black.script.0.at_s"]
    assert describe_late_actions(load_scenario("lab-five-people").people, 26.2) == []


def test_who_follow_each_other_are_reported_once_a_circle() -> None:
    def follows(name: str, **more: float) -> str:
        return str([{"kind": "follow", "person": name} | more]).replace("'", "")

    pair = [f"people.black.script={follows('blue')}", f"people.blue.script={follows('black')}"]
    after = f"people.pink.script={follows('black')}"
    (found,) = describe_circles(load_scenario("lab-five-people", [*pair, after]))
    assert found.startswith("people.black.script.0: black, who follows blue, who follows black: none of them walks")
    for lead in (f"people.blue.script={follows('black', for_s=2)}", "people.blue.script=[{kind: wander}]"):
        assert describe_circles(load_scenario("lab-five-people", [pair[0], lead, after])) == []
