"""The body: as tall as asked, made of segments a scanner can tell apart, its front another than its back."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from twin.instant.snapshot import RAY_GROUPS
from twin.models import MODELS
from twin.people.body.appearance import appearance_of
from twin.people.body.person_spec import GEOM_GROUP, JOINT_PLACE, JOINTS, LEG, NQ_PERSON, TRIM_GROUP, person_spec
from twin.people.body.proportions import fractions, leg_angles, proportions_of
from twin.scenario.person import Person


def body(**looks):
    person = Person(**looks)
    model = person_spec(appearance_of(person, np.random.default_rng(0))).compile()
    data = mujoco.MjData(model)
    data.qpos[2] = model.body("pelvis").pos[2]
    mujoco.mj_forward(model, data)
    return model, data


def vertices(model, data, geom):
    """Places of a mesh geom's vertices in the room (n, 3) [m]."""
    mesh = model.geom_dataid[geom]
    first = model.mesh_vertadr[mesh]
    local = model.mesh_vert[first : first + model.mesh_vertnum[mesh]]
    return local @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]


def lowest_and_highest(model, data):
    z = np.concatenate([vertices(model, data, geom)[:, 2] for geom in range(model.ngeom)])
    return z.min(), z.max()


def hits(model, data, origin, direction):
    """Name of the first geom that a ray meets, None where none."""
    geom = np.array([-1], dtype=np.int32)
    mujoco.mj_ray(model, data, np.array(origin, float), np.array(direction, float), RAY_GROUPS, True, -1, geom, None)
    return model.geom(int(geom[0])).name if geom[0] >= 0 else None


@pytest.mark.parametrize("hair_style", ["short", "long", "bun", "bald", "ponytail", "bob", "cropped"])
@pytest.mark.parametrize("height_m", [0.9, 1.2, 1.5, 1.75, 2.1])
def test_the_body_is_as_tall_as_asked(height_m, hair_style):
    low, high = lowest_and_highest(*body(height_m=height_m, hair_style=hair_style, cap="none"))
    assert low == pytest.approx(0.0, abs=1e-5)
    assert high == pytest.approx(height_m, abs=0.008)


def test_coordinates_are_laid_out_as_declared():
    model, _ = body()
    assert model.nq == NQ_PERSON
    names = [model.joint(joint).name for joint in range(model.njnt)]
    assert names == ["root", *JOINTS]
    assert [int(model.joint(name).qposadr[0]) for name in JOINTS] == [JOINT_PLACE[name] for name in JOINTS]


@pytest.mark.parametrize("seed", range(8))
def test_few_geoms_all_of_people_and_none_collides(seed):
    model = person_spec(appearance_of(Person(), np.random.default_rng(seed))).compile()
    assert (model.geom_group == GEOM_GROUP).sum() <= 27
    trim = {model.geom(geom).name for geom in np.flatnonzero(model.geom_group != GEOM_GROUP)}
    assert trim <= {"straps"}
    assert {int(group) for group in model.geom_group} <= {GEOM_GROUP, TRIM_GROUP}
    assert model.nmeshface < 8000
    assert not model.geom_contype.any()
    assert not model.geom_conaffinity.any()


def test_named_colours_arrive_matt_on_the_body():
    model, _ = body(shirt="#102030", sleeves="long")
    for name in ("chest", "left_sleeve", "right_forearm"):
        material = model.geom(name).matid[0]
        np.testing.assert_allclose(model.mat_rgba[material], [16 / 255, 32 / 255, 48 / 255, 1.0], atol=1e-6)
        assert model.mat_specular[material] == model.mat_reflectance[material] == 0.0
        assert (model.mat_texid[material] < 0).all()
    short, _ = body(sleeves="short", shirt="blue", skin="fair")
    assert short.geom("left_forearm").matid[0] != short.geom("left_sleeve").matid[0]


def texture_of(model, geom):
    """The picture (rows, columns, 3) on a geom, the upper edge first."""
    texture = model.mat_texid[model.geom(geom).matid[0], mujoco.mjtTextureRole.mjTEXROLE_RGB]
    height, width, first = model.tex_height[texture], model.tex_width[texture], model.tex_adr[texture]
    return model.tex_data[first : first + 3 * height * width].reshape(height, width, 3)[::-1]


