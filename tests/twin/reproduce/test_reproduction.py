"""What `twin reproduce laser-fisheye-imm` leaves behind, and what it refuses."""

import json
import re
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from typer.testing import CliRunner

from trackers.errors import InputError
from twin.reproduce.command import reproduce
from twin.reproduce.figure7 import FILTERS, IMM, MEAN_MAGNITUDE, simulate
from twin.reproduce.page import spans_text, text_of
from twin.reproduce.results import NPE, NVE, Result, curves, figure7_results
from twin.reproduce.walk import maneuvering_walk

SEEDS = range(1000, 1006)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    out = tmp_path_factory.mktemp("reproduce")
    reproduce("laser-fisheye-imm", seeds=len(SEEDS), seed=SEEDS.start, out=out)
    return out


@pytest.fixture(scope="module")
def runs():
    return simulate(maneuvering_walk(), SEEDS)


def test_it_leaves_results_plots_and_a_page_and_nothing_else(folder):
    assert {path.name for path in folder.iterdir()} == {"results.json", "figure6.svg", "figure7.svg", "report.html"}


def test_results_follow_the_contract_and_are_the_runs(folder, runs):
    results = json.loads((folder / "results.json").read_text())
    for result in results:
        assert list(result) == ["where", "row", "column", "paper", "ours", "ci95", "unit", "runs"]
        assert result["paper"] is None and result["runs"] == len(SEEDS)
        assert len(result["ci95"]) == 2 and result["ci95"][0] <= result["ci95"][1]
        assert np.isfinite([result["ours"], *result["ci95"]]).all()
    value = {(result["where"], result["row"], result["column"]): result["ours"] for result in results}
    assert len(value) == len(results)
    for where, name, errors in ((NPE, "NPE", runs.position), (NVE, "NVE", runs.speed[MEAN_MAGNITUDE])):
        column, curve = f"{name}, mean over scans", errors.normalised()
        for key in FILTERS:
            assert value[where, key, column] == pytest.approx(curve[key].mean(), rel=1e-9)
        for key in FILTERS[1:]:
            share = 100 * (1 - curve[IMM].mean() / curve[key].mean())
            assert value[where, f"IMM below {key}", column] == pytest.approx(share, rel=1e-9)
        lowest = (curve[IMM] < np.minimum(curve[FILTERS[1]], curve[FILTERS[2]])).mean()
        assert value[where, IMM, f"scans at which its {name} is the lowest"] == pytest.approx(100 * lowest)


def test_plots_are_svg_with_their_words(folder):
    for name, words in (("figure6.svg", ["footprint", "turning velocity"]), ("figure7.svg", ["NPE", "NVE", *FILTERS])):
        text = (folder / name).read_text()
        ElementTree.fromstring(text)
        for word in [*words, "stop", "start", "turn", "scan"]:
            assert word in text


def test_the_page_needs_nothing_but_itself(folder):
    page = (folder / "report.html").read_text()
    assert not re.findall(r'(?:src|href)="(?!data:)', page) and "<script" not in page
    assert page.count("data:image/svg+xml;base64,") == 2
    assert f"twin reproduce laser-fisheye-imm --seeds {len(SEEDS)} --seed {SEEDS.start}" in page
    for result in json.loads((folder / "results.json").read_text()):
        written = Result(**{**result, "ci95": tuple(result["ci95"])})
        assert all(text in page for text in text_of(written))
    for words in ("no other figure or table", "figure 6 is lost", "No parameter was tuned"):
        assert words in page


def test_the_same_seeds_leave_the_same_files(folder, tmp_path):
    reproduce("laser-fisheye-imm", seeds=len(SEEDS), seed=SEEDS.start, out=tmp_path)
    for path in folder.iterdir():
        assert (tmp_path / path.name).read_bytes() == path.read_bytes(), path.name


def test_results_and_curves_share_their_replicates(runs):
    first, second = curves(runs)[0], curves(runs)[0]
    for name in FILTERS:
        np.testing.assert_array_equal(first.by_filter[name], second.by_filter[name])
    npe = next(result for result in figure7_results(runs) if (result.where, result.row) == (NPE, IMM))
    assert npe.ci95[0] == np.quantile(first.by_filter[IMM].mean(axis=1)[1:], 0.025)


def test_bad_input_is_named():
    with pytest.raises(InputError, match="'laser'; valid are laser-fisheye-imm, gait"):
        reproduce("laser")
    with pytest.raises(InputError, match="--seeds 1: .* 2 or more"):
        reproduce("laser-fisheye-imm", seeds=1)


def test_a_place_that_cannot_be_written_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        reproduce("laser-fisheye-imm", seeds=2, out=tmp_path / "file")


def test_as_a_command(tmp_path: Path, monkeypatch):
    import typer

    monkeypatch.chdir(tmp_path)
    app = typer.Typer(rich_markup_mode=None)
    app.command()(reproduce)
    done = CliRunner().invoke(app, ["laser-fisheye-imm", "--seeds", "3"])
    assert done.exit_code == 0, done.output
    assert "NPE, mean over scans" in done.stdout and "report.html" in done.stdout
    assert (tmp_path / "out" / "reproduce-laser-fisheye-imm" / "results.json").is_file()


def test_spans_in_words():
    assert spans_text(np.array([], int)) == "none"
    assert spans_text(np.array([3, 7, 8, 9, 12])) == "3, 7–9, 12"
