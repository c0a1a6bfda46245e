"""In the test run a wrong shape or dtype is refused where it is handed in; outside of it nothing is checked or slower."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import jaxtyping
import numpy as np
import pytest
import shape_checks

from trackers.filters.gating import distances, validation_region
from trackers.filters.imm import ImmState


def test_an_array_of_another_shape_is_refused() -> None:
    with pytest.raises(jaxtyping.TypeCheckError, match="second"):
        distances(np.zeros((4, 2)), np.zeros((4, 3)))


def test_an_array_of_another_dtype_is_refused() -> None:
    with pytest.raises(jaxtyping.TypeCheckError, match="first"):
        distances(np.zeros((4, 2), np.intp), np.zeros((4, 2)))


def test_arrays_that_are_not_of_one_size_are_refused() -> None:
    """Two modes and three: each array alone is as described."""
    with pytest.raises(jaxtyping.TypeCheckError, match="probability"):
        ImmState(np.zeros((5, 2, 1)), np.zeros((5, 5, 2, 1)), np.zeros((3, 1)))


def test_a_number_that_is_none_is_refused_and_a_whole_one_is_not() -> None:
    assert validation_region(np.zeros((1, 1, 2)), np.zeros((1, 2)), 1).all()
    with pytest.raises(jaxtyping.TypeCheckError, match="radius_m"):
        validation_region(np.zeros((1, 1, 2)), np.zeros((1, 2)), "1")  # type: ignore[arg-type]


def refused(n_call: int) -> int:
    """How many of so many wrong calls of one function are refused."""
    n = 0
    for _ in range(n_call):
        try:
            distances(np.zeros((0, 2)), np.zeros((0, 2), np.intp))
        except jaxtyping.TypeCheckError:
            n += 1
    return n


def test_the_first_calls_of_a_function_are_checked_in_each_file_of_tests_and_then_one_of_so_many() -> None:
    shape_checks.begin_test_of(Path("one.py"))
    assert refused(shape_checks.FIRST) == shape_checks.FIRST
    assert refused(5 * shape_checks.EVERY) == 5
    shape_checks.begin_test_of(Path("one.py"))
    assert refused(shape_checks.FIRST) == 0
    shape_checks.begin_test_of(Path("another.py"))
    assert refused(shape_checks.FIRST) == shape_checks.FIRST


def test_a_function_within_a_function_is_counted_over_all_that_are_made_of_it() -> None:
    def made():
        def within(n: int) -> int:
            return n

        return shape_checks._sampled(within, typechecker=shape_checks.checked)

    wrong = []
    for k in range(shape_checks.FIRST + 1):
        assert made()(k) == k
    for _ in range(3 * shape_checks.EVERY):
        try:
            made()("x")
        except jaxtyping.TypeCheckError:
            wrong.append(1)
    assert len(wrong) == 3


def test_outside_of_the_tests_nothing_is_checked() -> None:
    code = "import sys, trackers.filters.gating as g; print(hasattr(g.distances, '__wrapped__'), 'beartype' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "False"]
