"""The environment of a room of boxes: what is free, met and hidden, and every query against brute force."""

from __future__ import annotations

import numpy as np
import pytest
from box_room import BOXES, CUPBOARD, ROOM, STATIONS, TABLE, box_distance, box_room_cloud

from trackers.environment import (
    FREE,
    OCCUPIED,
    UNKNOWN,
    Environment,
    EnvironmentOptions,
    PointCloud,
    build_environment,
)
from trackers.errors import InputError
from trackers.user_input.text_file import NO_LIMITS

VOXEL_M = 0.05


@pytest.fixture(scope="module")
def environment():
    return build_environment(box_room_cloud(), room="boxes")


def inside(box, count=400, inset=0.0, seed=1):
    rng = np.random.default_rng(seed)
    low, high = np.minimum(box[0] + inset, box.mean(axis=0)), np.maximum(box[1] - inset, box.mean(axis=0))
    return rng.uniform(low, high, (count, 3))


def gap_to(points, box):
    """Distance (n,) from points to a box, 0 inside."""
    return np.linalg.norm(np.maximum(np.maximum(box[0] - points, points - box[1]), 0), axis=1)


def test_floor_ceiling_and_walls_are_where_they_are(environment):
    assert environment.floor_m == pytest.approx(0.0, abs=0.003)
    assert environment.ceiling_m == pytest.approx(2.5, abs=0.003)
    assert len(environment.walls_m) == 4
    ends = environment.walls_m.reshape(-1, 2)
    np.testing.assert_allclose(np.abs(ends), np.broadcast_to([2.0, 1.5], ends.shape), atol=0.01)


def test_the_room_lies_left_of_its_walls(environment):
    way = environment.walls_m[:, 1] - environment.walls_m[:, 0]
    to_middle = -environment.walls_m[:, 0]
    assert (way[:, 0] * to_middle[:, 1] - way[:, 1] * to_middle[:, 0] > 0).all()


def is_occupied(environment: Environment, points: np.ndarray) -> np.ndarray:
    flat, inside = environment.grid.flat(points)
    return inside & (environment.state.ravel()[flat] == OCCUPIED)


def test_no_inside_of_furniture_is_free(environment):
    points = inside(CUPBOARD, inset=VOXEL_M)
    assert not environment.is_free(points).any()
    deep = inside(CUPBOARD, inset=2 * VOXEL_M)
    assert not is_occupied(environment, deep).any(), "the scanner saw the faces only"


def test_the_air_of_the_room_is_free(environment):
    points = inside(ROOM, 4000, inset=0.1)
    clear = np.min([gap_to(points, box) for box in BOXES], axis=0) > 0.1
    # seen by one of three stations, nearly everything is
    assert environment.is_free(points[clear]).mean() > 0.97
    assert not is_occupied(environment, points[clear]).any()


def test_nothing_outside_the_walls_is_free(environment):
    outside = np.array([[2.12, 0, 1], [-2.12, 0.3, 1], [0, 1.62, 1], [0, 0, -0.1], [0, 0, 2.6], [50, 0, 1]])
    assert not environment.is_free(outside).any()


def test_what_stands_in_the_shadow_of_furniture_is_unknown():
    shadowed = build_environment(box_room_cloud(STATIONS[:1]))
    # behind the cupboard, as seen from the only station
    behind = np.array([[-1.5, 1.4, 0.3], [-1.3, 1.42, 0.5]])
    away = behind - STATIONS[0]
    reach = np.linalg.norm(away, axis=1)
    assert (box_distance(STATIONS[0], away / reach[:, None], CUPBOARD) < reach).all()
    assert not shadowed.is_free(behind).any() and not is_occupied(shadowed, behind).any()
    assert shadowed.is_free([[0.0, 1.2, 0.3]]).all(), "beside it the way is clear"


def test_distance_against_brute_force(environment):
    points = inside(ROOM, 2000, inset=0.0)
    surface = environment.surface_m.astype(float)
    brute = np.array([np.linalg.norm(surface - point, axis=1).min() for point in points])
    error = np.abs(environment.distance_to_surface(points) - brute)
    assert error.max() < VOXEL_M
    assert np.median(error) < 0.01


def test_distance_to_the_true_boxes(environment):
    points = inside(ROOM, 2000, inset=0.1)
    truth = np.min(
        [*(gap_to(points, box) for box in BOXES), *np.abs(points - ROOM[0]).T, *np.abs(points - ROOM[1]).T], 0
    )
    outside = np.min([gap_to(points, box) for box in BOXES], axis=0) > 0.05
    error = environment.distance_to_surface(points[outside]) - truth[outside]
    assert np.median(np.abs(error)) < 0.015
    assert np.quantile(np.abs(error), 0.98) < 0.06


