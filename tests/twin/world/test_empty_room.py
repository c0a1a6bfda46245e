"""A room is read and measured once while its files stay as they are, and worlds that share it do not change it."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np

from twin.scenario import Scenario, load_scenario
from twin.world.empty_room import empty_room
from twin.world.scene import build_scene

ROOM = """<mujoco><worldbody>
  <geom name="floor" type="plane" size="5 5 0.1"/>
  <body name="table" pos="1 1 0.5"><geom name="top" type="box" size="{half} 0.5 0.5"/></body>
</worldbody></mujoco>"""


def in_room(path: Path, *changes: str) -> Scenario:
    area = "area=[[-4, -4], [4, -4], [4, 4], [-4, 4]]"
    return load_scenario("lab-five-people", ["people={ann: {start: [-1, -1]}}", f"room={path}", area, *changes])


def contents(model: mujoco.MjModel) -> dict[str, np.ndarray]:
    names = [name for name in dir(model) if not name.startswith("_")]
    return {name: np.copy(value) for name in names if isinstance(value := getattr(model, name), np.ndarray)}


def test_a_room_is_the_same_one_until_its_file_changes(tmp_path: Path) -> None:
    path = tmp_path / "room.xml"
    path.write_text(ROOM.format(half=0.5))
    first = empty_room(in_room(path))
    assert empty_room(in_room(path, "seed=7")) is first
    path.write_text(ROOM.format(half=0.6))
    second = empty_room(in_room(path))
    widths = [float(np.ptp(room.obstacles[0].corners[:, 0])) for room in (first, second)]
    np.testing.assert_allclose(widths, [1.0, 1.2])


def test_worlds_of_one_room_leave_nothing_in_each_other(tmp_path: Path) -> None:
    path = tmp_path / "room.xml"
    path.write_text(ROOM.format(half=0.5))
    alone = contents(build_scene(in_room(path)).model)
    build_scene(in_room(path, "seed=5", "sensors.waist.mount.xyz=[60, 0, 1]"))
    base = "{mount: {xyz: [-3, -3, 0]}, drive: {kind: wander}, body: {height_m: 0.3, radius_m: 0.2}}"
    build_scene(in_room(path, f"housings.base={base}"))
    again = contents(build_scene(in_room(path)).model)
    assert alone.keys() == again.keys()
    for name, values in alone.items():
        np.testing.assert_array_equal(values, again[name], err_msg=name)


def test_a_body_without_pictures_has_the_same_shape(tmp_path: Path) -> None:
    path = tmp_path / "room.xml"
    path.write_text(ROOM.format(half=0.5))
    drawn, plain = (build_scene(in_room(path), pictures=pictures).model for pictures in (True, False))
    assert drawn.ntex > plain.ntex
    for name in ("mesh_vert", "mesh_face", "geom_size", "geom_pos", "geom_quat", "geom_rgba", "site_pos", "body_pos"):
        np.testing.assert_array_equal(getattr(drawn, name), getattr(plain, name), err_msg=name)
