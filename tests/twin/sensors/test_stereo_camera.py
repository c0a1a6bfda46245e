"""The stereo camera: true depth, the error its formula says, and what real matching finds and does not."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from capsule_room import CapsuleWorld, capsule_model
from numpy.typing import NDArray
from pydantic import TypeAdapter

from trackers.observations import DepthImage
from trackers.rig import Pose, StereoSensor
from twin.scenario.camera_descriptions import StereoDescription
from twin.scenario.sensor_descriptions import SensorDescription, build_sensor
from twin.sensors.pinhole import Stereo
from twin.sensors.rays import trace_rays
from twin.sensors.render import RendererOnDemand
from twin.sensors.sensor import State

MOUNT = {"xyz": [0.0, 0.2, 1.2], "yaw_deg": 90}
_PX_M = 1 / 212  # of the camera below, at 1 m

_WALL = """
<mujoco>
  <statistic extent="8" center="0 2 1"/>
  <visual><headlight active="0"/><map znear="0.005" zfar="5"/></visual>
  <asset>
    <texture name="grain" type="2d" builtin="flat" rgb1="0.75 0.75 0.75" mark="random" markrgb="0.2 0.2 0.2"
             random="{random}" width="{pixels}" height="{pixels}"/>
    <material name="grain" texture="grain" texrepeat="1 1" texuniform="false" specular="0" shininess="0"/>
  </asset>
  <worldbody>
    <light type="directional" dir="0 1 0" diffuse="0.5 0.5 0.5" ambient="0.4 0.4 0.4" castshadow="false"/>
    <geom type="plane" pos="0 {y} 1.2" size="{half} {half} 1" xyaxes="1 0 0 0 0 1" material="grain"/>
  </worldbody>
</mujoco>
"""


def wall(distance_m: float, random: float = 0.35) -> CapsuleWorld:
    """A wall square to the camera, grained so that its grain has the same size in the picture from anywhere."""
    half = 1.6 * distance_m
    pixels = int(2 * half / (3 * _PX_M * distance_m))
    text = _WALL.format(y=0.2 + distance_m, half=half, pixels=pixels, random=random)
    return CapsuleWorld(mujoco.MjModel.from_xml_string(text))


def describe(**changes: object) -> StereoDescription:
    content = {"kind": "stereo", "mount": MOUNT, "rate_hz": 5, "size": [320, 240], "fx": 212.0, "range_max_m": 20}
    described = TypeAdapter(SensorDescription).validate_python(content | changes)
    assert isinstance(described, StereoDescription)
    return described


def look(world: CapsuleWorld, camera: StereoDescription, seed: int = 0, count: int = 1) -> list[DepthImage]:
    images: list[DepthImage] = []
    state: State = None
    rng = np.random.default_rng(seed)
    with RendererOnDemand(world.model) as renderer:
        sensor = build_sensor("deep", camera, renderer)
        for _ in range(count):
            reading, state = sensor.observe(0, [world.snapshot(0.0)], state, rng)
            assert isinstance(reading.observation, DepthImage)
            images.append(reading.observation)
    return images


def by_rays(world: CapsuleWorld, camera: StereoDescription) -> NDArray[np.float64]:
    """The depth that rays through the pixels' centres meet, inf where nothing is."""
    rig = camera.rig_sensor("deep")
    rays = rig.intrinsics.directions()
    length = np.linalg.norm(rays, axis=2)
    unit = np.ascontiguousarray((rays / length[..., None]).reshape(-1, 3) @ rig.room_from_sensor.rotation.T)
    geom, distance = np.empty(len(unit), dtype=np.int32), np.empty(len(unit))
    trace_rays(world.snapshot(0.0), rig.room_from_sensor.translation, unit, geom, distance)
    return np.where(distance < 0, np.inf, distance).reshape(length.shape) / length


def test_ideal_depth_is_what_rays_meet():
    world, camera = CapsuleWorld(capsule_model()), describe(mode="ideal")
    (image,), true_m = look(world, camera), by_rays(world, camera)
    near = true_m < 8
    assert near.mean() > 0.9
    errors = np.abs(image.depth_m - true_m)[near & (image.depth_m > 0)]
    assert np.median(errors) < 1e-3
    assert np.mean(errors > 0.01) < 0.02  # outlines


def test_depth_beyond_its_range_is_a_hole():
    world = CapsuleWorld(capsule_model())
    (image,) = look(world, describe(mode="ideal", range_min_m=1.0, range_max_m=2.0))
    true_m = by_rays(world, describe())
    said = image.depth_m > 0
    assert said.any()
    assert image.depth_m[said].min() >= 1.0
    assert image.depth_m[said].max() <= 2.0
    assert not said[(true_m > 2.01) | (true_m < 0.99)].mean() > 0.02


