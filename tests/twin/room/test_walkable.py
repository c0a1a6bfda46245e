"""Where people walk in a room that does not say it: what its floor and walls leave, and what leads out is closed."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from trackers.area import Area, meets_itself_at
from trackers.errors import InputError
from twin import models
from twin.geometry.polygon import inset, polygon_area
from twin.people.crowd.routes import Routes
from twin.room.floor_surface import floor_of
from twin.room.obstacles import OBSTACLE_REACH_M
from twin.room.walkable import NARROWEST_DOOR_M, parts_cut_off, rooms_left_out, walkable_area

pytestmark = pytest.mark.slow

FLOOR = '<geom name="floor" type="plane" size="{} {} 0.1"/>'
ENDLESS = '<geom name="floor" type="plane" size="0 0 0.1"/>'
OFF_M = OBSTACLE_REACH_M
NEAR_M = 0.03


def wall(x: float, y: float, half_x: float, half_y: float, height: float = 2.5) -> str:
    return f'<geom type="box" pos="{x} {y} {height / 2}" size="{half_x} {half_y} {height / 2}"/>'


def four_walls(half_x: float, half_y: float, gap: float = 0.0) -> str:
    """Walls 0.2 m thick around the inside, with a gap in the middle of the one at +x."""
    side = (half_y - gap / 2) / 2
    return (
        wall(0, half_y + 0.1, half_x + 0.2, 0.1)
        + wall(0, -half_y - 0.1, half_x + 0.2, 0.1)
        + wall(-half_x - 0.1, 0, 0.1, half_y)
        + wall(half_x + 0.1, half_y - side, 0.1, side)
        + wall(half_x + 0.1, side - half_y, 0.1, side)
    )


def area_of(world: str, turned_deg: float = 0.0, asset: str = "") -> np.ndarray:
    turned = world
    if turned_deg:  # a plane without an end stays as it is
        ground = ENDLESS if world.startswith(ENDLESS) else ""
        turned = f'{ground}<body euler="0 0 {turned_deg}">{world.removeprefix(ground)}</body>'
    model = mujoco.MjModel.from_xml_string(f"<mujoco>{asset}<worldbody>{turned}</worldbody></mujoco>")
    return area_in(model)


def area_in(model: mujoco.MjModel) -> np.ndarray:
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    corners = walkable_area(model, data, floor_of(model, data, "room.xml"), "room.xml")
    assert meets_itself_at(corners) is None
    Routes(corners, [])  # wide enough for ways
    assert inset(corners, 0.25) is not None  # and for wanderers
    return corners


def left_out_of(world: str) -> list[tuple[float, np.ndarray]]:
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{world}</worldbody></mujoco>")
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return rooms_left_out(model, data, floor_of(model, data, "room.xml"), area_in(model))


@pytest.mark.parametrize(("gap", "left_out"), [(0.6, 1), (0.8, 1), (NARROWEST_DOOR_M, 0), (1.2, 0)])
def test_a_room_behind_a_gap_that_nobody_fits_through_is_told(gap: float, left_out: int) -> None:
    half = (2 - gap / 2) / 2
    found = left_out_of(ENDLESS + four_walls(4, 2) + wall(-1, 2 - half, 0.05, half) + wall(-1, half - 2, 0.05, half))
    assert len(found) == left_out
    for size_m2, (x, y) in found:
        assert 8 < size_m2 < 11 and -4 < x < -1 and abs(y) < 2


def test_walls_around_too_little_are_told_where_people_walk_outdoors() -> None:
    ((size_m2, place),) = left_out_of(ENDLESS + four_walls(0.7, 0.7))
    assert 0.5 < size_m2 < 1 and np.abs(place).max() < 0.3
    assert left_out_of(ENDLESS + four_walls(4, 2) + wall(0, 0, 0.3, 0.3)) == []


@pytest.mark.parametrize(("beyond_m", "gap", "cut_off"), [(-0.3, 0, 0), (0.2, 0, 0), (1, 0, 1), (1, 0.6, 1), (1, 1, 0)])
def test_an_area_drawn_beyond_walls_that_nobody_passes_is_told(beyond_m: float, gap: float, cut_off: int) -> None:
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{ENDLESS}{four_walls(3, 2, gap)}</worldbody></mujoco>")
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    half = np.array([3, 2]) + beyond_m
    area = half * [[-1, -1], [1, -1], [1, 1], [-1, 1]]
    found = parts_cut_off(model, data, floor_of(model, data, "room.xml"), area)
    assert len(found) == cut_off
    assert all((np.abs(place) > [3, 2]).any() and size_m2 > 10 for size_m2, place in found)


def overlap(one: np.ndarray, other: np.ndarray) -> float:
    """Intersection over union, at the middles of 120 x 120 cells."""
    both = np.concatenate([one, other])
    cells = (np.stack(np.meshgrid(np.arange(120), np.arange(120)), axis=-1).reshape(-1, 2) + 0.5) / 120
    places = both.min(axis=0) + cells * np.ptp(both, axis=0)
    first, second = Area(one).contains(places), Area(other).contains(places)
    return float((first & second).sum() / (first | second).sum())


def rectangle(half_x: float, half_y: float, x: float = 0.0, y: float = 0.0) -> np.ndarray:
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    return corners * [half_x, half_y] + np.array([x, y])


def holds(corners: np.ndarray, *places: tuple[float, float]) -> list[bool]:
    return Area(corners).contains(np.array(places)).tolist()


@pytest.mark.parametrize(
    ("room", "least"), [("sensing_room", 0.9), ("meeting_room", 0.9), ("library_hall", 0.9), ("plaza", 0.9)]
)
def test_shipped_rooms_get_about_the_area_that_they_name(room: str, least: float) -> None:
    model = mujoco.MjModel.from_xml_path(str(models.find("rooms", room)))
    assert overlap(area_in(model), model.numeric("walkable_area").data.reshape(-1, 2)) >= least


def test_the_lab_names_less_than_its_walls_leave() -> None:
    """Its own area is the strip in the middle that the paper's people walked in, clear of all furniture."""
    model = mujoco.MjModel.from_xml_path(str(models.find("rooms", "lab")))
    corners, own = area_in(model), model.numeric("walkable_area").data.reshape(-1, 2)
    assert Area(corners).contains(own).all()
    assert overlap(corners, rectangle(3 - OFF_M, 2.2 - OFF_M, 0, 1.95)) > 0.9


