"""Files of `twin reproduce gait`, its measures, and what it refuses."""

from __future__ import annotations

import json
import re
from functools import cache
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from results_file import checked_results

from trackers.errors import InputError
from twin.commands.batch import reproduce
from twin.reproduce.gait import gait_comparison
from twin.reproduce.gait.gait_comparison import (
    PERSON_SECTION,
    RUNNING,
    SUBJECT_FILE,
    SUBJECT_SECTION,
    WALKING,
    read_subject,
    statures,
    walking_cadence,
    walking_step_m,
)
from twin.reproduce.gait.stride import (
    STANCE_POINTS,
    humps,
    measure_people,
    measure_stride,
    simulate_steady,
    stance,
    whole_stretches,
)

pytestmark = pytest.mark.slow

DATA = Path(__file__).parents[5] / "shared" / "data" / "gait"
recorded = pytest.mark.skipif(not (DATA / SUBJECT_FILE).exists(), reason="the recording of subject01 is not there")
SEEDS = range(3, 6)


@pytest.fixture(scope="module", autouse=True)
def each_gait_once():
    """People of the same statures at the same speed walk as they did: simulated once for all tests."""
    simulated = cache(lambda speed_m_s, statures_m, seconds: simulate_steady(speed_m_s, statures_m, seconds))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            gait_comparison,
            "simulate_steady",
            lambda speed, people, seconds=12.0: simulated(speed, tuple(people), seconds),
        )
        yield


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    out = tmp_path_factory.mktemp("gait")
    data = DATA if (DATA / SUBJECT_FILE).exists() else None
    reproduce("gait", seeds=len(SEEDS), seed=SEEDS.start, out=out, data=data)
    return out


def rows(folder: Path, where: str) -> dict[tuple[str, str], dict]:
    results = json.loads((folder / "results.json").read_text())
    return {(each["row"], each["column"].split(" (")[0]): each for each in results if each["where"] == where}


def test_it_leaves_results_plots_and_a_page_and_nothing_else(folder):
    names = {"results.json", "stance.svg", "loads.svg", "speeds.svg", "report.html"}
    assert {path.name for path in folder.iterdir()} == names
    for path in folder.glob("*.svg"):
        ElementTree.fromstring(path.read_text())
    page = (folder / "report.html").read_text()
    assert not re.findall(r'(?:src|href)="(?!data:)', page) and "<script" not in page
    assert f"--seeds {len(SEEDS)} --seed {SEEDS.start}" in page


def test_results_follow_the_contract(folder):
    for each in checked_results(folder):
        assert each["ci95"][0] <= each["ours"] + 1e-9 and each["ours"] <= each["ci95"][1] + 1e-9


def test_walking_is_as_published(folder):
    walking = rows(folder, WALKING)
    for (row, what), each in walking.items():
        if what in ("cadence", "step length"):
            assert each["ours"] == pytest.approx(each["paper"], rel=0.08), row
        if what == "mean load":
            assert each["ours"] == pytest.approx(1.0, abs=0.01)
        if "hump" in what:
            assert 1.05 < each["ours"] < 1.25
        if what == "dip":
            assert 0.65 < each["ours"] < 0.90
        if what == "stance of the stride":
            assert 58 < each["ours"] < 66
        if what == "stance":
            assert each["ours"] == pytest.approx(each["paper"], rel=0.02), row


def test_running_is_as_published(folder):
    for (row, what), each in rows(folder, RUNNING).items():
        if what == "hump":
            assert 2.0 < each["ours"] < 2.8, row
        if each["paper"] is not None:
            assert each["ours"] == pytest.approx(each["paper"], rel=0.15), (row, what)


def test_a_foot_stands_and_rolls_as_the_measured_person_s(folder):
    person = {what: each for (_, what), each in rows(folder, PERSON_SECTION).items()}
    assert person["stance"]["ours"] == pytest.approx(person["stance"]["paper"], rel=0.02)
    travel = person["travel of the point of load"]
    assert travel["ours"] == pytest.approx(travel["paper"], rel=0.05)
    early = person["load at 5 % of the stance"]
    assert early["ours"] == pytest.approx(early["paper"], abs=0.02)
    roll = [each for what, each in person.items() if what.startswith("point of load at")]
    assert len(roll) == 9 and sum(each["paper"] is not None for each in roll) == 4
    assert all(each["ours"] == pytest.approx(each["paper"], abs=0.05) for each in roll if each["paper"] is not None)


