"""In the test run a wrong shape or dtype is refused where it is handed in; outside of it nothing is checked or slower."""

from __future__ import annotations

import subprocess
import sys

import jaxtyping
import numpy as np
import pytest

from trackers.filters.gating import distances, validation_region
from trackers.filters.imm_state import ImmState


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


def test_outside_of_the_tests_nothing_is_checked() -> None:
    code = "import sys, trackers.filters.gating as g; print(hasattr(g.distances, '__wrapped__'), 'beartype' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "False"]
