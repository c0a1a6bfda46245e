"""Arms, hands and heads keep clear of the room and of others: in passing, in reaching, in bending."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from benchmarks.penetration import PenetrationCount, count_penetrations, furniture_in_use

from trackers.configuration import validate
from twin.scenario import Scenario, load_scenario
from twin.world.world import World

DT = 0.1
SENSORS = {"floor": {"kind": "floor", "mount": {"xyz": [-1.8, -1.4, 0]}}}


def world_of(people: dict[str, Any], duration_s: float, room: str = "plaza") -> World:
    content = {
        "name": "test", "room": room, "duration_s": duration_s, "seed": 1000, "people": people, "sensors": SENSORS,
    }  # fmt: skip
    return World(validate(Scenario, content, "test"))


def person(start: list[float], heading_deg: float, *script: dict[str, Any], **more: Any) -> dict[str, Any]:
    return {"start": start, "heading_deg": heading_deg, "height_m": 1.75, "script": list(script)} | more


def walk(*waypoints: list[float], **more: Any) -> dict[str, Any]:
    return {"kind": "walk", "waypoints": list(waypoints), "speed_m_s": 1.0} | more


REACH = {"kind": "reach", "point": [0.75, 0.0, 1.1], "for_s": 4.0}


@pytest.mark.parametrize("lateral_m", [0.5, 0.66, 0.7])
def test_arms_do_not_meet_as_strangers_pass(lateral_m: float) -> None:
    people = {
        "anna": person([-1.5, 0.0], 0, walk([1.5, 0.0])),
        "ben": person([1.5, lateral_m], 180, walk([-1.5, lateral_m])),
        "cleo": person([-1.5, -lateral_m], 0, walk([1.5, -lateral_m])),
    }
    found = count_penetrations(world_of(people, 5.0), np.arange(0, 5, DT))
    assert not found.deepest, str(found)


@pytest.mark.parametrize("x_m", [0.5, 0.75, 1.0])
def test_who_walks_past_keeps_off_a_hand_that_reaches(x_m: float) -> None:
    people = {
        "anna": person([0.0, 0.0], 0, REACH),
        "ben": person([x_m, -1.5], 90, {"kind": "stand", "for_s": 1.2}, walk([x_m, 1.5])),
    }
    found = count_penetrations(world_of(people, 7.0), np.arange(0, 7, DT))
    assert not found.deepest, str(found)


def begins(world: World, seconds: float) -> float | None:
    """The time at which anna's hand is farthest out [s]; None: it stays at her side."""
    hand = world.scene.model.geom("anna/left_hand").id
    out = []
    for t in np.arange(0, seconds, DT):
        world.snapshot(t)
        out.append(float(np.hypot(*world.data.geom_xpos[hand][:2])))
    return None if max(out) < 0.5 else DT * int(np.argmax(out))


def test_a_reach_waits_until_nobody_stands_before_the_hand_and_is_given_up_in_words() -> None:
    leaves = {"kind": "stand", "for_s": 2.0}, walk([1.5, 1.2])
    alone = begins(world_of({"anna": person([0.0, 0.0], 0, REACH)}, 9.0), 9.0)
    waits = begins(world_of({"anna": person([0.0, 0.0], 0, REACH), "ben": person([0.66, 0.0], 180, *leaves)}, 9.0), 9.0)
    assert alone is not None and waits is not None and waits > alone + 1.5
    stays = world_of({"anna": person([0.0, 0.0], 0, REACH), "ben": person([0.66, 0.0], 180, {"kind": "stand"})}, 12.0)
    assert begins(stays, 12.0) is None
    assert any("anna cannot reach" in each for each in stays.population.late())


@pytest.mark.parametrize(
    ("start", "heading_deg"),
    [([2.4, 1.2], 0), ([0.0, 1.9], 90), ([-2.4, 0.0], 180), ([0.0, -1.9], 270), ([-0.05, 0.9], 270)],
)
def test_who_bends_by_a_wall_or_a_table_turns_to_where_there_is_room_for_the_head(start, heading_deg) -> None:
    anna = person(start, heading_deg, {"kind": "bend", "angle_deg": 90, "for_s": 1.0})
    world = world_of({"anna": anna}, 6.0, "meeting_room")
    heads = []
    number = world.scene.ids["anna"]

    def allowed(t: float) -> dict[int, list[int]]:
        heads.extend(each.head_z for each in world.truth(round(t * 1e9), {}).people if each.id == number)
        return {}

    found = count_penetrations(world, np.arange(0, 6, DT), allowed)
    assert not found.deepest, str(found)
    assert min(heads) < 1.2


