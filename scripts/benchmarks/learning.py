"""What on-line boosting costs: a frame of 80 patches of 20 features, 50 trees of which 35 are kept."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import numpy as np

from benchmarks.figure import Figure
from trackers.learning.boosting import BoostingOptions, OnlineBoosting

_PATCHES, _FEATURES, _SCORED = 80, 20, 200
_ROUNDS = 60


def measure() -> Iterator[Figure]:
    """CPU time, the least of many rounds: a shared machine only ever adds."""
    rng = np.random.default_rng(0)
    label = np.where(np.arange(_PATCHES) < _PATCHES // 2, 1.0, -1.0)[None]
    frames = [rng.normal(size=(_PATCHES, _FEATURES)) + 0.3 * label.T for _ in range(2)]
    scored = rng.normal(size=(_SCORED, _FEATURES))
    boosting = OnlineBoosting(BoostingOptions(trees=50, kept=35))
    untrained = boosting.untrained(1)
    strong = boosting.learned(untrained, frames[0], label)
    update_ms = _least_ms(lambda: boosting.learned(strong, frames[1], label))
    yield Figure("classifier of 50 trees: update, 15 trees trained", update_ms, "ms of CPU", "<= 4")
    first_ms = _least_ms(lambda: boosting.learned(untrained, frames[0], label))
    yield Figure("classifier of 50 trees: first training", first_ms, "ms of CPU", "<= 12")
    yield Figure("classifier of 50 trees: 200 patches", _least_ms(lambda: strong.scores(scored)), "ms of CPU", "<= 0.3")
    by_scikit_learn = OnlineBoosting(BoostingOptions(trees=50, kept=35, learner="scikit-learn"))
    theirs_ms = _least_ms(lambda: by_scikit_learn.learned(strong, frames[1], label), 5)
    yield Figure("classifier of 50 trees: update with scikit-learn's trees over ours", theirs_ms / update_ms, "×", "")


def _least_ms(call: Callable[[], object], rounds: int = _ROUNDS) -> float:
    call()
    spent = []
    for _ in range(rounds):
        start = time.process_time()
        call()
        spent.append(time.process_time() - start)
    return 1e3 * min(spent)
