"""Lenses: the way back from pixels is the inverse of the projection, and folding lenses are refused."""

import cv2
import numpy as np
import pytest

from trackers.cameras import FisheyeIntrinsics
from trackers.errors import InputError
from twin.sensors.fisheye import LENSES, MARGIN_PX, Lens, build_face_table, check_fisheye

CAMERAS = {
    "equidistant": LENSES["equidistant_185"].intrinsics(),
    "equidistant, wide picture": LENSES["equidistant_185"].intrinsics((320, 200)),
    "opencv": LENSES["opencv_test_lens"].intrinsics((320, 200)),
    "240 degrees": Lens(width=301, height=300, fx=70, field_of_view_deg=240).intrinsics(),
    "narrow": Lens(width=64, height=48, fx=200, fy=190, cx=10, cy=40, field_of_view_deg=60).intrinsics(),
}


@pytest.fixture(params=CAMERAS)
def lens(request: pytest.FixtureRequest) -> FisheyeIntrinsics:
    return CAMERAS[request.param]


def test_directions_project_back_to_their_pixels(lens: FisheyeIntrinsics):
    directions = lens.pixel_rays()
    seen = np.isfinite(directions[..., 0])
    assert seen.any()
    np.testing.assert_allclose(np.linalg.norm(directions[seen], axis=-1), 1, rtol=1e-12)
    pixels, inside = lens.project(directions[seen] * 3.7)
    row, column = np.nonzero(seen)
    np.testing.assert_allclose(pixels, np.stack([column, row], axis=-1), atol=1e-7)
    assert inside.all()


def test_pixels_without_a_direction_lie_outside_the_field(lens: FisheyeIntrinsics):
    blind = ~np.isfinite(lens.pixel_rays()[..., 0])
    row, column = np.nonzero(blind)
    radius = np.hypot((column - lens.cx) / lens.fx, (row - lens.cy) / lens.fy)
    assert (radius > lens.radius_of_angle(lens.field_of_view_rad / 2)).all()


def test_the_model_is_opencv_s():
    lens = LENSES["opencv_test_lens"].intrinsics()
    points = np.random.default_rng(0).uniform([-1, -1, 0.5], [1, 1, 2], (50, 3))
    matrix = np.array([[lens.fx, 0, lens.cx], [0, lens.fy, lens.cy], [0, 0, 1]])
    theirs, _ = cv2.fisheye.projectPoints(points[:, None], np.zeros(3), np.zeros(3), matrix, np.array(lens.k))
    np.testing.assert_allclose(lens.project(points)[0], theirs[:, 0], atol=1e-9)


def test_185_degrees_fill_the_circle():
    lens = LENSES["equidistant_185"].intrinsics((700, 640))
    assert lens.fx * np.deg2rad(92.5) == pytest.approx(320)
    assert (lens.cx, lens.cy) == (349.5, 319.5)


def test_at_its_own_size_a_lens_is_as_it_was_calibrated():
    for lens in (*LENSES.values(), Lens(width=64, height=48, fx=200, cx=10, cy=40, field_of_view_deg=60)):
        found = lens.intrinsics()
        assert (found.width, found.height, found.fx) == (lens.width, lens.height, lens.fx)
        if lens.cx is not None:
            assert (found.cx, found.cy) == (pytest.approx(lens.cx), pytest.approx(lens.cy))


def test_scaling_keeps_what_a_pixel_s_place_sees():
    full, half = LENSES["opencv_test_lens"].intrinsics(), LENSES["opencv_test_lens"].intrinsics((640, 400))
    point = np.array([0.4, -0.3, 1.0])
    (u, v), (u2, v2) = full.project(point)[0], half.project(point)[0]
    assert (u2 + 0.5, v2 + 0.5) == (pytest.approx((u + 0.5) / 2), pytest.approx((v + 0.5) / 2))


def test_a_lens_that_folds_back_is_refused():
    opencv = LENSES["opencv_test_lens"]
    check_fisheye(opencv.intrinsics())
    with pytest.raises(InputError, match=r"folds back 93\.\d° from the axis; a field of view below 186\.\d° is valid"):
        opencv.model_copy(update={"field_of_view_deg": 200.0}).intrinsics()
    barely = FisheyeIntrinsics(width=9, height=9, fx=9, fy=9, cx=4, cy=4, k=(-1 / 3, 0, 0, 0), field_of_view_rad=1.999)
    check_fisheye(barely)  # dr/dθ = 1 - θ² reaches 0 at 1 rad
    with pytest.raises(InputError, match="folds back"):
        check_fisheye(barely.model_copy(update={"field_of_view_rad": 2.001}))


def test_too_wide_a_lens_is_refused():
    wide = FisheyeIntrinsics(width=9, height=9, fx=2, fy=2, cx=4, cy=4, field_of_view_rad=5.0)
    with pytest.raises(InputError, match="at most 240°"):
        check_fisheye(wide)


def test_a_picture_outside_the_field_is_refused():
    aside = FisheyeIntrinsics(width=9, height=9, fx=9, fy=9, cx=900, cy=4, field_of_view_rad=1.0)
    with pytest.raises(InputError, match="no pixel"):
        build_face_table(aside, np.eye(3), 1.0)


def test_radius_is_inverted_to_the_last_digits():
    lens = LENSES["opencv_test_lens"].intrinsics()
    theta = np.linspace(0, np.pi / 2 * 0.9999, 1000)
    np.testing.assert_allclose(lens.angle_of_radius(lens.radius_of_angle(theta)), theta, atol=1e-12)


def test_bilinear_taps_stay_inside_their_face(lens: FisheyeIntrinsics):
    table = build_face_table(lens, np.eye(3), 1.0)
    seen = table.column > -2
    inside_any = np.zeros(seen.shape, dtype=bool)
    for view in table.views:
        column, row, width, height = view.viewport
        across, up = table.column - column, table.row - row
        inside = seen & (across >= MARGIN_PX / 2) & (across <= width - 1 - MARGIN_PX / 2)
        inside &= (up >= MARGIN_PX / 2) & (up <= height - 1 - MARGIN_PX / 2)
        assert not (inside & inside_any).any()
        inside_any |= inside
    np.testing.assert_array_equal(inside_any, seen)
    np.testing.assert_array_equal(seen, np.isfinite(lens.pixel_rays()[..., 0]))


def test_only_the_needed_part_of_the_sides_is_drawn():
    table = build_face_table(LENSES["equidistant_185"].intrinsics(), np.eye(3), 1.0)
    front, *sides = table.views
    assert len(sides) == 4
    for side in sides:
        assert side.viewport[3] < 0.56 * front.viewport[3]
        assert side.bottom == pytest.approx(-np.tan(np.deg2rad(2.5)) * np.sqrt(2), abs=0.03)
    narrow = build_face_table(CAMERAS["narrow"], np.eye(3), 1.0)
    assert len(narrow.views) == 1
