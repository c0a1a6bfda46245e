"""A camera in the room: ellipsoids, boxes and depth against points projected one by one."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from trackers.area import Pose
from trackers.cameras import (
    CameraGroup,
    Ellipses,
    Ellipsoids,
    FisheyeIntrinsics,
    Intrinsics,
    PinholeIntrinsics,
    PlacedCamera,
)
from trackers.rig import PinholeSensor, StereoSensor, placed_camera

PICTURE = {"width": 320, "height": 240, "fx": 250.0, "fy": 260.0, "cx": 150.0, "cy": 125.0}
STRAIGHT = PinholeIntrinsics.model_validate(PICTURE)
BENT = PinholeIntrinsics.model_validate(PICTURE | {"distortion": (-0.25, 0.06, 0.001, -0.001, 0.0)})
FISHEYE = FisheyeIntrinsics(
    width=320, height=320, fx=98, fy=98, cx=159.5, cy=159.5, k=(-0.01, 0.002, 0, 0), field_of_view_rad=3.3
)
LENSES = {"straight": STRAIGHT, "bent": BENT, "fisheye": FISHEYE}

poses = st.builds(
    Pose,
    xyz=st.tuples(*[st.floats(-3, 3)] * 3),
    rpy=st.tuples(st.floats(-3, 3), st.floats(-1.4, 1.4), st.floats(-3, 3)),
)
seeds = st.integers(0, 2**32 - 1)


def in_view(camera: PlacedCamera, rng: np.random.Generator, count: int, near_m: float, far_m: float) -> np.ndarray:
    """Places in the room that pixels well inside the picture see."""
    low, high = 60, np.array([camera.intrinsics.width, camera.intrinsics.height]) - 60
    pixels = rng.uniform(low, high, (count, 2))
    return camera.eye_m + rng.uniform(near_m, far_m, (count, 1)) * camera.rays(pixels)


def longest_px(ellipses: Ellipses) -> np.ndarray:
    """The major semi-axis of each (n,)."""
    return np.sqrt(np.linalg.eigvalsh(ellipses.shape)[:, 1])


def surface(centre: np.ndarray, semi_axes: np.ndarray, yaw: float, count: int = 5000) -> np.ndarray:
    """Points all over an upright ellipsoid: a sphere of points, stretched, turned, moved."""
    turn = np.arange(count) * np.pi * (3 - np.sqrt(5))
    height = 1 - (2 * np.arange(count) + 1) / count
    across = np.sqrt(1 - height**2)
    ahead, aside, up = (np.stack([across * np.cos(turn), across * np.sin(turn), height], axis=-1) * semi_axes).T
    cosine, sine = np.cos(yaw), np.sin(yaw)
    return centre + np.stack([cosine * ahead - sine * aside, sine * ahead + cosine * aside, up], axis=-1)


def how_far_out(ellipses: Ellipses, place: int, pixels: np.ndarray) -> np.ndarray:
    """1 on the ellipse, less inside: the root of (q − c)ᵀ S⁻¹ (q − c)."""
    off = pixels - ellipses.centre[place]
    return np.sqrt(np.einsum("ni,ij,nj->n", off, np.linalg.inv(ellipses.shape[place]), off))


def gaps_px(camera: PlacedCamera, ellipses: Ellipses, place: int, points: np.ndarray) -> np.ndarray:
    """How far the projected surface reaches beyond the ellipse in 48 directions [px], below 0 where it falls short."""
    pixels, _ = camera.project(points)
    angle = np.linspace(0, 2 * np.pi, 48, endpoint=False)
    direction = np.stack([np.cos(angle), np.sin(angle)])
    reached = ((pixels - ellipses.centre[place]) @ direction).max(axis=0)
    return reached - np.sqrt(np.einsum("in,ij,jn->n", direction, ellipses.shape[place], direction))


@settings(max_examples=25, deadline=None)
@given(st.sampled_from(list(LENSES)), poses, seeds)
def test_the_ray_of_a_pixel_meets_what_projects_to_it(name: str, pose: Pose, seed: int):
    camera, rng = PlacedCamera(LENSES[name], pose), np.random.default_rng(seed)
    pixels = rng.uniform(70, 220, (20, 2))
    rays = camera.rays(pixels)
    np.testing.assert_allclose(np.linalg.norm(rays, axis=1), 1, rtol=1e-12)
    back, seen = camera.project(camera.eye_m + 3.0 * rays)
    assert seen.all()
    np.testing.assert_allclose(back, pixels, atol=1e-5)


@pytest.mark.parametrize("name", LENSES)
def test_every_pixels_ray_is_kept(name: str):
    camera = PlacedCamera(LENSES[name], Pose(xyz=(1, 2, 3), rpy=(0.3, -2, 1)))
    rays = camera.pixel_rays
    np.testing.assert_allclose(rays, camera.rays(camera.intrinsics.pixel_centres()), atol=1e-15)
    assert camera.pixel_rays is rays
    with pytest.raises(ValueError, match="read-only"):
        rays[0, 0] = 0


@pytest.mark.parametrize("intrinsics", [STRAIGHT, BENT])
def test_depth_becomes_points_that_project_to_their_pixels(intrinsics: PinholeIntrinsics):
    pose = Pose(xyz=(1, 2, 2.5), rpy=(-2, 0.1, 0.7))
    camera = PlacedCamera(intrinsics, pose)
    depth_m = np.random.default_rng(0).uniform(0.5, 6, (240, 320)).astype(np.float32)
    depth_m[3, 5] = 0
    points = camera.points(depth_m)
    assert np.isnan(points[3, 5]).all()
    depth_m[3, 5], points[3, 5] = 1, camera.points(np.ones_like(depth_m))[3, 5]
    np.testing.assert_allclose((points - pose.translation) @ pose.rotation[:, 2], depth_m, rtol=1e-12)
    pixels, seen = camera.project(points)
    assert seen.all()
    np.testing.assert_allclose(pixels, intrinsics.pixel_centres(), atol=1e-6)


def test_depth_of_another_size_or_of_a_fisheye_is_refused():
    with pytest.raises(ValueError, match=r"\(24, 32\); the camera's intrinsics say \(240, 320\)"):
        PlacedCamera(STRAIGHT, Pose()).points(np.ones((24, 32)))
    with pytest.raises(TypeError, match="pinhole"):
        PlacedCamera(FISHEYE, Pose()).points(np.ones((320, 320)))


def test_equal_sensors_share_a_camera():
    one, same, other = (
        PinholeSensor(topic="a", intrinsics=STRAIGHT, room_from_sensor=Pose(xyz=(x, 0, 0))) for x in (1, 1, 2)
    )
    assert placed_camera(one) is placed_camera(same)
    assert placed_camera(one) is not placed_camera(other)
    stereo = StereoSensor(topic="/a/image/compressed", intrinsics=STRAIGHT, room_from_sensor=Pose(xyz=(1, 2, 3)))
    expected = PlacedCamera(STRAIGHT, Pose(xyz=(1, 2, 3))).points(np.ones((240, 320)))
    np.testing.assert_array_equal(stereo.points(np.ones((240, 320))), expected)


@settings(max_examples=25, deadline=None)
@given(poses, seeds)
def test_a_straight_pinhole_sees_an_ellipsoid_as_exactly_its_ellipse(pose: Pose, seed: int):
    camera, rng = PlacedCamera(STRAIGHT, pose), np.random.default_rng(seed)
    centres = in_view(camera, rng, 3, 0.8, 6.0)
    semi_axes, yaw = rng.uniform(0.05, 0.3, (3, 3)), rng.uniform(-3, 3, 3)
    ellipses, seen = camera.ellipses(Ellipsoids.upright(centres, semi_axes, yaw))
    assert len(ellipses) == 3
    assert seen.all()
    for place in range(3):
        pixels, _ = camera.project(surface(centres[place], semi_axes[place], yaw[place]))
        out = how_far_out(ellipses, place, pixels)
        assert 0.995 < out.max() < 1 + 1e-9


@pytest.mark.parametrize("name", ["bent", "fisheye"])
def test_a_lens_that_bends_sees_a_head_as_nearly_its_ellipse(name: str):
    camera, rng = PlacedCamera(LENSES[name], Pose(xyz=(1, 2, 2.4), rpy=(-2, 0.1, 0.7))), np.random.default_rng(0)
    centres = in_view(camera, rng, 40, 1.0, 5.0)
    semi_axes, yaw = np.array([0.1, 0.08, 0.13]), rng.uniform(-3, 3, 40)
    ellipses, seen = camera.ellipses(Ellipsoids.upright(centres, semi_axes, yaw))
    assert seen.all()
    for place in range(40):
        gaps = gaps_px(camera, ellipses, place, surface(centres[place], semi_axes, yaw[place]))
        assert np.abs(gaps).max() < 0.02 * longest_px(ellipses)[place]


def test_a_fisheye_sees_what_is_beside_and_behind_its_plane():
    camera = PlacedCamera(FISHEYE, Pose())
    centres = np.array([[1.5, 0.2, 0.05], [-1.5, 0.2, -0.1]])
    ellipses, seen = camera.ellipses(Ellipsoids.upright(centres, (0.1, 0.1, 0.1)))
    assert seen.all()
    for place, centre in enumerate(centres):
        gaps = gaps_px(camera, ellipses, place, surface(centre, np.full(3, 0.1), 0.0))
        assert np.abs(gaps).max() < 0.02 * longest_px(ellipses)[place]


@pytest.mark.parametrize("intrinsics", LENSES.values())
def test_a_solid_around_or_behind_the_camera_has_no_ellipse_in_the_picture(intrinsics: Intrinsics):
    camera = PlacedCamera(intrinsics, Pose())
    centres = np.array([[0.0, 0.0, 0.05], [0.0, 0.1, -3.0], [0.0, 0.0, 3.0]])
    ellipses, seen = camera.ellipses(Ellipsoids.upright(centres, (0.1, 0.1, 0.1)))
    assert seen.tolist() == [False, False, True]
    assert np.isnan(ellipses.centre[0]).all()


def test_ellipses_know_their_outlines_and_points():
    turn = np.array([[np.cos(0.4), -np.sin(0.4)], [np.sin(0.4), np.cos(0.4)]])
    ellipses = Ellipses(np.array([[10.0, 20.0]]), (turn @ np.diag([25.0, 4.0]) @ turn.T)[None])
    outline = ellipses.outline(5000)
    np.testing.assert_allclose(how_far_out(ellipses, 0, outline[0]), 1)
    np.testing.assert_allclose(outline.max(axis=1) - [10, 20], np.sqrt(np.diag(ellipses.shape[0]))[None], rtol=1e-6)
    np.testing.assert_allclose(how_far_out(ellipses, 0, ellipses.points(np.array([[0.3, 0.4], [0, 0]]))[0]), [0.5, 0])


@pytest.mark.parametrize("name", LENSES)
def test_a_persons_box_holds_their_axis_and_is_as_wide_as_they_are(name: str):
    camera = PlacedCamera(LENSES[name], Pose(xyz=(0, 0, 2.2), rpy=(-1.9, 0, 0)))
    places = np.array([[0.0, 3.0], [0.4, 4.0], [0.0, -3.0]])
    boxes, seen = camera.person_boxes(places, [1.7, 1.2, 1.7], 0.5)
    assert seen.tolist() == [True, True, False]
    axis = np.array([[[x, y, z] for z in (0.0, 0.6, 1.2)] for x, y in places])
    axes, shown = camera.project(axis)
    assert shown[:2].all()
    assert (axes[:2] >= boxes[:2, None, :2]).all()
    assert (axes[:2] <= boxes[:2, None, 2:]).all()
    width_m = (boxes[:2, 2] - boxes[:2, 0]) / camera.intrinsics.fx * np.hypot(*places[:2].T)
    assert (width_m > 0.4).all()
    assert (width_m < 0.7).all()
    if isinstance(camera.intrinsics, PinholeIntrinsics):
        assert np.isnan(boxes[2]).all()


@pytest.mark.parametrize("intrinsics", LENSES.values())
def test_nobody_is_seen_as_nobody(intrinsics: Intrinsics):
    camera = PlacedCamera(intrinsics, Pose())
    ellipses, seen = camera.ellipses(Ellipsoids.upright(np.empty((0, 3)), (0.1, 0.1, 0.1)))
    assert len(ellipses) == len(seen) == 0
    assert ellipses.outline(8).shape == (0, 8, 2)
    assert camera.person_boxes(np.empty((0, 2)), 1.7, 0.5)[0].shape == (0, 4)


@settings(max_examples=20, deadline=None)
@given(poses, seeds)
def test_a_group_of_cameras_sees_what_each_sees(pose: Pose, seed: int):
    cameras = [PlacedCamera(lens, pose) for lens in (STRAIGHT, BENT, STRAIGHT, FISHEYE)]
    points = np.random.default_rng(seed).uniform(-5, 5, (40, 3))
    pixels, seen = CameraGroup(cameras).project(points.T)
    for number, camera in enumerate(cameras):
        expected, expected_seen = camera.project(points)
        np.testing.assert_allclose(pixels[number].T, expected, rtol=1e-9, atol=1e-6)
        np.testing.assert_array_equal(seen[number], expected_seen)
    assert CameraGroup([]).project(points.T)[0].shape == (0, 2, 40)