def test_height_under_furniture_and_floor(environment):
    for box in BOXES:
        middle = inside(box, inset=0.06)
        middle[:, 2] = 2.0
        under = environment.height_under(middle)
        error = np.abs(under - box[1, 2])[np.isfinite(under)]
        assert np.isfinite(under).mean() > 0.95
        assert np.median(error) < 0.01
        assert np.quantile(error, 0.95) < 0.03
    np.testing.assert_allclose(environment.height_under([[0.0, 0.3], [-0.3, -0.9]]), environment.floor_m, atol=1e-6)
    assert np.isnan(environment.height_under([[30.0, 0.0]])).all()


def clear_and_blocked(origin, points, margin):
    """Lines that stay a margin clear of all boxes, and lines that go through one even where that is a margin smaller."""
    way = points - origin
    reach = np.linalg.norm(way, axis=1)
    way = way / reach[:, None]
    grown = [np.array([box[0] - margin, box[1] + margin]) for box in BOXES]
    clear = np.all([box_distance(origin, way, box) > reach + margin for box in grown], axis=0)
    through = [box_distance(origin, way, np.array([box[0] + margin, box[1] - margin])) for box in (CUPBOARD,)]
    return clear, np.any([each < reach - 3 * margin for each in through], axis=0)


@pytest.mark.parametrize("origin", [[-1.85, -1.35, 2.4], [0.0, 0.0, 0.9], [1.9, 1.4, 1.8]])
def test_visible_against_brute_force(environment, origin):
    points = inside(ROOM, 3000, inset=0.12)
    origin = np.array(origin)
    far = np.linalg.norm(points - origin, axis=1) > 0.2
    clear, blocked = clear_and_blocked(origin, points, 0.1)
    seen = environment.visible(origin, points)
    assert clear[far].sum() > 500
    assert seen[far & clear].all()
    assert not seen[far & blocked].any()


def test_a_table_hides_what_is_under_it(environment):
    above = np.array([1.0, 0.0, 2.3])
    assert not environment.visible(above, [[1.0, 0.05, 0.3]]).any()
    assert environment.visible(above, [[1.0, 0.05, 1.0], [0.2, -0.2, 0.3]]).all()


def test_a_place_beyond_the_grid_is_seen_if_nothing_known_is_between(environment):
    assert not environment.visible([9.0, 0.0, 1.2], [[0.0, 0.0, 1.2]]).any(), "the wall is"
    assert environment.visible([9.0, 0.0, 9.0], [[9.0, 2.0, 1.2]]).all()


def test_the_papers_weights(environment):
    places = {
        (0.0, 0.3, 1.6): 1.0,
        (1.0, 0.0, 1.2): 0.5,  # over the table
        (-1.2, 0.95, 1.4): 0.5,  # over the cupboard
        (-1.2, 0.95, 0.5): 0.0,  # in it
        (0.0, 0.3, 0.4): 0.2,  # too low
        (0.0, 0.3, 2.2): 0.2,  # too high
        (1.0, 0.0, 2.2): 0.2,  # the least counts
        (2.1, 0.0, 1.6): 0.0,  # outside
        (0.0, 0.0, -0.02): 0.0,
        (40.0, 0.0, 1.6): 0.0,
    }
    np.testing.assert_allclose(environment.head_weight(list(places)), list(places.values()))
    np.testing.assert_allclose(environment.head_weight([[1.0, 0.0, 1.2]], above_furniture=0.3), 0.3)


def test_agreement_knows_the_room(environment):
    again = box_room_cloud(seed=5).points_m
    assert environment.agreement(again) > 0.99
    assert environment.agreement(0.7 * again + [0.2, 0.1, 0.0]) < 0.7


def test_points_between_two_surfaces_are_not_there():
    """A beam on an edge reports a range between the two surfaces it meets: one in a hundred does."""
    cloud = box_room_cloud()
    rng = np.random.default_rng(3)
    points = cloud.points_m.copy()
    stray = rng.random(len(points)) < 0.01
    origins = cloud.origins_m[cloud.station[stray]]
    points[stray] = origins + rng.uniform(0.3, 0.95, (stray.sum(), 1)) * (points[stray] - origins)
    strays = build_environment(PointCloud(points, cloud.station, cloud.origins_m))
    air = inside(ROOM, 4000, inset=0.15)
    air = air[np.min([gap_to(air, box) for box in BOXES], axis=0) > 0.15]
    assert is_occupied(strays, air).mean() < 0.002


def test_one_point_short_of_a_wall_is_no_wall_where_few_rays_come():
    """So few that it alone is a share of them, and next to what is occupied."""
    cloud = box_room_cloud(step_deg=1.5)
    points, origins = cloud.points_m.copy(), cloud.origins_m[cloud.station]
    stray = (np.abs(points[:, 0]) > 1.98) & (np.random.default_rng(3).random(len(points)) < 0.05)
    gap_m = np.linalg.norm(points - origins, axis=1)[:, None]
    points[stray] = (origins + (1 - 0.09 / gap_m) * (points - origins))[stray]
    strays = build_environment(PointCloud(points, cloud.station, cloud.origins_m))
    short = points[stray & (np.abs(points[:, 0]) < 1.93)]
    assert len(short) > 300 and is_occupied(strays, short).mean() < 0.2  # those that lie two in a voxel


