"""Worse is what is worse, and nothing else."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest

from twin.suites.comparison import compare, holm
from twin.suites.figures import GATED, allowed_by_default
from twin.suites.results import Group, GroupKey, Results, mean_over_seeds

TRACKERS = ("full", "lasers")
SCENARIOS = tuple(f"room-{k}" for k in range(6))
SPREAD = {"mota": 0.02, "motp_m": 0.005, "idf1": 0.03, "hota": 0.02, "misidentifications": 0.6}
"""How much a figure differs between seeds."""
NOISE = {"mota": 0.001, "motp_m": 0.0004, "idf1": 0.003, "hota": 0.003, "misidentifications": 0.2}
"""How much a harmless change moves it."""


def results(
    noise: int | None = None,
    n_seed: int = 3,
    shift: Mapping[str, float] | None = None,
    renderer: str = "llvmpipe",
    **more: object,
) -> Results:
    """A suite's figures; `noise` draws a harmless change, `shift` is added to the tracker `full`'s in room-0."""
    base, change = np.random.default_rng(1), np.random.default_rng(noise)
    groups = {}
    for scenario in SCENARIOS:
        for tracker in TRACKERS:
            seeds = {}
            for seed in range(n_seed):
                figures = {}
                for metric, spread in SPREAD.items():
                    value = 0.9 + spread * base.standard_normal() if metric != "motp_m" else 0.07
                    if metric == "misidentifications":
                        value = float(base.poisson(spread))
                    if noise is not None:
                        moved = NOISE[metric] * change.standard_normal()
                        value += round(moved) if metric == "misidentifications" else moved
                    if scenario == "room-0" and tracker == "full":
                        value += (shift or {}).get(metric, 0.0)
                    figures[metric] = value
                seeds[seed] = figures
            groups[GroupKey(scenario, "[]", tracker)] = Group("", tracker == "full", seeds)
    return Results("made-up", {"mujoco": "4.0.0", **more}, (renderer,), groups)


def judged(before: Results, now: Results) -> list[tuple[str, str, str]]:
    found = compare(before, now, allowed_by_default)
    return [(change.key.scenario, change.key.tracker, change.metric) for change in found.worse]


def test_nothing_changed_is_nothing_worse_and_nothing_better() -> None:
    found = compare(results(), results(), allowed_by_default)
    assert not found.worse and not found.better and not found.warnings
    assert len(found.changes) == len(SCENARIOS) * len(TRACKERS) * len(SPREAD)


@pytest.mark.parametrize("noise", range(20))
def test_harmless_changes_raise_no_alarm(noise: int) -> None:
    assert judged(results(), results(noise)) == []


@pytest.mark.parametrize(
    ("metric", "by"), [("mota", -0.03), ("motp_m", 0.01), ("hota", -0.04), ("misidentifications", 2.0)]
)
def test_a_figure_that_gets_worse_in_every_seed_is_caught_and_no_other(metric: str, by: float) -> None:
    now = results(noise=3, shift={metric: by})
    assert judged(results(), now) == [("room-0", "full", metric)]
    change = compare(results(), now, allowed_by_default).worse[0]
    assert change.n_seed == 3 and change.worst_seed in range(3)
    assert min(change.low, change.high) <= change.change <= max(change.low, change.high)
    assert change.change == pytest.approx(by, abs=5 * NOISE[metric])


def test_what_gets_better_is_no_alarm() -> None:
    found = compare(results(), results(shift={"hota": 0.05}), allowed_by_default)
    assert not found.worse and [change.metric for change in found.better] == ["hota"]


def test_the_tolerance_holds_where_the_interval_alone_would_alarm() -> None:
    now = results(shift={"motp_m": 0.0008})
    change = next(each for each in compare(results(), now, allowed_by_default).changes if each.change > 0)
    assert change.significant and not change.worse
    assert compare(results(), now, lambda metric, before: 0.0005).worse == [
        next(each for each in compare(results(), now, lambda metric, before: 0.0005).changes if each.change > 0)
    ]


def test_one_seed_alone_that_gets_much_worse_is_no_evidence() -> None:
    now = results()
    seeds = {seed: dict(figures) for seed, figures in now.groups[GroupKey("room-0", "[]", "full")].seeds.items()}
    seeds[1]["hota"] -= 0.5
    groups = {**now.groups, GroupKey("room-0", "[]", "full"): Group("", True, seeds)}
    assert judged(results(), Results("made-up", now.versions, now.renderers, groups)) == []


def test_a_figure_that_is_no_longer_there_is_worse() -> None:
    now = results()
    seeds = {
        seed: {**figures, "hota": None} for seed, figures in now.groups[GroupKey("room-0", "[]", "full")].seeds.items()
    }
    groups = {**now.groups, GroupKey("room-0", "[]", "full"): Group("", True, seeds)}
    assert judged(results(), Results("made-up", now.versions, now.renderers, groups)) == [("room-0", "full", "hota")]


def test_another_renderer_relaxes_the_figures_of_images_alone_and_is_told() -> None:
    shift = {"motp_m": 0.003}
    now = results(shift=shift, renderer="NVIDIA H200")
    assert judged(results(), results(shift=shift)) == [("room-0", "full", "motp_m")]
    assert judged(results(), now) == []  # `full` is image-based
    (warning,) = compare(results(), now, allowed_by_default).warnings
    assert "llvmpipe" in warning and "NVIDIA H200" in warning
    lasers = {
        key: Group(group.variant, False, group.seeds) if key.scenario == "room-0" else group
        for key, group in now.groups.items()
    }
    now = Results(now.suite, now.versions, now.renderers, lasers)
    assert judged(results(), now) == [("room-0", "full", "motp_m")]


def test_what_cannot_be_compared_is_told() -> None:
    found = compare(results(n_seed=2), results(n_seed=2), allowed_by_default)
    assert not found.changes and "fewer than 3 seeds" in found.warnings[0]
    before = results()
    less = Results("other", {"mujoco": "4.1.0"}, before.renderers, dict(list(before.groups.items())[2:]))
    warnings = " | ".join(compare(before, less, allowed_by_default).warnings)
    assert "MuJoCo 4.0.0, here it is 4.1.0" in warnings and "has what this run has not: room-0 with full" in warnings
    assert "is of the suite made-up, this one is other" in warnings
    assert "not in the baseline: room-0 with full" in " | ".join(compare(less, before, allowed_by_default).warnings)


def test_holm_is_holms() -> None:
    # The example of Wright, Adjusted p-values for simultaneous inference, Biometrics 48 (1992): levels 0.05 / (m - k).
    levels, significant = holm(np.array([0.01, 0.04, 0.03, 0.005]))
    np.testing.assert_allclose(levels, [0.05 / 3, 0.05, 0.05 / 2, 0.05 / 4])
    assert significant.tolist() == [True, False, False, True]
    assert holm(np.array([]))[1].size == 0
    assert holm(np.full(5, 1e-4))[1].all()


def test_the_mean_over_seeds_has_an_interval_that_holds_it() -> None:
    assert mean_over_seeds([]) is None
    one = mean_over_seeds([0.5])
    assert one is not None and (one.mean, one.low, one.high) == (0.5, None, None)
    many = mean_over_seeds([0.1, 0.2, 0.3, 0.4])
    assert many is not None and many.low is not None and many.high is not None
    assert 0.1 <= many.low < many.mean < many.high <= 0.4
    assert many == mean_over_seeds([0.1, 0.2, 0.3, 0.4])


def test_every_compared_figure_has_a_tolerance() -> None:
    assert all(allowed_by_default(metric, 0.5) > 0 for metric in GATED)
