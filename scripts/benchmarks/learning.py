"""Cost of appearance learned on-line: boosting, patches, score maps with their particles."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import numpy as np

from benchmarks.figure import Figure
from trackers.area import Pose
from trackers.cameras import PinholeIntrinsics, PlacedCamera
from trackers.filters.particle import Cloud
from trackers.laser_vision_learning.looks import Learner, Looks, LooksOptions, PeopleInPicture
from trackers.laser_vision_learning.score_maps import in_levels
from trackers.learning.boosting import BoostingOptions, OnlineBoosting, StrongClassifiers

_PATCHES, _FEATURES, _SCORED = 80, 20, 200
_ROUNDS = 60
_CAMERA = PlacedCamera(
    PinholeIntrinsics(width=640, height=480, fx=400, fy=400, cx=319.5, cy=239.5),
    Pose(xyz=(0.0, -6.85, 9.6), rpy=(np.deg2rad(-145), 0.0, 0.0)),
)
"""As it looks down into the library's hall."""
_PARTICLES = 500


def measure() -> Iterator[Figure]:
    """CPU time, the least of many rounds: a shared machine only ever adds."""
    yield from _boosting()
    yield from _looks()


def _boosting() -> Iterator[Figure]:
    """A frame of 80 patches of 20 features, 50 trees of which 35 are kept."""
    rng = np.random.default_rng(0)
    label = np.where(np.arange(_PATCHES) < _PATCHES // 2, 1.0, -1.0)[None]
    frames = [rng.normal(size=(1, _PATCHES, _FEATURES)) + 0.3 * label[..., None] for _ in range(2)]
    scored = rng.normal(size=(_SCORED, _FEATURES))
    boosting = OnlineBoosting(BoostingOptions(trees=50, kept=35))
    untrained = StrongClassifiers.untrained(1, boosting.options.trees)
    strong = boosting.learned(untrained, frames[0], label)
    update_ms = _least_ms(lambda: boosting.learned(strong, frames[1], label))
    yield Figure("classifier of 50 trees: update, 15 trees trained", update_ms, "ms of CPU", "<= 4")
    first_ms = _least_ms(lambda: boosting.learned(untrained, frames[0], label))
    yield Figure("classifier of 50 trees: first training", first_ms, "ms of CPU", "<= 12")
    yield Figure("classifier of 50 trees: 200 patches", _least_ms(lambda: strong.scores(scored)), "ms of CPU", "<= 0.3")


def _looks() -> Iterator[Figure]:
    """Two people side by side, 12 m from a camera of 640 × 480."""
    rng, learner = np.random.default_rng(0), Learner(_CAMERA, LooksOptions())
    picture = rng.integers(0, 256, (480, 640, 3), dtype=np.uint8)
    pair = np.array([[-0.3, 0.0], [0.3, 0.0]])

    def cut() -> None:
        patches = learner.sampler.drawn(pair[:1], rng)
        learner.describer.described(picture, patches.centre[0], np.repeat(patches.side, patches.centre.shape[1]))

    yield Figure("40 patches of a body, cut and described", _least_ms(cut), "ms of CPU", "<= 0.8")
    looks, both, people = Looks.unknown(2, learner.options), np.ones(2, bool), PeopleInPicture(picture, pair)
    for ns in range(6):
        looks = learner.trained(looks, people, ~np.eye(2, dtype=bool), both, ns, rng)
    cloud = Cloud.of(pair.T[:, :, None] + rng.normal(0, 0.1, (2, 2, _PARTICLES)))
    rows, levels = np.arange(2), learner.options.maps.levels

    def correlated() -> None:
        maps = learner.score_maps(looks, people, rows, rows, rng)
        in_levels(
            cloud, learner.likelihood(maps), levels, lambda state, rng: state + rng.normal(0, 0.02, state.shape), rng
        )

    each_ms = _least_ms(correlated) / 2
    yield Figure("score map and particles of a correlated person, one of two", each_ms, "ms of CPU", "<= 3")


def _least_ms(call: Callable[[], object], rounds: int = _ROUNDS) -> float:
    call()
    spent = []
    for _ in range(rounds):
        start = time.process_time()
        call()
        spent.append(time.process_time() - start)
    return 1e3 * min(spent)
