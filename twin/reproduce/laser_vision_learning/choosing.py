"""How M, K, patches and features were chosen: every choice's decisions at splits, on a development seed.

With mixed clothes nothing tells the choices apart: people wear near-identical ones, in the busy place. Who is right says
little where all are; the margin, by its deviation, tells more.
"""

from __future__ import annotations

import numpy as np

from twin.progress import OnProgress
from twin.reproduce.intervals import Bootstrap, interval
from twin.reproduce.laser_vision_learning.choice import VARIANTS
from twin.reproduce.laser_vision_learning.splits import decide, near_identical_clothes
from twin.reproduce.results import Result
from twin.scenario import load_scenario
from twin.scenario.load import dump_scenario
from twin.streams import stream
from twin.suites.cache import RecordingCache
from twin.suites.cache_keys import recording_key
from twin.suites.worker import RECORDING, record, renderer_of

CHOICE = "beyond the paper, choice"
RIGHT, MARGIN = "identities right, classifiers alone", "margin over its deviation"
SEED, DURATION_S = 1003, 16
_SCENARIO = "library-hall-busy"


def choices(cache: RecordingCache, on_progress: OnProgress | None) -> list[Result]:
    """Record the busy place in near-identical clothes, and let every choice decide who is who when correlated people part."""
    if on_progress is not None:
        on_progress("choices of the classifiers", 0, 1)
    changes = [f"seed={SEED}", f"duration_s={DURATION_S}", "background=none"]
    people = load_scenario(_SCENARIO, changes).people
    scenario = load_scenario(_SCENARIO, changes + near_identical_clothes(people))
    key = recording_key(dump_scenario(scenario), renderer_of(scenario))
    with cache.recording(key, lambda place: record(scenario, place)) as (entry, _):
        decided = decide(entry / RECORDING, VARIANTS, "correlated")
    found = []
    for name, decisions in decided.items():
        margin = np.array([each.margin for each in decisions])
        boot = Bootstrap(len(margin), stream(SEED, "reproduce", "choices bootstrap"))
        mean = boot.mean(margin)
        deviation = np.sqrt(np.maximum(boot.mean(margin**2) - mean**2, 1e-12))
        right = interval(100 * boot.mean(np.where(margin > 0, 1.0, 0.0)))
        told = interval(mean / deviation)
        for column, each, unit in ((RIGHT, right, "%"), (MARGIN, told, "1")):
            found.append(Result(CHOICE, name, column, None, each.value, (each.low, each.high), unit, len(margin)))
    if on_progress is not None:
        on_progress("choices of the classifiers", 1, 1)
    return found
