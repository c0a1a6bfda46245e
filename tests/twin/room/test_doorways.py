"""Doorways of a room, and cables that go over them."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from trackers.errors import InputError
from twin.room.building import Building
from twin.room.doorways import cable_route, doorways, piece_across, width_m
from twin.room.floor_surface import floor_of
from twin.room.obstacles import Footprints, obstacles_of
from twin.studies.candidate_poses import keep_free_zones
from twin.studies.devices import Constraints

WALLS = {  # middle and half the size [m]: 6 m x 4 m, a gap of 0.9 m in the south, a partition with one of 0.8 m
    "floor": ("3 2 -0.05", "3 2 0.05"),
    "roof": ("3 2 2.75", "3 2 0.05"),
    "west": ("-0.05 2 1.35", "0.05 2 1.35"),
    "east": ("6.05 2 1.35", "0.05 2 1.35"),
    "north": ("3 4.05 1.35", "3.1 0.05 1.35"),
    "south_1": ("0.5 -0.05 1.35", "0.6 0.05 1.35"),
    "south_2": ("4 -0.05 1.35", "2 0.05 1.35"),
    "lintel": ("1.55 -0.05 2.4", "0.45 0.05 0.3"),
    "partition_1": ("4 0.6 1.35", "0.05 0.6 1.35"),
    "partition_2": ("4 3 1.35", "0.05 1 1.35"),
    "beam": ("4 1.6 2.35", "0.05 0.4 0.35"),
}
LINTEL_M, BEAM_M = 2.1, 2.0


def building(**changes: tuple[str, str] | None) -> Building:
    """Build the room with other boxes, or without (None)."""
    boxes = {name: box for name, box in (WALLS | changes).items() if box}
    geoms = "".join(f'<geom name="{name}" type="box" pos="{at}" size="{half}"/>' for name, (at, half) in boxes.items())
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{geoms}</worldbody></mujoco>")
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    walkable = np.array([[0.3, 0.3], [5.7, 0.3], [5.7, 3.7], [0.3, 3.7]])
    return Building.of(model, data, floor_of(model, data, "room"), walkable, Footprints(obstacles_of(model)))


@pytest.fixture(scope="module")
def room() -> Building:
    return building()


def test_gaps_of_outer_and_inner_walls_and_named_doors_are_doorways(room: Building) -> None:
    outer, inner = doorways(room)
    assert np.sort(outer.ends[:, 0]) == pytest.approx([1.1, 2.0], abs=0.1) and outer.top_m == pytest.approx(LINTEL_M)
    assert np.sort(inner.ends[:, 1]) == pytest.approx([1.2, 2.0], abs=0.05) and inner.top_m == pytest.approx(BEAM_M)
    assert [width_m(room, each) for each in (outer, inner)] == pytest.approx([0.9, 0.8])
    closed = building(
        oak_door_leaf=("1.55 -0.03 1.0", "0.45 0.02 1.0"), south_1=("1.5 -0.05 1.35", "1.6 0.05 1.35"), lintel=None
    )
    named, _ = doorways(closed)
    assert np.sort(named.ends[:, 0]) == pytest.approx([1.1, 2.0], abs=0.05)
    assert width_m(closed, named) == pytest.approx(0.9, abs=0.01)
    assert len(doorways(building(outdoor=("1.5 3.9 1", "0.5 0.02 1")))) == 2  # "door" within a word is none


def test_zones_by_doors_want_a_door() -> None:
    asked = Constraints.model_validate({"keep_free": [{"name": "doors", "doors_m": 1}]})
    closed = building(south_1=("1.5 -0.05 1.35", "1.6 0.05 1.35"), lintel=None, partition_1=None, partition_2=None)
    with pytest.raises(
        InputError, match=r"study.yaml: constraints.keep_free.0.doors_m: .*the room has none; a gap in a wall"
    ):
        keep_free_zones(asked, closed, "study.yaml")
    (open_to_sky,) = keep_free_zones(asked, building(roof=None, lintel=None, partition_1=None, partition_2=None), "")
    assert open_to_sky.highest_m == np.inf


@pytest.mark.parametrize("within_m", [0.5, 1.0])
def test_a_zone_by_a_door_ends_at_its_distance(room: Building, within_m: float) -> None:
    door = doorways(room)[0]
    corners = door.zone(within_m)
    way = door.ends[1] - door.ends[0]
    share = np.clip((corners - door.ends[0]) @ way / (way @ way), 0, 1)
    gap_m = np.hypot(*(corners - door.ends[0] - share[:, None] * way).T)
    assert (gap_m >= within_m - 1e-9).all() and (gap_m <= 1.03 * within_m).all()


@pytest.mark.parametrize(
    ("ends_m", "over"),
    [((0.3, 0.95), 1), ((0.95, 0.3), 1), ((0.3, 2.6), 0), ((2.3, 0.3), 0)],
)
def test_a_cable_goes_over_a_doorway_unless_it_runs_higher(room: Building, ends_m: tuple, over: int) -> None:
    """From beside the door to its other side: up, across and down again, or straight where it runs above the lintel."""
    start, place = np.array([0.6, 0.1, ends_m[0]]), np.array([2.4, 0.1, ends_m[1]])
    route = cable_route(room, doorways(room), start, place)
    level_m = 0.1 + 1.8 + 0.1 + abs(ends_m[1] - ends_m[0])
    assert route.length_m == pytest.approx(level_m + 2 * over * (LINTEL_M - max(ends_m)), abs=0.06)
    assert len(route.over) == over


def test_a_cable_takes_the_way_without_a_doorway_where_that_is_shorter(room: Building) -> None:
    start, place = np.array([0.1, 3.9, 0.3]), np.array([0.1, 0.1, 0.3])
    assert cable_route(room, doorways(room), start, place).over == ()
    there, back = (cable_route(room, doorways(room), *each) for each in ((start, place), (place, start)))
    assert there.length_m == pytest.approx(back.length_m) == pytest.approx(4.0, abs=0.1)


def test_a_cable_s_way_keeps_to_the_walls_and_is_as_long_as_counted(room: Building) -> None:
    start, place = np.array([0.5, 3.0, 0.3]), np.array([5.0, 3.9, 1.3])
    route = cable_route(room, doorways(room), start, place)
    assert np.hypot(*np.diff(route.corners, axis=0).T).sum() + 1.0 == pytest.approx(route.length_m)
    across = piece_across(room.outline, doorways(room)[0])
    assert across[[0, -1], 0] == pytest.approx([1.1, 2.0], abs=0.1) and np.abs(across[:, 1]).max() < 0.12
