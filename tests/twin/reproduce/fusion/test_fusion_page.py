"""Results of `twin reproduce fusion`: subsets, the best of the others, the page, and the suites it refuses."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from trackers.errors import InputError
from twin.reproduce.fusion.reproduction import GROUNDS, HOME, OURS, SILENT, SUBSETS, check_suite, subsets, write_all
from twin.reproduce.results import ResultRow
from twin.suites.spec import load_suite

NAMES = ("floor", "waist", "knee", "fisheye", "camera_1", "camera_2")


def test_each_sensor_alone_and_each_left_out_come_first_and_all_subsets_are_63() -> None:
    first, every = list(subsets(NAMES, None)), list(subsets(NAMES, 63))
    assert first == every[: len(first)] and len(set(every)) == 63 and first[0] == NAMES
    assert {len(each) for each in first} == {1, 5, 6} and len(first) == 13
    assert list(subsets(("waist",), None)) == [("waist",)]


def test_the_page_names_the_best_of_the_others(tmp_path) -> None:
    hota = {OURS: 0.9, "laser-imm": 0.8, "sort": 0.85}
    cases = {seed: {name: SimpleNamespace(id=f"{name}-{seed}") for name in hota} for seed in (1000, 1001)}
    metrics = {
        f"{name}-{seed}": {"hota": value + 0.01 * (seed - 1000), "ms_per_frame.mean": 2.0}
        for name, value in hota.items()
        for seed in cases
    }
    runs: Any = SimpleNamespace(by_condition={"hall": cases}, metrics=metrics, not_done=())
    replayed = [
        ResultRow(where, row, "HOTA", None, 0.5, (0.4, 0.6), "1", 2)
        for where, row in ((SUBSETS, "floor"), (SILENT, "waist"))
    ]
    results, paths = write_all(tmp_path, runs, replayed, "twin reproduce fusion")
    found = next(each for each in results if (each.where, each.row, each.column) == (GROUNDS, "hall", "HOTA"))
    assert found.baseline is not None and found.baseline.tracker == "sort"
    assert found.ours == pytest.approx(0.905) and found.baseline.value == pytest.approx(0.855)
    assert "sort" in paths["page"].read_text()


def test_a_suite_without_the_home_is_refused() -> None:
    suite, path = load_suite("fusion")
    check_suite(suite, path)
    without = [entry for entry in suite.scenarios if entry.name != HOME]
    with pytest.raises(InputError, match=HOME):
        check_suite(suite.model_copy(update={"scenarios": without}), path)
