"""The meeting room and the library hall: what people, scanners and cameras in them may rely on."""

from __future__ import annotations

import os

os.environ.setdefault("MUJOCO_GL", "egl")

import cv2
import mujoco
import numpy as np
import pytest
import yaml
from scipy import ndimage

from trackers.area import Area, meets_itself_at
from twin.geometry.geom_hull import hull_points
from twin.models import MODELS
from twin.room.building import check_mount
from twin.room.furniture import furniture_of
from twin.room.obstacles import Footprints, obstacles_of

ROOMS = ("meeting_room", "library_hall")
KEEP_M = 0.35  # what a walking body's middle keeps from furniture
OPEN_FLOOR = np.array([[-10.0, -6.4], [10.0, -6.4], [10.0, 6.4], [-10.0, 6.4]])
SCANNERS = ("place_scanner_west", "place_scanner_east")


def compiled(name):
    model = mujoco.MjModel.from_xml_path(str(MODELS / "rooms" / f"{name}.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


@pytest.fixture(scope="module", params=ROOMS)
def room(request):
    return compiled(request.param)


@pytest.fixture(scope="module")
def meeting():
    return compiled("meeting_room")


@pytest.fixture(scope="module")
def hall():
    return compiled("library_hall")


def walkable(model):
    return model.numeric("walkable_area").data.reshape(-1, 2)


def sites(room, prefix):
    """Places (n, 3) and rotations (n, 3, 3) of the sites of that prefix, by name."""
    model, data = room
    names = [model.site(index).name for index in range(model.nsite)]
    return {
        name: (data.site_xpos[index], data.site_xmat[index].reshape(3, 3))
        for index, name in enumerate(names)
        if name.startswith(prefix)
    }


def cast(room, origin, rays):
    """What rays (n, 3) from a place hit: geom ids and ranges [m]."""
    model, data = room
    geoms, ranges = np.empty(len(rays), dtype=np.int32), np.empty(len(rays))
    origin = np.array(origin, dtype=float)
    mujoco.mj_multiRay(model, data, origin, rays.ravel(), None, True, -1, geoms, ranges, None, len(rays), 60.0)
    return geoms, ranges


def sees(room, origin, places, slack_m=0.02):
    """Whether places (n, 3) can be seen from the origin (3,)."""
    ways = places - origin
    far = np.linalg.norm(ways, axis=1)
    _, ranges = cast(room, origin, ways / far[:, None])
    return (ranges < 0) | (ranges > far - slack_m)


def grid(corners, step_m):
    low, high = corners.min(axis=0), corners.max(axis=0)
    return np.meshgrid(*(np.arange(start, stop, step_m) for start, stop in zip(low, high, strict=True)), indexing="ij")


def free_floor(model, step_m):
    """Coordinates x, y and whether a body can walk there, on a grid over the walkable area."""
    corners, footprints = walkable(model), Footprints(obstacles_of(model))
    x, y = grid(corners, step_m)
    places = np.stack([x.ravel(), y.ravel()], axis=1)
    free = Area(corners).contains(places)
    near = np.concatenate([footprints.gaps(part)[1].min(axis=1) for part in np.array_split(places @ [1, 1j], 40)])
    return x, y, (free & (near > KEEP_M)).reshape(x.shape)


def pictures_from(room, eye):
    """Pictures to the four sides from a place."""
    model, data = room
    renderer = mujoco.Renderer(model, 120, 160)
    camera = mujoco.MjvCamera()
    try:
        for azimuth in (0, 90, 180, 270):
            camera.lookat, camera.distance, camera.azimuth, camera.elevation = eye, 0.01, azimuth, 0
            renderer.update_scene(data, camera)
            yield renderer.render().astype(float)
    finally:
        renderer.close()


def test_few_geoms_and_lights_of_its_own(room):
    model, _ = room
    assert model.ngeom <= 150
    assert model.vis.headlight.active == 0
    assert 0 < model.nlight <= 8  # more are not drawn
    assert not model.light_castshadow.any()
    assert (model.geom_group == 0).all()
    assert (model.site_group == 5).all()
    assert model.vis.global_.offwidth >= 2048
    assert model.vis.global_.offheight >= 2048


def test_all_geoms_have_names_and_only_the_floor_is_met(room):
    model, _ = room
    assert all(model.geom(index).name for index in range(model.ngeom))
    meets = np.flatnonzero(model.geom_contype | model.geom_conaffinity)
    assert [model.geom(index).name for index in meets] == ["floor"]


def test_the_walkable_area_is_a_simple_polygon_within_the_walls(room):
    model, _ = room
    corners = walkable(model)
    assert meets_itself_at(corners) is None
    walls = [each for each in obstacles_of(model) if each.furniture.startswith(("wall_", "passage_"))]
    assert walls
    assert Footprints(walls).gaps(corners @ [1, 1j])[1].min() > 0.15


def test_furniture_stands_on_the_floor(room):
    model, data = room
    for body in range(1, model.nbody):
        name = model.body(body).name
        if name.startswith(("gallery", "clock", "picture", "display", "whiteboard", "windows", "radiator")):
            continue  # on the wall
        geoms = np.flatnonzero(model.geom_bodyid == body)
        foot = min(hull_points(model, data, int(geom))[:, 2].min() for geom in geoms)
        assert -0.011 < foot < 0.03, f"{name} {foot}"


def test_the_place_before_every_seat_is_free_and_can_be_reached(room):
    model, _ = room
    corners, obstacles = walkable(model), obstacles_of(model)
    x, y, free = free_floor(model, 0.1)
    part, count = ndimage.label(free)
    largest = part == 1 + np.bincount(part[part > 0] - 1).argmax()
    seats = furniture_of(model)
    assert len(seats) >= 6
    for name, seat in seats.items():
        place = seat.place[:2] + (seat.to_front_m + KEEP_M) * np.array([np.cos(seat.yaw), np.sin(seat.yaw)])
        others = Footprints([each for each in obstacles if each.furniture != seat.furniture])
        assert others.gaps(place @ [1, 1j] * np.ones(1))[1].min() > KEEP_M, name
        assert Area(corners).contains(place[None])[0], name
        assert np.hypot(x[largest] - place[0], y[largest] - place[1]).min() < 0.15, name
        assert 0.40 < seat.height < 0.50, name


@pytest.mark.parametrize(
    ("name", "eye"),
    [
        ("meeting_room", (0.0, -1.7, 1.6)),
        ("meeting_room", (-1.5, 1.6, 1.6)),
        ("library_hall", (0.0, 0.0, 1.65)),
        ("library_hall", (-9.0, 4.0, 1.65)),
        ("library_hall", (4.0, -7.6, 1.65)),
    ],
)
def test_walls_differ_and_nothing_is_black_or_blown_out(name, eye):
    means = []
    for image in pictures_from(compiled(name), eye):
        means.append(image.mean())
        assert (image.max(axis=-1) < 12).mean() < 0.01
        assert (image.min(axis=-1) > 250).mean() < 0.01
    assert all(80 < mean < 200 for mean in means)
    assert np.ptp(means) > 5


# -- meeting room


def test_one_can_walk_all_around_the_tables(meeting):
    model, _ = meeting
    x, y, free = free_floor(model, 0.05)
    part, _ = ndimage.label(free)
    near = np.unravel_index(np.hypot(x, y + 1.7).argmin(), x.shape)
    assert free[near]
    ring = part == part[near]
    gone_around = ndimage.binary_fill_holes(ring) & ~ring
    assert gone_around[np.unravel_index(np.hypot(x, y).argmin(), x.shape)]


def test_the_cameras_places_are_free_and_look_at_the_middle(meeting):
    model, data = meeting
    places = sites(meeting, "place_camera_")
    assert len(places) == 4
    for name, (place, turn) in places.items():
        check_mount(model, data, name, place)
        to_middle = np.array([0.0, 0.0, 1.1]) - place
        assert turn[:, 0] @ to_middle / np.linalg.norm(to_middle) > 0.999
        assert turn[2, 2] > 0.8


def test_a_head_anywhere_is_seen_by_two_cameras_at_least(meeting):
    x, y, free = free_floor(meeting[0], 0.2)
    heads = np.stack([x[free], y[free], np.full(free.sum(), 1.6)], axis=1)
    count = np.zeros(len(heads), dtype=int)
    for place, turn in sites(meeting, "place_camera_").values():
        local = (heads - place) @ turn  # ahead, left, up
        inside = (np.abs(local[:, 1]) < 0.75 * local[:, 0]) & (np.abs(local[:, 2]) < 0.56 * local[:, 0])  # 74 x 59 deg
        count += inside & sees(meeting, place, heads)
    assert (count >= 2).mean() > 0.95
    assert count.min() >= 1


def test_the_clock_is_the_only_thing_of_the_colour_of_skin(meeting):
    model, data = meeting
    skins = yaml.safe_load((MODELS / "people" / "wardrobe.yaml").read_text())["skin"].values()
    tones = np.array([[int(tone[start : start + 2], 16) for start in (1, 3, 5)] for tone in skins], dtype=np.uint8)
    skin, slack = hue_saturation(tones), np.array([2, 0.05])
    low, high = skin.min(axis=0) - slack, skin.max(axis=0) + slack

    def is_skin(colours):
        return ((hue_saturation(colours) >= low) & (hue_saturation(colours) <= high)).all(axis=1)

    clock = model.geom("clock_face")
    assert 1.5 < data.geom_xpos[clock.id, 2] < 1.75
    assert 0.10 < model.geom_size[clock.id, 0] < 0.14
    seen = 0
    renderer = mujoco.Renderer(model, 240, 320)
    camera = mujoco.MjvCamera()
    try:
        for place, turn in sites(meeting, "place_camera_").values():
            ahead = turn[:, 0]
            camera.lookat, camera.distance = place + 0.01 * ahead, 0.01
            camera.azimuth, camera.elevation = np.rad2deg([np.arctan2(ahead[1], ahead[0]), np.arcsin(ahead[2])])
            renderer.update_scene(data, camera)
            colours = renderer.render().copy().reshape(-1, 3)
            renderer.enable_segmentation_rendering()
            renderer.update_scene(data, camera)
            of_clock = renderer.render()[..., 0].ravel() == clock.id
            renderer.disable_segmentation_rendering()
            assert is_skin(colours[~of_clock]).mean() < 2e-4
            seen += of_clock.sum() > 15 and is_skin(colours[of_clock]).mean() > 0.6
    finally:
        renderer.close()
    assert seen >= 2


def hue_saturation(colours):
    """Hue [deg] and saturation of 8-bit colours (n, 3), (n, 2)."""
    hsv = cv2.cvtColor(np.ascontiguousarray(colours[None]).astype(np.float32) / 255, cv2.COLOR_RGB2HSV)[0]
    return hsv[:, :2].astype(float)


# -- library hall


def test_the_open_floor_is_open(hall):
    model, _ = hall
    inside = Area(OPEN_FLOOR)
    for each in obstacles_of(model):
        if not inside.contains(each.corners).any():
            continue
        assert each.furniture.startswith("pillar_")
    height = 0.35
    for y in np.arange(-6.4, 6.41, 0.2):
        _, ranges = cast(hall, (-10.0, y, height), np.array([[1.0, 0.0, 0.0]]))
        assert ranges[0] > 20.0


def test_scanners_see_the_whole_open_floor_between_them(hall):
    model, data = hall
    x, y = grid(OPEN_FLOOR, 0.25)
    places = np.stack([x.ravel(), y.ravel(), np.full(x.size, 0.35)], axis=1)
    shares = []
    for name in SCANNERS:
        ((place, turn),) = sites(hall, name).values()
        check_mount(model, data, name, place)
        assert 0.3 <= place[2] <= 0.4
        ahead = ((places - place) @ turn)[:, 0] > 0
        shares.append(sees(hall, place, places) & ahead)
        angles = np.deg2rad(np.arange(-90, 90.25, 0.25))
        rays = np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=1) @ turn.T
        geoms, _ = cast(hall, place, rays)
        assert (geoms >= 0).all()
    assert np.logical_or(*shares).all()
    assert all(share.mean() > 0.9 for share in shares)


def test_the_camera_hangs_on_the_third_floor_and_sees_most_of_the_open_floor(hall):
    model, data = hall
    ((place, turn),) = sites(hall, "place_camera_third_floor").values()
    check_mount(model, data, "place_camera_third_floor", place)
    assert 9.0 < place[2] < 10.0
    x, y = grid(OPEN_FLOOR, 0.5)
    places = np.stack([x.ravel(), y.ravel(), np.full(x.size, 0.9)], axis=1)
    local = (places - place) @ turn
    inside = (np.abs(local[:, 1]) < 0.8 * local[:, 0]) & (
        np.abs(local[:, 2]) < 0.6 * local[:, 0]
    )  # 62 deg upright, 4:3
    assert (inside & sees(hall, place, places)).mean() > 0.75


def test_gates_lie_behind_every_wall_and_lead_into_the_hall(hall):
    model, _ = hall
    gates = sites(hall, "gate_")
    assert len(gates) >= 4
    x, y, free = free_floor(model, 0.2)
    part, _ = ndimage.label(free)
    middle = part[np.unravel_index(np.hypot(x, y).argmin(), x.shape)]
    sides = set()
    for name, (place, turn) in gates.items():
        assert place[2] == 0, name
        assert Area(walkable(model)).contains(place[None, :2])[0], name
        assert max(abs(place[0]) - 13, abs(place[1]) - 10) > 0.3, name
        ahead = place[:2] + 3 * turn[:2, 0]
        assert (np.abs(ahead) < [13, 10]).all(), name
        near = np.unravel_index(np.hypot(x - place[0], y - place[1]).argmin(), x.shape)
        assert part[near] == middle > 0, name
        sides.add(tuple(np.round(turn[:2, 0]).astype(int)))
    assert sides == {(1, 0), (-1, 0), (0, 1), (0, -1)}
