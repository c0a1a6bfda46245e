"""Results and files of `twin reproduce laser-vision-learning`, and what it refuses."""

from __future__ import annotations

import re
import sqlite3
from pathlib import Path

import numpy as np
import pytest
from results_file import checked_results

from trackers.errors import InputError
from twin.commands.batch import reproduce
from twin.reproduce.laser_vision_learning.results import (
    ACCURACY,
    AFTER,
    CORRELATED,
    COST,
    MERGES,
    RELATIVE,
    TABLE_GROUPS,
    TABLE_ONE,
    TABLE_TWO,
    cost_fit,
    hall_results,
)
from twin.reproduce.laser_vision_learning.runs import (
    BASELINE,
    FUSED,
    LASER,
    NO_LEARNING,
    PAPER_SYSTEMS,
    SYSTEMS,
    VISION,
    HallCondition,
    HallRuns,
    PlaceStatistics,
    check_suite,
)
from twin.suites.spec import load_suite

SHORT = """
name: short
description: The busy place as the hall and as itself, short, crowded and without pictures.
reports: false
trackers: [laser-vision-learning-laser, sort]
set: {duration_s: 4, sensors.camera: null, sensors.west.rate_hz: 7, sensors.east.rate_hz: 7}
scenarios:
  - {scenario: library-hall-busy, name: hall}
  - {scenario: library-hall-busy, name: busy, set: {area: [[-3, -2], [3, -2], [3, 2], [-3, 2]]}}
  - {scenario: library-hall-busy, name: people-3, set: {duration_s: 2, people: {p01: {}, p02: {}, p03: {}}}}
  - scenario: library-hall-busy
    name: east-silent
    set: {duration_s: 2, people: {p01: {}, p02: {}}, faults: {silent: {sensor: east, kind: dropout, from_s: 1}}}
"""


def condition(name: str, n_run: int = 4, people: float = 10.0, close: float = 2.0) -> HallCondition:
    """A made-up condition of the three systems: what a frame costs is 1 ms, 0.2 a person and 0.5 one who interacts."""
    ones = np.ones(n_run)
    figures = {}
    trackers = (*SYSTEMS, *PAPER_SYSTEMS.values(), BASELINE, NO_LEARNING)
    for place, tracker in enumerate(trackers if name.startswith("groups") else SYSTEMS):
        figures[tracker] = {
            "failures.person_frames": 1000 * ones,
            "failures.missed": 10.0 * (place + np.arange(n_run)),
            "failures.false_location": 5 * ones,
            "failures.identity_wrong": 2 * ones,
            "disposal.correlated.total": 40 * ones,
            "disposal.correlated.disposed": 40 * ones - place,
            "disposal.merge_split.total": np.arange(n_run) + 1.0,
            "disposal.merge_split.disposed": np.arange(n_run) * 1.0,
            "disposal.identity_after.total": 10 * ones,
            "disposal.identity_after.disposed": 10 * ones - place,
            "mota": 0.9 * ones, "idf1": 0.8 * ones, "hota": 0.7 * ones,
            "ms_per_frame.mean": (1 + 0.2 * people + 0.5 * close) * ones * (place + 1),
            "ms_per_frame.p95": 20 * ones,
        }  # fmt: skip
    place = PlaceStatistics(
        frames=100 * ones,
        people=100 * people * ones,
        interacting=100 * close * ones,
        correlated=64 * ones,
        merges=2 * ones,
        merged=9 * ones,
        minutes=0.5 * ones,
        merge_s=np.array([0.4, 0.6, 1.2]),
    )
    return HallCondition(name, tuple(range(n_run)), figures, place)


def results_of(*conditions: HallCondition) -> dict[tuple[str, str, str], tuple[float | None, float]]:
    runs = HallRuns({each.name: each for each in conditions}, None, None, ())  # pyright: ignore[reportArgumentType]
    return {(each.where, each.row, each.column): (each.paper, each.ours) for each in hall_results(runs)}


def test_the_tables_are_sums_over_runs_with_the_papers_values() -> None:
    found = results_of(condition("hall"), condition("busy"))
    assert found[TABLE_ONE, CORRELATED, "vision only"] == (66.96, pytest.approx(100 * 38 / 40))
    assert found[TABLE_ONE, MERGES, "fused"] == (81.75, pytest.approx(100 * 6 / 10))
    assert found[TABLE_TWO, ACCURACY, "fused"] == (89.53, pytest.approx(100 * (1 - (60 + 20 + 8) / 4000)))
    assert found[TABLE_TWO, MERGES, "fused"][0] is None
    assert found[TABLE_TWO, RELATIVE, "fused"] == (pytest.approx(0.2188, abs=1e-4), pytest.approx(1 / 3))
    assert found[TABLE_TWO, COST, "laser only"] == (None, pytest.approx(8.0))
    assert found["the place", "merges a minute", "busy"] == (None, pytest.approx(4.0))
    assert found["the place", "merged pairs a frame", "busy"] == (pytest.approx(0.0895), pytest.approx(0.09))
    assert found["the place", "merges, median duration", "busy"] == (None, pytest.approx(0.6))
    assert found["the place", "share of them interacting", "hall"] == (16.35, pytest.approx(20.0))
    assert found["the place", "merges of 0.5 s or more", "hall"] == (None, pytest.approx(200 / 3))