@pytest.mark.parametrize("pattern", ["striped", "checked", "printed"])
def test_a_pattern_has_both_colours(pattern):
    model, _ = body(shirt="#ff0000", shirt_pattern=pattern, shirt_second="#0000ff", sleeves="long", coat="none")
    colours = {tuple(int(part) for part in colour) for colour in texture_of(model, "chest").reshape(-1, 3)}
    assert {(255, 0, 0), (0, 0, 255)} <= colours
    woven = pattern != "printed"
    assert (model.mat_texid[model.geom("left_sleeve").matid[0]] >= 0).any() == woven


@pytest.mark.parametrize(
    ("looks", "expected"),
    [
        ({"coat": "beige"}, {"left_tail", "right_tail"}),
        ({"skirt": "red"}, {"left_skirt", "right_skirt"}),
        ({"cap": "red", "skirt": "none"}, {"cap"}),
        ({"bag": "backpack"}, {"bag", "straps"}),
        ({"bag": "shoulder"}, {"bag", "straps"}),
        ({"bag": "handbag"}, {"bag"}),
    ],
)
def test_what_is_named_is_worn(looks, expected):
    model, _ = body(**({"coat": "none", "skirt": "none", "cap": "none", "bag": "none"} | looks))
    bare, _ = body(coat="none", skirt="none", cap="none", bag="none")
    names = {model.geom(geom).name for geom in range(model.ngeom)}
    assert expected <= names
    assert not expected & {bare.geom(geom).name for geom in range(bare.ngeom)}


@pytest.mark.parametrize("height_m", [0.95, 1.75])
@pytest.mark.parametrize("build", [0.8, 1.35])
def test_every_body_is_closed_where_segments_meet(height_m, build):
    """From ahead and from the side a ray at any height of the middle of the leg or trunk meets the body."""
    model, data = body(height_m=height_m, build=build, skirt="none", coat="none", bag="none", cap="none")
    lengths = appearance_of(Person(height_m=height_m), np.random.default_rng(0)).proportions
    for share in np.linspace(0.03, 0.97, 60):
        z = share * height_m
        y = lengths.hip_joint_width / 2 if z < lengths.hip_height else 0.0
        assert hits(model, data, (2, y, z), (-1, 0, 0)) is not None
        assert hits(model, data, (0, 2, z), (0, -1, 0)) is not None


def test_a_skirt_closes_the_legs_above_the_knee_and_not_below():
    model, data = body(height_m=1.75, skirt="red", coat="none")
    assert hits(model, data, (2, 0.0, 0.60), (-1, 0, 0)) in {"left_skirt", "right_skirt"}
    assert hits(model, data, (2, 0.0, 0.42), (-1, 0, 0)) is None


def test_a_face_is_in_front():
    model, data = body(hair_style="bald", cap="none", beard=False, glasses=False, skin="fair")
    head = data.site("head").xpos
    skull = vertices(model, data, model.geom("skull").id)
    nose = skull[skull[:, 0].argmax()]
    assert nose[0] > head[0] + 0.09
    assert abs(nose[1]) < 0.02
    assert vertices(model, data, model.geom("left_toes").id)[:, 0].max() > 0.15
    face = texture_of(model, "skull").astype(int).sum(axis=-1)
    columns = face.shape[1]
    middle, back = face[:, columns // 3 : 2 * columns // 3], face[:, : columns // 6]
    assert middle.min() < 150 < back.min()
    # two dark eyes beside the nose, none on it
    dark = (middle < 150).any(axis=0)
    assert not dark[dark.size // 2]
    assert dark[: dark.size // 2].any() and dark[dark.size // 2 :].any()


def test_points_lie_in_the_body():
    model, data = body()
    points = [site for site in range(model.nsite) if model.site(site).name.startswith("point_")]
    assert len(points) >= 40
    # from inside, a ray any way out crosses the surface: it meets the body from every side
    ways = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1.0], [0, 0, -1]])
    for point in points:
        assert all(hits(model, data, data.site_xpos[point], way) for way in ways), model.site(point).name


def test_segments_follow_the_table():
    model, data = body(height_m=1.8)
    table = fractions()
    heights = {"thigh": table.hip_height, "shank": table.knee_height, "foot": table.ankle_height}
    for segment, fraction in heights.items():
        assert data.body(f"left_{segment}").xpos[2] == pytest.approx(1.8 * fraction, abs=1e-9)


