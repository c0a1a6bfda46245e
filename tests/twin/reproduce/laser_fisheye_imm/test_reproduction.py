"""Files of `twin reproduce laser-fisheye-imm`, and what it refuses."""

import csv
import re
import shutil
import sqlite3
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from pydantic import TypeAdapter
from results_file import checked_results
from typer.testing import CliRunner

from trackers.errors import InputError
from twin.commands.batch import reproduce
from twin.reproduce.laser_fisheye_imm.figure7 import (
    FILTERS,
    IMM,
    MEAN_MAGNITUDE,
    NPE,
    NVE,
    curves,
    figure7_results,
    simulate,
)
from twin.reproduce.laser_fisheye_imm.runs import COLUMNS
from twin.reproduce.laser_fisheye_imm.table_one import COUNTS, DENSITY, TABLE_ONE, paper_value
from twin.reproduce.laser_fisheye_imm.walk import maneuvering_walk
from twin.reproduce.results import ResultRow, format_ranges, format_result

pytestmark = pytest.mark.slow

SEEDS = range(1000, 1002)
RUNS = range(1000, 1006)
SHORT = """
name: short
description: The paper's condition and two beyond it, short and with small pictures.
seeds: 2
trackers: [laser-fisheye-imm, waist-fisheye-imm, laser-imm, laser-fisheye-kalman, waist-fisheye-kalman, laser-kalman]
set: {duration_s: 0.8, sensors.fisheye.size: [120, 120]}
scenarios:
  - {scenario: lab-five-people, name: people-5}
  - {scenario: lab-five-people, name: people-2, set: {people.white: null, people.black: null, people.blue: null}}
  - {scenario: lab-five-people, name: dark, set: {lights: [{at_s: 0, brightness: 0.05}]}}
"""


