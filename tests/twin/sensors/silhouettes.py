"""A fisheye picture's outlines of people against rays: the oracle, for the tests and for the benchmark."""

from __future__ import annotations

import mujoco
import numpy as np
from capsule_room import CapsuleWorld, capsule_model
from contourpy import contour_generator
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from trackers.cameras import FisheyeIntrinsics
from twin.instant.snapshot import RAY_GROUPS
from twin.scenario.sensor_descriptions import FisheyeDescription
from twin.sensors.fisheye import Fisheye
from twin.sensors.render import RendererOnDemand

RING = {1: (-1.5, 1.0), 2: (-0.4, 2.0), 3: (0.7, 1.0), 4: (1.8, 2.4), 5: (2.2, 0.25), 6: (-2.4, 0.15), 7: (-0.9, 1.1)}


def description(**changes: object) -> FisheyeDescription:
    mount = {"xyz": [0, 0.2, 1.0], "yaw_deg": 90} | changes.pop("mount", {})
    return FisheyeDescription.model_validate(
        {"kind": "fisheye", "mount": mount, "rate_hz": 10, "noise": "off", **changes}
    )


def picture(world: CapsuleWorld, camera: FisheyeDescription) -> NDArray[np.uint8]:
    with RendererOnDemand(world.model) as renderer:
        fisheye = Fisheye("camera", camera.rig_sensor("camera"), renderer)
        reading, _ = fisheye.observe(0, [world.snapshot(0.0)], None, np.random.default_rng(0))
    return reading.observation.rgb


def unlit(world: CapsuleWorld) -> CapsuleWorld:
    """Each geom in its plain colour, whatever its shape."""
    world.model.light_diffuse[:] = 0
    world.model.light_specular[:] = 0
    world.model.light_ambient[:] = 1
    return world


def lens_angle(lens: FisheyeIntrinsics, pixels: NDArray) -> NDArray[np.float64]:
    """Angle from the axis [rad] of places (n, 2) in the picture; NaN outside the field."""
    return lens.angle_of_radius(np.hypot((pixels[:, 0] - lens.cx) / lens.fx, (pixels[:, 1] - lens.cy) / lens.fy))


class SilhouetteRays:
    """Whether the ray through any place in the picture meets a person: the oracle, free of any renderer."""

    def __init__(self, world: CapsuleWorld, camera: FisheyeDescription) -> None:
        self.world, self.lens = world, camera.intrinsics()
        pose = camera.rig_sensor("camera").room_from_sensor
        self.rotation, self.origin = pose.rotation, pose.translation

    def __call__(self, pixels: NDArray[np.float64]) -> NDArray[np.bool_]:
        theta = lens_angle(self.lens, pixels)
        inside = np.isfinite(theta)
        x = (pixels[inside, 0] - self.lens.cx) / self.lens.fx
        y = (pixels[inside, 1] - self.lens.cy) / self.lens.fy
        phi, theta = np.arctan2(y, x), theta[inside]
        rays = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=1)
        geom = np.empty(len(rays), dtype=np.int32)
        distance = np.empty(len(rays))
        mujoco.mj_multiRay(
            self.world.model, self.world.data, self.origin, (rays @ self.rotation.T).ravel(), RAY_GROUPS, True, -1,
            geom, distance, None, len(rays), 1e6,
        )  # fmt: skip
        hit = np.zeros(len(pixels), dtype=bool)
        hit[inside] = (geom >= 0) & (self.world.person_of_geom[geom] > 0)
        return hit

    def boundary(self) -> NDArray[np.float64]:
        """Places (n, 2) on the outlines, where rows and columns of pixels cross them, to 1/100 px."""
        width, height = self.lens.width, self.lens.height
        grid = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).astype(float)  # (h, w, 2)
        hit = self(grid.reshape(-1, 2)).reshape(height, width)
        found = []
        for step, changes in (((1, 0), hit[:, 1:] != hit[:, :-1]), ((0, 1), hit[1:] != hit[:-1])):
            row, column = np.nonzero(changes)
            inner = np.stack([column, row], axis=1).astype(float)
            outer, began = inner + step, hit[row, column]
            for _ in range(7):
                middle = (inner + outer) / 2
                same = (self(middle) == began)[:, None]
                inner, outer = np.where(same, middle, inner), np.where(same, outer, middle)
            found.append((inner + outer) / 2)
        return np.concatenate(found)


def silhouette_displacements(camera: FisheyeDescription) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """How far the outlines that rays find lie from those drawn, and the other way round [px].

    Outlines end where the lens's field does: within 2 px of its rim there is nothing to compare.
    """
    world = unlit(CapsuleWorld(capsule_model(RING), speed=0))
    world.model.geom_rgba[:, :3] = (world.person_of_geom > 0)[:, None]
    lens = camera.intrinsics()
    bright = picture(world, camera)[..., 0].astype(float)
    boundary = SilhouetteRays(world, camera).boundary()
    pieces = [
        line[:-1] + (line[1:] - line[:-1]) * share
        for line in contour_generator(z=bright).lines(127.5)
        for share in np.arange(0, 1, 0.1)
    ]
    rim = 2 / min(lens.fx, lens.fy)
    compared = boundary[lens_angle(lens, boundary) < lens.field_of_view_rad / 2 - rim]
    displacement, _ = cKDTree(np.concatenate(pieces)).query(compared)
    drawn = np.concatenate(pieces)
    drawn = drawn[lens_angle(lens, drawn) < lens.field_of_view_rad / 2 - rim]
    back, _ = cKDTree(boundary).query(drawn)
    return displacement, back