def test_a_child_is_no_small_adult():
    child, adult = proportions_of(1.10, child=True), proportions_of(1.10)
    assert (1.10 - child.chin_height) / 1.10 == pytest.approx(1 / 5.9, abs=0.01)
    assert child.hip_height < adult.hip_height
    assert child.head_breadth > adult.head_breadth
    grown = fractions(1.75, child=True)
    assert grown == fractions()
    with pytest.raises(ValueError, match="height_m is expected"):
        fractions(child=True)


def test_two_people_bring_their_own_pictures():
    spec = mujoco.MjSpec()
    for name in ("anna", "ben"):
        looks = appearance_of(Person(shirt="red", shirt_pattern="striped"), np.random.default_rng(0))
        spec.attach(person_spec(looks), prefix=f"{name}/", frame=spec.worldbody.add_frame())
    model = spec.compile()
    assert {model.texture(number).name for number in range(model.ntex)} == {
        f"{name}/{texture}" for name in ("anna", "ben") for texture in ("face", "shirt")
    }


@pytest.mark.parametrize("seed", range(4))
def test_a_body_that_is_never_drawn_has_the_same_shape(seed):
    looks = appearance_of(Person(shirt_pattern="checked"), np.random.default_rng(seed))
    drawn, plain = (person_spec(looks, pictures=pictures).compile() for pictures in (True, False))
    for name in (
        "mesh_vert",
        "mesh_face",
        "geom_pos",
        "geom_quat",
        "geom_aabb",
        "body_inertia",
        "bvh_aabb",
        "site_pos",
    ):
        np.testing.assert_array_equal(getattr(drawn, name), getattr(plain, name), err_msg=name)
    assert plain.ntex == 0
    assert plain.mesh_texcoord.size == 0


@pytest.mark.parametrize("heading", np.linspace(-np.pi, np.pi, 9))
def test_a_scanner_meets_two_legs_at_the_knee_and_one_trunk_with_arms_at_the_waist(heading):
    spec = mujoco.MjSpec.from_file(str(MODELS / "rooms" / "lab.xml"))
    looks = appearance_of(Person(height_m=1.75, skirt="none", coat="none", bag="none"), np.random.default_rng(1))
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
    assert {"hips", "chest"} & set(at_waist) or {"left_hand", "right_hand"} & set(at_waist)
    assert len(at_waist) >= 20


LOOKS = appearance_of(Person(height_m=1.8), np.random.default_rng(0))
LENGTHS = LOOKS.proportions
MODEL = person_spec(LOOKS).compile()
DATA = mujoco.MjData(MODEL)


@settings(max_examples=60, deadline=None)
@given(
    pelvis_yaw=st.floats(-3, 3),
    turn=st.floats(-0.8, 0.8),
    pitch=st.floats(-0.4, 1.0),
    ahead=st.floats(-0.45, 0.45),
    aside=st.floats(-0.2, 0.2),
    up=st.floats(0.45, 0.7),
)
def test_the_foot_is_where_it_was_asked_to_be(pelvis_yaw, turn, pitch, ahead, aside, up):
    facing = np.exp(1j * pelvis_yaw)
    over_floor = np.array(-(ahead + 1j * aside) * facing)
    foot_yaw = np.array(pelvis_yaw + turn)
    angles = leg_angles(
        over_floor, np.array(up), np.array(pelvis_yaw), foot_yaw, np.array(pitch),
        np.array(LENGTHS.thigh), np.array(LENGTHS.shank),
    )  # fmt: skip
    assert angles[3] >= 0
    DATA.qpos[:] = 0
    DATA.qpos[:7] = [0.3, -0.2, 1.0, np.cos(pelvis_yaw / 2), 0, 0, np.sin(pelvis_yaw / 2)]
    for joint, angle in zip(LEG, angles, strict=False):
        DATA.qpos[JOINT_PLACE[f"left_{joint}"]] = angle
    mujoco.mj_kinematics(MODEL, DATA)
    ankle = DATA.body("left_thigh").xpos - [over_floor.real, over_floor.imag, up]
    np.testing.assert_allclose(DATA.body("left_foot").xpos, ankle, atol=1e-9)
    cy, sy, cp, sp = np.cos(foot_yaw), np.sin(foot_yaw), np.cos(pitch), np.sin(pitch)
    wanted = np.array([[cy * cp, -sy, cy * sp], [sy * cp, cy, sy * sp], [-sp, 0, cp]])
    np.testing.assert_allclose(DATA.body("left_foot").xmat.reshape(3, 3), wanted, atol=1e-9)