def test_the_same_cloud_gives_the_same_environment(environment):
    again = build_environment(box_room_cloud(), room="boxes")
    np.testing.assert_array_equal(again.state, environment.state)
    np.testing.assert_array_equal(again.top_m, environment.top_m)
    np.testing.assert_array_equal(again.walls_m, environment.walls_m)


def test_every_voxel_is_one_of_three(environment):
    assert set(np.unique(environment.state)) == {UNKNOWN, FREE, OCCUPIED}
    assert len(environment.surface_m) == (environment.state == OCCUPIED).sum()


@pytest.mark.parametrize("query", ["is_free", "distance_to_surface", "head_weight"])
def test_not_a_number_is_no_place(environment, query):
    with pytest.raises(ValueError, match="NaN or infinity"):
        getattr(environment, query)([[0.0, np.nan, 1.0]])
    with pytest.raises(ValueError, match="is expected"):
        getattr(environment, query)([0.0, 0.0, 1.0])


def test_a_cloud_too_small_is_refused():
    cloud = box_room_cloud()
    with pytest.raises(InputError, match="500 points are too few for a room; at least 1000 are expected"):
        build_environment(PointCloud(cloud.points_m[:500], cloud.station[:500], cloud.origins_m))


def test_stations_that_are_not_in_the_room_are_refused():
    cloud = box_room_cloud()
    with pytest.raises(InputError, match="stations stand .* above the floor .* are expected"):
        build_environment(PointCloud(cloud.points_m, cloud.station, cloud.origins_m - [0, 0, 2]))


def test_too_many_voxels_are_refused_unless_the_limits_are_lifted(monkeypatch: pytest.MonkeyPatch):
    cloud = box_room_cloud()
    said = "voxel_m: 0.01 m divides .* into too many voxels; .* or more, or --no-limits, is expected"
    with pytest.raises(InputError, match=said):
        build_environment(
            PointCloud(cloud.points_m * [20, 20, 1], cloud.station, cloud.origins_m * [20, 20, 1]),
            options=EnvironmentOptions(voxel_m=0.01),
        )
    monkeypatch.setattr("trackers.environment.build.MOST_VOXELS", 1000)
    with pytest.raises(InputError, match="too many voxels"):
        build_environment(cloud, options=EnvironmentOptions(voxel_m=0.1))
    monkeypatch.setenv(NO_LIMITS, "1")
    assert build_environment(cloud, options=EnvironmentOptions(voxel_m=0.1)).grid.size > 1000


@pytest.mark.parametrize(
    ("points", "station", "origins", "message"),
    [
        (np.zeros((3, 2)), [0, 0, 0], np.zeros((1, 3)), r"points have shape \(3, 2\); \(n, 3\) is expected"),
        (np.zeros((3, 3)), [0, 0], np.zeros((1, 3)), "one for each point is expected"),
        (np.zeros((3, 3)), [0, 0, 1], np.zeros((1, 3)), "stations 0 to 1 are named and 1 given; 0 to 0 are expected"),
        (np.full((3, 3), np.inf), [0, 0, 0], np.zeros((1, 3)), "points hold NaN or infinity; leave out rays"),
        (np.zeros((3, 3)), [0, 0, 0], np.zeros((0, 3)), "at least one station is expected"),
    ],
)
def test_a_cloud_that_does_not_fit_together(points, station, origins, message):
    with pytest.raises(InputError, match=message):
        PointCloud(points, np.array(station, dtype=np.int16), origins)


def test_a_cloud_as_ply(tmp_path):
    cloud = box_room_cloud(step_deg=6.0)
    cloud.write_ply(tmp_path / "room.ply")
    head, body = (tmp_path / "room.ply").read_bytes().split(b"end_header\n")
    assert f"element vertex {len(cloud.points_m)}".encode() in head
    rows = np.frombuffer(body, dtype=[("xyz", "<f4", 3), ("station", "<i2")])
    np.testing.assert_allclose(rows["xyz"], cloud.points_m, atol=1e-6)
    np.testing.assert_array_equal(rows["station"], cloud.station)


def test_walls_of_a_room_that_is_turned():
    turned = build_environment(box_room_cloud(turn_rad=0.4))
    lengths = np.sort(np.linalg.norm(turned.walls_m[:, 1] - turned.walls_m[:, 0], axis=1))
    np.testing.assert_allclose(lengths, [3.0, 3.0, 4.0, 4.0], atol=0.03)
    way = turned.walls_m[:, 1] - turned.walls_m[:, 0]
    angle = np.arctan2(way[:, 1], way[:, 0]) % (np.pi / 2)
    np.testing.assert_allclose(angle, 0.4, atol=0.005)


def test_a_table_is_free_underneath(environment):
    under = inside(np.array([TABLE[0] - [0, 0, 0.5], [TABLE[1, 0], TABLE[1, 1], TABLE[0, 2]]]), inset=0.1)
    assert environment.is_free(under).mean() > 0.8
