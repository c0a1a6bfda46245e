"""The body: as tall as asked, made of segments a scanner can tell apart, its front another than its back."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from twin.models import MODELS
from twin.people.appearance import appearance_of
from twin.people.body import FACE_GROUP, GEOM_GROUP, JOINT_PLACE, JOINTS, NQ_PERSON, person_spec
from twin.people.proportions import fractions
from twin.scenario.people import Person


def body(**looks):
    person = Person(**looks)
    model = person_spec(appearance_of(person, np.random.default_rng(0))).compile()
    data = mujoco.MjData(model)
    data.qpos[2] = model.body("pelvis").pos[2]
    mujoco.mj_forward(model, data)
    return model, data


def lowest_and_highest(model, data):
    """Extent of the body over all geoms, by their axis-aligned support along z [m]."""
    low, high = np.inf, -np.inf
    for geom in range(model.ngeom):
        z = data.geom_xmat[geom].reshape(3, 3)[2]
        size = model.geom_size[geom]
        if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_ELLIPSOID:
            reach = np.linalg.norm(z * size)
        else:
            reach = size[0] + abs(z[2]) * size[1]
        low, high = min(low, data.geom_xpos[geom][2] - reach), max(high, data.geom_xpos[geom][2] + reach)
    return low, high


@pytest.mark.parametrize("hair_style", ["short", "long", "bun", "bald"])
@pytest.mark.parametrize("height_m", [1.2, 1.5, 1.75, 1.9])
def test_the_body_is_as_tall_as_asked(height_m, hair_style):
    low, high = lowest_and_highest(*body(height_m=height_m, hair_style=hair_style))
    assert low == pytest.approx(0.0, abs=0.002)
    assert high == pytest.approx(height_m, abs=0.005)


def test_coordinates_are_laid_out_as_declared():
    model, _ = body()
    assert model.nq == NQ_PERSON
    names = [model.joint(joint).name for joint in range(model.njnt)]
    assert names == ["root", *JOINTS]
    assert [int(model.joint(name).qposadr[0]) for name in JOINTS] == [JOINT_PLACE[name] for name in JOINTS]


def test_few_geoms_all_of_people_and_none_collides():
    model, _ = body(hair_style="long")
    assert model.ngeom <= 32
    face = {
        name for geom in range(model.ngeom) if model.geom_group[geom] == FACE_GROUP for name in [model.geom(geom).name]
    }
    assert face == {"left_eye", "right_eye", "left_ear", "right_ear", "nose", "mouth"}
    assert (model.geom_group == GEOM_GROUP).sum() == model.ngeom - len(face)
    assert not model.geom_contype.any()
    assert not model.geom_conaffinity.any()


def test_named_colours_arrive_matt_on_the_body():
    model, _ = body(shirt="#102030", sleeves="long")
    for name in ("chest", "belly", "left_sleeve", "right_forearm"):
        material = model.geom(name).matid[0]
        np.testing.assert_allclose(model.mat_rgba[material], [16 / 255, 32 / 255, 48 / 255, 1.0], atol=1e-6)
        assert model.mat_specular[material] == model.mat_reflectance[material] == 0.0
    short, _ = body(sleeves="short", shirt="blue", skin="fair")
    assert short.geom("left_forearm").matid[0] != short.geom("left_sleeve").matid[0]


def test_a_face_is_in_front():
    model, data = body()
    head = data.site("head").xpos
    for name in ("nose", "mouth", "left_eye", "right_eye"):
        assert data.geom(name).xpos[0] > head[0] + 0.05
    assert data.geom("left_eye").xpos[1] > 0 > data.geom("right_eye").xpos[1]
    assert data.geom("left_toes").xpos[0] > 0.05


def test_points_lie_in_the_body():
    model, data = body()
    points = [site for site in range(model.nsite) if model.site(site).name.startswith("point_")]
    assert len(points) >= 40
    inside = np.zeros(len(points), dtype=bool)
    for geom in range(model.ngeom):
        local = (data.site_xpos[points] - data.geom_xpos[geom]) @ data.geom_xmat[geom].reshape(3, 3)
        size = model.geom_size[geom]
        if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_ELLIPSOID:
            inside |= ((local / size) ** 2).sum(axis=1) <= 1
        else:
            local[:, 2] -= np.clip(local[:, 2], -size[1], size[1])
            inside |= np.linalg.norm(local, axis=1) <= size[0]
    assert inside.all()


def test_segments_follow_the_table():
    model, data = body(height_m=1.8)
    table = fractions()
    heights = {"thigh": table.hip_height, "shank": table.knee_height, "foot": table.ankle_height}
    for segment, fraction in heights.items():
        assert data.body(f"left_{segment}").xpos[2] == pytest.approx(1.8 * fraction, abs=1e-9)


@pytest.mark.parametrize("heading", np.linspace(-np.pi, np.pi, 9))
def test_a_scanner_meets_two_legs_at_the_knee_and_one_trunk_with_arms_at_the_waist(heading):
    spec = mujoco.MjSpec.from_file(str(MODELS / "rooms" / "lab.xml"))
    looks = appearance_of(Person(height_m=1.75), np.random.default_rng(1))
    spec.attach(person_spec(looks), prefix="anna/", frame=spec.worldbody.add_frame())
    model = spec.compile()
    data = mujoco.MjData(model)
    place = data.qpos
    place[:7] = [0, 2.0, looks.proportions.hip_height, np.cos(heading / 2), 0, 0, np.sin(heading / 2)]
    for side, sign in (("left", 1), ("right", -1)):
        place[JOINT_PLACE[f"{side}_hip_roll"]] = 0.03 * sign
    mujoco.mj_kinematics(model, data)
    angles = np.deg2rad(np.arange(60, 120, 0.25))
    rays = np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=-1)

    def hit(height_m):
        geoms = np.empty(len(rays), dtype=np.int32)
        ranges = np.empty(len(rays))
        mujoco.mj_multiRay(
            model, data, np.array([0, 0, height_m]), rays.ravel(), None, True, -1, geoms, ranges, None, len(rays), 10.0
        )
        return [model.geom(geom).name.removeprefix("anna/") for geom in geoms if model.geom_group[geom] == GEOM_GROUP]

    legs = {name.partition("_")[0] for name in hit(0.45)}
    # seen exactly from the side, one leg hides the other
    assert legs == {"left", "right"} if abs(np.sin(heading)) > 0.1 else legs <= {"left", "right"} and legs
    at_waist = hit(0.95)
    assert {"hips", "belly"} & set(at_waist) or {"left_hand", "right_hand"} & set(at_waist)
    assert len(at_waist) >= 20
