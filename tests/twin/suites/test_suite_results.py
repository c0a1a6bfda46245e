"""Trackers compared with one of them, paired by case; charts of a metric."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from trackers.errors import InputError
from twin.suites.dask_runner import suite_progress
from twin.suites.filmstrip import colour_of, marker
from twin.suites.results import (
    Group,
    GroupKey,
    Results,
    differences_by_scenario,
    differences_from,
    note_on_frames,
    worst_cases,
)
from twin.suites.spec import Suite, load_suite
from twin.suites.tasks import State


def results(**by_tracker: list[float | None]) -> Results:
    """MOTA of each tracker, a seed a value; None: that case is not done. Switches are ten less a hundred times that."""
    groups = {}
    for tracker, values in by_tracker.items():
        done = {
            seed: {"mota": value, "id_switches": 100 - 100 * value}
            for seed, value in enumerate(values)
            if value is not None
        }
        groups[GroupKey("lab", "[]", tracker)] = Group("", done)
    return Results("ablation", {}, (), groups)


def test_differences_are_paired_by_seed():
    spread = [0.1, 0.5, 0.9, 0.3, 0.7, 0.2]
    found = {
        row.tracker: row
        for row in differences_from(results(ours=spread, less=[each - 0.02 for each in spread]), "ours")
    }
    assert set(found) == {"less"}
    less = found["less"]
    assert less.n_case == 6
    assert less.differences["mota"].mean == pytest.approx(-0.02)
    assert less.differences["mota"].high == pytest.approx(-0.02)  # unpaired the spread would hide it
    assert less.verdict("mota") == less.verdict("id_switches") == "worse"
    assert less.differences["idf1"] is None and less.verdict("idf1") == ""


def test_only_cases_that_both_have_done_count():
    (row,) = differences_from(results(ours=[0.5, None, 0.7], other=[0.6, 0.9, None]), "ours")
    assert row.n_case == 1
    assert row.differences["mota"].mean == pytest.approx(0.1)
    assert row.verdict("mota") == ""  # one case has no interval


def test_no_difference_is_no_verdict():
    (row,) = differences_from(results(ours=[0.5, 0.6, 0.7], other=[0.6, 0.5, 0.7]), "ours")
    assert row.verdict("mota") == ""


def test_counts_over_frames_are_compared_as_rates_and_different_frames_are_said() -> None:
    """Each tracker has a false positive in every hundredth person-frame; one reports half as often."""
    frames = {"often": 400, "seldom": 200}
    groups = {
        GroupKey(room, "[]", tracker): Group(
            "", {seed: {"false_positives": n / 100, "id_switches": 2, "judged.person_frames": n} for seed in range(6)}
        )
        for room, n_of in {"lab": frames, "hall": {"often": 300, "seldom": 300}}.items()
        for tracker, n in n_of.items()
    }
    (row,) = differences_from(Results("made-up", {}, (), groups), "often")
    false_positives, switches = row.differences["false_positives"], row.differences["id_switches"]
    assert false_positives is not None and false_positives.mean == pytest.approx(0) and switches.mean == 0
    note = note_on_frames(Results("made-up", {}, (), groups))
    assert note is not None and "(lab): often in 2400, seldom in 1200; each is evaluated at the stamps" in note
    same = {key: group for key, group in groups.items() if key.scenario == "hall"}
    assert note_on_frames(Results("made-up", {}, (), same)) is None
    unknown = {key: Group("", {0: {"mota": 0.5}}) for key in groups}
    assert note_on_frames(Results("made-up", {}, (), unknown)) is None


def hota_results(**by_scenario: dict[str, list[float]]) -> Results:
    """HOTA by scenario and tracker, one value per seed."""
    groups = {
        GroupKey(scenario, "[]", tracker): Group("", {seed: {"hota": value} for seed, value in enumerate(values)})
        for scenario, by_tracker in by_scenario.items()
        for tracker, values in by_tracker.items()
    }
    return Results("drawn", {}, (), groups)


def test_strata_add_up_and_the_cases_behind_are_counted_and_ranked():
    found = hota_results(
        one={"sort": [0.8, 0.8], "mine": [0.9, 0.7]},
        two={"sort": [0.5, 0.5, 0.5], "mine": [0.495, 0.2, 0.6]},
    )
    (whole,) = differences_from(found, "sort")
    strata = differences_by_scenario(found, "sort")
    assert whole.behind == pytest.approx(2 / 5)  # by .005 is not behind
    assert [rows[0].behind for rows in strata.values()] == pytest.approx([1 / 2, 1 / 3])
    total = sum(rows[0].n_case * rows[0].differences["hota"].mean for rows in strata.values())
    assert total == pytest.approx(whole.n_case * whole.differences["hota"].mean)
    worst = worst_cases(found, "sort")
    assert [(case.key.scenario, case.seed) for case in worst] == [("two", 1), ("one", 1), ("two", 0)]


def test_a_suite_names_one_of_its_trackers(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("name: mine\ntrackers: [sort]\nreference: laser-imm\nscenarios: [{scenario: lab-five-people}]\n")
    with pytest.raises(InputError, match="reference: 'laser-imm' is none of the trackers; valid are sort"):
        load_suite(path)
    assert isinstance(load_suite("ablation")[0], Suite)


def test_a_suite_may_name_its_reference_as_version_0_1_did(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = tmp_path / "former.yaml"
    path.write_text("name: mine\ntrackers: [sort]\nbeside: sort\nscenarios: [{scenario: lab-five-people}]\n")
    assert load_suite(path)[0].reference == "sort"
    assert f"{path}: beside: is now called 'reference'" in caplog.text


def test_trackers_are_told_apart_when_the_colours_come_round_again() -> None:
    marks = [marker(place, 11, 7, "0.990") for place in range(24)]
    assert len(set(marks)) == 24 and colour_of(0) == colour_of(8)
    assert all("<title>0.990</title>" in each for each in marks)


def test_the_time_left_is_not_that_of_the_imports_before_the_first_case(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Two workers import for 20 s and then do a case in 2 s: of 36 cases, 35 s of work are left when one is done."""
    now = 1000.0
    monkeypatch.setattr("twin.suites.dask_runner.time.monotonic", lambda: now)
    estimates: dict[int, float] = {}
    with suite_progress() as progress:
        progress.state(State(waiting=34, running=2, done=0, failed=0, workers=2))
        now += 20.0
        for done in range(1, 36):
            now += 1.0
            monkeypatch.setattr("twin.suites.dask_runner._LINE_EVERY_S", -1.0)
            progress.state(State(waiting=max(34 - done, 0), running=min(36 - done, 2), done=done, failed=0, workers=2))
            if found := re.search(r"about (\d+) s left", capsys.readouterr().err):
                estimates[done] = float(found[1])
    assert set(estimates) == set(range(3, 36))
    assert all(estimate == pytest.approx(36 - done, rel=0.2, abs=1) for done, estimate in estimates.items())
