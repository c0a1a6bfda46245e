"""Figure 7 in rows: means over the scans, the IMM against the others, and where it is the lowest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackers.arrays import Array
from twin.reproduce.intervals import Bootstrap, interval
from twin.reproduce.laser_fisheye_imm.figure7 import FILTERS, IMM, MEAN_MAGNITUDE, READINGS, MonteCarlo, SquaredErrors
from twin.reproduce.results import Result
from twin.streams import stream

NPE, NVE = "figure 7 (a)", "figure 7 (b)"


@dataclass(frozen=True, eq=False)
class Curves:
    """NPE or NVE of each filter at each scan, in every replicate of the bootstrap, (1 + replicates, k)."""

    where: str
    name: str
    by_filter: dict[str, Array]

    def lowest(self) -> Array:
        """Where the IMM is below both others, (1 + replicates, k)."""
        return np.all([self.by_filter[IMM] < curve for name, curve in self.by_filter.items() if name != IMM], axis=0)


def curves(runs: MonteCarlo) -> tuple[Curves, Curves]:
    """NPE and NVE, on the same bootstrap replicates."""
    bootstrap = _bootstrap(runs)
    return (
        _curves(NPE, "NPE", runs.position, bootstrap),
        _curves(NVE, "NVE", runs.speed[MEAN_MAGNITUDE], bootstrap),
    )


def figure7_results(runs: MonteCarlo) -> list[Result]:
    """Every figure of figure 7: means over the scans, the IMM against the others, and the other readings of a speed.

    The paper shows curves and prints no number of them.
    """
    bootstrap, n_run, rows = _bootstrap(runs), len(runs.seeds), []

    def add(where: str, row: str, column: str, values: Array, unit: str) -> None:
        found = interval(values)
        rows.append(Result(where, row, column, None, found.value, (found.low, found.high), unit, n_run))

    for found in curves(runs):
        mean = {name: curve.mean(axis=1) for name, curve in found.by_filter.items()}
        for name in FILTERS:
            add(found.where, name, f"{found.name}, mean over scans", mean[name], "1")
        for name in FILTERS[1:]:
            add(
                found.where,
                f"IMM below {name}",
                f"{found.name}, mean over scans",
                100 * (1 - mean[IMM] / mean[name]),
                "%",
            )
        add(found.where, IMM, f"scans at which its {found.name} is the lowest", 100 * found.lowest().mean(axis=1), "%")
    for reading in READINGS[1:]:
        other = _curves(NVE, "NVE", runs.speed[reading], bootstrap)
        for name in FILTERS:
            column = f"NVE, mean over scans, speed read as {reading}"
            add(NVE, name, column, other.by_filter[name].mean(axis=1), "1")
    return rows


def _curves(where: str, name: str, errors: SquaredErrors, bootstrap: Bootstrap) -> Curves:
    return Curves(
        where,
        name,
        {key: bootstrap.ratio(squared, errors.measured) for key, squared in errors.by_filter.items()},
    )


def _bootstrap(runs: MonteCarlo) -> Bootstrap:
    return Bootstrap(len(runs.seeds), stream(runs.seeds.start, "reproduce", "bootstrap"))
