"""Every element of MJCF, by the table in docs/mjcf.md: modelled alike for all, without effect, or refused in a sentence.

The elements are read from MuJoCo's own schema: one that a later version adds has no row, and fails here.
"""

from __future__ import annotations

import re
from pathlib import Path
from xml.etree import ElementTree

import cv2
import mujoco
import numpy as np
import pytest
from command_line import twin
from made_rooms import LAMP, disagreements, reports, room_of, scenario_in

from trackers.errors import InputError
from twin.world.scene import build_scene
from twin.world.world import World

ROOT = Path(__file__).parents[3]
META = {"include", "frame", "replicate"}
"""Elements that MuJoCo's manual has and its schema has not."""


def schema() -> set[str]:
    """The paths of all elements in MuJoCo's schema, `body` for worldbody too."""
    stack: list[str] = []
    found = set(META)
    for line in mujoco.mj_printSchema(False, False).splitlines():
        if head := re.match(r"( *)([a-z_()]+) \([!?*R]\)", line):
            stack[len(head[1]) // 3 :] = [head[2].replace("(world)", "")]
            found.add("/".join(stack[1:]) or "mujoco")
    return found


def table() -> dict[tuple[str, ...], str]:
    """The rows of the table: their elements, and what the twin makes of them."""
    found = {}
    for line in (ROOT / "docs" / "mjcf.md").read_text().splitlines():
        cells = [cell.strip() for cell in line.split("|")[1:-1]]
        if len(cells) == 3 and cells[1] in ("modelled", "no effect", "refused"):
            found[tuple(re.findall(r"`([^`]+)`", cells[0]))] = cells[1]
    return found


TABLE = table()
CHAIN = (
    '<body name="a" pos="-1 0 .5"><joint name="hinge" axis="0 0 1"/><geom name="a" size=".2"/><site name="s1"/>'
    '<body name="b" pos=".5 0 0"><joint name="slide" type="slide"/><geom name="b" size=".2"/><site name="s2"/>'
    '<camera name="eye"/></body></body><body name="c" pos="1 -1 .5"><joint name="ball" type="ball"/>'
    '<geom name="c" size=".2"/></body>'
)
"""Bodies that something may move."""
TENDONS = (
    '<tendon><spatial name="rope" width=".05"><site site="s1"/><geom geom="a"/><site site="s2"/><pulley divisor="2"/>'
    '<site site="s1"/><site site="s2"/></spatial><fixed name="fixed"><joint joint="hinge" coef="1"/></fixed>'
    '<fixed name="other"><joint joint="slide" coef="1"/></fixed></tendon>'
)
SOLID = '<geom name="b" type="box" size=".3 .4 .5" pos="0 0 .5" rgba="1 0 0 1"/>'
_OF_JOINTS = ("general", "motor", "position", "velocity", "intvelocity", "damper", "cylinder", "pid")
ACTUATORS = "".join(f'<{kind} joint="hinge"/>' for kind in _OF_JOINTS) + (
    '<orientation joint="ball" kp="1"/><muscle joint="slide" lengthrange="0 1"/><adhesion body="a" ctrlrange="0 1"/>'
    '<dcmotor joint="hinge" motorconst="1 1" resistance="1"/>'
)
_SITE = ("touch", "accelerometer", "velocimeter", "gyro", "force", "torque", "magnetometer", "rangefinder")
_JOINT = ("jointpos", "jointvel", "jointactuatorfrc")
_TENDON = ("tendonpos", "tendonvel", "tendonactuatorfrc")
_ACTUATOR = ("actuatorpos", "actuatorvel", "actuatorfrc")
_FRAME = ("pos", "quat", "xaxis", "yaxis", "zaxis", "linvel", "angvel", "linacc", "angacc")
_BODY = ("subtreecom", "subtreelinvel", "subtreeangmom")
SENSORS = "".join(
    [
        *(f'<{kind} site="s1"/>' for kind in _SITE),
        *(f'<{kind} joint="hinge"/>' for kind in _JOINT),
        *(f'<{kind} tendon="fixed"/>' for kind in _TENDON),
        *(f'<{kind} actuator="m"/>' for kind in _ACTUATOR),
        *(f'<jointlimit{kind} joint="limited"/><tendonlimit{kind} tendon="limit"/>' for kind in ("pos", "vel", "frc")),
        *(f'<frame{kind} objtype="body" objname="a"/>' for kind in _FRAME),
        *(f'<{kind} body="a"/>' for kind in _BODY),
        *(f'<{kind} geom1="a" geom2="c" cutoff="1"/>' for kind in ("distance", "normal", "fromto")),
        '<camprojection site="s1" camera="eye"/><ballquat joint="ball"/><ballangvel joint="ball"/>',
        '<insidesite site="s1" objtype="body" objname="a"/><contact geom1="a"/><e_potential/><e_kinetic/><clock/>',
        '<tactile geom="a" mesh="pad"/><user dim="900000" needstage="acc"/>',
    ]
)
EQUALITIES = (
    '<connect body1="a" body2="c" anchor="0 0 0"/><weld body1="a" body2="c"/><joint joint1="hinge" joint2="slide"/>'
    '<tendon tendon1="fixed" tendon2="other"/>'
)


def section(tag: str, content: str) -> str:
    return f"<{tag}>{content}</{tag}>"


NO_EFFECT: dict[str, tuple[str, str, str]] = {
    "compiler/lengthrange": (
        "",
        '<compiler><lengthrange interval="1"/></compiler><option timestep=".1"><flag gravity="disable"/></option>'
        '<size memory="1M"/><statistic extent="99"/>',
        "",
    ),
    "visual": (
        "",
        '<visual><global fovy="9"/><quality numslices="3"/><headlight ambient="1 1 1"/><map znear=".5"/>'
        '<scale com="9"/><rgba haze="1 0 0 1"/></visual>',
        "",
    ),
    "body/joint": (
        '<body pos="0 0 .5" sleep="never" gravcomp="1"><freejoint/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>'
        '<body pos="0 0 .5"><joint/><geom size=".01" group="5"/></body>',
        "<default><joint armature='1'/></default>",
        "",
    ),
    "body/camera": ('<camera pos="0 0 1"/>', '<default><camera fovy="9"/></default>', ""),
    "contact": (
        "",
        '<default><pair friction="1 1 1 1 1"/></default>',
        '<contact><pair geom1="a" geom2="c"/><exclude body1="a" body2="c"/></contact>',
    ),
    "tendon": ("", '<default><tendon width=".2"/></default>', TENDONS),
    "equality": ("", '<default><equality active="false"/></default>', TENDONS + section("equality", EQUALITIES)),
    "actuator": (
        "",
        "<default>" + re.sub(' (joint|body)="\\w+"| lengthrange="0 1"', "", ACTUATORS) + "</default>",
        section("actuator", ACTUATORS),
    ),
    "sensor": (
        '<body pos="2 -2 .5"><joint name="limited" range="0 1"/><geom size=".01" group="5"/></body>',
        '<asset><mesh name="pad" builtin="plate" params="3 3"/></asset>',
        TENDONS.replace("</tendon>", '<fixed name="limit" range="0 1"><joint joint="hinge" coef="1"/></fixed></tendon>')
        + '<actuator><motor name="m" joint="hinge"/></actuator>'
        + section("sensor", SENSORS),
    ),
    "keyframe": (
        "",
        '<custom><text name="t" data="x"/><tuple name="u"><element objtype="body" objname="a"/></tuple></custom>',
        '<keyframe><key qpos="1 0 .7 .7 0 0"/></keyframe>',
    ),
}
"""By an element of a row: what goes into the room, before and after its worldbody."""
REFUSED: dict[str, tuple[str, str, str]] = {
    "asset/hfield": ("", '<asset><hfield name="h" nrow="3" ncol="3" size="1 1 1 1"/></asset>', ""),
    "asset/skin": (
        "",
        "",
        '<asset><skin name="cape" vertex="0 0 0 1 0 0 0 1 0" face="0 1 2"><bone body="a" bindpos="0 0 0" '
        'bindquat="1 0 0 0" vertid="0 1 2" vertweight="1 1 1"/></skin></asset>',
    ),
    "deformable/skin": ("", "", '<deformable><skin name="cape"><bone body="a"/></skin></deformable>'),
    "body/flexcomp": (
        '<flexcomp name="cloth" type="grid" count="4 4 1" spacing=".2 .2 .1" dim="2"><edge/><elasticity/><contact/>'
        '<pin id="1"/><plugin plugin="p"><config key="a" value="1"/></plugin></flexcomp>',
        "",
        "",
    ),
    "equality/flex": ("", "", '<equality><flex flex="cloth"/></equality>'),
    "equality/flexstrain": ("", "", '<equality><flexstrain flex="cloth"/></equality>'),
    "deformable/flex": (
        "",
        "",
        '<deformable><flex name="cloth" body="a" vertex="0 0 0 1 0 0 0 1 0" element="0 1 2" dim="2">'
        "<contact/><edge/><elasticity/></flex></deformable>",
    ),
    "extension": (
        "",
        '<extension><plugin plugin="mujoco.sdf.torus"><instance name="t"><config key="a" value="1"/></instance>'
        "</plugin></extension>",
        "",
    ),
    "asset/mesh/plugin": (
        "",
        '<asset><mesh name="m"><plugin plugin="p"><config key="a" value="1"/></plugin></mesh></asset>',
        "",
    ),
    "body/geom/plugin": ('<geom type="sdf"><plugin plugin="p"><config key="a" value="1"/></plugin></geom>', "", ""),
    "body/plugin": ('<body><plugin plugin="p"><config key="a" value="1"/></plugin></body>', "", ""),
    "actuator/plugin": ("", "", '<actuator><plugin plugin="p"><config key="a" value="1"/></plugin></actuator>'),
    "sensor/plugin": ("", "", '<sensor><plugin plugin="p"><config key="a" value="1"/></plugin></sensor>'),
}
TETRAHEDRON = "0 0 0 1 0 0 0 1 0 0 0 1"
MODELLED: dict[str, tuple[str, str]] = {
    "box": (SOLID, ""),
    "plane": ('<geom name="b" type="plane" size=".5 .5 1" pos="0 0 .5" zaxis="-1 -1 0"/>', ""),
    "plane from behind": ('<geom name="b" type="plane" size=".5 .5 1" pos="0 0 .5" zaxis="1 1 0"/>', ""),
    "sphere": ('<geom name="b" size=".4" pos="0 0 .4"/>', ""),
    "capsule": ('<geom name="b" type="capsule" fromto="0 0 .3 0 .5 .8" size=".2"/>', ""),
    "cylinder": ('<geom name="b" type="cylinder" size=".3 .5" pos="0 0 .5"/>', ""),
    "ellipsoid": ('<geom name="b" type="ellipsoid" size=".3 .4 .5" pos="0 0 .5"/>', ""),
    "mesh": ('<geom name="b" type="mesh" mesh="m"/>', f'<asset><mesh name="m" vertex="{TETRAHEDRON}"/></asset>'),
    "open mesh": (
        '<geom name="b" type="mesh" mesh="m"/>',
        f'<asset><mesh name="m" inertia="shell" vertex="{TETRAHEDRON}" face="0 1 3 0 3 2"/></asset>',
    ),
    "open mesh from behind": (
        '<geom name="b" type="mesh" mesh="m"/>',
        f'<asset><mesh name="m" inertia="shell" vertex="{TETRAHEDRON}" face="0 3 1 0 2 3"/></asset>',
    ),
    "builtin mesh": (
        '<geom name="b" type="mesh" mesh="m" pos="0 0 .5"/>',
        '<asset><mesh name="m" builtin="supertorus" params="9 .5 1 1" scale=".4 .4 .4"/></asset>',
    ),
    "mesh fitted by a box": (
        '<geom name="b" type="box" mesh="m"/>',
        f'<asset><mesh name="m" vertex="{TETRAHEDRON}"/></asset>',
    ),
    "mocap": (f'<body name="b" mocap="true">{SOLID}</body>', ""),
    "free body": (f'<body name="b"><freejoint/>{SOLID}</body>', ""),
    "hinge of a small mass": (
        "<body name='b'><joint/>" + SOLID.replace("<geom ", '<geom mass="1e-20" ') + "</body>",
        "",
    ),
    "frame and replicate": (
        f'<frame pos=".3 0 0"><replicate count="2" offset=".4 .9 0">{SOLID}</replicate></frame>',
        "",
    ),
    "default class": (
        '<body name="b" childclass="c"><geom name="b" pos="0 0 .5"/></body>',
        '<default><default class="c"><geom type="box" size=".3 .3 .5" rgba="0 1 0 1"/></default></default>',
    ),
    "no contacts": (SOLID.replace("<geom ", '<geom contype="0" conaffinity="0" '), '<compiler discardvisual="true"/>'),
    "fused": (f'<body name="b">{SOLID}</body>', '<compiler fusestatic="true"/>'),
    "radians": ('<geom name="b" type="box" size=".2 .4 .5" pos="0 0 .5" euler="0 0 1"/>', '<compiler angle="radian"/>'),
    "glass": (SOLID.replace("1 0 0 1", "1 0 0 .2"), ""),
    "opaque in a clear material": (
        SOLID.replace("<geom ", '<geom material="m" '),
        '<asset><material name="m" rgba="1 1 1 0"/></asset>',
    ),
    "layers": (
        SOLID.replace("<geom ", '<geom material="m" '),
        '<asset><texture name="t" type="2d" builtin="checker" width="32" height="32" rgb1="1 1 0"/>'
        '<material name="m" emission=".3" reflectance="1"><layer role="rgb" texture="t"/></material></asset>',
    ),
}
UNSEEN: dict[str, tuple[str, str]] = {
    "alpha": (SOLID.replace("1 0 0 1", "1 0 0 0"), ""),
    "alpha of the material": (
        SOLID.replace('rgba="1 0 0 1"', 'material="m"'),
        '<asset><material name="m" rgba="1 1 1 0"/></asset>',
    ),
    "alpha of its own": (
        SOLID.replace("1 0 0 1", "1 0 0 0").replace("<geom ", '<geom material="m" '),
        '<asset><material name="m"/></asset>',
    ),
    "site": ('<site name="b" size=".4" pos="0 0 .5"/>', ""),
}


def exercised(pieces: tuple[str, str, str]) -> set[str]:
    """The paths of the elements in what goes into a room, before and after its worldbody."""
    found: set[str] = set()

    def walk(element: ElementTree.Element, path: str) -> None:
        for child in element:
            is_nested = (path == "body" and child.tag == "body") or (path == "default" and child.tag == "default")
            here = path if is_nested else f"{path}/{child.tag}".lstrip("/")
            found.add(here)
            walk(child, here)

    inside, before, after = pieces
    walk(ElementTree.fromstring(f"<mujoco><body>{inside}</body>{before}{after}</mujoco>"), "")
    return found


def row_of(element: str) -> tuple[str, ...]:
    return next(row for row in TABLE if element in row)


def test_every_element_of_the_schema_has_one_row() -> None:
    listed = [element for row in TABLE for element in row]
    assert sorted(listed) == sorted(schema())


def test_every_element_without_effect_and_every_refused_one_is_tried() -> None:
    for answer, tried in (("no effect", NO_EFFECT), ("refused", REFUSED)):
        used = set().union(*map(exercised, tried.values()))
        untried = {element for row, said in TABLE.items() if said == answer for element in row} - used
        assert not untried
        assert all(TABLE[row_of(element)] == answer for element in tried)


@pytest.fixture(scope="module")
def chain(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    return reports(scenario_in(tmp_path_factory.mktemp("chain"), room_of(CHAIN)))


@pytest.mark.parametrize("element", NO_EFFECT)
def test_elements_without_effect_change_no_sensor(tmp_path: Path, chain: dict[str, bytes], element: str) -> None:
    inside, before, after = NO_EFFECT[element]
    room = room_of(CHAIN + inside, before=before, after=after)
    mujoco.MjModel.from_xml_string(room)  # all of it is valid
    assert reports(scenario_in(tmp_path, room)) == chain


@pytest.mark.parametrize("element", REFUSED)
def test_refused_elements_are_named_in_one_sentence(tmp_path: Path, element: str) -> None:
    inside, before, after = REFUSED[element]
    tag = "plugin" if element.endswith("plugin") else element.split("/")[-1]
    with pytest.raises(InputError, match=rf"room\.xml: <{tag}[ >].* expected$") as told:
        build_scene(scenario_in(tmp_path, room_of(CHAIN + inside, before=before, after=after)))
    assert "\n" not in str(told.value)


@pytest.mark.sample(20)
@pytest.mark.parametrize("thing", [*MODELLED, *UNSEEN])
def test_what_is_drawn_is_met_by_rays_and_in_peoples_way(tmp_path: Path, thing: str) -> None:
    inside, before = (MODELLED | UNSEEN)[thing]
    world = World(scenario_in(tmp_path, room_of(inside, before=before)))
    snapshot = world.empty_snapshot(0.0)
    assert max(disagreements(snapshot, [(-2.4, -2.4, 1.6), (2.4, -2.4, 0.6)], (0.2, 0.3, 0.5))) < 2e-3
    in_the_way = {each.furniture for each in world.scene.ground.obstacles}
    assert any(name.startswith("b") for name in in_the_way) == (thing in MODELLED)


def test_a_texture_a_lamp_and_an_attached_model_show(tmp_path: Path) -> None:
    plain = reports(scenario_in(tmp_path / "plain", room_of(SOLID)))
    (tmp_path / "attached").mkdir()
    (tmp_path / "attached" / "thing.xml").write_text(
        f"<mujoco><worldbody><body name='b'>{SOLID}</body></worldbody></mujoco>"
    )
    (tmp_path / "attached" / "part.xml").write_text(f"<mujoco><worldbody>{SOLID}</worldbody></mujoco>")
    model = '<asset><model name="m" file="thing.xml"/></asset>'
    attached = room_of('<attach model="m" body="b" prefix="x_"/>', before=model)
    assert reports(scenario_in(tmp_path / "attached", attached)) == plain
    included = room_of("").replace("</mujoco>", '<include file="part.xml"/></mujoco>')
    assert reports(scenario_in(tmp_path / "attached", included)) == plain
    painted = (
        '<asset><texture name="t" type="cube" builtin="flat" width="8" height="8" rgb1="0 0 1"/>'
        '<material name="m" texture="t"/></asset>'
    )
    blue = SOLID.replace('rgba="1 0 0 1"', 'material="m"')
    for room in (room_of(blue, before=painted), room_of(SOLID, lamp=LAMP.replace(".6", ".2"))):
        found = reports(scenario_in(tmp_path / "other", room))
        assert found["camera.rgb"] != plain["camera.rgb"]
        assert found["laser.ranges_m"] == plain["laser.ranges_m"]


LAMPS = {
    8: 'ambient=".1 .1 .1"',
    7: "",
}


@pytest.mark.parametrize(("count", "ambient"), LAMPS.items())
def test_as_many_lamps_shine_as_a_picture_can_show_and_one_more_is_refused(
    tmp_path: Path, count: int, ambient: str
) -> None:
    dark = f'<light type="directional" diffuse=".001 .001 .001" {ambient}/>'
    for others, last in (
        (count - 1, LAMP),
        (count, f'{LAMP}<light active="false"/><light diffuse="0 0 0" specular="0 0 0"/>'),
    ):
        room = room_of(SOLID, lamp=dark * others + last)
        if others == count - 1:
            rgb = np.frombuffer(reports(scenario_in(tmp_path, room))["camera.rgb"], dtype=np.uint8)
            assert rgb.mean() > 40  # the last one, too
        else:
            with pytest.raises(InputError, match=rf"room\.xml: {count + 1} <light> shine, .* are expected"):
                build_scene(scenario_in(tmp_path, room))


@pytest.mark.parametrize("kind", ["point", "image"])
def test_lamps_that_are_drawn_as_others_are_refused(tmp_path: Path, kind: str) -> None:
    with pytest.raises(
        InputError, match=rf"room\.xml: light 'l' is of type '{kind}'.* spot or directional is expected"
    ):
        build_scene(scenario_in(tmp_path, room_of(lamp=f'<light name="l" type="{kind}"/>')))


def test_textures_that_the_renderer_leaves_out_are_refused(tmp_path: Path) -> None:
    (tmp_path / "t.ktx").write_bytes(b"KTX")
    asset = '<asset><texture name="rug" type="2d" file="t.ktx"/></asset>'
    with pytest.raises(InputError, match=r"room\.xml: texture 'rug' has 1 channel, which is not drawn; a PNG image"):
        build_scene(scenario_in(tmp_path, room_of(before=asset)))


@pytest.mark.parametrize("group", [-1, 6, 2**20])
def test_groups_that_mujoco_does_not_tell_apart_are_refused(tmp_path: Path, group: int) -> None:
    with pytest.raises(InputError, match=rf"room\.xml: geom 'b' is in group {group}; a group from 0 to 5 is expected"):
        build_scene(scenario_in(tmp_path, room_of(SOLID.replace("<geom ", f'<geom group="{group}" '))))


def test_the_command_line_refuses_with_code_2_and_draws_what_is_modelled(tmp_path: Path) -> None:
    scenario_in(tmp_path, room_of('<flexcomp name="cloth" type="grid" count="4 4 1" spacing=".2 .2 .1" dim="2"/>'))
    command = ["view", tmp_path / "scenario.yaml", "--out", tmp_path / "out.png"]
    done = twin(*command)
    assert done.returncode == 2
    assert done.stderr.strip().count("\n") == 0
    assert "<flexcomp name='cloth'>" in done.stderr
    scenario_in(tmp_path, room_of(SOLID))
    assert twin(*command).returncode == 0
    assert cv2.imread(str(tmp_path / "out.png")) is not None
