"""The fisheye picture against rays and projection: everything in its place, no seams; lenses and their calibrations."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from capsule_room import ROOM, CapsuleWorld, capsule_model
from silhouettes import description, picture, silhouette_displacements, unlit

from trackers.cameras import FisheyeIntrinsics
from trackers.errors import InputError
from twin.sensors.camera import LENSES, Lens, check_fisheye
from twin.sensors.fisheye import Fisheye, build_face_table
from twin.sensors.render import RendererOnDemand
from twin.sensors.render_scene import MARGIN_PX


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"lens": "opencv_test_lens", "size": [800, 500]},
        {"lens": {"width": 500, "height": 480, "fx": 110, "fy": 108, "field_of_view_deg": 230}},
        {"mount": {"pitch_deg": 25, "roll_deg": 30}},
    ],
    ids=["equidistant 185", "opencv", "230 degrees", "turned"],
)
def test_silhouettes_agree_with_rays(changes: dict):
    displacement, back = silhouette_displacements(description(**changes))
    assert len(displacement) > 1000
    assert displacement.mean() <= 0.4
    assert np.quantile(displacement, 0.95) <= 1.0
    # And nothing is drawn that no ray meets: the other way round, at most half a pixel more between the points.
    assert back.mean() <= 0.6
    assert np.quantile(back, 0.95) <= 1.2


_BALLS = """
<mujoco>
  <statistic extent="8" center="0 2 1"/>
  <visual><headlight active="0"/></visual>
  <worldbody>
    <light type="directional" ambient="1 1 1" diffuse="0 0 0" specular="0 0 0"/>
    <geom type="sphere" size="0.03" pos="{ball}" rgba="1 1 1 1"/>
    {people}
  </worldbody>
