"""The fisheye picture against rays and projection: everything in its place, no seams."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from capsule_room import ROOM, CapsuleWorld, capsule_model
from silhouettes import description, picture, silhouette_displacements, unlit

from twin.sensors.fisheye import Fisheye
from twin.sensors.render import RendererOnDemand


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
