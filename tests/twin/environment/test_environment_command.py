"""`twin environment`: the files it leaves, and the sentences it says to bad input."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from trackers.environment import load_environment
from trackers.errors import InputError
from twin.commands.run import environment

pytestmark = pytest.mark.slow

ROOM = """<mujoco><worldbody>
  <geom name="floor" type="plane" size="2 1.5 0.1" contype="1" conaffinity="1"/>
  <geom type="plane" pos="0 0 2.5" size="2 1.5 0.1" zaxis="0 0 -1"/>
  <geom type="plane" pos="2 0 1.25" size="1.25 1.5 0.1" zaxis="-1 0 0"/>
  <geom type="plane" pos="-2 0 1.25" size="1.25 1.5 0.1" zaxis="1 0 0"/>
  <geom type="plane" pos="0 1.5 1.25" size="2 1.25 0.1" zaxis="0 -1 0"/>
  <geom type="plane" pos="0 -1.5 1.25" size="2 1.25 0.1" zaxis="0 1 0"/>
  <geom name="chest" type="box" pos="1.2 0.8 0.4" size="0.4 0.3 0.4"/>
</worldbody></mujoco>"""
SCENARIO = """name: small
room: small.xml
area: [[-1.5, -1.0], [0.5, -1.0], [0.5, 1.0], [-1.5, 1.0]]
duration_s: 1
people: {}
sensors: {low: {kind: laser, rate_hz: 10, mount: {xyz: [0, 0, 0.4]}}}
"""


@pytest.fixture
def run(tmp_path, monkeypatch):
    (tmp_path / "small.xml").write_text(ROOM)
    (tmp_path / "small.yaml").write_text(SCENARIO)
    monkeypatch.chdir(tmp_path)
    app = typer.Typer()
    app.command()(environment)

    def run(*arguments):
        result = CliRunner().invoke(app, ["small.yaml", *arguments])
        if isinstance(result.exception, InputError):
            raise result.exception
        assert result.exit_code == 0, result.output
        return result.output

    return run


def test_what_it_leaves(run, tmp_path):
    printed = run("--station", "-1,0", "--station", "0.3,-0.4,1.4", "--out", "env/here.npz", "--cloud", "env/here.ply")
    assert [line.split() for line in printed.strip().splitlines()] == [
        ["environment", "env/here.npz"],
        ["picture", "env/here.png"],
        ["cloud", "env/here.ply"],
    ]
    found = load_environment(tmp_path / "env" / "here.npz")
    assert found.room == "small"
    np.testing.assert_allclose(found.stations_m, [[-1, 0, 1.2], [0.3, -0.4, 1.4]])
    np.testing.assert_allclose(found.area_m[0], [-1.5, -1.0])
    assert found.height_under([[1.2, 0.8]])[0] == pytest.approx(0.8, abs=0.02)
    picture = cv2.imread(str(tmp_path / "env" / "here.png"))
    assert picture.shape[0] > 600 and picture.shape[1] > 1000 and picture.std() > 20
    assert (tmp_path / "env" / "here.ply").read_bytes().startswith(b"ply\n")


def test_the_same_seed_gives_the_same_files_wherever_they_are_written(run, tmp_path):
    for out in (["--out", "one.npz"], []):
        run("--station", "-1,0", "--voxel", "0.1", "--seed", "7", *out)
    for suffix in (".npz", ".png"):
        assert (tmp_path / f"one{suffix}").read_bytes() == (tmp_path / f"out/small{suffix}").read_bytes()
    assert load_environment(tmp_path / "one.npz").grid.voxel_m == 0.1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--station", "there"], r"--station there: is no place; X,Y or X,Y,Z \[m\] is expected"),
        (["--station", "1"], "--station 1: is no place"),
        (["--station", "7,0"], "--station 7,0,1.2: is not over the room's floor"),
        (["--station", "1.2,0.8,0.4"], r"is inside 'chest' of the room"),
        (["--noise", "some"], "--noise some: there is no such noise; valid are off, default, worse"),
        (["--voxel", "0"], "--voxel 0: is not the side of a voxel; 0.01 to 0.5 m is expected"),
        (["--out", "room.npy"], "--out room.npy: a name ending in .npz is expected"),
        (["--cloud", "room.txt"], "--cloud room.txt: a name ending in .ply is expected"),
    ],
)
def test_bad_input(run, tmp_path, arguments, message):
    with pytest.raises(InputError, match=message):
        run(*arguments)
    assert not (tmp_path / "out").exists()