@pytest.mark.parametrize("distance_m", [1.0, 2.0, 4.0, 7.0])
def test_disparity_noise_errs_as_its_formula_says(distance_m: float):
    camera = describe(mode="disparity-noise", noise={"disparity_sigma_px": 0.2})
    (image,) = look(wall(distance_m), camera)
    expected_m = distance_m**2 * 0.2 / (212 * camera.baseline_m)
    assert image.depth_m.std() == pytest.approx(expected_m, rel=0.05)
    assert np.median(image.depth_m) == pytest.approx(distance_m, abs=0.05 * expected_m + 1e-4)


def test_matched_errs_with_the_square_of_the_distance():
    # A matcher's error depends on where between two whole disparities the true one lies: all places are asked.
    camera = describe()
    focal_baseline = 212 * camera.baseline_m
    sigma_px = []
    for distance_m in (1.0, 2.0, 4.0, 7.0):
        squares, count = 0.0, 0
        for place in range(6):
            true_m = focal_baseline / (focal_baseline / distance_m + (place - 2.5) / 6)
            (image,) = look(wall(true_m), camera, seed=place)
            middle_m = image.depth_m[60:180, 80:240]
            found = middle_m > 0
            assert found.mean() > 0.95
            squares += float(np.sum((middle_m[found] - true_m) ** 2))
            count += int(found.sum())
        sigma_px.append(np.sqrt(squares / count) * focal_baseline / distance_m**2)
    assert max(sigma_px) < 0.3
    np.testing.assert_allclose(sigma_px, np.mean(sigma_px), rtol=0.2)


def test_a_wall_without_grain_has_no_match():
    (grained,) = look(wall(3.0), describe())
    (bare,) = look(wall(3.0, random=0.0), describe())
    assert (grained.depth_m > 0).mean() > 0.85
    assert (bare.depth_m > 0).mean() < 0.5


def test_a_baseline_to_the_right_gives_positive_disparity_on_people():
    world, camera = CapsuleWorld(capsule_model()), describe()
    (image,), true_m = look(world, camera), by_rays(world, camera)
    person = np.zeros_like(true_m, dtype=bool)
    with RendererOnDemand(world.model) as renderer:
        sensor = build_sensor("deep", camera, renderer)
        assert isinstance(sensor, Stereo)
        person = sensor.person_image(world.snapshot(0.0)) > 0
    found = person & (image.depth_m > 0)
    assert found.sum() > 0.3 * person.sum()
    assert np.median(np.abs(image.depth_m - true_m)[found]) < 0.2


def test_noise_comes_before_matching_and_differs_from_frame_to_frame():
    world = wall(2.0)
    quiet = look(world, describe(noise="off"), count=2)
    np.testing.assert_array_equal(quiet[0].depth_m, quiet[1].depth_m)
    noisy = look(world, describe(noise="worse"), count=2)
    assert (noisy[0].depth_m != noisy[1].depth_m).mean() > 0.1
    assert (noisy[0].rgb != noisy[1].rgb).mean() > 0.5


def test_one_scene_update_serves_both_views(monkeypatch: pytest.MonkeyPatch):
    updates = []
    update = mujoco.mjv_updateScene
    monkeypatch.setattr(mujoco, "mjv_updateScene", lambda *arguments: (updates.append(1), update(*arguments)))
    look(CapsuleWorld(capsule_model()), describe())
    assert len(updates) == 1


def test_the_rig_names_how_depth_is_made():
    rig = describe(mode="disparity-noise", baseline_m=0.2).rig_sensor("deep")
    assert isinstance(rig, StereoSensor)
    assert (rig.mode, rig.baseline_m) == ("disparity-noise", 0.2)
    assert (rig.topic, rig.depth_topic) == ("/deep/image/compressed", "/deep/depth/compressed")


def test_a_rig_without_a_mode_cannot_be_sensed_with():
    rig = StereoSensor(
        topic="/s/image/compressed", room_from_sensor=Pose(), intrinsics=describe().intrinsics(), baseline_m=None
    )
    camera = describe()
    with pytest.raises(ValueError, match="both are needed"):
        Stereo(
            "s",
            rig,
            lambda: pytest.fail("rendered"),
            matching=camera.matching,
            noise=camera.noise,
            range_min_m=0.5,
            range_max_m=8,
        )