@recorded
def test_we_differ_from_the_subject_about_as_the_subject_s_feet_do(folder):
    (apart,) = (each for (_, what), each in rows(folder, SUBJECT_SECTION).items() if what.startswith("curves apart"))
    assert apart["ours"] < 0.035
    assert 0.02 < apart["paper"] < 0.05
    page = (folder / "report.html").read_text()
    assert "real curves of" in page and "their mean" in (folder / "stance.svg").read_text()


def test_without_a_recording_the_published_figures_stay(tmp_path):
    reproduce("gait", seeds=len(SEEDS), seed=SEEDS.start, out=tmp_path)
    assert not rows(tmp_path, SUBJECT_SECTION) and rows(tmp_path, WALKING)
    assert "no recording was given" in (tmp_path / "report.html").read_text()


@pytest.mark.nightly
def test_the_same_seeds_leave_the_same_files(tmp_path):
    for name in ("one", "two"):
        reproduce("gait", seeds=2, out=tmp_path / name)
    for path in (tmp_path / "one").iterdir():
        assert (tmp_path / "two" / path.name).read_bytes() == path.read_bytes(), path.name


def test_statures_are_a_seed_s_own():
    assert statures(range(5, 8)) == statures(range(0, 10))[5:8]
    assert all(1.5 <= each <= 2.0 for each in statures(range(200)))


def test_a_drawn_load_is_measured():
    t = np.arange(0, 6.0, 1 / 600)
    left = np.where((t % 1.2) < 0.72, 1.0 + 0.1 * np.cos(4 * np.pi * (t % 1.2) / 0.72), 0.0)
    right = np.where(((t + 0.6) % 1.2) < 0.72, 0.8, 0.0)
    found = measure_stride(np.stack([left, right], axis=-1), 600.0, 0.7)
    assert found.stride_s == pytest.approx(1.2, abs=0.01)
    assert found.cadence == pytest.approx(100, abs=1)
    assert found.stance_share == pytest.approx(0.6, abs=0.01)
    assert found.stance_s == pytest.approx(0.72, abs=0.01)
    with pytest.raises(ValueError, match="no whole stride"):
        measure_stride(np.ones((100, 2)), 600.0)


def test_stances_that_are_cut_off_do_not_count():
    on = np.array([1, 1, 0, 1, 1, 1, 0, 0, 1, 1], dtype=bool)
    assert whole_stretches(on) == [slice(3, 6)]
    load = np.where(on, 1.0, 0.0)
    assert stance(load, 10.0).curves.shape == (1, STANCE_POINTS)
    assert stance(load, 10.0).seconds.tolist() == [0.3]


def test_humps_and_dip():
    curve = 1 + 0.2 * np.cos(np.linspace(-np.pi, 5 * np.pi, STANCE_POINTS))
    first, dip, second = humps(curve)
    assert (first, second) == (pytest.approx(1.2, abs=0.01), pytest.approx(1.2, abs=0.01))
    assert dip == pytest.approx(0.8, abs=0.01)


def test_steps_are_as_long_as_the_speed_and_the_cadence_say():
    (found,) = measure_people(simulate_steady(1.2, [1.75], 8.0))
    assert found.step_length_m * found.cadence / 60 == pytest.approx(1.2, rel=0.01)
    assert walking_step_m(np.array(1.2)) * walking_cadence(np.array(1.2)) / 60 == pytest.approx(1.2)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, r"cannot be read \(No such file or directory\); in the folder of --data"),
        ("no header\n1 2\n", "has no column time"),
        ("endheader\ntime ground_force_vy\n0 1\n", "has no column 1_ground_force_vy"),
        ("endheader\ntime ground_force_vy 1_ground_force_vy\n0 1 x\n", "is not a table of numbers"),
        ("endheader\ntime ground_force_vy 1_ground_force_vy\n0 1 nan\n1 2 3\n", "is not a table of numbers"),
        ("endheader\ntime ground_force_vy 1_ground_force_vy\n0 1 2\n1 2\n", "is not a table of numbers"),
    ],
)
def test_a_recording_that_is_none_is_refused(tmp_path, content, words):
    if content is not None:
        (tmp_path / SUBJECT_FILE).write_text(content)
    with pytest.raises(InputError, match=words):
        read_subject(tmp_path)


def test_only_gait_reads_data(tmp_path):
    with pytest.raises(InputError, match="--data: is an option of `reproduce gait` only"):
        reproduce("laser-fisheye-imm", seeds=2, data=tmp_path)
