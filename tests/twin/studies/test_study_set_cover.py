"""Greedy and exact beside every set there is."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings, strategies

from twin.studies.coverage import at_least, count_bits
from twin.studies.set_cover import CoverProblem, exact, greedy
from twin.studies.visibility import packed


def made_up(seed: int, n: int = 9, rows: int = 40, k: int = 1, per: int = 1) -> CoverProblem:
    rng = np.random.default_rng(seed)
    counts = rng.integers(0, per + 1, (n, rows)) * (rng.random((n, rows)) < 0.4)
    counts = np.minimum(counts, k).astype(float)
    near = rng.random((n, n)) < 0.2
    is_allowed = lambda chosen: not any(near[a, b] for a, b in combinations(sorted(chosen), 2))  # noqa: E731
    stay = (rng.random(rows) < 0.1).astype(float)
    return CoverProblem(
        counts, stay, rng.integers(1, 5, rows).astype(float), k, ["a"] * 6 + ["b"] * (n - 6), is_allowed
    )


def best_of_all(choice: CoverProblem, number: dict[str, int]) -> float:
    found = -1.0
    for chosen in combinations(range(len(choice.device)), sum(number.values())):
        right = all(sum(choice.device[each] == name for each in chosen) == count for name, count in number.items())
        if right and choice.is_allowed(list(chosen)):
            found = max(found, choice.value(chosen))
    return found


@settings(max_examples=60, deadline=None)
@given(strategies.integers(0, 10_000), strategies.sampled_from([1, 2]), strategies.sampled_from([1, 2]))
def test_exact_is_the_best_of_all_and_its_bounds_hold(seed: int, k: int, per: int) -> None:
    choice, number = made_up(seed, k=k, per=per), {"a": 2, "b": 1}
    best = best_of_all(choice, number)
    found, first = exact(choice, number, 60), greedy(choice, number)
    if best < 0:
        assert not found.complete and not first.complete and not found.optimal
        assert found.summary() == "no placement keeps the constraints"
        return
    assert found.optimal and found.summary() == "optimal"
    assert found.value == pytest.approx(best) and choice.value(found.chosen) == pytest.approx(found.value)
    if len(first.chosen) == 3:
        assert first.value <= found.value + 1e-12
    assert first.bound >= best - 1e-12


def test_without_time_exact_is_greedy_and_tells_the_gap() -> None:
    choice = made_up(3, n=30, rows=300)
    found, first = exact(choice, {"a": 2, "b": 3}, 0.0), greedy(choice, {"a": 2, "b": 3})
    assert found.chosen == first.chosen and found.bound >= exact(choice, {"a": 2, "b": 3}, 60).value
    assert not found.optimal and "below the best" in found.summary()


def test_where_more_poses_keep_no_constraints_none_is_the_best_of_more() -> None:
    apart = replace(made_up(4), is_allowed=lambda chosen: len(chosen) < 2)
    for limit_s, said in ((60.0, "no placement keeps"), (0.0, "none found that keeps")):
        found = exact(apart, {"a": 2, "b": 0}, limit_s)
        assert (found.chosen, found.complete) == ((), False) and found.summary() == f"{said} the constraints"
    assert exact(apart, {"a": 1, "b": 0}, 60.0).summary() == "optimal"
    assert not greedy(apart, {"a": 2, "b": 0}).complete


@given(strategies.integers(0, 1000), strategies.integers(1, 4))
def test_packed_bits_count_what_bits_do(seed: int, k: int) -> None:
    seen = np.random.default_rng(seed).random((5, 131)) < 0.5
    assert count_bits(at_least(packed(seen), k)) == int((seen.sum(axis=0) >= k).sum())
