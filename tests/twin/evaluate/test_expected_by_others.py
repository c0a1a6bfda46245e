"""Our OSPA, GOSPA and HOTA are Stone Soup's and TrackEval's, on people and tracks made at random.

The expected values are made by `expected_by_others.py` in environments of those programs.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from synthetic_sets import ORDERS_AND_CUTOFFS, sets, similarities
from trackeval_names import by_trackevals_names

from twin.evaluate.clear import PairMatrix
from twin.evaluate.hota import hota
from twin.evaluate.summary import gospa, ospa

EXPECTED = json.loads(Path(__file__).with_name("expected_by_others.json").read_text())
SAME = {"rtol": 0, "atol": 1e-12}


def test_the_input_is_what_the_others_were_given():
    of_sets = sum(each.sum() for pair in sets() for each in pair)
    of_similarities = sum(each.sum() for frame in similarities() for each in frame)
    assert of_sets == pytest.approx(EXPECTED["stonesoup"]["input_sum"], abs=1e-9)
    assert of_similarities == pytest.approx(EXPECTED["trackeval"]["input_sum"], abs=1e-9)


@pytest.mark.parametrize(("place", "order", "cutoff"), [(i, *pair) for i, pair in enumerate(ORDERS_AND_CUTOFFS)])
def test_ospa_and_gospa_are_stone_soups(place, order, cutoff):
    distances = [np.linalg.norm(people[:, None] - tracks[None], axis=-1) for people, tracks in sets()]
    ours = [ospa(each, cutoff, order) for each in distances]
    np.testing.assert_allclose(ours, EXPECTED["stonesoup"]["ospa"][place], **SAME)
    parts = [gospa(each, cutoff, order) for each in distances]
    ours = [[each.distance, each.localisation, each.missed, each.false] for each in parts]
    np.testing.assert_allclose(ours, EXPECTED["stonesoup"]["gospa"][place], **SAME)


def test_hota_is_trackevals():
    scores = hota([PairMatrix(*frame) for frame in similarities()])
    for name, values in by_trackevals_names(scores).items():
        np.testing.assert_allclose(values, EXPECTED["trackeval"][name], err_msg=name, **SAME)
