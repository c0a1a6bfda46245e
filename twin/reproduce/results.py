"""Results of a reproduction by row: the paper's value and those of three systems; `results.json`, texts, and the page.

The four columns: the paper's printed value; the paper's system here, by its own rules (a `-paper` preset); ours; and the
plain baseline (`sort`, `floor-kalman`). All systems here track the same recordings. Confidence intervals are those of the
percentile bootstrap over runs (Efron and Tibshirani, 1993). The number of scans at which one curve is below another is not
smooth: where curves are close, a replicate's noise decides, so the interval of a count near all or none is drawn to the
middle. The page is one self-contained HTML file, with plots in one style.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from math import log
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trackers.arrays import Array
from trackers.errors import InputError
from twin.console import print_table
from twin.recording.atomic_file import write_atomic
from twin.report.metrics_table import format_number
from twin.report.palette import data_uri, page_template
from twin.streams import stream

N_REPLICATE = 2000
CONFIDENCE = 0.95
POISSON_ZERO_UPPER = -log((1 - CONFIDENCE) / 2)
"""Upper end of Poisson's exact interval for no event: 3.69 events."""


@dataclass(frozen=True)
class Interval:
    """A value over all runs, and its percentile interval."""

    value: float
    low: float
    high: float


class Bootstrap:
    """Multiplicity of each of n runs in each replicate; row 0 is the original sample.

    All metrics share the draws, so that they are compared run by run.
    """

    def __init__(self, n_run: int, rng: np.random.Generator, n_replicate: int = N_REPLICATE) -> None:
        drawn = rng.multinomial(n_run, np.full(n_run, 1 / n_run), size=n_replicate)
        self.counts: Array = np.concatenate([np.ones((1, n_run)), drawn])  # (1 + replicates, runs)

    def ratio(self, above: Array, below: Array) -> Array:
        """Compute Σ above / Σ below over the runs (n, k) at each scan, in every replicate, (1 + replicates, k).

        NaN where a replicate drew only runs without any event: it tells nothing of a share, and `interval` leaves it out.
        """
        whole = self.counts @ below
        return np.divide(self.counts @ above, whole, out=np.full(whole.shape, np.nan), where=whole != 0)

    def mean(self, values: Array) -> Array:
        """Compute the mean of (n,) values over the runs, in every replicate, (1 + replicates,)."""
        return self.counts @ values / len(values)

    def median(self, values: Array) -> Array:
        """Compute the median of (n,) values over the runs, in every replicate, (1 + replicates,)."""
        order, half = values.argsort(), len(values) / 2
        drawn = self.counts[:, order].cumsum(axis=1)
        return 0.5 * (values[order][(drawn >= half).argmax(axis=1)] + values[order][(drawn > half).argmax(axis=1)])

    def difference(self, change: Array) -> Interval:
        """Compute the mean of differences of counts (n,), paired by run, with its interval.

        If no run differs, the interval is that of `rate` for no event, on both sides.
        """
        if not change.any():
            return Interval(0.0, -POISSON_ZERO_UPPER / len(change), POISSON_ZERO_UPPER / len(change))
        return interval(self.mean(change))

    def rate(self, counts: Array, exposure: Array) -> Interval:
        """Compute events per exposure, from counts (n,) and exposures (n,) of each run, with its interval.

        Without any event the bootstrap interval has no width; the upper end is then that of Poisson's exact interval,
        `POISSON_ZERO_UPPER` events in all exposure together (Garwood, Biometrika 28, 1936).
        """
        if not counts.any():
            return Interval(0.0, 0.0, POISSON_ZERO_UPPER / float(exposure.sum()))
        return self.share(counts, exposure)

    def share(self, above: Array, below: Array) -> Interval:
        """Compute Σ above / Σ below over the runs (n,), with its interval."""
        return interval(self.ratio(above[:, None], below[:, None])[:, 0])


def interval(values: Array) -> Interval:
    """Compute the interval of (1 + replicates,) values, the first of the original sample; NaN: a replicate that tells nothing."""
    low, high = np.nanquantile(values[1:], [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2])
    return Interval(float(values[0]), float(low), float(high))


def mean_over_runs(values: Array, seed: int, stream_name: str) -> Interval:
    """Compute the mean of (n,) values over runs, and its interval with draws of this stream of the seed."""
    return interval(Bootstrap(len(values), stream(seed, "reproduce", stream_name)).mean(values))


