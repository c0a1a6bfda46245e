"""Drawn rooms, each with the people of four seeds: in how many rooms a tracker is behind the plain baseline.

The suite `drawn` has one seed a room, so that a room is behind by one unlucky person. `python -m benchmarks.drawn_rooms FIRST`
takes rooms from seed FIRST on, which nobody should have looked at; people and noise have the seeds 10 FIRST, 10 FIRST + 1, …
"""

from __future__ import annotations

import os
import sys
import tempfile
from collections import defaultdict
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from scipy.stats import bootstrap

from benchmarks.figure import Figure
from twin.models import cache_folder
from twin.suites.cache import RecordingCache, cache_limit_bytes
from twin.suites.cluster import Workers
from twin.suites.result_files import read_results
from twin.suites.run import run_suite
from twin.suites.spec import load_suite

FIRST_SEED = "BENCH_DRAWN_ROOMS_SEED"
"""Environment variable: the seed of the first room, where it shall not be the one below."""
_FIRST_SEED = 6625
_A_STRATUM, _SEEDS = 5, 4
_BEHIND = -0.01
_STRATA: Mapping[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "one-scanner": ({"scanners": [1, 1]}, {}),
    "knee-scanners": ({"scanners": [2, 3], "waist": 0}, {}),
    "waist-scanners": ({"scanners": [2, 3], "waist": 1}, {}),
    "both-layers": ({"scanners": [2, 3], "waist": 0.5}, {}),
    "crowded": ({"scanners": [2, 3]}, {"count": [10, 20], "in_groups": 0.7}),
}
"""Sensors and people of each stratum, as in the suite `drawn`."""


def described(first: int) -> dict[str, Any]:
    """Describe the suite of the rooms from seed `first` on."""
    scenarios, room = [], first
    for stratum, (sensors, people) in _STRATA.items():
        for _ in range(_A_STRATUM):
            drawn = {
                "room": {"kind": "drawn", "seed": room},
                "sensors": {"kind": "drawn", "seed": room, **sensors},
                "people": {"kind": "drawn", **people},
            }
            seeds = {"from": 10 * room, "count": _SEEDS}
            scenarios.append({"scenario": "drawn", "name": f"{stratum}-{room}", "seeds": seeds, "set": drawn})
            room += 1
    return {
        "name": "drawn-rooms",
        "description": "Drawn rooms, each with the people of several seeds.",
        "limit_s": 600,
        "trackers": ["sort", "laser-imm", "laser-kalman"],
        "reference": "sort",
        "reports": False,
        "scenarios": scenarios,
    }


def measure() -> Iterator[Figure]:
    """Measure the rooms from the seed that is set on."""
    yield from figures(int(os.environ.get(FIRST_SEED, _FIRST_SEED)))


def figures(first: int) -> Iterator[Figure]:
    """Compare trackers by room: means over a room's seeds, bounds of 95 % intervals over rooms."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "drawn-rooms.yaml"
        path.write_text(yaml.safe_dump(described(first), default_flow_style=None), encoding="utf-8")
        out, cache = Path(folder) / "out", RecordingCache(cache_folder(), cache_limit_bytes())
        run_suite(*load_suite(str(path)), out, cache, Workers(jobs=len(os.sched_getaffinity(0))))
        groups = read_results(out).groups
    by_room: dict[str, dict[str, dict[str, float]]] = defaultdict(dict)
    for key, group in groups.items():
        by_room[key.scenario][key.tracker] = {each: float(np.mean(group.values(each))) for each in ("hota", "mota")}
    for tracker, reference, targets in (
        ("laser-imm", "sort", {"hota": ">= 0.06", "mota": ">= 0.04"}),
        ("laser-imm", "laser-kalman", {"hota": ">= 0", "mota": ">= 0"}),
    ):
        for metric, target in targets.items():
            ahead = {room: of[tracker][metric] - of[reference][metric] for room, of in by_room.items()}
            values, what = (
                np.array(list(ahead.values())),
                f"{tracker} less {reference}, {metric.upper()}, {len(ahead)} rooms",
            )
            interval = bootstrap((values,), np.mean, rng=np.random.default_rng(0)).confidence_interval
            yield Figure(f"{what} of {_SEEDS} seeds", float(values.mean()), "", target)
            yield Figure(
                f"{what}, low end of the interval", float(interval.low), "", ">= 0" if reference == "sort" else ""
            )
            if metric == "hota" and reference == "sort":
                behind = sorted(room for room, value in ahead.items() if value < _BEHIND)
                print(f"behind: {', '.join(behind) or 'none'}", file=sys.stderr)
                yield Figure(
                    f"rooms in which {tracker} is behind by more than 0.01", len(behind) / len(ahead), "", "<= 0.02"
                )


if __name__ == "__main__":
    for figure in figures(int(sys.argv[1])):
        print(figure.row(), flush=True)
