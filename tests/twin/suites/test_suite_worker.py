"""A case as it is recorded, kept, tracked and evaluated, beside a plain run of the same."""

from __future__ import annotations

import warnings
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import cv2
import numpy as np
import pytest

from trackers.errors import InputError
from trackers.rig import Rig
from twin.recording.reader import Recording
from twin.report.birdseye import plan_width_px
from twin.run.live import run_scenario
from twin.scenario import load_scenario
from twin.suites import worker
from twin.suites.cache import RecordingCache
from twin.suites.cache_keys import whole_code
from twin.suites.expansion import Case, expand
from twin.suites.filmstrip import FilmstripWork, draw_filmstrip, people_shown, times_within
from twin.suites.metrics import flatten_metrics
from twin.suites.spec import load_suite
from twin.suites.worker import CaseWork, run_case
from twin.truth.truth_types import PersonTruth, TruthFrame

pytestmark = pytest.mark.slow

SUITE = """
name: short
seeds: [3]
trackers: [laser-fisheye-imm, laser-imm]
scenarios:
  - scenario: lab-five-people
    set:
      duration_s: 2
      faults: {late: {sensor: waist, kind: dropout, probability: 1, from_s: 9}}
      sensors.fisheye.size: [240, 240]
      trackers.laser-imm: {trunk: {variance_m2: 0.02}}
"""


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> RecordingCache:
    return RecordingCache(tmp_path_factory.mktemp("cache"), 10**9)


@pytest.fixture(scope="module")
def cases(tmp_path_factory: pytest.TempPathFactory) -> list[Case]:
    path = tmp_path_factory.mktemp("suite") / "short.yaml"
    path.write_text(SUITE)
    return expand(*load_suite(path))


def without_cost(metrics: dict) -> dict:
    return {name: value for name, value in flatten_metrics(metrics).items() if not name.startswith("ms_per_frame")}


def test_a_case_has_the_figures_of_a_run_and_the_second_tracker_renders_nothing(
    cases: list[Case], cache: RecordingCache, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scenario = load_scenario("lab-five-people", [*cases[0].overrides, "seed=3"])
    document = run_scenario(scenario, trackers=[case.tracker for case in cases], out=tmp_path, video=False).metrics
    assert document is not None
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # what a scenario warns of is a result
        first = run_case(CaseWork(cases[0], cache, whole_code()))
    assert "OpenGL" in first.renderer
    monkeypatch.setattr(worker, "run_scenario", None)  # whoever records now fails
    second = run_case(CaseWork(cases[1], cache, whole_code()))
    for case, result in zip(cases, (first, second), strict=True):
        assert without_cost(result.metrics) == without_cost(document["trackers"][case.tracker])
        assert set(result.files) == {"report.html", "metrics.json", f"tracks/{case.tracker}.csv"}
        assert any("faults.late.from_s: 9 s is not before the end" in each for each in result.scenario_warnings)
        assert not any("faults.late" in each for each in result.tracker_warnings)
        assert result.incidents[0].kind == "worst" and 1.0 <= result.incidents[0].t_s <= 2.0
    short = run_case(CaseWork(replace(cases[1], report=False), cache, whole_code()))
    assert without_cost(short.metrics) == without_cost(second.metrics) and short.incidents == second.incidents
    tracks = f"tracks/{cases[1].tracker}.csv"
    assert set(short.files) == {"metrics.json", tracks} and short.files[tracks] == second.files[tracks]


def test_a_case_whose_people_moved_before_is_recorded_to_the_same_bits(cases: list[Case], tmp_path: Path) -> None:
    caches = [RecordingCache(tmp_path / name, 10**9) for name in ("anew", "moved")]
    anew, moved = (
        run_case(CaseWork(cases[1], each, whole_code(), same_people=same))
        for each, same in zip(caches, (False, True), strict=True)
    )
    assert moved.recording == anew.recording
    assert without_cost(moved.metrics) == without_cost(anew.metrics)
    assert [each.size()[0] for each in caches] == [1, 2]  # the motion lies beside the recording


@pytest.mark.parametrize("t_s", [1.0, 1.95])
def test_the_worst_moment_is_drawn_in_three_pictures_also_at_the_end(
    t_s: float, cases: list[Case], cache: RecordingCache
) -> None:
    jpeg = draw_filmstrip(FilmstripWork(cases[1], cache, t_s))
    picture = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
    assert picture is not None and picture.shape[0] == 360 and picture.shape[1] % 3 == 0
    thirds = np.split(picture.astype(np.int16), 3, axis=1)
    assert all(np.abs(one - other).mean() > 1 for one, other in pairwise(thirds))


def test_the_strip_of_a_case_beside_another_has_a_row_of_each(cases: list[Case], cache: RecordingCache) -> None:
    jpeg = draw_filmstrip(FilmstripWork(cases[1], cache, 1.0, beside=cases[0]))
    picture = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
    assert picture is not None and picture.shape[0] == 720
    own = draw_filmstrip(FilmstripWork(cases[1], cache, 1.0))
    above = cv2.imdecode(np.frombuffer(own, np.uint8), cv2.IMREAD_COLOR)
    assert (
        np.abs(picture[:360].astype(np.int16) - above).mean()
        < 1
        < np.abs(picture[360:].astype(np.int16) - above).mean()
    )


def test_a_strip_shows_the_people_in_the_area_alone_where_the_room_is_much_larger() -> None:
    far = PersonTruth(3, 40.0, 0.0, in_area=False)
    frames = [TruthFrame(n * 10**9, (PersonTruth(1, 10.0 + n, 5.0), PersonTruth(2, 12.0, 7.0), far)) for n in range(9)]
    bag = cast(Recording, SimpleNamespace(truth=lambda: iter(frames)))
    shown = people_shown(bag, [2.0, 3.0, 4.0], np.array([[-25.0, -25.0], [25.0, 25.0]]))
    assert shown is not None and shown.tolist() == [[12 - 2.5, 5 - 2.5], [14 + 2.5, 7 + 2.5]]
    assert people_shown(bag, [2.0, 3.0, 4.0], np.array([[8.0, 2.0], [16.0, 10.0]])) is None
    assert people_shown(bag, [20.0, 21.0], np.array([[-25.0, -25.0], [25.0, 25.0]])) is None
    assert plan_width_px(Rig.model_construct(), (), 300, shown) == 300  # a square, as that of the people


@pytest.mark.parametrize("duration_s", [0.5, 1.8, 2.0, 8.0, 60.0])
def test_the_times_of_a_strip_lie_within_the_run_and_about_its_worst_one(duration_s: float) -> None:
    for t_s in np.linspace(0, duration_s, 21):
        times = times_within(float(t_s), duration_s)
        assert len(times) == 3 and times == sorted(times) and times[0] >= 0
        if duration_s > 1.75:
            assert times[-1] < duration_s and times[0] <= t_s <= times[-1] + 0.15 + 1e-9


def test_a_worker_with_other_code_refuses(cases: list[Case], cache: RecordingCache) -> None:
    with pytest.raises(InputError, match=r"the worker's code is not that of the suite's process"):
        run_case(CaseWork(cases[0], cache, "0123"))


def test_a_case_whose_evaluation_is_above_a_limit_is_refused_with_that(
    cases: list[Case], cache: RecordingCache, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("twin.evaluate.summary.MOST_PAIRS", 10)
    said = r"^laser-imm: is not evaluated; tracks/laser-imm\.csv: its frames hold \d+ pairs .*, or --no-limits, is expected$"
    with pytest.raises(InputError, match=said):
        run_case(CaseWork(replace(cases[1], report=False), cache, whole_code()))