</mujoco>
"""


@pytest.mark.parametrize(
    ("ball", "side"),
    [
        ((1.0, 2.2, 1.0), "right"),
        ((0.0, 2.2, 1.6), "up"),
        ((1.2, 0.18, 1.0), "right"),
        ((-1.2, 1.4, 1.0), "left"),
        ((0.0, 0.3, 0.2), "down"),
        ((0.7, 0.9, 1.7), "right"),
    ],
)
def test_things_appear_where_the_rig_projects_them(ball: tuple[float, float, float], side: str):
    world = CapsuleWorld(capsule_model({}, _BALLS.replace("{ball}", " ".join(map(str, ball)))))
    camera = description()
    rig = camera.rig_sensor("camera")
    weight = picture(world, camera)[..., 1].astype(float)
    row, column = np.indices(weight.shape)
    centre = np.array([(column * weight).sum(), (row * weight).sum()]) / weight.sum()
    pose = rig.room_from_sensor
    expected, inside = rig.intrinsics.project((np.array(ball) - pose.translation) @ pose.rotation)
    assert inside
    np.testing.assert_allclose(centre, expected, atol=0.25)
    middle = np.array([rig.intrinsics.cx, rig.intrinsics.cy])
    offset = (centre - middle) @ {"right": [1, 0], "left": [-1, 0], "up": [0, -1], "down": [0, 1]}[side]
    assert offset > 20


def test_a_uniform_room_is_uniform_to_the_rim():
    world = unlit(CapsuleWorld(capsule_model({})))
    world.model.geom_rgba[:] = [0.5, 0.25, 0.75, 1]
    rgb = picture(world, description())
    seen = np.isfinite(description().intrinsics().pixel_rays()[..., 0])
    assert (rgb[~seen] == 0).all()
    room = rgb[seen].astype(int)
    assert np.ptp(room, axis=0).max() <= 1
    np.testing.assert_allclose(room.mean(axis=0), [127.5, 63.75, 191.25], atol=1)


@pytest.mark.parametrize("headlight", ["0", "1"])
def test_no_step_in_brightness_where_faces_meet(headlight: str):
    """The same shiny room from a camera rolled by 45°, whose faces meet elsewhere, looks the same everywhere."""
    room = ROOM.replace('active="0"', f'active="{headlight}"').replace('specular="0 0 0"', "")
    world = CapsuleWorld(capsule_model({}, room))
    world.model.geom_rgba[:, :3] = 0.8
    straight, rolled = description(), description(mount={"roll_deg": 45})
    first, second = picture(world, straight).astype(np.float32), picture(world, rolled).astype(np.float32)
    lens = straight.intrinsics()
    first_pose = straight.rig_sensor("camera").room_from_sensor
    second_pose = rolled.rig_sensor("camera").room_from_sensor
    directions = lens.pixel_rays()
    theta = np.arctan2(np.hypot(directions[..., 0], directions[..., 1]), directions[..., 2])
    places, _ = lens.project(directions @ first_pose.rotation.T @ second_pose.rotation)
    same = cv2.remap(second, places.astype(np.float32), None, cv2.INTER_LINEAR)
    # Where surfaces meet each other, pixels differ by how the edge falls on them: compare what is smooth.
    rough = cv2.dilate(np.abs(cv2.Laplacian(first[..., 0], cv2.CV_32F)), np.ones((5, 5)))
    smooth = (rough < 6) & (theta < np.deg2rad(91.5))
    x, y, z = np.moveaxis(np.nan_to_num(directions), -1, 0)
    largest = np.sort(np.abs(np.stack([x, y, np.maximum(z, 0)])), axis=0)
    seam = smooth & (largest[2] - largest[1] < 0.01)
    assert smooth.mean() > 0.5
    assert seam.sum() > 500
    difference = np.abs(first - same).max(axis=2)
    assert difference[seam].max() <= 3
    assert difference[seam].mean() <= difference[smooth].mean() + 0.25


def test_decorations_are_not_drawn():
    world = unlit(CapsuleWorld(capsule_model({1: (0.0, 1.5)}), speed=0))
    rgb = picture(world, description()).astype(int)
    magenta = (rgb[..., 0] > 200) & (rgb[..., 1] < 60) & (rgb[..., 2] > 200)
    assert not magenta.any()


def test_each_picture_has_its_own_array(world: CapsuleWorld, renderer: RendererOnDemand):
    camera = Fisheye("camera", description(size=[64, 64]).rig_sensor("camera"), renderer)
    rng = np.random.default_rng(0)
    first, _ = camera.observe(0, [world.snapshot(0.0)], None, rng)
    kept = first.observation.rgb.copy()
    second, _ = camera.observe(1, [world.snapshot(0.5)], None, rng)
    np.testing.assert_array_equal(first.observation.rgb, kept)
    assert (second.observation.rgb != kept).any()
    assert first.observation.rgb.flags.c_contiguous


def test_two_cameras_share_a_renderer(world: CapsuleWorld, renderer: RendererOnDemand):
    small = Fisheye("small", description(size=[64, 64]).rig_sensor("small"), renderer)
    large = Fisheye("large", description(size=[200, 160]).rig_sensor("large"), renderer)
    rng, snapshot = np.random.default_rng(0), world.snapshot(0.0)
    before, _ = small.observe(0, [snapshot], None, rng)
    large.observe(0, [snapshot], None, rng)
    after, _ = small.observe(0, [snapshot], None, rng)
    np.testing.assert_array_equal(before.observation.rgb, after.observation.rgb)


def test_another_model_than_the_renderer_s_is_loud(renderer: RendererOnDemand):
    camera = Fisheye("camera", description(size=[64, 64]).rig_sensor("camera"), renderer)
    other = CapsuleWorld(capsule_model({}))
    with pytest.raises(ValueError, match="another model"):
        camera.observe(0, [other.snapshot(0.0)], None, np.random.default_rng(0))


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
    with pytest.raises(InputError, match=r"folds back 93\.\d° from the axis; a field of view below 186\.\d+° is valid"):
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
        build_face_table(aside, np.eye(3))


def test_radius_is_inverted_to_the_last_digits():
    lens = LENSES["opencv_test_lens"].intrinsics()
    theta = np.linspace(0, np.pi / 2 * 0.9999, 1000)
    np.testing.assert_allclose(lens.angle_of_radius(lens.radius_of_angle(theta)), theta, atol=1e-12)


def test_bilinear_taps_stay_inside_their_face(lens: FisheyeIntrinsics):
    table = build_face_table(lens, np.eye(3))
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
    table = build_face_table(LENSES["equidistant_185"].intrinsics(), np.eye(3))
    front, *sides = table.views
    assert len(sides) == 4
    for side in sides:
        assert side.viewport[3] < 0.56 * front.viewport[3]
        assert side.bottom == pytest.approx(-np.tan(np.deg2rad(2.5)) * np.sqrt(2), abs=0.03)
    narrow = build_face_table(CAMERAS["narrow"], np.eye(3))
    assert len(narrow.views) == 1
