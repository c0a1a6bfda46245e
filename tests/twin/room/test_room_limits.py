"""Rooms that ask for more than a room needs are refused before it is made; --no-limits and --room-root allow more."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from command_line import twin
from made_rooms import room_of, scenario_in

from trackers.errors import InputError
from trackers.user_input.text_file import NO_LIMITS
from twin.room.files import ROOM_ROOT, room_files
from twin.world.scene import build_scene

TEXTURE = '<texture name="t{0}" type="2d" file="t.png"/>'
MESH = '<mesh name="m{0}" file="m.stl"/>'


def png_of(width: int, height: int) -> bytes:
    """A PNG that says it is so large, in less than a hundred bytes."""
    header = b"IHDR" + struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + header + struct.pack(">I", zlib.crc32(header))


def stl_of(n_faces: int) -> bytes:
    return bytes(80) + struct.pack("<I", n_faces) + bytes(50 * n_faces)


OBJ = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
FAN = "".join(f'<attach model="m" body="b" prefix="p{place}"/>' for place in range(200))
ATTACHED = ('<mujoco><worldbody><body name="b">' + '<geom size=".1"/>' * 200 + "</body></worldbody></mujoco>").encode()
TOO_MUCH: dict[str, tuple[str, str, Mapping[str, bytes], str]] = {
    "a texture": (TEXTURE, "", {"t.png": png_of(60_000, 60_000)}, "take about 43200 MB"),
    "textures together": (
        "".join(map(TEXTURE.format, range(10))),
        "",
        {"t.png": png_of(3000, 3000)},
        "take about 1080 MB",
    ),
    "a cube": ('<texture name="t" type="cube" fileup="t.png"/>', "", {"t.png": png_of(20_000, 20_000)}, "take about"),
    "meshes together": ("".join(map(MESH.format, range(10))), "", {"m.stl": stl_of(100_000)}, "take about 1600 MB"),
    "a polygon": (
        '<mesh name="m" file="m.obj"/>',
        "",
        {"m.obj": OBJ + b"f" + b" 1 2 3 4" * 200_000 + b"\n"},
        "take about 1280 MB",
    ),
    "a mesh of MuJoCo's": ('<mesh name="m" builtin="supersphere" params="9000 1 1"/>', "", {}, "take about"),
    "a texture by its class": (
        '<texture name="t" type="2d"/></asset><default><texture builtin="flat" width="99999" height="99999"/></default><asset>',
        "",
        {},
        "take about",
    ),
    "elements": ("", '<geom size=".1"/>' * 20_001, {}, "is made of 200[0-9]{2} elements"),
    "copies": ("", '<replicate count="2001"><geom size=".1"/></replicate>', {}, "<replicate> makes 2001 copies"),
    "attached models": ('<model name="m" file="a.xml"/>', FAN, {"a.xml": ATTACHED}, "is made of 4[0-9]{4} elements"),
    "numbers": ('</asset><custom><numeric name="n" size="99999"/></custom><asset>', "", {}, "holds 99999"),
    "things in the way": (
        "",
        "".join(
            f'<geom type="box" size=".02 .02 .5" pos="{x} {y} .5"/>'
            for x in np.linspace(-2.7, 2.7, 23)
            for y in np.linspace(-2.7, 2.7, 23)
        ),
        {},
        "stands in people's way with 529 things",
    ),
}


@pytest.mark.parametrize("what", TOO_MUCH)
def test_too_much_is_refused_before_it_is_made(tmp_path: Path, what: str) -> None:
    assets, inside, files, said = TOO_MUCH[what]
    scenario = scenario_in(tmp_path, room_of(inside, before=f"<asset>{assets}</asset>"))
    for name, content in files.items():
        (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=rf"room\.xml: .*{said}.*; at most .*, or --no-limits, is expected") as told:
        build_scene(scenario)
    assert "\n" not in str(told.value)


@pytest.mark.parametrize("what", ["copies", "numbers"])
def test_no_limits_lifts_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, what: str) -> None:
    monkeypatch.setenv(NO_LIMITS, "1")
    assets, inside, _, _ = TOO_MUCH[what]
    scenario_in(tmp_path, room_of(inside, before=f"<asset>{assets}</asset>"))
    assert room_files(tmp_path / "room.xml")


@pytest.mark.parametrize("tag", ["body", "frame", "replicate", "default"])
@pytest.mark.parametrize("depth", [101, 500, 50_000])
def test_elements_nested_too_deep_are_refused(tmp_path: Path, tag: str, depth: int) -> None:
    nested = f"<{tag}>" * depth + f"</{tag}>" * depth
    with pytest.raises(InputError, match=rf"room\.xml: <{tag}> is nested 101 deep; at most 100 is expected"):
        build_scene(scenario_in(tmp_path, room_of(nested)))


def test_sizes_of_the_engine_and_of_the_viewer_ask_for_nothing(tmp_path: Path) -> None:
    room = room_of(
        before='<size memory="900G" nuserdata="2000000000" nkey="2000000000" nuser_geom="2000000000"/>'
        '<visual><global offwidth="2000000000"/><quality shadowsize="1000000" numslices="1000000"/></visual>',
        after='<sensor><user dim="2000000000" needstage="acc"/></sensor>',
    )
    assert build_scene(scenario_in(tmp_path, room)).model.nuserdata == 0


def a_room_with_a_shared_mesh(folder: Path) -> Path:
    (folder / "assets").mkdir(parents=True)
    (folder / "assets" / "tent.obj").write_bytes(OBJ)
    mesh = '<asset><mesh name="tent" file="../assets/tent.obj"/></asset>'
    scenario_in(folder / "here", room_of('<geom name="tent" type="mesh" mesh="tent"/>', before=mesh))
    return folder / "here"


def test_room_root_allows_the_files_of_one_folder_more(tmp_path: Path) -> None:
    here = a_room_with_a_shared_mesh(tmp_path)
    (tmp_path / "other").mkdir()
    for root, code, said in (
        ((), 2, "leads outside the room's folder; a relative path inside of it, or --room-root"),
        (("--room-root", str(tmp_path / "other")), 2, "leads outside the room's folder and --room-root"),
        (("--room-root", str(tmp_path / "none")), 2, "is no folder"),
        (("--room-root", str(tmp_path / "assets")), 0, ""),
    ):
        done = twin("view", here / "scenario.yaml", "--out", here / "out.png", *root)
        assert (done.returncode, said in done.stderr) == (code, True), done.stderr


def test_only_the_command_line_and_the_environment_say_the_root(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    here = a_room_with_a_shared_mesh(tmp_path)
    with pytest.raises(InputError, match="room_root"):
        scenario_in(here, (here / "room.xml").read_text(), [f"room_root={tmp_path}"])
    monkeypatch.setenv(ROOM_ROOT, str(tmp_path / "assets"))
    assert (tmp_path / "assets" / "tent.obj").resolve() in {path.resolve() for path in room_files(here / "room.xml")}
