"""Rooms that users bring: what any MJCF file may hold, and what is refused before a file outside its folder is read."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from command_line import twin

from trackers.area import Area
from trackers.errors import InputError
from twin.room.files import room_files
from twin.scenario import load_scenario
from twin.suites.cache_keys import recording_key
from twin.world.scene import Scene, build_scene
from twin.world.simulation import Simulation
from twin.world.world import World

pytestmark = pytest.mark.slow

SHELL = """
<geom name="floor" type="plane" size="0 0 0.1"/>
<geom name="west" type="box" pos="-3.1 0 1.25" size="0.1 2.2 1.25"/>
<geom name="east" type="box" pos="3.1 0 1.25" size="0.1 2.2 1.25"/>
<geom name="south" type="box" pos="0 -2.1 1.25" size="3.2 0.1 1.25"/>
<geom name="north" type="box" pos="0 2.1 1.25" size="3.2 0.1 1.25"/>
"""
SCENARIO = """
name: mine
room: rooms/mine.xml
duration_s: 1
people:
  ann: {script: {kind: wander}}
  bob: {start: [2, 1], script: {kind: stand}}
sensors:
  waist: {kind: laser, role: waist, rate_hz: 5, mount: {xyz: [0, -1.9, 0.95], yaw_deg: 90}}
  camera: {kind: camera, rate_hz: 5, size: [160, 120], field_of_view_deg: 90, mount: {xyz: [0, -1.9, 1.8], yaw_deg: 90}}