def band(values: Array) -> tuple[Array, Array, Array]:
    """Compute `interval` at each scan of (1 + replicates, k): the curve and its lower and upper border, (k,) each."""
    low, high = np.nanquantile(values[1:], [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2], axis=0)
    return values[0], low, high


@dataclass(frozen=True)
class SystemValue:
    """Value of another system over the same runs. tracker: its preset; ci95: over those runs."""

    tracker: str
    value: float
    ci95: tuple[float, float]

    @classmethod
    def of(cls, tracker: str, found: Interval) -> SystemValue:
        """Make the value from an interval."""
        return cls(tracker, found.value, (found.low, found.high))

    @classmethod
    def mean(cls, tracker: str, values: Array, seed: int, stream_name: str) -> SystemValue | None:
        """Make the value from the mean of (n,) values over runs; None where all are NaN."""
        known = values[~np.isnan(values)]
        return cls.of(tracker, mean_over_runs(known, seed, stream_name)) if known.size else None


@dataclass(frozen=True)
class ResultRow:
    """One value of ours. paper: None if not printed; ci95: over `runs` runs.

    paper_system: of the paper's system here; baseline: of the plain one. None if not run, or without such a value.
    """

    where: str
    row: str
    column: str
    paper: float | None
    ours: float
    ci95: tuple[float, float]
    unit: str
    runs: int
    paper_system: SystemValue | None = None
    baseline: SystemValue | None = None

    @classmethod
    def of(
        cls,
        where: str,
        row: str,
        column: str,
        ours: Interval,
        unit: str,
        runs: int,
        paper: float | None = None,
        paper_system: SystemValue | None = None,
        baseline: SystemValue | None = None,
    ) -> ResultRow:
        """Make a result from an interval."""
        interval = (ours.low, ours.high)
        return cls(where, row, column, paper, ours.value, interval, unit, runs, paper_system, baseline)

    @classmethod
    def of_runs(
        cls,
        where: str,
        row: str,
        column: str,
        values: Array,
        unit: str,
        seed: int,
        stream_name: str,
        paper: float | None = None,
        paper_system: SystemValue | None = None,
        baseline: SystemValue | None = None,
    ) -> list[ResultRow]:
        """Make the result of the mean of (n,) values over the runs that have one; none where all are NaN."""
        known = values[~np.isnan(values)]
        if not known.size:
            return []
        mean = mean_over_runs(known, seed, stream_name)
        return [cls.of(where, row, column, mean, unit, known.size, paper, paper_system, baseline)]

    @property
    def system_texts(self) -> tuple[tuple[str, str], tuple[str, str]]:
        """Value and interval of the paper's system here, and of the baseline, as texts; a dash for none."""
        return format_system(self.paper_system, self.unit), format_system(self.baseline, self.unit)


_DECIMALS = {
    "1": 3,
    "%": 1,
    "BW": 3,
    "m": 3,
    "cm": 2,
    "m/s": 2,
    "s": 3,
    "steps/min": 1,
    "/run": 2,
    "/person-min": 2,
    "/min": 1,
    "ms": 2,
    "°": 0,
}

Row = tuple[ResultRow, str, str, str]
"""Result, and the texts of the paper's value, ours and its interval."""


def write_results(path: Path, results: Sequence[ResultRow]) -> None:
    """Write `results.json`: a list of objects with the fields of `ResultRow`. Raises InputError where it cannot be written."""
    write_atomic(path, json.dumps([asdict(result) for result in results], indent=2) + "\n")


def rows_of(results: Sequence[ResultRow], *wheres: str) -> list[ResultRow]:
    """Select the results of these tables."""
    return [each for each in results if each.where in wheres]


def format_rows(results: Sequence[ResultRow]) -> list[Row]:
    """Format results for `rows.html.j2`."""
    return [(result, *format_result(result)) for result in results]


def pivot_rows(results: Sequence[ResultRow], intervals: bool = True) -> Mapping[str, object] | None:
    """Pivot results: one row per condition and tracker, one column per metric; of rows named "CONDITION, METRIC", or of
    choices. The other systems are named in the cells of ours where they have no rows.
    """
    have_rows = len({each.column for each in results if ", " in each.row}) > 1
    found: dict[str, dict[str, tuple[str, str, str, list[str]]]] = {}
    for result, paper, ours, spread in format_rows(results):
        condition, _, metric = result.row.partition(", ")
        row, column = (f"{condition}: {result.column}", metric) if metric else (result.row, result.column)
        systems = zip(("the paper’s system here", "baseline"), result.system_texts, strict=True)
        others = [] if have_rows else [f"{name} {text}" for name, (text, interval) in systems if interval]
        cell = ours, spread if intervals else "", "" if result.paper is None else paper, others
        found.setdefault(row, {})[column] = cell
    columns = list(dict.fromkeys(column for row in found.values() for column in row))
    rows = [(row, [cells.get(column) for column in columns]) for row, cells in found.items()]
    return {"columns": columns, "rows": rows} if found else None


