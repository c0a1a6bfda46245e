"""The fisheye's projection and its way back, for any lens that does not fold."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given, settings, strategies as st

from trackers.cameras import FisheyeIntrinsics

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
