"""Settings of a viewer, of the engine and of the compiler change no sensor, whichever a room's file has.

The elements and attributes are read from MuJoCo's own schema, so that one that a later version adds is tried too.
"""

from __future__ import annotations

import re
from pathlib import Path

import mujoco
import numpy as np
import pytest
from made_rooms import LAMP, reports, room_of, scenario_in

from twin.world.simulation import Simulation

SETTINGS = ("compiler", "option", "size", "statistic", "visual")
SAID = {
    "znear": (".9", ".0001"), "zfar": (".2", "1000"), "extent": (".3", "900"), "fogend": ("1", "2"), "fogstart": (".1", "1"),
    "memory": ("64M", "900G"), "offwidth": ("16", "60000"), "offheight": ("16", "60000"), "offsamples": ("0", "16"),
    "shadowsize": ("0", "16384"), "numslices": ("3", "90"), "numstacks": ("3", "90"), "numquads": ("1", "50"),
    "nkey": ("1", "100000000"), "nuserdata": ("5", "100000000"), "meshdir": ("a", "b"), "texturedir": ("a", "b"),
    "assetdir": ("a", "b"), "eulerseq": ("XYZ", "zyx"), "inertiagrouprange": ("0 1", "5 5"), "fovy": ("5", "120"),
    "nuser_geom": ("1", "10000000"), "nuser_body": ("1", "10000000"), "cameraid": ("-1", "-1"),
    "boundmass": (".1", "1"), "settotalmass": ("3", "900"),
}  # fmt: skip
"""Values of attributes that are not switches, or of which the ordinary ones would change little."""
ORDINARY = (
    "disable", "enable", "true", "false", "1", "0", "0.5", "7", "0.5 0.5 0.5", "1 1 1", "0.9 0.1 0.9 1", "0.1 0.9 0.1 1",
    "radian", "dynamic", "merge", "error", "textures", "Euler", "implicit", "elliptic", "dense", "PGS", "CG", "none", "all",
    "0.1 0.1 0.1 0.1 0.1", "0.3 0.8 0.1 0.5 2", "0.01 1",
)  # fmt: skip
SAME_FILE = ("coordinate", "angle")
"""Attributes that say how the file is to be read."""
TOGETHER = ({"nconmax", "njmax", "nstack"},)
"""Attributes that do not go with one that is tried before them (memory)."""


def attributes() -> dict[str, list[str]]:
    """Of each element of settings, by its path, the attributes in MuJoCo's schema."""
    found: dict[str, list[str]] = {}
    stack: list[str] = []
    for line in mujoco.mj_printSchema(False, False).splitlines():
        if head := re.match(r"( *)([a-z_()]+) \([!?*R]\)(.*)", line):
            stack[len(head[1]) // 3 :] = [head[2]]
            line = head[3]
        path = "/".join(stack[1:])
        if path.split("/")[0] in SETTINGS:
            found.setdefault(path, []).extend(line.split())
    return found


def element(path: str, said: dict[str, str]) -> str:
    """An element of these attributes within its parents, as MJCF."""
    *parents, tag = path.split("/")
    inner = f"<{tag} {' '.join(f'{name}={value!r}' for name, value in said.items())}/>"
    for parent in reversed(parents):
        inner = f"<{parent}>{inner}</{parent}>"
    return inner


def taken(path: str, said: dict[str, str]) -> bool:
    """Whether MuJoCo reads these attributes."""
    try:
        mujoco.MjSpec.from_string(f"<mujoco>{element(path, said)}</mujoco>")
    except ValueError:
        return False
    return True


def changed(path: str, names: list[str], which: int) -> dict[str, str]:
    """A value for each attribute that MuJoCo takes: the first or the last such."""
    said: dict[str, str] = {}
    for name in names:
        if name in SAME_FILE or any(name in each for each in TOGETHER):
            continue
        fitting = [value for value in SAID.get(name, ORDINARY) if taken(path, {name: value})]
        assert fitting, f"no value for {path}/{name}: say one in SAID"
        said[name] = fitting[-which]
    return said


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    found = reports(scenario_in(tmp_path_factory.mktemp("plain"), room_of(THING)))
    assert len(set(np.frombuffer(found["camera.rgb"], dtype=np.uint8).tolist())) > 20
    return found


THING = '<geom name="ball" type="sphere" pos="0 0 0.4" size="0.4" rgba=".8 .2 .2 1"/>'


@pytest.mark.parametrize("which", [0, 1])
def test_no_setting_changes_a_sensor(tmp_path: Path, plain: dict[str, bytes], which: int) -> None:
    """All of them at once; where they change something each one is tried alone, so that it is named."""
    elements = {path: element(path, changed(path, names, which)) for path, names in attributes().items() if names}
    assert len(elements) > 10
    if reports(scenario_in(tmp_path, room_of(THING, before="".join(elements.values())))) == plain:
        return
    for path, said in elements.items():
        assert reports(scenario_in(tmp_path, room_of(THING, before=said))) == plain, path
    pytest.fail("together they change what none changes alone")


@pytest.mark.parametrize("path", ["visual/map", "visual/quality", "visual/headlight", "statistic"])
def test_nor_does_it_with_shadows_and_samples(tmp_path: Path, path: str) -> None:
    switched = ["rendering.shadows=true", "rendering.samples=4"]
    plain = reports(scenario_in(tmp_path / "plain", room_of(THING), switched))
    said = changed(path, attributes()[path], 1)
    assert reports(scenario_in(tmp_path / "set", room_of(THING, before=element(path, said)), switched)) == plain


@pytest.mark.parametrize("distance_m", [30, 300, 3000])
def test_a_thing_far_away_cuts_nothing_near_out_of_a_picture(
    tmp_path: Path, plain: dict[str, bytes], distance_m: int
) -> None:
    far = f'<geom type="box" pos="{distance_m} 0 1" size="1 1 1"/>'
    found = reports(scenario_in(tmp_path, room_of(THING + far)))
    for name, report in plain.items():
        if name.endswith("ranges_m") or "." not in name:
            assert found[name] == report, name
        else:  # rounding, at edges above all, where the far plane is another
            kind, least = (np.float32, 1e-3) if name.endswith("depth_m") else (np.uint8, 8)
            there, here = (np.frombuffer(each, dtype=kind).astype(float) for each in (found[name], report))
            assert (abs(there - here) > least).mean() < 2e-3, name


def test_near_and_far_plane_hold_what_is_near_and_far(tmp_path: Path) -> None:
    near = '<geom name="near" type="box" pos="-2.5 -2.5 1.8" size=".01 .01 .01" rgba="1 0 0 1"/>'
    tower = '<geom name="tower" type="box" pos="4000 4000 0" size="300 300 4000" rgba="0 1 0 1"/>'
    with Simulation(scenario_in(tmp_path, room_of(near + tower))) as simulation:
        rgb = simulation.look(10**9)["camera"].rgb.astype(int)
    assert ((rgb[..., 0] > 2 * rgb[..., 1]) & (rgb[..., 0] > 60)).any()
    assert ((rgb[..., 1] > 2 * rgb[..., 0]) & (rgb[..., 1] > 60)).any()


def test_a_room_with_weak_lamps_alone_is_lit_by_its_walls_and_one_without_by_the_twins(tmp_path: Path) -> None:
    spot = '<light name="spot" pos="0 0 2.4" dir="0 0 -1"/>'
    for place, lamp in enumerate((spot, "", LAMP)):
        with Simulation(scenario_in(tmp_path / str(place), room_of(THING, lamp=lamp))) as simulation:
            assert simulation.look(10**9)["camera"].rgb.mean() > 25, lamp
