"""Table I's arithmetic: sums, pairs by seed, intervals, where a column breaks, and what an occlusion excuses."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from twin.reproduce.laser_fisheye_imm.plots import _spread
from twin.reproduce.laser_fisheye_imm.runs import COLUMNS, FULL, IMM, KALMAN, LabCondition, LongOcclusion
from twin.reproduce.laser_fisheye_imm.table_one import (
    LOST,
    MISIDENTIFIED,
    TOTAL,
    breaks_at,
    cell,
    difference,
    error_rate,
    filters_difference,
    paper_value,
    statements,
    system_value,
)
from twin.reproduce.results import POISSON_ZERO_UPPER, Bootstrap
from twin.reproduce.suite_runs import round_robin

N = 8
NONE = np.zeros(N)
SOME = np.array([0, 1, 0, 2, 0, 1, 0, 3.0])


def condition(
    misidentified: dict[str, np.ndarray], lost: dict[str, np.ndarray] | None = None, hidden=(), n_person: int = 5
) -> LabCondition:
    """A made-up condition: events by tracker, none where nothing is said."""
    figures = {
        column.tracker: {
            "misidentifications": misidentified.get(column.tracker, NONE),
            "lost_tracks": (lost or {}).get(column.tracker, NONE),
            "mota": np.full(N, 0.98),
            "idf1": np.full(N, 0.985),
            "motp_m": np.linspace(0.06, 0.08, N),
        }
        for column in COLUMNS
    }
    return LabCondition(
        name=f"people-{n_person}",
        overrides=(),
        seeds=tuple(range(1000, 1000 + N)),
        n_person=n_person,
        person_minutes=np.full(N, n_person * 26.2 / 60),
        metrics=figures,
        long_occlusions=tuple(hidden),
        incidents=(),
    )


def by(filter_: str) -> dict[str, np.ndarray]:
    return {column.tracker: SOME for column in COLUMNS if column.filter == filter_}


def test_the_paper_s_figures_are_where_it_prints_them() -> None:
    assert [paper_value(column, MISIDENTIFIED) for column in COLUMNS] == [0, 3, 3, None, None, None]
    assert [paper_value(column, LOST) for column in COLUMNS] == [0, 5, 8, None, None, None]
    assert [paper_value(column, TOTAL) for column in COLUMNS] == [0, 8, 11, None, None, None]
    assert paper_value(FULL, "MOTA") is None


def test_a_cell_is_the_mean_over_runs_within_its_interval() -> None:
    made = condition({FULL.tracker: SOME}, {FULL.tracker: SOME[::-1]})
    found = cell(made, FULL.tracker, TOTAL)
    assert found.value == pytest.approx((SOME + SOME[::-1]).mean())
    assert found.low < found.value < found.high
    assert cell(made, FULL.tracker, MISIDENTIFIED).value == pytest.approx(SOME.mean())
    assert cell(made, FULL.tracker, "MOTP").value == pytest.approx(0.07)


def test_the_papers_systems_and_the_baseline_stand_beside_ours_where_they_were_run() -> None:
    made = condition({})
    assert system_value(made, FULL.paper_tracker, MISIDENTIFIED) is None
    figures = made.metrics[FULL.tracker]
    papers = {each.paper_tracker: figures | {"lost_tracks": SOME} for each in COLUMNS}
    unfinished = figures | {"lost_tracks": np.full(N, np.nan)}
    full = replace(made, metrics={**made.metrics, **papers, "sort": unfinished})
    found = system_value(full, FULL.paper_tracker, LOST)
    assert found is not None and (found.tracker, found.value) == ("laser-fisheye-imm-paper", SOME.mean())
    assert system_value(full, FULL.baseline, LOST) is None
    assert {each.baseline for each in COLUMNS} == {"sort", None}
    assert filters_difference(full, paper=True).value == 0
    assert any("rules alone" in each.text for each in statements(full))


def test_a_figure_that_some_runs_lack_is_the_mean_of_the_others() -> None:
    made = condition({})
    made.metrics[FULL.tracker]["mota"][:2] = np.nan
    assert cell(made, FULL.tracker, "MOTA").value == pytest.approx(0.98)


def test_no_event_in_any_run_leaves_an_upper_end() -> None:
    found = cell(condition({}), FULL.tracker, MISIDENTIFIED)
    assert (found.value, found.low) == (0, 0)
    # Poisson: with this mean a run, n runs without any have a chance of 2.5 %
    assert np.exp(-found.high * N) == pytest.approx(0.025)
    assert abs(POISSON_ZERO_UPPER - 3.689) < 1e-3


def test_rates_divide_by_what_was_watched() -> None:
    bootstrap = Bootstrap(2, np.random.default_rng(0), 400)
    found = bootstrap.rate(np.array([1.0, 3.0]), np.array([10.0, 10.0]))
    assert (found.value, found.low, found.high) == pytest.approx((0.2, 0.1, 0.3))
    assert bootstrap.rate(np.array([1.0, 3.0]), np.array([30.0, 10.0])).value == pytest.approx(0.1)


def test_differences_are_paired_by_seed() -> None:
    noisy = np.array([0, 5, 1, 7, 2, 9, 3, 4.0])
    kalman = COLUMNS[3]
    assert (kalman.filter, kalman.sensors) == (KALMAN, FULL.sensors)
    made = condition({FULL.tracker: noisy, kalman.tracker: noisy + 1})
    found = difference(made, FULL.tracker, kalman.tracker)
    assert (found.value, found.low, found.high) == pytest.approx(
        (-1, -1, -1)
    )  # however much the runs themselves differ
    shuffled = condition({FULL.tracker: noisy, kalman.tracker: noisy[::-1] + 1})
    wide = difference(shuffled, FULL.tracker, kalman.tracker)
    assert wide.value == pytest.approx(-1) and wide.low < -2 < 0 < wide.high


def test_where_no_run_differs_the_interval_goes_both_ways() -> None:
    found = difference(condition(by(IMM) | by(KALMAN)), FULL.tracker, COLUMNS[3].tracker)
    assert found.value == 0 and -found.low == found.high == pytest.approx(POISSON_ZERO_UPPER / N)


def test_filters_are_compared_over_all_sensor_sets() -> None:
    assert filters_difference(condition(by(KALMAN))).value == pytest.approx(-3 * SOME.mean())
    assert filters_difference(condition(by(IMM))).value == pytest.approx(3 * SOME.mean())
    one_better_one_worse = condition({COLUMNS[0].tracker: SOME, COLUMNS[4].tracker: SOME})
    assert filters_difference(one_better_one_worse).value == 0


def test_a_column_breaks_where_its_interval_leaves_zero() -> None:
    rare = np.array([0, 0, 0, 0, 0, 0, 0, 4.0])
    calm, shaky, broken = (
        condition({FULL.tracker: events}, n_person=n) for n, events in ((3, NONE), (5, rare), (8, SOME + 1))
    )
    assert error_rate(shaky, FULL).value > 0 and error_rate(shaky, FULL).low == 0
    assert breaks_at([calm, shaky, broken], FULL) is broken
    assert breaks_at([calm, shaky], FULL) is None
    rate = error_rate(broken, FULL)
    assert rate.value == pytest.approx((SOME + 1).sum() / (N * 8 * 26.2 / 60))


def hidden_in(seed: int, lost: bool = True) -> LongOcclusion:
    return LongOcclusion(seed, "blue", 3.0, 5.0, lost)


def test_a_loss_is_excused_in_a_run_with_a_long_occlusion_alone() -> None:
    lost = {FULL.tracker: np.array([1, 0, 0, 0, 0, 0, 0, 2.0])}
    hidden = [hidden_in(1000), hidden_in(1000), hidden_in(1003, lost=False)]
    _, found, *_ = statements(condition({}, lost, hidden))
    assert found.verdict == "does not hold" and found.evidence.startswith("2 lost in 6 such runs; 1 in the other 2,")
    _, found, *_ = statements(condition({}, lost, [hidden_in(1000), hidden_in(1007)]))
    assert found.verdict == "holds" and found.evidence.startswith("0 lost in 6 such runs; 3 in the other 2,")


def test_statements_say_what_the_runs_show() -> None:
    good = condition({column.tracker: SOME for column in COLUMNS[1:3]} | {c.tracker: SOME + 1 for c in COLUMNS[3:]})
    assert [each.verdict for each in statements(good)] == ["holds"] * 5 + ["does not hold", "holds"]  # IDF1 is 0.985
    lost = {FULL.tracker: np.eye(N)[0]}
    bad = list(statements(condition({FULL.tracker: SOME}, lost)))
    assert [each.verdict for each in bad[:4]] == ["does not hold"] * 4
    excused = list(statements(condition({}, lost, [hidden_in(1000)])))
    assert excused[0].verdict == excused[1].verdict == "holds" and "1 in the other 1" in excused[1].evidence
    doubtful = list(statements(condition({COLUMNS[3].tracker: np.eye(N)[0]})))
    assert doubtful[3].verdict == "not decided"


def test_strips_show_every_run_and_kind_before_the_same_again() -> None:
    class Made:
        def __init__(self, name: str) -> None:
            self.case = self.incident = self
            self.name, self.kind, self.seed = name, name[0], int(name[1])

    made = [Made(name) for name in ("m0", "m0", "l0", "m0", "m1", "m1")]
    assert [each.case.name for each in round_robin(made)] == ["m0", "l0", "m1", "m0", "m1", "m0"]  # pyright: ignore


def test_equal_runs_stand_side_by_side() -> None:
    off = _spread(np.array([0, 1, 0, 0, 2.0]))
    assert off[1] == off[4] == 0
    assert all(second > first for first, second in pairwise(sorted(off[[0, 2, 3]])))
    assert np.abs(_spread(np.zeros(100))).max() < 0.5
