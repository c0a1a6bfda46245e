"""Where a thing may be put up."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from trackers.errors import InputError
from twin.room.building import Building, check_mount
from twin.room.floor_surface import floor_of
from twin.room.obstacles import Footprints, obstacles_of

SHED = """
<mujoco><asset><mesh name="block" vertex="1 1 0  1.5 1 0  1.5 1.5 0  1 1.5 0  1 1 2  1.5 1 2  1.5 1.5 2  1 1.5 2"/></asset>
<worldbody>
  <geom type="plane" size="30 30 1"/>
  <geom type="box" pos="-3 0 1.25" size="0.1 2.1 1.25"/> <geom type="box" pos="3 0 1.25" size="0.1 2.1 1.25"/>
  <geom type="box" pos="0 -2 1.25" size="3.1 0.1 1.25"/> <geom type="box" pos="0 2 1.25" size="3.1 0.1 1.25"/>
  <geom type="box" pos="0 0 2.6" size="3.1 2.1 0.1"/>
  <geom type="mesh" mesh="block"/>
  <geom name="table" type="box" pos="-1.5 -1 0.7" size="0.5 0.4 0.02"/>
</worldbody></mujoco>
"""


@pytest.fixture(scope="module")
def shed() -> Building:
    model = mujoco.MjModel.from_xml_string(SHED)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    walkable = np.array([[-2.7, -1.7], [2.7, -1.7], [2.7, 1.7], [-2.7, 1.7]])
    return Building.of(model, data, floor_of(model, data, "shed"), walkable, Footprints(obstacles_of(model)))


def test_the_walls_are_found(shed: Building) -> None:
    low, high = shed.outline.min(axis=0), shed.outline.max(axis=0)
    assert low == pytest.approx([-2.9, -1.9], abs=0.05) and high == pytest.approx([2.9, 1.9], abs=0.05)
    places = np.array([[0, 0, 1.0], [40, 40, 1], [3.0, 0, 1], [3.3, 0, 1], [0, -5, 1]])
    assert shed.is_indoors(places).tolist() == [True, False, True, False, False]


def test_a_mesh_counts_as_a_wall(shed: Building) -> None:
    places = np.array([[1.25, 1.25, 1], [1.6, 1.25, 1], [3.0, 0, 1], [0, 0, 2.6], [0, 0, 1], [-1.5, -1, 0.7]])
    assert shed.is_solid(places).tolist() == [True, False, True, True, False, True]


def test_people_walk_amid_the_floor_below_a_height_and_not_above_a_table(shed: Building) -> None:
    places = np.array([[0, 0, 0.35], [0, 0, 2.3], [0, 1.85, 0.35], [-1.5, -1, 0.9], [1.6, 1.25, 0.4]])
    assert shed.is_walked(places, 2.2).tolist() == [True, False, False, False, False]


def test_places_along_walls_face_the_room(shed: Building) -> None:
    places, facing = shed.along_walls(0.5, 0.1, [1.0])
    assert len(places) == pytest.approx(2 * (5.8 + 3.8) / 0.5, abs=4)
    off = np.minimum(2.9 - np.abs(places[:, 0]), 1.9 - np.abs(places[:, 1]))
    assert off == pytest.approx(0.1, abs=1e-6) and shed.is_indoors(places).all()
    ahead = places[:, :2] + 0.3 * np.stack([np.cos(facing), np.sin(facing)], axis=1)
    assert (np.minimum(2.9 - np.abs(ahead[:, 0]), 1.9 - np.abs(ahead[:, 1])) > 0.05).all()


def test_ceilings_and_the_nearest_walls(shed: Building) -> None:
    assert shed.ceiling_m(np.array([[0.0, 0.0], [20.0, 20.0]])) == pytest.approx([2.5, np.inf])
    (first, foot, _), (second, _, _) = shed.walls_nearest(np.array([2.0, 1.7, 1.0]))
    assert (first, second) == pytest.approx((0.2, 0.9)) and foot == pytest.approx([2.0, 1.9], abs=0.05)


def test_distances_are_square_to_the_wall(shed: Building) -> None:
    for _, _, along in shed.walls_nearest(np.array([2.0, 1.7, 1.0])):
        assert min(abs(along)) == pytest.approx(0.0, abs=1e-9)


def test_the_edge_of_a_floor_is_drawn_where_no_wall_stands(shed: Building) -> None:
    assert shed.open_edges() == []
    with_door = SHED.replace('pos="0 -2 1.25" size="3.1 0.1 1.25"', 'pos="-1.8 -2 1.25" size="1.3 0.1 1.25"').replace(
        '<geom type="mesh"', '<geom type="box" pos="1.8 -2 1.25" size="1.3 0.1 1.25"/> <geom type="mesh"'
    )
    model = mujoco.MjModel.from_xml_string(with_door)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    walkable = np.array([[-2.7, -1.7], [2.7, -1.7], [2.7, 1.7], [-2.7, 1.7]])
    building = Building.of(model, data, floor_of(model, data, "shed"), walkable, Footprints(obstacles_of(model)))
    (door,) = building.open_edges()
    assert np.abs(door[:, 0]).max() == pytest.approx(0.5, abs=0.15) and (door[:, 1] < -1.8).all()


def test_a_floor_without_walls_is_all_building(tmp_path: Path) -> None:
    model = mujoco.MjModel.from_xml_string('<mujoco><worldbody><geom type="plane" size="5 5 1"/></worldbody></mujoco>')
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    walkable = np.array([[-4.8, -4.8], [4.8, -4.8], [4.8, 4.8], [-4.8, 4.8]])
    yard = Building.of(model, data, floor_of(model, data, "yard"), walkable, Footprints([]))
    assert yard.is_indoors(np.array([[0, 0, 1.0], [4.9, 4.9, 1], [5.2, 0, 1]])).tolist() == [True, True, False]


@pytest.mark.parametrize("turn_deg", [0, 37, 45, 200])
def test_no_mount_is_outside_the_planes_around_an_l_shaped_room(turn_deg: float) -> None:
    """Walls seen from their fronts alone; outside lies the L's notch, with other parts of the room behind its walls."""
    corners = np.array([[-4, -3], [4, -3], [4, 0], [0, 0], [0, 3], [-4, 3]], dtype=float)
    ways = np.roll(corners, -1, axis=0) - corners
    walls = "".join(
        f'<geom name="wall_{number}" type="plane" pos="{x} {y} 1.25" size="{np.hypot(*way) / 2} 1.25 0.1" '
        f'xyaxes="{-way[0]} {-way[1]} 0 0 0 1"/>'
        for number, ((x, y), way) in enumerate(zip(corners + ways / 2, ways, strict=True), start=1)
    )
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><compiler angle="degree"/><worldbody><geom name="floor" type="plane" size="0 0 1"/>'
        f'<frame euler="0 0 {turn_deg}">{walls}</frame></worldbody></mujoco>'
    )
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    turn = np.deg2rad(turn_deg)
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    x, y = np.meshgrid(np.arange(-3.9, 4.0, 0.4), np.arange(-2.9, 3.0, 0.4))
    for place in [*np.column_stack([x.ravel(), y.ravel()]), np.full(2, 1.5)]:
        xyz = np.array([*rotation @ place, 0.9])
        if (place > 0).all():
            with pytest.raises(InputError, match=r"outside the room, behind 'wall_[34]'|inside 'wall_[34]'"):
                check_mount(model, data, "mount", xyz)
        else:
            check_mount(model, data, "mount", xyz)
