"""The sensing room: what its people, its floor and its cameras may rely on."""

from __future__ import annotations

import os

os.environ.setdefault("MUJOCO_GL", "egl")

from itertools import combinations

import mujoco
import numpy as np
import pytest

from trackers.area import Area
from twin.models import MODELS
from twin.people.crowd.routes import Routes
from twin.room.furniture import Bed, Seat, furniture_of
from twin.room.obstacles import OBSTACLE_REACH_M, Footprints, obstacles_of, within_reach

WIDE_M, DEEP_M, HIGH_M = 5.0, 4.2, 2.6


@pytest.fixture(scope="module")
def room():
    model = mujoco.MjModel.from_xml_path(str(MODELS / "rooms" / "sensing_room.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


@pytest.fixture(scope="module")
def routes(room):
    model, _ = room
    area = model.numeric("walkable_area").data.reshape(-1, 2)
    return Routes(area, within_reach(obstacles_of(model), area, OBSTACLE_REACH_M))


def test_every_geom_has_a_name_and_is_the_rooms(room):
    model, _ = room
    assert all(model.geom(geom).name for geom in range(model.ngeom))
    assert (model.geom_group == 0).all()
    assert model.vis.headlight.active == 0
    assert model.ngeom < 110
    assert (model.body_weldid == 0).all()


def test_the_tiles_are_the_floor_grid(room):
    model, data = room
    tiles = model.geom("tiles")
    np.testing.assert_allclose(2 * tiles.size[:2], [3.6, 2.8])
    np.testing.assert_allclose(data.geom("tiles").xpos, [0, 0, 0.001])
    np.testing.assert_allclose(model.mat_texrepeat[model.mat("tiles").id], [18, 14])


def test_the_furniture_is_there_at_sensible_heights(room):
    furniture = furniture_of(room[0])
    seats = [each for each in furniture.values() if isinstance(each, Seat)]
    (bed,) = (each for each in furniture.values() if isinstance(each, Bed))
    assert len(seats) >= 4
    assert all(0.40 <= seat.height <= 0.48 for seat in seats)
    assert 0.45 <= bed.place[2] <= 0.60
    assert {"table", "shelf", "dresser", "lamp", "night_stand"} <= {each.furniture for each in obstacles_of(room[0])}


def before(seat, gap_m):
    """The place on the floor this far ahead of a seat's front edge."""
    return seat.place[:2] + (seat.to_front_m + gap_m) * np.array([np.cos(seat.yaw), np.sin(seat.yaw)])


def beside(bed, gap_m):
    """The places on the floor this far off a bed's two sides."""
    outwards = bed.sides() - bed.place[:2]
    return bed.sides() + gap_m * outwards / np.linalg.norm(outwards, axis=1, keepdims=True)


def test_every_seat_and_the_bed_can_be_reached_from_everywhere(room, routes):
    ends = []
    for each in furniture_of(room[0]).values():
        if isinstance(each, Seat):
            for gap in (0.35, 0.2, 0.15):
                assert routes.reachable(before(each, gap))
            assert routes.near(before(each, 0.35)) <= {each.furniture}
            ends.append(before(each, 0.35))
        else:
            ends += [place for place in beside(each, 0.35) if routes.reachable(place)]
            assert len(ends) >= 1
    for start, goal in combinations(ends, 2):
        assert routes.way(start, goal) is not None


def test_most_of_the_tiles_are_free_to_walk(routes):
    x, y = np.meshgrid(np.linspace(-1.75, 1.75, 36), np.linspace(-1.35, 1.35, 28))
    tiles = np.stack([x.ravel(), y.ravel()], axis=-1)
    assert Area(routes.area).contains(tiles).all()
    gaps = Footprints(routes.obstacles).gaps(tiles[:, 0] + 1j * tiles[:, 1])[1].min(axis=1)
    assert (gaps > 0.32).mean() > 0.6
    assert sum(routes.reachable(tile) for tile in tiles[::7]) > 0.75 * len(tiles[::7])


def test_every_ray_from_inside_ends_on_the_room(room):
    model, data = room
    angles = np.deg2rad(np.arange(0, 360, 3))
    up = np.deg2rad(np.arange(-80, 81, 20))
    rays = np.array([[np.cos(a) * np.cos(b), np.sin(a) * np.cos(b), np.sin(b)] for a in angles for b in up])
    geoms, ranges = np.empty(len(rays), dtype=np.int32), np.empty(len(rays))
    mujoco.mj_multiRay(
        model, data, np.array([0.0, 0.0, 1.2]), rays.ravel(), None, True, -1, geoms, ranges, None, len(rays), 20.0
    )
    assert (geoms >= 0).all()
    ends = rays * ranges[:, None]
    assert np.abs(ends[:, 0]).max() <= WIDE_M / 2 + 1e-6
    assert np.abs(ends[:, 1]).max() <= DEEP_M / 2 + 1e-6
    assert (1.2 + ends[:, 2]).max() <= HIGH_M + 1e-6


def test_it_looks_lit_from_every_corner_of_the_ceiling(room):
    model, data = room
    renderer = mujoco.Renderer(model, 240, 320)
    camera = mujoco.MjvCamera()
    means = []
    try:
        for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
            eye = np.array([2.4 * x, 2.0 * y, 2.5])
            ahead = np.array([0.0, 0.0, 0.6]) - eye
            camera.lookat, camera.distance = eye + 0.01 * ahead / np.linalg.norm(ahead), 0.01
            camera.azimuth = np.rad2deg(np.arctan2(ahead[1], ahead[0]))
            camera.elevation = np.rad2deg(np.arctan2(ahead[2], np.hypot(ahead[0], ahead[1])))
            renderer.update_scene(data, camera)
            image = renderer.render().astype(float)
            means.append(image.mean())
            assert (image.max(axis=-1) < 12).mean() < 0.01
            assert (image.min(axis=-1) > 250).mean() < 0.02
    finally:
        renderer.close()
    assert all(100 < mean < 190 for mean in means)
