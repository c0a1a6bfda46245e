"""People in drawn rooms: whether every scene can be built, who walks into what, and who does not get where they go.

`python -m benchmarks.drawn_people FIRST LAST` prints each of these seeds with a fault, then the sums.
"""

from __future__ import annotations

import sys
import warnings
from collections import Counter
from collections.abc import Iterable, Iterator

import numpy as np

from benchmarks.figure import Figure
from benchmarks.penetration import PenetrationCount, count_penetrations, furniture_in_use
from trackers.errors import InputError
from twin.scenario import load_scenario
from twin.world.world import World

SEEDS = range(1000, 1100)
EVERY_S = 0.2


def people_of(seed: int) -> tuple[PenetrationCount, list[str]]:
    """Run the drawn scene of a seed without sensors: overlaps of bodies, and warnings and people who are late."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        scenario = load_scenario("drawn", [f"seed={seed}"])
        world = World(scenario)
        times = np.arange(0.0, scenario.duration_s, EVERY_S)
        overlaps = count_penetrations(world, times, lambda _: furniture_in_use(world))
    return overlaps, [*(str(each.message) for each in caught), *world.population.late()]


def figures(seeds: Iterable[int]) -> Iterator[Figure]:
    """Sums over seeds; each fault is reported on stderr."""
    counts: Counter[str] = Counter()
    deepest_m = 0.0
    for seed in seeds:
        counts["scenes"] += 1
        try:
            overlaps, said = people_of(seed)
        except InputError as refusal:
            counts["refused"] += 1
            print(f"{seed}: refused: {refusal}", file=sys.stderr, flush=True)
            continue
        counts["samples"] += overlaps.samples
        counts["with overlap"] += overlaps.with_overlap
        counts["scenes with overlap"] += bool(overlaps.with_overlap)
        deepest_m = max(deepest_m, overlaps.depth_m)
        reported = [*(str(overlaps).splitlines()[1:]), *said]
        if reported:
            print(f"{seed}: {'; '.join(reported)}", file=sys.stderr, flush=True)
    yield Figure("drawn scenes refused", counts["refused"], f"of {counts['scenes']}", "<= 0")
    yield Figure("drawn scenes where bodies overlap", counts["scenes with overlap"], f"of {counts['scenes']}", "<= 0")
    yield Figure("times at which bodies overlap", counts["with overlap"], f"of {counts['samples']}", "")
    yield Figure("deepest overlap", 100 * deepest_m, "cm", "<= 1")


def measure() -> Iterator[Figure]:
    """A hundred drawn scenes."""
    yield from figures(SEEDS)


if __name__ == "__main__":
    for figure in figures(range(int(sys.argv[1]), int(sys.argv[2]))):
        print(figure.row())
