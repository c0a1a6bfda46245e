"""Beams as runs, and back."""

from __future__ import annotations

import numpy as np
import pytest

from twin.truth.truth_types import RayRun
from twin.world.truth_details import person_runs


def test_runs_begin_and_end_where_the_person_changes():
    ids = np.array([2, 2, 0, 0, 1, 3, 3, 0, 3], dtype=np.int16)
    assert person_runs(ids) == (RayRun(2, 0, 1), RayRun(1, 4, 4), RayRun(3, 5, 6), RayRun(3, 8, 8))


@pytest.mark.parametrize("size", [0, 1, 5])
def test_beams_that_meet_nobody_make_no_run(size: int):
    assert person_runs(np.zeros(size, dtype=np.int16)) == ()


def test_runs_hold_all_of_a_scan():
    rng = np.random.default_rng(3)
    for _ in range(50):
        ids = np.repeat(rng.integers(0, 4, 30), rng.integers(1, 4, 30)).astype(np.int16)
        back = np.zeros_like(ids)
        for run in person_runs(ids):
            back[run.first_beam : run.last_beam + 1] = run.id
        np.testing.assert_array_equal(back, ids)
