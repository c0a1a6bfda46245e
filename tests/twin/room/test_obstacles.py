"""Obstacles: footprints of what stands in a room, and how far people are from them."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from hypothesis import given, strategies as st

from trackers.area import Area
from trackers.errors import InputError
from twin.geometry.polygon import polygon_area
from twin.room.obstacles import Footprints, Obstacle, inflated, obstacles_of, within_reach

SQUARE = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [0.0, 1.0]])


def room(bodies):
    return mujoco.MjModel.from_xml_string(f"<mujoco><compiler angle='degree'/><worldbody>{bodies}</worldbody></mujoco>")


@pytest.mark.parametrize(
    ("geom", "area", "tolerance"),
    [
        ('type="box" pos="1 2 0.5" size="0.3 0.2 0.5"', 0.24, 0.0),
        ('type="box" pos="1 2 0.5" size="0.3 0.2 0.5" euler="0 0 30"', 0.24, 0.0),
        ('type="box" pos="1 2 0.5" size="0.1 0.2 0.5" euler="90 0 0"', 0.2, 0.0),
        ('type="cylinder" pos="1 2 0.5" size="0.3 0.5"', 0.2827, 0.06),
        ('type="capsule" pos="1 2 0.5" size="0.1 0.2" euler="0 90 0"', 0.4 * 0.2 + 0.0314, 0.06),
        ('type="sphere" pos="1 2 0.5" size="0.3"', 0.2827, 0.06),
        ('type="ellipsoid" pos="1 2 0.5" size="0.3 0.2 0.4"', 0.1885, 0.06),
        ('type="plane" pos="1 2 0.5" size="0.7 0.5 0.1" zaxis="1 0 0"', 0.05, 0.0),
    ],
)
def test_the_footprint_of_each_shape_covers_it(geom, area, tolerance):
    (obstacle,) = obstacles_of(room(f'<geom name="thing" {geom}/>'))
    assert obstacle.furniture == "thing"
    covered = polygon_area(obstacle.corners)
    if "plane" in geom:
        assert np.ptp(obstacle.corners, axis=0).min() == pytest.approx(0.05)
    else:
        assert area * 0.98 <= covered <= area * (1.01 + tolerance)
    way = np.roll(obstacle.corners, -1, axis=0) - obstacle.corners
    after = np.roll(way, -1, axis=0)
    assert (way[:, 0] * after[:, 1] - way[:, 1] * after[:, 0] > 0).all()


def test_a_mesh_is_covered():
    spec = mujoco.MjSpec.from_string("<mujoco/>")
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    spec.add_mesh(name="wedge", uservert=corners.ravel())
    spec.worldbody.add_geom(name="wedge", type=mujoco.mjtGeom.mjGEOM_MESH, meshname="wedge", pos=[3, 0, 0])
    (obstacle,) = obstacles_of(spec.compile())
    assert polygon_area(obstacle.corners) == pytest.approx(0.5)
    np.testing.assert_allclose(obstacle.corners.min(axis=0), [3, 0], atol=1e-6)


@pytest.mark.parametrize(
    "geom",
    [
        '<geom type="plane" size="3 3 1"/>',
        '<geom type="plane" size="0 0 1"/>',
        '<geom type="plane" pos="0 0 1.9" size="3 3 1" zaxis="0 0 -1"/>',
        '<geom type="box" pos="0 0 0.01" size="1 1 0.01"/>',
        '<geom type="box" pos="0 0 2.3" size="1 1 0.1"/>',
        '<geom type="box" pos="0 0 1" size="1 1 1" rgba="0 0 0 0"/>',
        '<body><freejoint/><geom type="box" pos="0 0 1" size="1 1 1"/></body>',
    ],
    ids=["floor", "endless floor", "ceiling", "rug", "lamp", "unseen", "loose"],
)
def test_what_is_in_nobodys_way(geom):
    assert obstacles_of(room(geom)) == []


def test_a_height_field_is_refused():
    spec = mujoco.MjSpec.from_string("<mujoco/>")
    spec.add_hfield(name="hill", nrow=2, ncol=2, size=[1, 1, 1, 0.1], userdata=[0, 0, 0, 1])
    spec.worldbody.add_geom(name="hill", type=mujoco.mjtGeom.mjGEOM_HFIELD, hfieldname="hill")
    with pytest.raises(InputError, match="'hill' is a height field"):
        obstacles_of(spec.compile())


def test_a_table_is_one_obstacle_and_shelves_hide_their_books():
    table = """<body name="table" pos="1 0 0"><geom type="box" pos="0 0 0.7" size="0.6 0.4 0.02"/>
      <geom type="box" pos="0.5 0.3 0.35" size="0.03 0.03 0.35"/><geom type="box" pos="-0.5 0.3 0.35" size="0.03 0.03 0.35"/>
      </body>"""
    (obstacle,) = obstacles_of(room(table))
    assert obstacle.furniture == "table"
    np.testing.assert_allclose(obstacle.corners.min(axis=0), [0.4, -0.4])
    shelf = """<geom name="shelf" type="box" pos="0 0 1" size="0.5 0.2 1"/>
      <geom name="book" type="box" pos="0.1 0 1" size="0.1 0.1 0.1"/>"""
    assert [each.furniture for each in obstacles_of(room(shelf))] == ["shelf"]


def test_an_l_keeps_its_corner_free():
    sofa = """<body name="sofa"><geom type="box" pos="0 0 0.2" size="1 0.4 0.2"/>
      <geom type="box" pos="-0.6 1.4 0.2" size="0.4 1 0.2"/></body>"""
    corners = obstacles_of(room(sofa))
    assert len(corners) == 2
    place = np.array([0.9 + 1.4j])
    assert Footprints(corners).gaps(place)[1].min() > 0.5


def test_what_is_out_of_reach_is_left_out():
    far = Obstacle("far", SQUARE + np.array([5.0, 0.0]))
    inside = Obstacle("inside", 0.1 * SQUARE + [1.0, 0.5])
    around = Obstacle("around", 10 * SQUARE - [5.0, 5.0])
    beside = Obstacle("beside", SQUARE + np.array([2.1, 0.0]))
    across = Obstacle("across", np.array([[-1.0, 0.4], [3.0, 0.4], [3.0, 0.6], [-1.0, 0.6]]))
    found = within_reach([far, inside, around, beside, across], SQUARE, 0.2)
    assert [each.furniture for each in found] == ["inside", "around", "beside", "across"]


@given(st.floats(-4, 6), st.floats(-4, 5))
def test_gaps_are_distances_and_directions(x, y):
    place = complex(x, y)
    towards, gap = (each[0, 0] for each in Footprints([Obstacle("box", SQUARE)]).gaps(np.array([place])))
    inside = 0 < x < 2 and 0 < y < 1
    if inside:
        assert gap == pytest.approx(-min(x, 2 - x, y, 1 - y))
    else:
        nearest = complex(min(max(x, 0), 2), min(max(y, 0), 1))
        assert gap == pytest.approx(abs(nearest - place))
    if abs(gap) > 1e-6:
        assert abs(towards) == pytest.approx(1.0)
        border = place + towards * gap
        assert min(abs(border.real), abs(border.real - 2), abs(border.imag), abs(border.imag - 1)) < 1e-6


@given(st.floats(0.05, 1.0), st.floats(0, 6.3))
def test_a_margin_is_kept_all_around(margin_m, angle):
    wide = inflated(SQUARE, margin_m)
    turned = np.array([np.cos(angle), np.sin(angle)])
    rim = (SQUARE[:, None] + 0.999 * margin_m * turned).reshape(-1, 2)
    assert Area(wide).contains(rim).all()
    gaps = Footprints([Obstacle("box", SQUARE)]).gaps(wide[:, 0] + 1j * wide[:, 1])[1]
    assert gaps.max() < 1.05 * margin_m