@pytest.mark.parametrize("floor", [FLOOR.format(3, 2), FLOOR.format(3.2, 2.2), FLOOR.format(3.7, 2.9), ENDLESS])
@pytest.mark.parametrize("gap", [0.0, 0.9, 1.2])
@pytest.mark.parametrize("turned_deg", [0, 30])
def test_four_walls_enclose_the_area_whatever_floor_is_under_them_and_a_door_closes_it(
    floor: str, gap: float, turned_deg: float
) -> None:
    corners = area_of(floor + four_walls(3, 2, gap), turned_deg)
    angle = np.deg2rad(turned_deg)
    expected = rectangle(3 - OFF_M, 2 - OFF_M) @ [[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]
    assert len(corners) == 4
    assert np.linalg.norm(corners[:, None] - expected, axis=2).min(axis=1).max() < 2 * NEAR_M


@pytest.mark.parametrize("turned_deg", [0, 17])
def test_rooms_are_joined_by_doors_that_one_fits_through(turned_deg: float) -> None:
    def flat(gap: float) -> np.ndarray:
        half = (2 - gap / 2) / 2
        inner = wall(-1, 2 - half, 0.05, half) + wall(-1, half - 2, 0.05, half)
        return area_of(ENDLESS + four_walls(4, 2) + inner, turned_deg)

    angle = np.deg2rad(turned_deg)
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    rooms = [tuple(place) for place in np.array([(-2.5, 0.0), (2.0, 0.0)]) @ turn]
    joined = flat(0.9)
    assert holds(joined, *rooms) == [True, True]
    assert Routes(joined, []).way(np.array(rooms[0]), np.array(rooms[1])) is not None
    assert holds(flat(0.6), *rooms) == [False, True]  # the larger one


def test_a_room_of_the_shape_of_an_l_keeps_it() -> None:
    walls = wall(0, -2.1, 3, 0.1) + wall(-3.1, 0, 0.1, 2) + wall(3.1, -1, 0.1, 1) + wall(1.6, 0.1, 1.4, 0.1)
    walls += wall(0.1, 1, 0.1, 1) + wall(-1.5, 2.1, 1.5, 0.1)
    corners = area_of(ENDLESS + walls)
    off = OFF_M
    expected = np.array(
        [
            [-3 + off, -2 + off],
            [3 - off, -2 + off],
            [3 - off, -off],
            [-off, -off],
            [-off, 2 - off],
            [-3 + off, 2 - off],
        ]
    )
    assert len(corners) == 6
    assert np.linalg.norm(corners[:, None] - expected, axis=2).min(axis=1).max() < 2 * NEAR_M


def test_furniture_stays_in_the_area_and_pillars_are_gone_around() -> None:
    sofa = '<geom type="box" pos="-2.6 0 0.25" size="0.4 1 0.25"/>'
    pillar = '<geom type="cylinder" pos="0.5 0 1.25" size="0.3 1.25"/>'
    assert overlap(area_of(ENDLESS + four_walls(3, 2) + sofa + pillar), rectangle(3 - OFF_M, 2 - OFF_M)) > 0.98


def test_shelves_as_high_as_walls_are_walls_and_lamps_and_ceilings_are_not() -> None:
    shelf = wall(0, 1.8, 3, 0.2, 1.9)
    above = '<geom type="box" pos="0 0 2.6" size="3 2 0.1"/><geom type="sphere" pos="1 0 2.2" size="0.15"/>'
    corners = area_of(ENDLESS + four_walls(3, 2) + shelf + above)
    assert overlap(corners, rectangle(3 - OFF_M, 1.8 - OFF_M, 0, -0.2)) > 0.98


def test_a_fence_encloses_as_walls_do() -> None:
    posts = "".join(wall(x, y, 0.04, 0.04, 1.0) for x in np.arange(-5, 5.1, 1.0) for y in (-4, 4))
    posts += "".join(wall(x, y, 0.04, 0.04, 1.0) for x in (-5, 5) for y in np.arange(-3, 3.1, 1.0))
    low, high = area_of(ENDLESS + posts).min(axis=0), area_of(ENDLESS + posts).max(axis=0)
    np.testing.assert_allclose([*low, *high], [-5, -4, 5, 4], atol=0.25)


def test_outdoors_the_area_ends_with_the_floor_or_ten_metres_off_what_stands_on_it() -> None:
    assert overlap(area_of(FLOOR.format(12, 9)), rectangle(12 - OFF_M, 9 - OFF_M)) > 0.98
    tree = '<geom type="cylinder" pos="20 5 1.5" size="0.3 1.5"/>'
    np.testing.assert_allclose(area_of(ENDLESS).max(axis=0), 10 - OFF_M, atol=0.1)
    np.testing.assert_allclose(area_of(ENDLESS + tree).max(axis=0), [30.3 - OFF_M, 15.3 - OFF_M], atol=0.1)


def test_a_wide_opening_leaves_the_floors_own_edge() -> None:
    corners = area_of(FLOOR.format(3, 2) + four_walls(3, 2, gap=2.4))
    assert overlap(corners, rectangle(3 - OFF_M, 2 - OFF_M)) > 0.98


def test_floors_of_tiles_boxes_and_meshes_are_floors() -> None:
    tiles = "".join(
        f'<geom type="box" pos="{x} {y} -0.05" size="0.49 0.49 0.05"/>'
        for x in np.arange(-2.5, 2.6)
        for y in np.arange(-1.5, 1.6)
    )
    inside = rectangle(3 - OFF_M, 2 - OFF_M)
    assert overlap(area_of(tiles), inside) > 0.95
    asset = (
        '<asset><mesh name="ground" vertex="0 0 0  6 0 0  6 2 0  2 2 0  2 4 0  0 4 0 '
        '0 0 -1  6 0 -1  6 2 -1  2 2 -1  2 4 -1  0 4 -1" '
        'face="0 1 2  0 2 3  0 3 4  0 4 5  6 8 7  6 9 8  6 10 9  6 11 10  0 7 1  0 6 7  1 8 2  1 7 8  2 9 3  2 8 9  '
        '3 10 4  3 9 10  4 11 5  4 10 11  5 6 0  5 11 6"/></asset>'
    )
    corners = area_of('<geom type="mesh" mesh="ground"/>', asset=asset)
    assert len(corners) == 6
    np.testing.assert_allclose(
        polygon_area(corners), (6 - 2 * OFF_M) * (2 - 2 * OFF_M) + 2 * (2 - 2 * OFF_M), rtol=0.03
    )


@pytest.mark.parametrize(
    ("world", "said"),
    [
        ("", r"^room\.xml: has no floor; a plane, or a box or mesh with a level top, at z = 0 is expected"),
        (
            '<geom name="deck" type="box" pos="0 0 0.3" size="3 3 0.1"/>',
            r"nearest level surface is 'deck' at z = 0\.4 m",
        ),
        ('<geom type="plane" size="3 3 0.1" euler="10 0 0"/>', "has no floor; "),
        ('<body><freejoint/><geom type="box" pos="0 0 -0.1" size="3 3 0.1"/></body>', "has no floor; "),
        ('<geom type="plane" size="3 3 0.1" rgba="1 1 1 0"/>', "has no floor; "),
        (FLOOR.format(0.45, 3), "its floor leaves nowhere to walk: no part of 1 m² is free 0.2 m off the walls; "),
    ],
)
def test_rooms_in_which_nobody_can_walk_are_refused(world: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        area_of(world)


@pytest.mark.parametrize("sides", [3, 5, 8, 24])
def test_rooms_of_any_shape_keep_people_off_their_walls(sides: int) -> None:
    angle = 2 * np.pi * np.arange(sides) / sides + 0.2
    walls = "".join(
        f'<geom type="box" pos="{4.1 * np.cos(a)} {4.1 * np.sin(a)} 1.2" size="0.1 {4.3 * np.tan(np.pi / sides)} 1.2" '
        f'euler="0 0 {np.rad2deg(a)}"/>'
        for a in angle
    )
    corners = area_of(ENDLESS + walls)
    off = 4 - (corners @ np.stack([np.cos(angle), np.sin(angle)])).max()
    assert OFF_M - 2 * NEAR_M < off < OFF_M * np.sqrt(2) + 2 * NEAR_M
    inner = (4 - OFF_M) ** 2 * sides * np.tan(np.pi / sides)
    assert 0.85 * inner < polygon_area(corners) < 1.03 * inner