@pytest.fixture(scope="module")
def short(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("suite") / "short.yaml"
    path.write_text(SHORT)
    return path


@pytest.fixture(scope="module")
def folder(tmp_path_factory, short):
    out = tmp_path_factory.mktemp("reproduce")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROOMTWIN_CACHE", str(out / "cache"))
        reproduce(
            "laser-fisheye-imm", seeds=2, seed=SEEDS.start, runs=len(RUNS), suite=str(short), jobs=1, out=out / "there"
        )
    return out / "there"


@pytest.fixture(scope="module")
def runs():
    return simulate(maneuvering_walk(), RUNS)


def format_rows(folder: Path) -> list[ResultRow]:
    return TypeAdapter(list[ResultRow]).validate_json((folder / "results.json").read_bytes())


def test_it_leaves_results_tables_plots_and_a_page_and_nothing_else(folder):
    plots = ("figure6", "figure7", "figure9", "table1", "densities", "conditions")
    names = {path.name for path in folder.iterdir()} - {"strips"}  # there where anything happened
    assert names == {
        "results.json",
        "runs.csv",
        "incidents.csv",
        "report.html",
        "suite",
        *(f"{name}.svg" for name in plots),
    }


def test_results_follow_the_contract(folder):
    for row in checked_results(folder):
        assert row["runs"] == (len(RUNS) if row["where"] in (NPE, NVE) else len(SEEDS))


def test_figure_7_is_the_runs(folder, runs):
    value = {(row.where, row.row, row.column): row.ours for row in format_rows(folder)}
    for where, name, errors in ((NPE, "NPE", runs.position), (NVE, "NVE", runs.speed[MEAN_MAGNITUDE])):
        column, measured = f"{name}, mean over scans", errors.measured.sum(axis=0)
        curve = {key: squared.sum(axis=0) / measured for key, squared in errors.by_filter.items()}
        for key in FILTERS:
            assert value[where, key, column] == pytest.approx(curve[key].mean(), rel=1e-9)
        for key in FILTERS[1:]:
            share = 100 * (1 - curve[IMM].mean() / curve[key].mean())
            assert value[where, f"IMM below {key}", column] == pytest.approx(share, rel=1e-9)
        lowest = (curve[IMM] < np.minimum(curve[FILTERS[1]], curve[FILTERS[2]])).mean()
        assert value[where, IMM, f"scans at which its {name} is the lowest"] == pytest.approx(100 * lowest)


def test_table_one_is_what_the_suite_measured_and_the_paper_printed(folder):
    found = {(row.row, row.column): row for row in format_rows(folder) if row.where == TABLE_ONE}
    with sqlite3.connect(folder / "suite" / "results.sqlite") as connection:
        query = "SELECT AVG(value) FROM results WHERE scenario = 'people-5' AND tracker = ? AND metric = ?"
        for column in COLUMNS:
            metrics = {"misidentified": "misidentifications", "lost": "lost_tracks", "MOTA": "mota", "MOTP": "motp_m"}
            for row, metric in metrics.items():
                (mean,) = connection.execute(query, (column.tracker, metric)).fetchone()
                assert found[row, column.name].ours == pytest.approx(mean), (column, row)
                assert found[row, column.name].paper == paper_value(column, row)
    assert {row for row, _ in found} == {*COUNTS, "MOTA", "IDF1", "MOTP"}


def test_every_run_of_every_column_is_a_row(folder):
    with (folder / "runs.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == 3 * len(SEEDS) * len(COLUMNS)
    minutes = {(row["condition"], row["seed"]): float(row["person_minutes"]) for row in rows}
    for (condition, _), found in minutes.items():
        assert found == pytest.approx((2 if condition == "people-2" else 5) * 0.8 / 60, rel=0.1)
    densities = {row.row for row in format_rows(folder) if row.where == DENSITY}
    assert densities == {"people-2", "people-5"}


def test_every_incident_is_listed_and_every_drawn_one_has_its_picture(folder):
    with (folder / "incidents.csv").open() as stream:
        incidents = list(csv.DictReader(stream))
    for incident in incidents:
        assert incident["kind"] in ("misidentification", "lost")
        assert (folder / incident["report"]).is_file()
    with (folder / "runs.csv").open() as stream:
        counted = sum(int(row["misidentifications"]) + int(row["lost_tracks"]) for row in csv.DictReader(stream))
    assert counted == len(incidents)
    strips = folder / "strips"
    drawn = list(strips.iterdir()) if strips.is_dir() else []
    assert (folder / "report.html").read_text().count("data:image/jpeg;base64,") == len(drawn)
    assert bool(drawn) == any(row["condition"] == "people-5" for row in incidents) or drawn


def test_plots_are_svg_with_their_words(folder):
    words = {
        "figure6": ["footprint", "turning velocity", "stop", "start", "turn", "scan"],
        "figure7": ["NPE", "NVE", *FILTERS, "stop", "start", "turn", "scan"],
        "figure9": ["footprints", "purple", "track, measured", "time [s]"],
        "table1": ["misidentified", "lost", *(column.name for column in COLUMNS)],
        "densities": ["errors per person-minute", "0.57/m²", "Kalman"],
        "conditions": ["dark", "people-5"],
    }
    for name, expected in words.items():
        text = (folder / f"{name}.svg").read_text()
        ElementTree.fromstring(text)
        for word in expected:
            assert word in text, (name, word)


def test_the_page_needs_nothing_but_itself(folder):
    page = (folder / "report.html").read_text()
    assert not re.findall(r'src="(?!data:)', page) and "<script" not in page
    assert all(link.startswith(("#", "suite/cases/")) for link in re.findall(r'href="([^"]*)"', page))
    assert page.count("data:image/svg+xml;base64,") == 6
    assert f"twin reproduce laser-fisheye-imm --seeds 2 --seed {SEEDS.start} --runs 6 --suite " in page
    for row in format_rows(folder):
        assert all(text in page for text in format_result(row))
    for words in ("figure 6 is lost", "No parameter was tuned", "Statements", "breaks at", "paper 8"):
        assert words in page


def test_results_and_curves_share_their_replicates(runs):
    first, second = curves(runs)[0], curves(runs)[0]
    for name in FILTERS:
        np.testing.assert_array_equal(first.by_filter[name], second.by_filter[name])
    npe = next(result for result in figure7_results(runs) if (result.where, result.row) == (NPE, IMM))
    assert npe.ci95[0] == np.quantile(first.by_filter[IMM].mean(axis=1)[1:], 0.025)


def test_bad_input_is_named(tmp_path):
    with pytest.raises(
        InputError,
        match="'laser'; valid are laser-fisheye-imm, laser-vision-learning, camera-floor-particle, rgbd-head, fusion, gait",
    ):
        reproduce("laser")
    with pytest.raises(InputError, match="--seeds 1: .* 2 or more"):
        reproduce("laser-fisheye-imm", seeds=1)
    with pytest.raises(InputError, match="--runs 1: .* 2 or more"):
        reproduce("laser-fisheye-imm", runs=1)
    with pytest.raises(InputError, match="camera-floor-particle, rgbd-head, fusion` only"):
        reproduce("gait", jobs=2)
    with pytest.raises(InputError, match="suite 'tables'"):
        reproduce("laser-fisheye-imm", suite="tables", out=tmp_path)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("name: people-5}", "name: five}"), "none is named people-5"),
        ((", laser-kalman]", "]"), "trackers: people-5 is run without laser-kalman; it is expected among them"),
    ],
)
def test_a_suite_that_is_not_table_one_is_refused(tmp_path, change, words):
    path = tmp_path / "other.yaml"
    path.write_text(SHORT.replace(*change))
    with pytest.raises(InputError, match=words):
        reproduce("laser-fisheye-imm", seeds=2, suite=str(path), out=tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_place_that_cannot_be_written_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        reproduce("laser-fisheye-imm", seeds=2, out=tmp_path / "file")


def test_as_a_command_that_takes_up_what_is_done_and_leaves_the_same_files(folder, short, tmp_path: Path, monkeypatch):
    import typer

    monkeypatch.setenv("ROOMTWIN_CACHE", str(folder.parent / "cache"))
    monkeypatch.chdir(tmp_path)
    out = tmp_path / "out" / "reproduce-laser-fisheye-imm"
    shutil.copytree(folder / "suite", out / "suite")
    app = typer.Typer(rich_markup_mode=None)
    app.command()(reproduce)
    arguments = [
        "laser-fisheye-imm",
        "--seeds",
        "2",
        "--seed",
        str(SEEDS.start),
        "--runs",
        str(len(RUNS)),
        "--jobs",
        "1",
    ]
    done = CliRunner().invoke(app, [*arguments, "--suite", str(short)])
    assert isinstance(done.exception, InputError) and "--resume" in str(done.exception)
    done = CliRunner().invoke(app, [*arguments, "--suite", str(short), "--resume"])
    assert done.exit_code == 0, done.output
    for words in ("NPE, mean over scans", "table I", "misidentified", "report.html"):
        assert words in done.stdout
    for path in folder.iterdir():
        if path.is_file():
            assert (out / path.name).read_bytes() == path.read_bytes(), path.name


def test_spans_in_words():
    assert format_ranges(np.array([], int)) == "none"
    assert format_ranges(np.array([3, 7, 8, 9, 12])) == "3, 7–9, 12"