def pivot_each(results: Sequence[ResultRow], *wheres: str, intervals: bool = True) -> dict[str, Mapping[str, object]]:
    """Pivot each of these tables that has results, by its name."""
    grids = {where: pivot_rows(rows_of(results, where), intervals) for where in wheres}
    return {where: grid for where, grid in grids.items() if grid is not None}


def format_result(result: ResultRow) -> tuple[str, str, str]:
    """Format the paper's value, ours, and its interval."""
    return _value(result.paper, result.unit), _value(result.ours, result.unit), _interval(result.ci95, result.unit)


def format_system(found: SystemValue | None, unit: str) -> tuple[str, str]:
    """Format the value of another system and its interval; a dash and an empty text for none."""
    return ("–", "") if found is None else (_value(found.value, unit), _interval(found.ci95, unit))


def _value(value: float | None, unit: str) -> str:
    return format_number(value, _DECIMALS[unit], _shown(unit))


def _interval(ci95: tuple[float, float], unit: str) -> str:
    low, high = (format_number(value, _DECIMALS[unit]) for value in ci95)
    return " ".join(filter(None, (low, "to", high, _shown(unit))))


def _shown(unit: str) -> str:
    return "" if unit == "1" else unit


def format_ranges(scans: NDArray[np.intp]) -> str:
    """Format ascending scans with ranges: "3, 7–9"; "none" without any."""
    if len(scans) == 0:
        return "none"
    runs = np.split(scans, np.flatnonzero(np.diff(scans) > 1) + 1)
    return ", ".join(f"{run[0]}" if len(run) == 1 else f"{run[0]}–{run[-1]}" for run in runs)


_NAMES = {"where": "where", "row": "row", "metric": "column"}


def print_results(title: str, results: Sequence[ResultRow]) -> None:
    """Print a table on stdout: values of the paper, its system here, ours, and the baseline if run."""
    has_systems = any(each.paper_system or each.baseline for each in results)
    names = {name: [getattr(each, field) for each in results] for name, field in _NAMES.items()}
    shown = [name for name, texts in names.items() if name == "row" or len(set(texts)) > 1]  # one for all says nothing
    heads = [*shown, "paper", *(["paper's system here"] if has_systems else []), "ours", "95 %"]
    rows = []
    for number, result in enumerate(results):
        paper, ours, interval = format_result(result)
        (papers_system, _), (baseline, _) = result.system_texts
        values = (paper, papers_system, ours, interval, baseline) if has_systems else (paper, ours, interval)
        rows.append([*(names[name][number] for name in shown), *values])
    print_table([*heads, *(["baseline"] if has_systems else [])], rows, names=len(shown), title=title)


def make_folder(folder: Path) -> None:
    """Make a folder of `--out`. Raises InputError where it cannot be written."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"--out {folder}: cannot be written ({error.strerror}); a writable folder is needed"
        ) from error


def write_reproduction(
    folder: Path,
    command: str,
    template_name: str,
    results: Sequence[ResultRow],
    drawn: Mapping[str, str],
    **content: Any,
) -> dict[str, Path]:
    """Write `results.json`, plots as SVG, and the page from a template of this package; return their paths by name.

    command: the command that repeats it; drawn: plots as SVG by name, `plots` in the template; content: its other variables.
    Raises InputError where a file cannot be written.
    """
    svgs = {name: folder / f"{name}.svg" for name in drawn}
    paths = {"results": folder / "results.json", **svgs, "page": folder / "report.html"}
    write_results(paths["results"], results)
    plots = {name: data_uri(svg) for name, svg in drawn.items()}
    page = page_template("twin.reproduce", template_name).render(command=command, plots=plots, **content)
    for name, text in {**drawn, "page": page}.items():
        write_atomic(paths[name], text)
    return paths


def write_pictures(folder: Path, pictures: Mapping[str, bytes]) -> None:
    """Write JPEGs under their names. Raises InputError where a file cannot be written."""
    for name, jpeg in pictures.items():
        write_atomic(folder / f"{name}.jpg", jpeg)
