"""Results of `twin reproduce fusion`: subsets, tables, the best of the others, the page, and the suites it refuses."""

from __future__ import annotations

import json
from itertools import chain
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from trackers.errors import InputError
from twin.reproduce.fusion.reproduction import (
    COLUMNS,
    DENSITY,
    DRAWN,
    FAULTS,
    GROUNDS,
    HOME,
    OURS,
    SILENT,
    SUBSETS,
    TABLES,
    check_suite,
    replay_results,
    rows_of_ways,
    subsets,
    table_of,
    write_all,
)
from twin.reproduce.results import ResultRow
from twin.suites.metrics import METRICS
from twin.suites.spec import load_suite

NAMES = ("floor", "waist", "knee", "fisheye", "camera_1", "camera_2")


def test_each_sensor_alone_and_each_left_out_come_first_and_all_subsets_are_63() -> None:
    first, every = list(subsets(NAMES, None)), list(subsets(NAMES, 63))
    assert first == every[: len(first)] and len(set(every)) == 63 and first[0] == NAMES
    assert {len(each) for each in first} == {1, 5, 6} and len(first) == 13
    assert list(subsets(("waist",), None)) == [("waist",)]


@pytest.mark.parametrize("most", [None, 1, 63])
def test_others_track_the_same_subset_and_beside_a_silent_sensor_the_rig_without_it(most: int | None) -> None:
    rows = rows_of_ways(NAMES, most)
    for (table, row), (ours, theirs) in rows.items():
        assert theirs[1] is None
        if table == SUBSETS:
            assert ours == theirs
        else:
            assert ours == (NAMES, row) and set(theirs[0]) == set(NAMES) - {row}
    assert {row for table, row in rows if table == SILENT} == set(NAMES)


def metrics_of(hota: float) -> dict[str, float]:
    return {"hota": hota, "mota": hota - 0.1, "head_yaw_median_rad": np.pi, "head_error_m.x": np.nan}


def test_the_baseline_of_a_row_is_the_best_of_those_that_can_use_its_rig() -> None:
    rows = rows_of_ways(NAMES, None)
    rng = np.random.default_rng(1)
    tracked: dict[tuple[str, Any], list[dict[str, float] | None]] = {}
    for ours, theirs in rows.values():
        tracked[OURS, ours] = [metrics_of(each) for each in rng.uniform(0.4, 1, 3)]
        for name in ("laser-imm", "sort", "floor-kalman"):
            needed = "floor" if name == "floor-kalman" else "waist"
            values = rng.uniform(0.2, 1, 3)
            tracked[name, theirs] = [metrics_of(each) if needed in theirs[0] else None for each in values]
    results = replay_results(rows, tracked, 1000)
    for each in results:
        ours, theirs = rows[each.where, each.row]
        able = {
            name: np.mean([run["hota"] for run in runs if run])
            for (name, way), runs in tracked.items()
            if way == theirs and name != OURS and None not in runs
        }
        assert (each.baseline.tracker if each.baseline else None) == max(able, key=able.__getitem__, default=None)
        if each.column == "HOTA":
            assert each.ours == pytest.approx(np.mean([run["hota"] for run in tracked[OURS, ours] if run]))
            assert each.baseline is None or each.baseline.value == pytest.approx(max(able.values()))
    assert {each.column for each in results} == {"HOTA", "MOTA", "head yaw, median"}  # no row of NaN alone
    assert {round(each.ours) for each in results if each.unit == "°"} == {180}
    assert next(each for each in results if each.row == "camera_1" and each.where == SUBSETS).baseline is None


def test_the_page_names_the_best_of_the_others_and_has_a_table_for_each_group(tmp_path) -> None:
    hota = {OURS: 0.9, "laser-imm": 0.8, "sort": 0.85}
    cases = {seed: {name: SimpleNamespace(id=f"{name}-{seed}") for name in hota} for seed in (1000, 1001)}
    metrics = {
        f"{name}-{seed}": {"hota": value + 0.01 * (seed - 1000), "ms_per_frame.mean": 2.0, "idf1": None}
        for name, value in hota.items()
        for seed in cases
    }
    grounds = ("hall", "drawn-stereo", "density-30", "fault-clock")
    runs: Any = SimpleNamespace(by_condition=dict.fromkeys(grounds, cases), metrics=metrics, not_done=())
    replayed = [
        ResultRow(where, row, "HOTA", None, 0.5, (0.4, 0.6), "1", 2)
        for where, row in ((SUBSETS, "floor"), (SILENT, "waist"))
    ]
    results, paths = write_all(tmp_path, runs, replayed, "twin reproduce fusion")
    assert tuple(dict.fromkeys(each.where for each in results)) == TABLES
    found = next(each for each in results if (each.where, each.row, each.column) == (GROUNDS, "hall", "HOTA"))
    assert found.baseline is not None and found.baseline.tracker == "sort"
    assert found.ours == pytest.approx(0.905) and found.baseline.value == pytest.approx(0.855)
    page = paths["page"].read_text()
    assert "baseline: sort" in page and page.count('<table class="grid">') == len(TABLES) and "IDF1" not in page
    assert len(json.loads(paths["results"].read_text())) == len(results)


def test_tables_partition_the_suite_and_each_ground_has_this_tracker_and_another() -> None:
    suite, _ = load_suite("fusion")
    by_table: dict[str, list[str]] = {}
    for entry in suite.scenarios:
        by_table.setdefault(table_of(entry.name or entry.scenario), []).append(entry.name or entry.scenario)
        assert OURS in (entry.trackers or ()) and len(entry.trackers or ()) > 1
    assert list(by_table) == [GROUNDS, DRAWN, DENSITY, FAULTS] and min(map(len, by_table.values())) == 4
    names = list(chain.from_iterable(by_table.values()))
    assert len(set(names)) == len(names) == len(suite.scenarios)
    assert HOME in by_table[GROUNDS] and "lab" in by_table[GROUNDS]


def test_a_suite_without_the_home_or_with_a_tracker_of_its_own_there_is_refused() -> None:
    suite, path = load_suite("fusion")
    check_suite(suite, path)
    without = [entry for entry in suite.scenarios if entry.name != HOME]
    with pytest.raises(InputError, match=HOME):
        check_suite(suite.model_copy(update={"scenarios": without}), path)
    own = [
        entry.model_copy(update={"trackers": (OURS, "mine")}) if entry.name == HOME else entry
        for entry in suite.scenarios
    ]
    with pytest.raises(InputError, match="'mine' is defined by the suite"):
        check_suite(suite.model_copy(update={"scenarios": own}), path)


def test_metrics_of_the_tables_are_those_of_metrics_json() -> None:
    assert {name for name, *_ in COLUMNS} <= METRICS.keys()
