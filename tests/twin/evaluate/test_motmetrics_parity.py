"""CLEAR and identity against py-motmetrics on random crowds."""

import motmetrics
import numpy as np
import pytest
from motmetrics_names import by_motmetrics_names, histories

from twin.evaluate.clear import PairMatrix, clear, identity

GATE_M = 0.5


def random_crowd(seed: int) -> list[PairMatrix]:
    """People on random walks in a small room, tracks with errors, drop-outs, swapped identities and ghosts."""
    rng = np.random.default_rng(seed)
    n_person, n_frame = int(rng.integers(1, 8)), int(rng.integers(5, 60))
    places = rng.uniform(0, 2.5, (n_person, 2))
    labels = np.arange(1, n_person + 1)
    frames = []
    for _ in range(n_frame):
        places = places + rng.normal(0, 0.1, places.shape)
        if rng.random() < 0.15:
            rng.shuffle(labels)
        if rng.random() < 0.1:
            labels[rng.integers(n_person)] = labels.max() + 1
        there, seen, ghost = rng.random(n_person) < 0.9, rng.random(n_person) < 0.8, rng.random() < 0.2
        found = np.concatenate([places + rng.normal(0, 0.15, places.shape), rng.uniform(0, 2.5, (1, 2))])
        tracked = np.append(seen, ghost)
        ids = np.append(labels, 900)
        shuffled = rng.permutation(np.flatnonzero(tracked))
        distances = np.linalg.norm(places[there][:, None] - found[shuffled][None], axis=-1)
        frames.append(PairMatrix(np.flatnonzero(there) + 1, ids[shuffled], distances))
    return frames


def accumulate(frames: list[PairMatrix]) -> motmetrics.MOTAccumulator:
    accumulator = motmetrics.MOTAccumulator(auto_id=True)
    for frame in frames:
        # Two people last matched with one track: motmetrics takes the first in the list, we the last matched one.
        recency = [accumulator.last_match.get(person, -1) for person in frame.person_ids.tolist()]
        order = np.argsort(recency, kind="stable")[::-1]
        distances = np.where(frame.values <= GATE_M, frame.values, np.nan)[order]
        accumulator.update(frame.person_ids[order], frame.track_ids, distances)
    return accumulator


@pytest.mark.parametrize("seed", range(40))
def test_agrees_with_motmetrics(seed):
    frames = random_crowd(seed)
    ours = by_motmetrics_names(clear(frames, GATE_M), histories(frames, GATE_M), identity(frames, GATE_M))
    expected = motmetrics.metrics.create().compute(accumulate(frames), metrics=list(ours)).iloc[0]
    for name, value in ours.items():
        assert value == pytest.approx(expected[name], abs=1e-6), name


def test_the_random_crowds_contain_what_is_compared():
    crowds = [random_crowd(seed) for seed in range(40)]
    scores = [clear(crowd, GATE_M) for crowd in crowds]
    assert sum(s.id_switches for s in scores) > 100
    assert sum(histories(crowd, GATE_M).fragmentations for crowd in crowds) > 100
    assert sum(s.false_positives for s in scores) > 100