def test_people_in_groups_have_four_columns_and_differences_paired_by_run() -> None:
    runs = HallRuns(
        {each: condition(each) for each in ("hall", "busy", "groups", "groups-one-scanner")}, None, None, ()
    )  # pyright: ignore[reportArgumentType]
    found = {(each.row, each.column): each for each in hall_results(runs) if each.where == TABLE_GROUPS}
    row = found[AFTER, "fused"]
    assert (row.paper, row.ours) == (None, pytest.approx(100))
    assert row.paper_system is not None and row.paper_system.value == pytest.approx(70)
    assert row.baseline is not None and (row.baseline.tracker, row.baseline.value) == ("sort", pytest.approx(40))
    assert found[ACCURACY, "laser only"].paper == 73.37
    assert found[f"{AFTER}, fused over without learning", "difference"].ours == pytest.approx(70)
    assert found[f"one scanner: {AFTER}", "fused"].ours == pytest.approx(100)
    assert runs.changed == []


def test_the_cost_of_a_change_of_the_hall_is_paired_by_seed() -> None:
    changed = condition("lights-out", n_run=3)
    changed.metrics[FUSED]["failures.missed"][:] += 30
    found = results_of(condition("hall"), condition("busy"), changed)
    where = "beyond the paper, changed"
    assert found[where, "lights-out, loss of accuracy", "fused"] == (None, pytest.approx(3.0))
    assert found[where, "lights-out, loss of accuracy", "laser only"] == (None, pytest.approx(0.0))


def test_the_fit_of_costs_finds_the_line() -> None:
    crowds = [condition(f"people-{n}", people=n, close=close) for n, close in ((5, 1.0), (15, 6.0), (25, 8.0))]
    fit = cost_fit(crowds, FUSED)
    assert fit is not None
    np.testing.assert_allclose(fit, [1, 0.2, 0.5, 1], atol=1e-9)
    assert cost_fit(crowds[:1], LASER) is None
    assert VISION in crowds[0].trackers


def test_a_suite_without_the_hall_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "short.yaml"
    path.write_text(SHORT.replace("name: hall}", "name: room}"))
    with pytest.raises(InputError, match="none is named hall; one, the place of table II, is expected"):
        check_suite(*load_suite(str(path)))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("reproduce")
    (out / "short.yaml").write_text(SHORT)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROOMTWIN_CACHE", str(out / "cache"))
        reproduce("laser-vision-learning", seeds=2, seed=1600, suite=str(out / "short.yaml"), jobs=1, out=out / "there")
    return out / "there"


@pytest.mark.slow
def test_it_leaves_results_runs_plots_strips_and_a_page(folder: Path) -> None:
    names = {path.name for path in folder.iterdir()}
    assert names == {"results.json", "runs.csv", "report.html", "suite", "strips", "figure11.svg", "densities.svg"}
    page = (folder / "report.html").read_text()
    words = re.sub(r"base64,[A-Za-z0-9+/=]+", "", page)
    assert "None" not in words and "nan" not in words.replace("nano", "")
    assert page.count("data:image/jpeg") == len(list((folder / "strips").iterdir())) >= 1
    assert len((folder / "runs.csv").read_text().splitlines()) == 1 + 4 * 2 * 2


@pytest.mark.slow
def test_its_figures_are_those_of_the_suite(folder: Path) -> None:
    rows = checked_results(folder)
    for row in rows:
        assert (row["ci95"][0] <= row["ours"] + 1e-9 and row["ours"] - 1e-9 <= row["ci95"][1]) or row["runs"] == 2
    found = {(row["where"], row["row"], row["column"]): row["ours"] for row in rows}
    query = "SELECT SUM(value) FROM results WHERE scenario = 'hall' AND tracker = ? AND metric = ?"
    with sqlite3.connect(folder / "suite" / "results.sqlite") as connection:

        def total(metric: str) -> float:
            return connection.execute(query, (LASER, metric)).fetchone()[0]

        failures = sum(total(f"failures.{kind}") for kind in ("missed", "false_location", "identity_wrong"))
        expected = 100 * (1 - failures / total("failures.person_frames"))
    assert found[TABLE_TWO, ACCURACY, "laser only"] == pytest.approx(expected)