"""
TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


def write(path: Path, content: str | bytes) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def scenario_of(folder: Path, room: str):
    """A scenario in a folder and its room in `rooms/` beside it; paths are relative to the file that names them."""
    write(folder / "rooms" / "mine.xml", room)
    return load_scenario(str(write(folder / "mine.yaml", SCENARIO)))


def scene_of(folder: Path, world: str, *, before: str = "", after: str = "") -> Scene:
    room = f"<mujoco>{before}<worldbody>{SHELL}{world}</worldbody>{after}</mujoco>"
    return build_scene(scenario_of(folder, room))


def test_a_room_beside_its_scenario_loads_runs_and_encloses_its_people(tmp_path: Path) -> None:
    scenario = scenario_of(tmp_path, f"<mujoco><worldbody>{SHELL}</worldbody></mujoco>")
    with Simulation(scenario) as simulation:
        observations = list(simulation)
        scene = simulation.world.scene
    assert {each.sensor for each in observations} == {"waist", "camera"}
    np.testing.assert_allclose(np.abs(scene.area), np.tile([2.8, 1.8], (4, 1)), atol=0.03)
    scan = next(each for each in observations if each.sensor == "waist")
    assert scan.ranges_m[np.isfinite(scan.ranges_m)].max() < 5.1  # walls all around


def test_bodies_within_bodies_stand_where_they_are_turned_to(tmp_path: Path) -> None:
    table = (
        '<body name="corner" pos="-1.5 0 0" euler="0 0 90"><body name="table" pos="0.5 0 0" euler="0 0 -45">'
        '<geom type="box" pos="0 0 0.36" size="0.4 0.4 0.36"/></body></body>'
    )
    scene = scene_of(tmp_path, table)
    (obstacle,) = scene.ground.obstacles
    assert obstacle.furniture == "table"
    np.testing.assert_allclose(obstacle.corners.mean(axis=0), [-1.5, 0.5], atol=1e-9)
    np.testing.assert_allclose(np.ptp(obstacle.corners, axis=0), 0.8 * np.sqrt(2), atol=1e-9)


def test_rooms_in_radians_with_classes_of_their_own_change_no_person(tmp_path: Path) -> None:
    plain = scene_of(tmp_path / "plain", "")
    before = (
        '<compiler angle="radian" eulerseq="ZYX" autolimits="false"/><option gravity="0 0 -1.6" timestep="0.01"/>'
        '<default><geom rgba="1 0 0 1" type="box" size="0.1 0.1 0.1"/><joint damping="3"/><site size="0.3"/></default>'
    )
    odd = scene_of(tmp_path / "odd", '<geom name="box" pos="1 0 0.1"/>', before=before)
    person = [plain.model.geom(geom).name for geom in np.flatnonzero(plain.person_of_geom)]
    assert person
    for name in person:
        for field in ("type", "size", "rgba", "pos", "quat", "group"):
            np.testing.assert_array_equal(getattr(plain.model.geom(name), field), getattr(odd.model.geom(name), field))


def test_what_would_move_in_a_room_stands_still_and_is_in_peoples_way(tmp_path: Path) -> None:
    world = (
        '<body name="door" pos="0 1 1"><joint name="hinge" type="hinge" axis="0 0 1" range="-90 90"/>'
        '<geom name="leaf" type="box" pos="0.4 0 -0.25" size="0.4 0.02 0.75"/><site name="knob"/></body>'
        '<body name="ball" pos="-1 1 0.2"><freejoint name="loose"/><geom type="sphere" size="0.2"/></body>'
        '<body name="cart" mocap="true" pos="-2 -1 0.3"><geom name="cart" type="box" size="0.2 0.2 0.3"/></body>'
        '<camera name="eye" pos="0 0 2"/>'
    )
    after = (
        '<actuator><motor name="push" joint="hinge"/></actuator><sensor><jointpos joint="hinge"/></sensor>'
        '<keyframe><key name="open" qpos="0.5 -1 1 0.2 1 0 0 0"/></keyframe>'
    )
    scenario = scenario_of(tmp_path, f"<mujoco><worldbody>{SHELL}{world}</worldbody>{after}</mujoco>")
    with Simulation(scenario) as simulation:
        door = simulation.world.scene.model.geom("leaf").id
        list(simulation)
        np.testing.assert_allclose(simulation.world.data.geom_xpos[door], [0.4, 1, 0.75], atol=1e-9)
        obstacles = simulation.world.scene.ground.obstacles
    assert {each.furniture for each in obstacles} >= {"door", "ball", "cart"}


@pytest.mark.parametrize("thing", ["body", "geom", "joint", "site", "material", "mesh"])
def test_names_that_people_use_too_do_not_clash(tmp_path: Path, thing: str) -> None:
    named = {
        "body": '<body name="ann"><geom type="sphere" pos="0 0 0.1" size="0.1"/></body>',
        "geom": '<geom name="ann" type="sphere" pos="0 0 0.1" size="0.1"/>',
        "joint": '<body><freejoint name="root"/><geom type="sphere" size="0.1"/></body>',
        "site": '<site name="head"/>',
        "material": '<geom type="sphere" material="skin" pos="0 0 0.1" size="0.1"/>',
        "mesh": '<geom type="mesh" mesh="head"/>',
    }[thing]
    assets = '<asset><material name="skin"/><mesh name="head" vertex="0 0 0 1 0 0 0 1 0 0 0 1"/></asset>'
    scene = scene_of(tmp_path, named, before=assets)
    assert scene.ids == {"ann": 1, "bob": 2}


def test_a_name_that_only_a_person_may_have_is_told(tmp_path: Path) -> None:
    body = '<body name="ann/pelvis"><geom type="sphere" size="0.1"/></body>'
    with pytest.raises(InputError, match=r"mine\.xml: .*ann/pelvis.*"):
        scene_of(tmp_path, body)


def test_includes_meshes_textures_and_attached_models_of_the_rooms_folder_load(tmp_path: Path) -> None:
    rooms = tmp_path / "rooms"
    write(rooms / "parts" / "walls.xml", f"<mujoco><worldbody>{SHELL}</worldbody></mujoco>")
    write(rooms / "meshes" / "tent.obj", TETRAHEDRON)
    write(rooms / "chair" / "leg.obj", TETRAHEDRON)
    write(
        rooms / "chair" / "chair.xml",
        '<mujoco><asset><mesh name="leg" file="leg.obj"/></asset>'
        '<worldbody><body name="seat"><geom type="mesh" mesh="leg"/></body></worldbody></mujoco>',
    )
    write(rooms / "pictures" / "tiles.png", cv2.imencode(".png", np.full((8, 8, 3), 90, np.uint8))[1].tobytes())
    room = (
        '<mujoco><compiler meshdir="meshes" texturedir="pictures"/><include file="parts/walls.xml"/>'
        '<asset><mesh file="tent.obj"/><texture name="tiles" type="2d" file="tiles.png"/>'
        '<material name="tiles" texture="tiles"/><model name="chair" file="chair/chair.xml"/></asset>'
        '<worldbody><geom type="mesh" mesh="tent" pos="-2 -1 0"/><geom type="box" size="0.1 0.1 0.1" material="tiles"/>'
        '<body pos="0 -1.5 0"><attach model="chair" body="seat" prefix="one_"/></body></worldbody></mujoco>'
    )
    scenario = scenario_of(tmp_path, room)
    assert {each.furniture for each in build_scene(scenario).ground.obstacles} >= {"one_seat"}
    read = {path.relative_to(rooms).as_posix() for path in room_files(rooms / "mine.xml")}
    assert read == {
        "mine.xml",
        "parts/walls.xml",
        "meshes/tent.obj",
        "chair/chair.xml",
        "chair/leg.obj",
        "pictures/tiles.png",
    }


@pytest.mark.parametrize(
    "changed", ["parts/walls.xml", "parts/deep.xml", "meshes/tent.obj", "chair/chair.xml", "chair/leg.obj"]
)
def test_the_key_of_a_recording_follows_every_file_of_its_room(tmp_path: Path, changed: str) -> None:
    room = write(
        tmp_path / "mine.xml",
        '<mujoco><compiler meshdir="meshes"/><include file="parts/walls.xml"/>'
        '<asset><mesh file="tent.obj"/><model name="chair" file="chair/chair.xml"/></asset></mujoco>',
    )
    write(tmp_path / "parts" / "walls.xml", '<mujoco><include file="parts/deep.xml"/></mujoco>')
    write(tmp_path / "parts" / "deep.xml", "<mujoco/>")
    write(tmp_path / "meshes" / "tent.obj", TETRAHEDRON)
    write(tmp_path / "chair" / "chair.xml", '<mujoco><asset><mesh file="leg.obj"/></asset></mujoco>')
    write(tmp_path / "chair" / "leg.obj", TETRAHEDRON)
    resolved = f"room: {room}\nseed: 1\n"
    before = recording_key(resolved, "llvmpipe")
    assert before == recording_key(resolved, "llvmpipe")
    (tmp_path / changed).write_text((tmp_path / changed).read_text() + "\n")
    assert before != recording_key(resolved, "llvmpipe")


OUTSIDE = [
    ('<include file="../secret.xml"/>', r"<include file='\.\./secret\.xml'>"),
    ('<include file="parts/../../secret.xml"/>', r"<include file='parts/\.\./\.\./secret\.xml'>"),
    ('<include file="..\\secret.xml"/>', r"<include file='\.\.\\\\secret\.xml'>"),
    ('<include file="{away}/secret.xml"/>', r"<include file='/.*/secret\.xml'>"),
    ('<include file="link.xml"/>', r"<include file='link\.xml'>"),
    ('<include file="parts/nested.xml"/>', r"nested\.xml: <include file='\.\./\.\./secret\.xml'>"),
    ('<asset><mesh file="../secret.obj"/></asset>', r"<mesh file='\.\./secret\.obj'>"),
    (
        '<compiler meshdir=".."/><asset><mesh file="secret.obj"/></asset>',
        r"<mesh file='secret\.obj'> \(with the compiler's folder '\.\.'\)",
    ),
    (
        '<compiler assetdir="{away}"/><asset><texture name="h" file="secret.obj"/></asset>',
        r"<texture file='secret\.obj'>",
    ),
    ('<asset><mesh file="{away}/secret.obj"/></asset>', r"<mesh file='/.*/secret\.obj'>"),
    ('<asset><texture type="cube" fileup="../secret.png"/></asset>', r"<texture fileup='\.\./secret\.png'>"),
    ('<asset><model name="m" file="../secret.xml"/></asset>', r"<model file='\.\./secret\.xml'>"),
    ('<asset><model name="m" file="parts/model.xml"/></asset>', r"model\.xml: <mesh file='\.\./\.\./secret\.obj'>"),
    (
        '<asset><mesh file="not/there/../../../secret.stl"/></asset>',
        r"<mesh file='not/there/\.\./\.\./\.\./secret\.stl'>",
    ),
]


@pytest.mark.parametrize(("inside", "said"), OUTSIDE)
def test_files_outside_the_rooms_folder_are_never_read(tmp_path: Path, inside: str, said: str) -> None:
    write(tmp_path / "secret.xml", "<mujoco/>")
    write(tmp_path / "secret.obj", TETRAHEDRON)
    rooms = tmp_path / "rooms"
    write(rooms / "parts" / "nested.xml", '<mujoco><include file="../../secret.xml"/></mujoco>')
    write(rooms / "parts" / "model.xml", '<mujoco><asset><mesh file="../../secret.obj"/></asset></mujoco>')
    (rooms / "link.xml").symlink_to(tmp_path / "secret.xml")
    room = f"<mujoco>{inside.format(away=tmp_path)}<worldbody>{SHELL}</worldbody></mujoco>"
    with pytest.raises(InputError, match=rf"mine\.xml: {said}.* leads outside the room's folder; .* is expected$"):
        build_scene(scenario_of(tmp_path, room))


@pytest.mark.parametrize(
    ("room", "said"),
    [
        ("<mujoco><worldbody><geom type='cone'/></worldbody></mujoco>", r"mine\.xml: is not a room \(.*cone.*\); .*"),
        ("<mujoco><worldbody><geom type='box' size='1'/></worldbody></mujoco>", r"mine\.xml: does not compile \(.*"),
        ("<mujoco><worldbody>", r"mine\.xml: is not well-formed XML \(.*\); a valid MJCF file is expected"),
        ("", r"mine\.xml: is not well-formed XML \("),
        ("<robot name='r'/>", r"mine\.xml: "),
        (b"<mujoco>\xff</mujoco>", r"mine\.xml: byte 8 is not UTF-8; "),
        ("<!DOCTYPE mujoco [<!ENTITY x 'y'>]><mujoco/>", r"mine\.xml: holds a <!DOCTYPE; "),
        ("<mujoco><asset><mesh file='none.obj'/></asset></mujoco>", r"mine\.xml: .*none\.obj"),
        ("<mujoco><include file='none.xml'/></mujoco>", r"mine\.xml: .*none\.xml"),
        ("<mujoco/>", r"mine\.xml: has no floor; "),
        (f"<mujoco><worldbody>{SHELL.replace('0 0 0.1', '1 1 0.1')}</worldbody></mujoco>", None),
        (
            '<mujoco><custom><numeric name="walkable_area" data="20 0 22 0 22 2 20 2"/></custom>'
            '<worldbody><geom type="plane" size="4 4 0.1"/></worldbody></mujoco>',
            r"mine\.xml: walkable_area: there is no floor at z = 0 under x 20 to 22 m, y 0 to 2 m; ",
        ),
    ],
)
def test_rooms_that_cannot_be_are_told_in_one_sentence(tmp_path: Path, room: str | bytes, said: str | None) -> None:
    write(tmp_path / "rooms" / "mine.xml", room)
    write(tmp_path / "mine.yaml", SCENARIO)
    if said is None:  # a floor smaller than its walls: its own edge
        scenario = load_scenario(str(tmp_path / "mine.yaml"), ["people={}"])
        np.testing.assert_allclose(np.abs(build_scene(scenario).area), 0.8, atol=0.03)
        return
    with pytest.raises(InputError, match=said) as told:
        build_scene(load_scenario(str(tmp_path / "mine.yaml")))
    assert "\n" not in str(told.value)


def test_the_command_line_ends_with_code_2_and_one_sentence(tmp_path: Path) -> None:
    scenario_of(tmp_path, '<mujoco><include file="../../other.xml"/></mujoco>')
    done = twin("view", tmp_path / "mine.yaml", "--out", tmp_path / "out.png")
    assert done.returncode == 2
    assert "leads outside the room's folder" in done.stderr
    assert "Traceback" not in done.stderr


def test_wanderers_stay_in_an_area_from_geometry(tmp_path: Path) -> None:
    inner = "".join(
        f'<geom type="box" pos="-0.5 {y} 1.25" size="0.05 {half} 1.25"/>' for y, half in ((1.2, 0.8), (-1.4, 0.6))
    )
    scenario = scenario_of(tmp_path, f"<mujoco><worldbody>{SHELL}{inner}</worldbody></mujoco>")
    world = World(scenario)
    area, places = Area(world.scene.walkable), []
    for t in np.arange(0.0, 30.0, 0.25):
        world.population.advance(t)
        truth = world.population.truth(t)
        places += list(np.stack([truth.x, truth.y], axis=-1))
    assert area.contains(np.array(places)).all()
    assert area.contains(np.array([[-1.5, 0.0], [1.5, 0.0]])).all()  # on both sides of the gap


def test_a_room_attached_to_itself_is_refused_before_it_is_read_without_end(tmp_path: Path) -> None:
    room = '<mujoco><asset><model name="m" file="{}"/></asset><worldbody>' + SHELL + "</worldbody></mujoco>"
    with pytest.raises(InputError, match=r"mine.xml: mine.xml is read by itself, through mine.xml"):
        build_scene(scenario_of(tmp_path, room.format("mine.xml")))
    write(tmp_path / "rooms" / "other.xml", room.format("mine.xml"))
    with pytest.raises(InputError, match=r"mine.xml is read by itself, through mine.xml and other.xml"):
        build_scene(scenario_of(tmp_path, room.format("other.xml")))


def test_a_level_plane_is_a_table_top_and_an_upright_one_a_thin_wall(tmp_path: Path) -> None:
    top, wall = '<geom name="top" type="plane" size=".5 .4 .1" pos="-1.5 0 .7"/>', '<geom name="wall" type="plane" {}/>'
    assert [each.furniture for each in scene_of(tmp_path, top).ground.obstacles] == ["top"]
    upright = wall.format('size="1 .5 .1" pos="0 0 1" euler="0 90 0"')  # faces along x; the scanner is behind it
    scenario = scenario_of(tmp_path, f"<mujoco><worldbody>{SHELL}{upright}</worldbody></mujoco>")
    with Simulation(scenario, images=False) as simulation:
        assert [each.furniture for each in simulation.world.scene.ground.obstacles] == ["wall"]
    endless = wall.format('size="0 0 .1" pos="0 -1.7 1" euler="-90 0 0"')
    with pytest.raises(InputError, match="waist.mount.xyz: .* is inside 'wall'"):
        Simulation(scenario_of(tmp_path, f"<mujoco><worldbody>{SHELL}{endless}</worldbody></mujoco>"), images=False)


@pytest.mark.parametrize(
    ("element", "said"),
    [
        ('<geom type="box" size=".1 nan .1"/>', r"<geom size='.1 nan .1'> is not finite"),
        ('<geom type="box" size=".1 .1 .1" rgba="NAN 0 0 1"/>', r"<geom rgba='NAN 0 0 1'>"),
        ('<body pos="-inf 0 0"><geom size=".1"/></body>', r"<body pos='-inf 0 0'>"),
        ('<light diffuse="+Infinity 0 0"/>', r"<light diffuse='\+Infinity 0 0'>"),
        ('<site name="seat_x" pos="nan 0 0"/>', "<site pos='nan 0 0'>"),
    ],
)
def test_numbers_that_are_not_finite_are_refused(tmp_path: Path, element: str, said: str) -> None:
    with pytest.raises(InputError, match=f"mine.xml: {said}"):
        scene_of(tmp_path, element)


def test_a_name_may_read_like_a_number_that_is_not_finite(tmp_path: Path) -> None:
    scene_of(tmp_path, '<geom name="nan" size=".1" pos="0 0 .1"/><body name="Infinity"/>')


@pytest.mark.parametrize("geom", ['size="1e200 1 1"', 'size="1 1 1" pos="0 1e9 0"'])
def test_a_thing_without_measure_is_named(tmp_path: Path, geom: str) -> None:
    with pytest.raises(
        InputError, match=r"mine.xml: 'moon' reaches .* m from the room's origin; lengths in metres, at most 1"
    ):
        scene_of(tmp_path, f'<geom name="moon" type="box" {geom}/>')


@pytest.mark.parametrize("per_m", [100, 1000])
def test_a_room_in_another_unit_is_refused_with_its_size(tmp_path: Path, per_m: int) -> None:
    floor = f'<geom type="plane" size="{4 * per_m} {3 * per_m} 1"/>'
    wall = f'<geom type="box" pos="0 {3 * per_m} {per_m}" size="{4 * per_m} {0.1 * per_m} {per_m}"/>'
    with pytest.raises(
        InputError, match=f"mine.xml: its floor is {8 * per_m} m wide, as of a room in mm or cm; lengths"
    ):
        build_scene(scenario_of(tmp_path, f"<mujoco><worldbody>{floor}{wall}</worldbody></mujoco>"))


@pytest.mark.parametrize(
    ("scale", "said"), [(1, ""), (40, "'m' is 56.6 m long; a mesh in mm has"), (1e-3, "'m' is 0.00141 m long;")]
)
def test_a_mesh_in_another_unit_is_told(tmp_path: Path, scale: float, said: str) -> None:
    write(tmp_path / "rooms/thing.obj", TETRAHEDRON)
    asset = f'<asset><mesh name="m" file="thing.obj" scale="{scale} {scale} {scale}"/></asset>'
    thing = f'<geom type="mesh" mesh="m" pos="{-2.5 if scale < 2 else 60} -1 0.3"/>'
    room = f"<mujoco>{asset}<worldbody>{SHELL}{thing}</worldbody></mujoco>"
    with Simulation(scenario_of(tmp_path, room), images=False) as simulation:
        told = [each for each in simulation.warnings if "the mesh" in each]
        assert len(told) == bool(said) and said in "".join(told)


@pytest.mark.parametrize(
    ("element", "said"),
    [
        (
            '<replicate count="1000000000"><geom size=".1"/></replicate>',
            r"<replicate> makes 1e\+09 copies; at most 2000",
        ),
        (
            '<replicate count="100" offset="1 0 0"><replicate count="100" offset="0 1 0"><geom size=".1"/></replicate>'
            "</replicate>",
            r"<replicate> makes 10000 copies",
        ),
    ],
)
def test_more_than_a_room_needs_is_refused_before_it_is_made(tmp_path: Path, element: str, said: str) -> None:
    with pytest.raises(InputError, match=f"mine.xml: .*{said}"):
        scene_of(tmp_path, element)


@pytest.mark.parametrize(
    "asset",
    [
        '<texture name="t" builtin="flat" width="1000000" height="1000000"/>',
        '<mesh name="m" builtin="plate" params="10000 10000"/>',
    ],
)
def test_pictures_without_measure_are_refused(tmp_path: Path, asset: str) -> None:
    with pytest.raises(
        InputError, match=r"mine.xml: its .* take about .* MB of memory; at most 1000, or --no-limits, is"
    ):
        scene_of(tmp_path, "", before=f"<asset>{asset}</asset>")


def test_a_row_of_copies_is_a_room_as_any(tmp_path: Path) -> None:
    scene = scene_of(tmp_path, '<replicate count="3" offset="0.5 0 0"><geom size=".1" pos="0 0 0.1"/></replicate>')
    assert sum(scene.model.geom_size[:, 0] == 0.1) >= 3
