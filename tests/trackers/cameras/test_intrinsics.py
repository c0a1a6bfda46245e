"""Pinhole and fisheye cameras: projection against OpenCV's, and back."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import assume, given, settings, strategies as st

from trackers.cameras import FisheyeIntrinsics, PinholeIntrinsics
from trackers.rig import Pose, Rig, StereoSensor

DISTORTIONS = {
    "none": (0.0, 0.0, 0.0, 0.0, 0.0),
    "barrel": (-0.3, 0.1, 0.001, -0.002, 0.01),
    "pincushion": (0.2, 0.05, -0.001, 0.001, 0.0),
    "folding": (-0.4, 0.0, 0.0, 0.0, 0.0),
}


def lens(distortion: str = "none", **changes: float) -> PinholeIntrinsics:
    content = {"width": 640, "height": 480, "fx": 500.0, "fy": 510.0, "cx": 300.0, "cy": 250.0}
    return PinholeIntrinsics.model_validate(content | {"distortion": DISTORTIONS[distortion]} | changes)


def points(count: int = 500) -> np.ndarray:
    rng = np.random.default_rng(0)
    return np.stack([rng.uniform(-2, 2, count), rng.uniform(-2, 2, count), rng.uniform(3, 8, count)], axis=-1)


@pytest.mark.parametrize("distortion", DISTORTIONS)
def test_pixels_are_opencvs(distortion: str):
    camera = lens(distortion)
    expected, _ = cv2.projectPoints(points(), np.zeros(3), np.zeros(3), camera.matrix, np.array(camera.distortion))
    np.testing.assert_allclose(camera.project(points())[0], expected[:, 0], atol=1e-9)


@pytest.mark.parametrize("distortion", DISTORTIONS)
def test_unproject_is_the_way_back(distortion: str):
    camera = lens(distortion)
    given = points()
    pixels, seen = camera.project(given)
    assert 0.2 < seen.mean() < 1
    np.testing.assert_allclose(camera.unproject(pixels[seen]), given[seen] / given[seen, 2:], atol=1e-9)


def test_a_place_behind_the_fold_sees_nothing():
    camera = lens("folding")
    radius = camera.fold_radius
    assert radius == pytest.approx(np.sqrt(1 / 1.2))
    edge = camera.cx + camera.fx * radius * (1 - 0.4 * radius**2)
    assert np.isnan(camera.unproject(np.array([edge + 1, camera.cy]))[:2]).any()
    assert np.isfinite(camera.unproject(np.array([edge - 1, camera.cy]))).all()
    # One by one as together.
    pixels = np.stack([np.linspace(-100.0, 740.0, 60), np.full(60, 260.0)], axis=-1)
    np.testing.assert_array_equal([camera.unproject(pixel) for pixel in pixels], camera.unproject(pixels))
    # Beyond the fold a point's pixel would come back into the picture.
    _, seen = camera.project(np.array([[1.4, 0.0, 1.0], [0.5, 0.0, 1.0]]))
    assert seen.tolist() == [False, True]


def test_the_picture_ends_half_a_pixel_beyond_its_outer_pixels():
    camera = lens()
    corners = np.array([[-0.49, -0.49], [639.49, 479.49], [-0.51, 10.0], [639.51, 10.0], [10.0, -0.51], [10.0, 479.51]])
    _, seen = camera.project(3.0 * camera.unproject(corners))
    assert seen.tolist() == [True, True, False, False, False, False]


def test_what_lies_behind_has_no_pixel():
    pixels, seen = lens().project(np.array([[0.1, 0.1, -2.0], [0.0, 0.0, 0.0]]))
    assert not seen.any()
    assert np.isnan(pixels).all()


def test_a_stereo_cameras_points_lie_in_the_room():
    pose = Pose.from_matrix(np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]), (1.0, 2.0, 1.5))
    sensor = StereoSensor(topic="/s/image/compressed", room_from_sensor=pose, intrinsics=lens(), baseline_m=0.1)
    assert sensor.depth_topic == "/s/depth/compressed"
    middle = sensor.points(np.full((480, 640), 3.0, dtype=np.float32))[250, 300]
    np.testing.assert_allclose(middle, [1.0, 5.0, 1.5], atol=1e-9)
    left, right = sensor.eyes_m()
    np.testing.assert_allclose(right - left, [0.1, 0, 0], atol=1e-12)


def test_a_rig_with_cameras_is_read_as_it_was_written():
    rig = Rig.parse(
        """
        sensors:
          front: {kind: camera, topic: /front/image, intrinsics: {width: 64, height: 48, fx: 50, fy: 50, cx: 31.5, cy: 23.5}}
          deep:
            kind: stereo
            topic: /deep/rgb
            depth_topic: /deep/depth
            intrinsics: {width: 64, height: 48, fx: 50, fy: 50, cx: 31.5, cy: 23.5}
        """,
        "rig.yaml",
    )
    assert list(rig.cameras()) == ["front", "deep"]
    assert Rig.parse(rig.dump_yaml(), "again") == rig


def test_a_stereo_camera_needs_a_topic_for_its_depth():
    with pytest.raises(ValueError, match="depth_topic is missing"):
        StereoSensor.model_validate({"topic": "/s/rgb", "intrinsics": lens().model_dump()})


coefficient = st.floats(-0.05, 0.05)
lenses = st.builds(
    FisheyeIntrinsics,
    width=st.just(320),
    height=st.integers(100, 320),
    fx=st.floats(60, 200),
    fy=st.floats(60, 200),
    cx=st.floats(100, 220),
    cy=st.floats(50, 150),
    k=st.tuples(coefficient, coefficient, st.just(0.0), st.just(0.0)),
    field_of_view_rad=st.floats(1.0, 4.0),
)


@settings(max_examples=25, deadline=None)
@given(lenses, st.integers(0, 2**32 - 1))
def test_the_ray_of_a_points_pixel_goes_through_the_point(lens: FisheyeIntrinsics, seed: int):
    assume(lens.fold_angle_rad > lens.field_of_view_rad / 2 + 0.1)
    points = np.random.default_rng(seed).normal(size=(50, 3))
    pixels, seen = lens.project(points)
    towards = points / np.linalg.norm(points, axis=1, keepdims=True)
    np.testing.assert_allclose(lens.rays(pixels[seen]), towards[seen], atol=1e-7)


@settings(max_examples=25, deadline=None)
@given(lenses, st.integers(0, 2**32 - 1))
def test_a_picture_shows_what_is_in_the_field_of_view_and_within_its_edges(lens: FisheyeIntrinsics, seed: int):
    points = np.random.default_rng(seed).normal(size=(50, 3))
    pixels, seen = lens.project(points)
    off_axis = np.arccos(points[:, 2] / np.linalg.norm(points, axis=1))
    u, v = pixels.T
    within = (u >= -0.5) & (u < lens.width - 0.5) & (v >= -0.5) & (v < lens.height - 0.5)
    np.testing.assert_array_equal(seen, (off_axis <= lens.field_of_view_rad / 2) & within)


def test_the_axis_meets_the_principal_point():
    lens = FisheyeIntrinsics(width=64, height=64, fx=20, fy=20, cx=30, cy=33, field_of_view_rad=3.0)
    pixels, seen = lens.project(np.array([0.0, 0.0, 2.0]))
    assert pixels.tolist() == [30, 33]
    assert bool(seen)
    assert lens.rays(np.array([30.0, 33.0])).tolist() == [0, 0, 1]


def test_a_coefficient_of_next_to_nothing_bends_nothing():
    lens = {"width": 64, "height": 64, "fx": 20, "fy": 20, "cx": 30, "cy": 33, "field_of_view_rad": 3.0}
    assert FisheyeIntrinsics.model_validate(lens | {"k": (0.0, 2e-311, 0.0, 0.0)}).fold_angle_rad == np.inf


def test_a_focal_length_without_end_is_refused():
    with pytest.raises(ValueError, match="finite"):
        FisheyeIntrinsics(width=64, height=64, fx=np.inf, fy=20, cx=30, cy=33, field_of_view_rad=3.0)
