"""Merges of `library-hall-groups` by the truth: how long, how often, and how many pairs are correlated meanwhile.

`python -m benchmarks.hall_groups FIRST LAST` measures these seeds.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from benchmarks.figure import Figure
from twin.recording.situation_table import read_situations
from twin.recording.tables import read_truth
from twin.reproduce.laser_vision_learning.results import MEDIAN, PAIRS, SECONDS, place_results
from twin.reproduce.laser_vision_learning.runs import GROUPS, HallCondition, place_statistics
from twin.run.live import run_scenario
from twin.scenario import load_scenario

SEEDS = range(1000, 1004)
_TARGETS = {MEDIAN: ">= 1.5", SECONDS: ">= 20", PAIRS: "<= 1"}


def figures(seeds: Sequence[int]) -> Iterator[Figure]:
    """Every row on the scenes with its interval, over the runs of these seeds without a camera."""
    recorded = []
    with tempfile.TemporaryDirectory() as folder:
        for seed in seeds:
            scenario = load_scenario("library-hall-groups", [f"seed={seed}", "background=none", "sensors.camera=null"])
            out = Path(folder) / str(seed)
            run_scenario(scenario, trackers=(), out=out, video=False)
            recorded.append((read_truth(out / "truth.csv"), read_situations(out / "truth_situations.csv")))
    place = place_statistics(recorded)
    for row in place_results(HallCondition(GROUPS, tuple(seeds), {}, place)):
        n = f"n = {len(place.merge_s)} merges, {row.runs} runs"
        name = f"groups: {row.row} [{row.ci95[0]:.2f}, {row.ci95[1]:.2f}] ({n})"
        yield Figure(name, row.ours, row.unit, _TARGETS.get(row.row, ""))


def measure() -> Iterator[Figure]:
    """Four development seeds."""
    yield from figures(SEEDS)


if __name__ == "__main__":
    for figure in figures(range(int(sys.argv[1]), int(sys.argv[2]) + 1)):
        print(figure.row())