def test_the_hand_without_a_bag_reaches() -> None:
    reach = {"kind": "reach", "point": [0.5, -0.2, 1.2], "for_s": 2.0}
    gaps = {}
    for bag in ("none", "handbag"):
        world = world_of({"anna": person([0.0, 0.0], 0, reach, bag=bag)}, 4.0)
        hands = {hand: world.scene.model.geom(f"anna/{hand}_hand").id for hand in ("left", "right")}
        run = []
        for t in np.arange(0, 4, DT):
            world.snapshot(t)
            run.append([np.linalg.norm(world.data.geom_xpos[each] - reach["point"]) for each in hands.values()])
        gaps[bag] = dict(zip(hands, np.min(run, axis=0), strict=True))
    assert gaps["none"]["right"] < 0.08 < gaps["none"]["left"]
    assert world.scene.appearances["anna"].carries == (False, True)
    assert gaps["handbag"]["left"] < 0.08 < gaps["handbag"]["right"]


ROOM = """<mujoco><custom><numeric name="walkable_area" data="-2 -2 2 -2 2 2 -2 2"/></custom><worldbody>
  <light pos="0 0 2"/><geom name="floor" type="plane" size="3 3 1"/>
  <geom name="screen" type="box" pos="0 {side} 0.9" size="1.2 0.02 0.9"/>
  <body name="stool"><geom type="box" size="0.2 0.2 0.23" pos="0 0 0.23"/><site name="seat_stool" pos="0 0 0.46"/></body>
</worldbody></mujoco>"""


def beside_a_screen(
    tmp_path: Path, side_m: float, *script: dict[str, Any], **more: Any
) -> tuple[PenetrationCount, list[str]]:
    """Overlaps of a broad person with a screen whose face is `side_m` left of a stool, and what is said of them."""
    room = tmp_path / "room.xml"
    room.write_text(ROOM.format(side=side_m + 0.02))
    anna = person([1.0, -0.5], 180, *script, height_m=1.85, build=1.15, bag="none") | more
    world = world_of({"anna": anna}, 12.0, str(room))
    return count_penetrations(world, np.arange(0, 12, 2 * DT), lambda _: furniture_in_use(world)), world.late()


SIT = {"kind": "sit", "seat": "stool", "for_s": 3.0}


@pytest.mark.parametrize("side_m", [0.34, 0.42, 0.6])
def test_elbows_keep_off_what_stands_beside_a_seat(side_m: float, tmp_path: Path) -> None:
    found, said = beside_a_screen(tmp_path, side_m, SIT)
    assert not found.deepest and not said, (str(found), said)


def test_a_seat_without_room_is_warned_of_with_person_thing_and_depth(tmp_path: Path) -> None:
    found, said = beside_a_screen(tmp_path, 0.22, SIT)
    assert found.deepest
    (sentence,) = said
    assert sentence.startswith("anna has no room on 'stool' (left_") and "cm inside 'screen'), at " in sentence


@pytest.mark.parametrize("far_m", [0.3, 0.42, 0.7])
def test_a_hand_stops_at_what_it_touches(far_m: float, tmp_path: Path) -> None:
    reach = {"kind": "reach", "point": [0.6, far_m, 1.2], "for_s": 2.0}
    start = {"start": [0.6, 0.0], "heading_deg": 90}
    found, said = beside_a_screen(tmp_path, 0.45, reach, **start)
    assert not found.deepest, str(found)
    # behind the screen
    assert [each.startswith("anna has no room to reach (0.6, 0.7, 1.2) (") for each in said] == [True] * (far_m > 0.6)


@pytest.mark.sample(2)
@pytest.mark.parametrize("seed", [1022, 1039, 1047, 1056])
def test_nobody_in_a_drawn_room_stands_for_seconds_in_anothers_way(seed: int) -> None:
    world = World(load_scenario("drawn", [f"seed={seed}"]))
    places, there = [], []
    for t in np.arange(0, 20, 0.5):
        world.people.advance(t)
        places.append(world.population._crowd.place.copy())
        there.append(world.population.under_way & world.population._crowd.present)
    for k in range(8, len(places)):
        last = np.array(places[k - 8 : k + 1])
        stands = (np.abs(last - last[-1]).max(axis=0) < 0.1) & np.all(there[k - 8 : k + 1], axis=0)
        assert not stands.any(), (k / 2, world.population.late())
