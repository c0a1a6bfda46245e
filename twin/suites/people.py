"""People's motion kept by content, beside the recordings: moved once a seed, however many sensors look at them."""

from __future__ import annotations

from pathlib import Path

from twin.people.motion import Motion
from twin.scenario import Scenario
from twin.suites.cache import RecordingCache
from twin.suites.fingerprint import people_key
from twin.world.staged import Staged, moved

_FILE = "motion.npz"


def staged_in(cache: RecordingCache, scenario: Scenario) -> Staged:
    """The scenario's people and their motion, from the cache or moved for it; raises InputError as a simulation does."""

    def make(folder: Path) -> None:
        moved(scenario).save(folder / _FILE)

    with cache.recording(people_key(scenario), make) as (entry, _):
        return Staged.of(scenario, Motion.load(entry / _FILE))
