"""Which person a camera's pixels show, against the rays through their centres; and the boxes around them."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pytest
from capsule_room import CapsuleWorld, capsule_model
from numpy.typing import NDArray
from pydantic import TypeAdapter
from scipy.ndimage import maximum_filter, minimum_filter
from silhouettes import RING

from twin.instant.snapshot import RAY_GROUPS
from twin.scenario.sensor_descriptions import FisheyeDescription, SensorDescription, build_sensor
from twin.sensors.render import RendererOnDemand
from twin.truth.visibility import PersonImaging, person_boxes

MOUNT = {"xyz": [0, 0.2, 1.0], "yaw_deg": 90}
CAMERAS = {
    "fisheye": {"kind": "fisheye", "mount": MOUNT | {"roll_deg": 20}},
    "fisheye, rectangular": {"kind": "fisheye", "lens": "opencv_test_lens", "size": [400, 250], "mount": MOUNT},
    "pinhole": {"kind": "camera", "size": [320, 240], "field_of_view_deg": 100, "mount": MOUNT},
    "barrel": {
        "kind": "camera",
        "size": [320, 240],
        "field_of_view_deg": 80,
        "distortion": {"k1": -0.25, "k2": 0.05, "p1": 0.002},
        "mount": MOUNT,
    },
    "stereo": {"kind": "stereo", "size": [320, 240], "field_of_view_deg": 90, "mount": MOUNT | {"pitch_deg": 10}},
}


def describe(content: dict[str, Any]) -> Any:
    return TypeAdapter(SensorDescription).validate_python({"rate_hz": 10, "noise": "off"} | content)


def ids_by_rays(world: CapsuleWorld, camera: Any) -> NDArray[np.int16]:
    """The id that the ray through each pixel's centre meets, -1 outside the field: the oracle."""
    lens = camera.intrinsics()
    directions = lens.pixel_rays() if isinstance(camera, FisheyeDescription) else lens.directions()
    inside = np.isfinite(directions[..., 2])
    pose = camera.rig_sensor("camera").room_from_sensor
    rays = directions[inside] / np.linalg.norm(directions[inside], axis=1, keepdims=True) @ pose.rotation.T
    geom, distance = np.empty(len(rays), dtype=np.int32), np.empty(len(rays))
    mujoco.mj_multiRay(
        world.model, world.data, pose.translation, rays.ravel(), RAY_GROUPS, True, -1, geom, distance, None, len(rays),
        1e6,
    )  # fmt: skip
    people = np.full(inside.shape, -1, dtype=np.int16)
    people[inside] = np.where(geom >= 0, world.person_of_geom[geom], 0)
    return people


@pytest.mark.parametrize("name", list(CAMERAS))
def test_every_pixel_shows_whom_its_ray_meets(name: str):
    camera = describe(CAMERAS[name])
    world = CapsuleWorld(capsule_model(RING), speed=0)
    snapshot = world.snapshot(0.0)
    with RendererOnDemand(world.model) as renderer:
        sensor = build_sensor("camera", camera, renderer)
        assert isinstance(sensor, PersonImaging)
        sensor.observe(0, [snapshot], None, np.random.default_rng(0))
        people = sensor.person_image(snapshot)
        again = sensor.person_image(snapshot)
        reading, _ = sensor.observe(0, [snapshot], None, np.random.default_rng(0))
    assert people.dtype == np.int16
    assert people.shape == reading.observation.rgb.shape[:2]
    np.testing.assert_array_equal(people, again)
    true = ids_by_rays(world, camera)
    np.testing.assert_array_equal(people == -1, true == -1)
    assert len(np.unique(true[true > 0])) >= 3
    wrong = people != true
    # Drawn pixels lie up to half a pixel off; elsewhere than along outlines hardly any is wrong: round shapes are drawn
    # with facets, and where two of one person just touch, a line of pixels shows what is behind.
    outline = maximum_filter(true, 3) != minimum_filter(true, 3)
    assert (wrong & ~outline).mean() <= 3e-4
    assert wrong.mean() <= 0.01


@pytest.mark.parametrize("name", list(CAMERAS))
def test_boxes_hold_what_rays_meet_to_a_pixel(name: str):
    camera = describe(CAMERAS[name])
    world = CapsuleWorld(capsule_model(RING), speed=0)
    snapshot = world.snapshot(0.0)
    with RendererOnDemand(world.model) as renderer:
        sensor = build_sensor("camera", camera, renderer)
        assert isinstance(sensor, PersonImaging)
        boxes = {box.id: box for box in person_boxes(sensor.person_image(snapshot))}
    true = {box.id: box for box in person_boxes(ids_by_rays(world, camera))}
    compared = [id_ for id_, box in true.items() if box.visible_px > 200]
    assert len(compared) >= 3
    for id_ in compared:
        drawn, met = boxes[id_], true[id_]
        for edge in ("left", "top"):
            assert abs(getattr(drawn, edge) - getattr(met, edge)) <= 2
        assert abs(drawn.left + drawn.width - met.left - met.width) <= 2
        assert abs(drawn.top + drawn.height - met.top - met.height) <= 2
        assert drawn.visible_px == pytest.approx(met.visible_px, rel=0.12)


def test_a_body_behind_the_room_is_not_seen():
    world = CapsuleWorld(capsule_model({1: (0.0, 5.0), 2: (0.0, 2.0)}), speed=0)  # the wall stands at y = 4
    snapshot = world.snapshot(0.0)
    with RendererOnDemand(world.model) as renderer:
        sensor = build_sensor("camera", describe(CAMERAS["pinhole"]), renderer)
        assert isinstance(sensor, PersonImaging)
        assert [box.id for box in person_boxes(sensor.person_image(snapshot))] == [2]
