"""What was to be shown of table I, and whether these runs show it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from twin.reproduce.laser_fisheye_imm.conditions import COAST_S, COLUMNS, FULL, Condition
from twin.reproduce.laser_fisheye_imm.table_one import MISIDENTIFIED, cell, excuse, filters_difference, values

Verdict = Literal["holds", "does not hold", "not decided"]

LEAST_MOTA, LEAST_IDF1, MOST_MOTP_M = 0.97, 0.99, 0.10


@dataclass(frozen=True)
class Claim:
    """A sentence, whether the runs bear it out, and the figures it rests on."""

    text: str
    verdict: Verdict
    figures: str


def claims(condition: Condition) -> list[Claim]:
    """The claims about the paper's experiment, in order."""
    return list(_claims(condition))


def _claims(condition: Condition) -> Iterator[Claim]:
    n_run = len(condition.seeds)
    misidentified = int(values(condition, FULL, MISIDENTIFIED).sum())
    yield Claim(
        "The full system with IMM takes nobody for somebody else, in any run.",
        _holds(misidentified == 0),
        f"{misidentified} in {n_run} runs",
    )
    found = excuse(condition)
    yield Claim(
        f"It loses nobody in a run without an occlusion longer than the {COAST_S:g} s that tracks coast.",
        _holds(found.lost_without == 0),
        f"{found.lost_without} lost in {found.n_run_without} such runs; {found.lost_with} in the other "
        f"{found.n_run_with}, listed below",
    )
    sums = {each.name: int(condition.errors(each).sum()) for each in COLUMNS}
    own = sums.pop(FULL.name)
    yield Claim(
        "Every other column makes more errors, summed over the runs.",
        _holds(min(sums.values()) > own),
        f"{own} against " + ", ".join(f"{total} ({name})" for name, total in sums.items()),
    )
    change = filters_difference(condition)
    yield Claim(
        "The Kalman filter makes more errors than the IMM, summed over the sensor sets and paired by seed.",
        "holds" if change.high < 0 else "does not hold" if change.low > 0 or change.value >= 0 else "not decided",
        f"IMM − Kalman: {change.value:.2f} errors a run, 95 %: {change.low:.2f} to {change.high:.2f}".replace("-", "−"),
    )
    own_figures = {row: cell(condition, FULL, row).value for row in ("MOTA", "IDF1", "MOTP") if _known(condition, row)}
    for row, bound in (("MOTA", LEAST_MOTA), ("IDF1", LEAST_IDF1)):
        if row in own_figures:
            yield Claim(
                f"{row} of the full system is at least {bound:g}, on the mean.",
                _holds(own_figures[row] >= bound),
                f"{own_figures[row]:.3f}, least in a run {np.nanmin(values(condition, FULL, row)):.3f}",
            )
    if "MOTP" in own_figures:
        yield Claim(
            f"Its tracks are {MOST_MOTP_M:g} m from their people at most, on the mean (MOTP).",
            _holds(own_figures["MOTP"] <= MOST_MOTP_M),
            f"{own_figures['MOTP']:.3f} m, most in a run {np.nanmax(values(condition, FULL, 'MOTP')):.3f} m",
        )


def _holds(whether: bool) -> Verdict:
    return "holds" if whether else "does not hold"


def _known(condition: Condition, row: str) -> bool:
    return not np.isnan(values(condition, FULL, row)).all()
