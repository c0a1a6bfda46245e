"""Our CLEAR, identity, HOTA, OSPA and GOSPA against what other people's programs say of other people's data."""

import json
from functools import cache, reduce
from operator import add
from pathlib import Path

import numpy as np
import pytest
from motmetrics_names import by_motmetrics_names, histories
from trackeval_names import by_trackevals_names

from twin.evaluate.clear import PairMatrix, clear, identity
from twin.evaluate.hota import hota
from twin.evaluate.summary import gospa, ospa

DATA = Path(__file__).parents[3].parent / "shared" / "data" / "metrics"
pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason=f"the reference data {DATA} is not on this machine")

SEQUENCES = ("TUD-Campus", "TUD-Stadtmitte")
MAX_IOU_DISTANCE = 0.5


def _boxes(path: Path) -> np.ndarray:
    """Columns frame, id, left, top, width, height."""
    return np.loadtxt(path, delimiter=",", usecols=range(6))


def _iou(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    low = np.maximum(a[:, None, :2], b[None, :, :2])
    high = np.minimum(a[:, None, :2] + a[:, None, 2:], b[None, :, :2] + b[None, :, 2:])
    shared = np.prod(np.maximum(high - low, 0), axis=-1)
    return shared / (a[:, None, 2:].prod(-1) + b[None, :, 2:].prod(-1) - shared)


@cache
def _similarities(sequence: str) -> list[PairMatrix]:
    truth, tracks = _boxes(DATA / sequence / "gt.txt"), _boxes(DATA / sequence / "test.txt")
    frames = []
    for frame in np.union1d(truth[:, 0], tracks[:, 0]):
        people, found = truth[truth[:, 0] == frame], tracks[tracks[:, 0] == frame]
        iou = _iou(people[:, 2:], found[:, 2:])
        frames.append(PairMatrix(people[:, 1].astype(np.int64), found[:, 1].astype(np.int64), iou))
    return frames


def _distances(sequence: str) -> list[PairMatrix]:
    return [PairMatrix(f.person_ids, f.track_ids, 1 - f.values) for f in _similarities(sequence)]


def _expected(program: str, sequence: str) -> dict:
    return json.loads((DATA / "expected_values.json").read_text())[program][sequence]


def _over(sequence: str, score):
    """The score of one sequence, or of all added together."""
    return reduce(add, [score(name) for name in (SEQUENCES if sequence == "OVERALL" else (sequence,))])


@pytest.mark.parametrize("sequence", [*SEQUENCES, "OVERALL"])
def test_clear_and_identity_agree_with_motmetrics(sequence):
    expected = _expected("motmetrics_1.4.0", sequence)
    scores = _over(sequence, lambda name: clear(_distances(name), MAX_IOU_DISTANCE))
    identities = _over(sequence, lambda name: identity(_distances(name), MAX_IOU_DISTANCE))
    followed = _over(sequence, lambda name: histories(_distances(name), MAX_IOU_DISTANCE))
    ours = by_motmetrics_names(scores, followed, identities)
    # Transfers, ascents and migrations are subdivisions of switches that we do not make.
    assert expected.keys() - ours.keys() == {"num_transfer", "num_ascend", "num_migrate"}
    for name, value in ours.items():
        assert value == pytest.approx(expected[name], abs=1e-6), name


@pytest.mark.parametrize("sequence", [*SEQUENCES, "OVERALL"])
def test_hota_agrees_with_trackeval(sequence):
    expected = _expected("trackeval_12c8791", sequence)
    scores = _over(sequence, lambda name: hota(_similarities(name)))
    for name, values in by_trackevals_names(scores).items():
        np.testing.assert_allclose(values, expected[name], atol=1e-6, rtol=0, err_msg=name)


def test_overall_figures_of_the_reference():
    assert _over("OVERALL", lambda name: clear(_distances(name), 0.5)).mota == pytest.approx(0.555116, abs=1e-6)
    assert _over("OVERALL", lambda name: identity(_distances(name), 0.5)).idf1 == pytest.approx(0.624296, abs=1e-6)
    assert _over("OVERALL", lambda name: hota(_similarities(name))).hota.mean() == pytest.approx(0.399957, abs=1e-6)


@cache
def _ground_distances() -> list[np.ndarray]:
    truth = np.loadtxt(DATA / "pets_gt_ground_f1-200.csv", delimiter=",", skiprows=_header("pets_gt_ground_f1-200.csv"))
    name = "pets_sort_ground_f1-200.csv"
    tracks = np.loadtxt(DATA / name, delimiter=",", skiprows=_header(name))
    frames = np.union1d(truth[:, 0], tracks[:, 0])
    pairs = [(truth[truth[:, 0] == f, 2:], tracks[tracks[:, 0] == f, 2:]) for f in frames]
    return [np.linalg.norm(people[:, None] - found[None], axis=-1) for people, found in pairs]


def _header(name: str) -> int:
    first = (DATA / name).read_text().split(",", 1)[0]
    return 0 if first.isdigit() else 1


@pytest.mark.parametrize("order", [1, 2])
def test_ospa_agrees_with_stone_soup(order):
    expected = json.loads((DATA / "ospa_gospa_stonesoup.json").read_text())[f"OSPA_c1_p{order}"]
    ours = [ospa(distances, 1.0, order) for distances in _ground_distances()]
    np.testing.assert_allclose(ours[:10], expected["first10"], atol=1e-6, rtol=0)
    assert np.mean(ours) == pytest.approx(expected["mean"], abs=1e-6)


@pytest.mark.parametrize("order", [1, 2])
def test_gospa_agrees_with_stone_soup(order):
    expected = json.loads((DATA / "ospa_gospa_stonesoup.json").read_text())[f"GOSPA_c1_p{order}_alpha2"]
    ours = [gospa(distances, 1.0, order) for distances in _ground_distances()]
    np.testing.assert_allclose([g.distance for g in ours[:5]], expected["first5_distance"], atol=1e-6, rtol=0)
    for name in ("distance", "localisation", "missed", "false"):
        assert np.mean([getattr(g, name) for g in ours]) == pytest.approx(expected[name], abs=1e-6), name
