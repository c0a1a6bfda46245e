"""Recorded paths: what a file may hold, and what a user is told when it holds something else."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from trackers.errors import InputError
from twin.scenario import load_scenario
from twin.scenario.load import dump_scenario
from twin.world.simulation import Simulation

DATA = Path(__file__).parents[4] / "shared" / "data" / "trajectories"

SCENARIO = """
name: crowd
room: plaza
duration_s: 4.0
pedestrians: {file: paths.txt, frame_rate_hz: 10}
people: {}
sensors:
  low: {kind: laser, rate_hz: 10, mount: {xyz: [0, 0, 0.4]}}
"""

FRAMES = """
0 1 0.0 0 1.0 9 9 9
4 1 0.4 0 1.0 9 9 9
8 1 0.8 0 1.2 9 9 9
4 2 3.0 0 3.0 9 9 9
8 2 3.2 0 3.0 9 9 9
"""


def load(folder: Path, paths: str, *overrides: str, name: str = "paths.txt"):
    (folder / name).write_text(paths)
    (folder / "crowd.yaml").write_text(SCENARIO)
    return load_scenario(folder / "crowd.yaml", [f"pedestrians.file={folder / name}", *overrides])


def points(scenario, name: str) -> np.ndarray:
    return np.array(scenario.people[name].script[0].points)


def test_rows_become_people_with_paths(tmp_path: Path) -> None:
    scenario = load(tmp_path, FRAMES)
    assert list(scenario.people) == ["walker-1", "walker-2"]
    np.testing.assert_allclose(points(scenario, "walker-1"), [[0, 0, 1], [0.4, 0.4, 1], [0.8, 0.8, 1.2]])
    np.testing.assert_allclose(points(scenario, "walker-2")[:, 0], [0.4, 0.8])


def test_a_table_of_seconds_says_the_same(tmp_path: Path) -> None:
    table = "t,id,x,y\n0.0,1,0.0,1.0\n0.4,1,0.4,1.0\n0.8,1,0.8,1.2\n0.4,2,3.0,3.0\n0.8,2,3.2,3.0\n"
    by_frames = load(tmp_path, FRAMES)
    by_seconds = load(tmp_path, table, "pedestrians.frame_rate_hz=null", name="paths.csv")
    for name in ("walker-1", "walker-2"):
        np.testing.assert_allclose(points(by_frames, name), points(by_seconds, name))


def test_a_file_is_found_beside_the_scenario(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "paths.txt").write_text(FRAMES)
    (tmp_path / "crowd.yaml").write_text(SCENARIO)
    monkeypatch.chdir("/")
    assert len(load_scenario(tmp_path / "crowd.yaml").people) == 2


def test_the_resolved_scenario_needs_the_file_no_more(tmp_path: Path) -> None:
    scenario = load(tmp_path, FRAMES)
    (tmp_path / "paths.txt").unlink()
    (tmp_path / "again.yaml").write_text(dump_scenario(scenario))
    assert load_scenario(tmp_path / "again.yaml") == scenario


def test_start_shift_and_turn(tmp_path: Path) -> None:
    moved = load(tmp_path, FRAMES, "pedestrians.start_s=0.4", "pedestrians.shift_m=[5, 0]", "pedestrians.turn_deg=90")
    np.testing.assert_allclose(points(moved, "walker-1"), [[-0.4, 4, 0], [0, 4, 0.4], [0.4, 3.8, 0.8]], atol=1e-12)


def test_whoever_is_gone_before_the_start_does_not_come(tmp_path: Path) -> None:
    later = load(tmp_path, FRAMES + "60 3 0 0 0 9 9 9\n64 3 0.4 0 0 9 9 9\n", "pedestrians.start_s=5")
    assert list(later.people) == ["walker-3"]


@pytest.mark.parametrize(
    ("paths", "said"),
    [
        ("0 1 0 0 0\n4 1 0.4 0 0\n8 1 0.8 0 0\n80 1 4 0 0\n", "gap of 7.2 s"),
        ("0 1 0 0 0\n4 1 0.4 0 0\n4 1 0.5 0 0\n", "line 3: t 4, id 1 stands on line 2 too"),
        ("0 1 0 0 0\n4 1 9 0 0\n", "22.5 m/s"),
        ("0 1 0 0 0\n4 1 nan 0 0\n", "line 2: column 3 is 'nan'; a finite number is expected"),
        ("0 1 0 0 0\n4 1 inf 0 0\n", "column 3 is 'inf'; a finite number is expected"),
        ("0 1 0 0 0\n4 1 a 0 0\n", "column 3 is 'a'; a finite number is expected"),
        ("0 1 0\n", "has no header and 3 columns; frame,id,x,y without a header, or a header with the columns"),
        ("0 1 0 0\n4 1 1\n", "line 2: has 3 cells; 4 as in the first row are expected"),
        ("0,1,2,3,4,5,6,-1,-1,-1\n", "has no header and 10 columns"),
        ("0 1.5 0 0 0\n4 1.5 0 0 0\n", "a whole number from 0 on, or a name, is expected"),
        ("0 1 0 0 0\n", "nobody has more than one row"),
        ("0 1 0 0 0\n10000000 1 0.4 0 0\n", "rows of a person come every 1e+06 s, too rarely for a path"),
        ("0 1 0 0 0\n4 1 1e9 0 0\n", "line 2: [1e+09, 0] is out of the world"),
        ("0 1e300 0 0 0\n4 1e300 0 0 0\n", "a whole number from 0 on, or a name, is expected"),
        ("", "holds no rows"),
        ("t,who,x,y\n0,1,0,0\n", "line 1: column 'id' is missing among t,who,x,y"),
    ],
)
def test_a_file_that_is_no_paths_teaches(tmp_path: Path, paths: str, said: str) -> None:
    with pytest.raises(InputError, match=re.escape(said)) as refused:
        load(tmp_path, paths)
    assert "\n" not in str(refused.value)
    assert "is expected" in str(refused.value) or "are expected" in str(refused.value)


@pytest.mark.parametrize(
    ("overrides", "said"),
    [
        (["pedestrians.frame_rate_hz=null"], "frame_rate_hz: is missing"),
        (["pedestrians.frame_rate_hz=1.5e-5"], "frame_rate_hz: a number greater than or equal to 0.01 is expected"),
        (["pedestrians.frame_rate_hz=0.1"], "come every 40 s, too rarely .* frame_rate_hz"),
        (["pedestrians.file=/dev/zero"], "/dev/zero: is a device, not a file"),
        (["pedestrians.ids=[7]"], "holds nobody of number 7; one of 1, 2 is expected"),
        (["pedestrians.start_s=60"], "nobody of"),
        (["pedestrians.file=/nowhere.txt"], "cannot be read"),
        (["people.walker-1={}"], "is one of the people already"),
        (["pedestrians.frame_rate=10"], "did you mean 'frame_rate_hz'"),
    ],
)
def test_a_wrong_description_teaches(tmp_path: Path, overrides: list[str], said: str) -> None:
    with pytest.raises(InputError, match=said):
        load(tmp_path, FRAMES, *overrides)


def test_somebody_with_one_row_is_left_out_with_a_warning(tmp_path: Path) -> None:
    said = "pedestrians: person 9 has one row in paths.txt, which is no path, and is left out"
    scenario = load(tmp_path, FRAMES + "4 9 0 0 0 9 9 9\n")
    assert list(scenario.people) == ["walker-1", "walker-2"] and scenario.warnings[-1] == said
    (tmp_path / "again.yaml").write_text(dump_scenario(scenario))
    assert load_scenario(tmp_path / "again.yaml") == scenario
    with Simulation(scenario, images=False) as simulation:
        assert f"scenario 'crowd': {said}" in simulation.warnings
    (told,) = load(tmp_path, FRAMES).warnings
    assert told.endswith("paths.txt: has no header; its columns are read as frame, id, x, z, y")
    named = load(tmp_path, "frame,id,x,y\n0,1,0,0\n4,1,0.5,0\n")
    assert named.warnings == () and "warnings" not in dump_scenario(named)
    with pytest.raises(InputError, match="has one row of number 9, no path; one of 1, 2 is expected"):
        load(tmp_path, FRAMES + "4 9 0 0 0 9 9 9\n", "pedestrians.ids=[9]")


@pytest.mark.skipif(not DATA.is_dir(), reason="the recordings of pedestrians are not here")
@pytest.mark.parametrize(("file", "rate_hz", "people"), [("eth.txt", 15, 360), ("zara01.txt", 25, 148)])
def test_everybody_of_the_real_recordings_comes(tmp_path: Path, file: str, rate_hz: int, people: int) -> None:
    (tmp_path / "crowd.yaml").write_text(SCENARIO)
    scenario = load_scenario(
        tmp_path / "crowd.yaml",
        [f"pedestrians={{file: {DATA / file}, frame_rate_hz: {rate_hz}}}", "duration_s=1000"],
    )
    assert len(scenario.people) == people
