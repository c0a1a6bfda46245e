"""The lab: what a rig at the origin may rely on."""

from __future__ import annotations

import os

os.environ.setdefault("MUJOCO_GL", "egl")

import mujoco
import numpy as np
import pytest

from twin.models import MODELS

WAIST_M, KNEE_M = 0.95, 0.45


@pytest.fixture(scope="module")
def lab():
    model = mujoco.MjModel.from_xml_path(str(MODELS / "rooms" / "lab.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def cast(lab, origin, angles):
    model, data = lab
    rays = np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=-1)
    geoms, ranges = np.empty(len(rays), dtype=np.int32), np.empty(len(rays))
    mujoco.mj_multiRay(
        model, data, np.array(origin, dtype=float), rays.ravel(), None, True, -1, geoms, ranges, None, len(rays), 20.0
    )
    return geoms, ranges


def test_few_geoms_and_no_headlight(lab):
    model, _ = lab
    assert model.ngeom < 60
    assert model.vis.headlight.active == 0
    assert (model.geom_group == 0).all()
    assert model.vis.global_.offwidth >= 2048
    assert model.vis.global_.offheight >= 2048


@pytest.mark.parametrize("height_m", [KNEE_M, WAIST_M])
def test_every_beam_ends_on_the_room_and_none_on_the_tracked_area(lab, height_m):
    angles = np.deg2rad(np.arange(0, 180.5, 0.5))
    geoms, ranges = cast(lab, (0, 0, height_m), angles)
    assert (geoms >= 0).all()
    x, y = ranges * np.cos(angles), ranges * np.sin(angles)
    inside = (np.abs(x) < 2.3) & (y > 0.3) & (y < 3.1)
    assert not inside.any()
    assert ranges.min() > 2.5


@pytest.mark.parametrize("height_m", [KNEE_M, WAIST_M])
def test_nothing_stands_in_the_tracked_area(lab, height_m):
    for y in np.arange(0.35, 3.1, 0.1):
        _, ranges = cast(lab, (-2.3, y, height_m), np.array([0.0]))
        assert ranges[0] > 4.6


def test_the_sensors_have_their_space(lab):
    model, data = lab
    near = np.array(
        [[x, y, z] for x in (-0.09, 0.0, 0.09) for y in (-0.09, 0.0, 0.09) for z in np.arange(0.1, 1.6, 0.1)]
    )
    around = np.deg2rad(np.arange(0, 360, 15))
    for place in near:
        _, ranges = cast(lab, place, around)
        assert ranges[ranges >= 0].min() > 0.015


def test_the_walkable_area_holds_the_tracked_area(lab):
    model, _ = lab
    corners = model.numeric("walkable_area").data.reshape(-1, 2)
    assert corners.min(axis=0)[0] <= -2.0
    assert corners.max(axis=0)[0] >= 2.0
    assert corners.min(axis=0)[1] <= 0.6
    assert corners.max(axis=0)[1] >= 2.8


def test_walls_differ_and_nothing_is_black_or_blown_out(lab):
    model, data = lab
    renderer = mujoco.Renderer(model, 120, 160)
    camera = mujoco.MjvCamera()
    means = []
    try:
        for azimuth in (0, 90, 180, 270):
            camera.lookat, camera.distance, camera.azimuth, camera.elevation = (0, 1.9, 1.4), 0.01, azimuth, 0
            renderer.update_scene(data, camera)
            image = renderer.render().astype(float)
            means.append(image.mean())
            assert (image.max(axis=-1) < 12).mean() < 0.01
            assert (image.min(axis=-1) > 250).mean() < 0.01
    finally:
        renderer.close()
    assert np.ptp(means) > 8
    assert all(80 < mean < 200 for mean in means)
