"""Metrics of a case: the entries of `metrics.json`, the compared ones and their default tolerances.

The default tolerances are ours, small enough to detect validation gates of half the size (in MOTP, DetA and OSPA; seeds 0 to
2 and 1000 to 1002). Harmless changes move metrics less: in the lab, seeds 1000 to 1005, other image noise changed no metric
of any tracker with a camera, in 144 pairs of runs (`scripts/bench --only suite-spread`). Other *scanner* noise changes
identities: DetA of trackers without a camera moves by 0.011, IDF1 by 0.045 (σ of a mean over three seeds). Where scans
differ, `twin.suites.permutation_test` adds an allowance for chance.
"""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf, isclose, isfinite
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, Field

from trackers.configuration import Strict
from trackers.errors import InputError
from twin.report.metrics_table import (
    METRICS as REPORT_METRICS,
    SUMMED_OVER_FRAMES,
    Metric,
    format_number,
)
from twin.streams import stream

PERSON_FRAMES = "judged.person_frames"
"""Number of people in the evaluated frames, summed over frames."""

RECORDING_METRICS: Mapping[str, Metric] = {
    each.key: each
    for each in (
        Metric("track_count", "Tracks", "", "ids that a tracker gave in a recording", "less", 0),
        Metric("tracks_per_frame", "Tracks per frame", "", "mean number of tracks reported at once", "less", 2),
    )
}
"""Metrics of tracks alone, for bags without truth: bounds of `require`, not compared, as neither direction is better."""

METRICS: Mapping[str, Metric] = {**REPORT_METRICS, **RECORDING_METRICS}


RATES: Mapping[str, Metric] = {
    key: replace(REPORT_METRICS[key], unit="per 1,000 person-frames", decimals=1) for key in SUMMED_OVER_FRAMES
}
"""Counts that grow with the number of evaluated frames, as two trackers are compared by them."""


def rate(key: str, figures: Mapping[str, float | None]) -> float | None:
    """Return a metric as two trackers are compared by it: one of `RATES` as a rate; None without person-frames."""
    value = figures.get(key)
    if key not in RATES or value is None:
        return value
    return 1000 * value / people if (people := figures.get(PERSON_FRAMES)) else None


def at_frames_of(
    key: str, value: float, figures: Mapping[str, float | None], before: Mapping[str, float | None]
) -> float:
    """Return a metric of a case, of `RATES` the count at its rate in the person-frames that the case had before, if known."""
    people, had = figures.get(PERSON_FRAMES), before.get(PERSON_FRAMES)
    return value * had / people if key in RATES and people and had and people != had else value


def known_of(metrics: Sequence[str], values_of: Iterable[Callable[[str], list[float]]]) -> tuple[str, ...]:
    """Return these metrics, and those of tracks alone where a group has no other, as of bags without truth.

    values_of: of each group, its values of a metric.
    """
    groups = list(values_of)
    without = [not any(map(values, metrics)) for values in groups]
    if not any(
        any(map(values, RECORDING_METRICS)) for values, has_none in zip(groups, without, strict=True) if has_none
    ):
        return tuple(metrics)
    return (*([] if all(without) else metrics), *RECORDING_METRICS)


class Tolerance(Strict):
    """Tolerated worsening of a metric's mean over a scenario's seeds: absolute + relative × |baseline|."""

    absolute: float = Field(default=0.0, ge=0, description="how much worse the figure may get, in its own unit")
    relative: float = Field(default=0.0, ge=0, description="what is added to that, as a share of the baseline's figure")

    def allowed(self, baseline: float) -> float:
        """Compute the tolerated change, in the metric's unit."""
        return self.absolute + self.relative * abs(baseline)


GATED: Mapping[str, Tolerance] = {
    "mota": Tolerance(absolute=0.005),
    "motp_m": Tolerance(absolute=0.0005, relative=0.01),
    "idf1": Tolerance(absolute=0.01),
    "hota": Tolerance(absolute=0.008),
    "deta": Tolerance(absolute=0.003),
    "assa": Tolerance(absolute=0.01),
    "gospa_m": Tolerance(absolute=0.003, relative=0.02),
    "ospa_m": Tolerance(absolute=0.001, relative=0.02),
    "misidentifications": Tolerance(absolute=0.5),
    "lost_tracks": Tolerance(absolute=0.5),
    "id_switches": Tolerance(absolute=0.5),
    "misses": Tolerance(absolute=2.0, relative=0.1),
    "false_positives": Tolerance(absolute=2.0, relative=0.1),
    "head_error_m.x": Tolerance(absolute=0.002, relative=0.02),
    "head_error_m.y": Tolerance(absolute=0.002, relative=0.02),
    "head_error_m.z": Tolerance(absolute=0.002, relative=0.02),
    "head_yaw_error_rad": Tolerance(absolute=0.01, relative=0.02),
}
"""Compared metrics in the order shown. Those at the wider gate add little, and the time per frame depends on the machine's
load.
"""

SHOWN = tuple(metric for metric in METRICS if metric in GATED or metric == "hota_cap")
"""Metrics of a page's tables; the cap of HOTA does not depend on the tracker alone, and so is not compared."""

SENSOR_METRICS: Mapping[str, Metric] = {
    "range_scatter_m": Metric(
        "range_scatter_m", "Scatter of ranges", "m", "of a scanner, where a beam meets one surface twice", "less", 4
    )
}
"""Metrics of a sensor's own reports, independent of trackers."""

GATED_SENSOR_METRICS: Mapping[str, Tolerance] = {"range_scatter_m": Tolerance(relative=0.05)}
"""Compared sensor metrics. Another draw of the same noise moves less, and doubled noise more than twice as much, even with
people walking through (tests/twin/suites/test_suite_contents.py).
"""


def allowed_by_default(metric: str, baseline: float) -> float:
    """Compute the default tolerance of a metric, in its unit."""
    return (GATED[metric] if metric in GATED else GATED_SENSOR_METRICS[metric]).allowed(baseline)


def tolerances_of(facts: Mapping[str, Any]) -> Callable[[str, float], float]:
    """Return the function that computes tolerances, from the suite's facts."""
    own = {name: Tolerance(**content) for name, content in facts.get("tolerances", {}).items()}

    def allowed(metric: str, baseline: float) -> float:
        return own[metric].allowed(baseline) if metric in own else allowed_by_default(metric, baseline)

    return allowed


def metric_named(key: str) -> Metric:
    """Look up a compared metric: of a tracker, or of a sensor."""
    return SENSOR_METRICS[key] if key in SENSOR_METRICS else METRICS[key]


def flatten_metrics(metrics: Mapping[str, Any]) -> dict[str, float | None]:
    """Flatten a tracker's entry of `metrics.json` to numbers by dotted path, without the gate, which is no result."""
    return {key: value for key, value in _leaves(metrics, "") if key != "gate_m"}


def metric_range(key: str) -> tuple[float, float]:
    """Return the least and the greatest value of a metric.

    Metrics for which more is better are shares or 1 less something; all others are counts, lengths or angles.
    """
    least = -inf if key.rpartition(".")[2] in ("mota", "accuracy") else 0.0
    return least, 1.0 if METRICS[key].better == "more" else inf


def check_ranges(figures: Mapping[str, float | None], source: str) -> None:
    """Raise InputError, naming `source` and the metric, for a value outside the metric's range."""
    for key, value in figures.items():
        if value is None or key not in METRICS:
            continue
        least, most = metric_range(key)
        if not least <= value <= most + 1e-9:
            raise InputError(f"{source}: {key} is {value:g}; a number from {least:g} to {most:g} is expected")


def _leaves(content: Mapping[str, Any], prefix: str) -> Iterator[tuple[str, float | None]]:
    for key, value in content.items():
        if isinstance(value, Mapping):
            yield from _leaves(value, f"{prefix}{key}.")
        elif value is None or (isinstance(value, int | float) and not isinstance(value, bool)):
            yield f"{prefix}{key}", None if value is None else float(value)


_WITHIN = (50, 80, 95)
"""Stated probabilities of the radii shown [%]."""


def pooled_shares(cases: Sequence[Mapping[str, float | None]]) -> dict[str, float | None]:
    """Compute shares over the frames of all cases, by name; None where the cases lack what they are shares of.

    Ghosts: coasting rows matched with no person, of all rows. MOTA of the seen: without misses of people that no used sensor
    sees, and without their ghosts; and after start-up, also without misses of people not yet tracked.
    """

    def total(name: str, weight: str | None = None) -> float:
        return sum((case.get(name) or 0.0) * (1.0 if weight is None else case.get(weight) or 0.0) for case in cases)

    extra, hidden_ghosts = total("false_positives"), total("errors.false_positive.ghost_unseen")
    start_up = total("errors.missed.start_up")
    seen = total(PERSON_FRAMES) - total("errors.missed.unseen") - total("errors.missed.unused")
    wrong = total("errors.missed.seen") + extra - hidden_ghosts + total("id_switches")
    stated = "within_radius.n"
    parts = {
        "ghosts": (total("errors.false_positive.ghost") + hidden_ghosts, total("judged.matches") + extra),
        "MOTA of the seen": (seen - wrong - start_up, seen),
        "after start-up": (seen - start_up - wrong, seen - start_up),
        **{f"within {each} % radius": (total(f"within_radius.{each}", stated), total(stated)) for each in _WITHIN},
    }
    return {name: part / whole if whole > 0 else None for name, (part, whole) in parts.items()}


_N_REPLICATE = 2000
FEWEST = 6
"""Values that an interval needs: of fewer, all are on one side of 0 by chance in more than 5 % of cases (2 · 0.5^n)."""
_MOST_DRAWN = 10**7  # values drawn at a time: 80 MB


@dataclass(frozen=True)
class MeanOverSeeds:
    """Mean of a metric over seeds and its 95 % bootstrap interval, whose bounds are None for fewer than `FEWEST` seeds."""

    mean: float
    low: float | None
    high: float | None
    n: int


def mean_over_seeds(values: list[float], together: Sequence[Hashable] | None = None) -> MeanOverSeeds | None:
    """Compute the mean and its percentile interval; None without values. Equal values give equal intervals.

    together: a label of each value. Values of one label share their chance, as cases of one drawn room do: the bootstrap draws
    labels, each with all its values (Davison and Hinkley, "Bootstrap methods", 1997, 3.8), and `FEWEST` counts labels.
    """
    if not values:
        return None
    n, mean = len(values), float(np.mean(values))
    label = np.arange(n) if together is None else np.unique([repr(each) for each in together], return_inverse=True)[1]
    of_label = np.bincount(label)
    if len(of_label) < FEWEST:
        return MeanOverSeeds(mean, None, None, n)
    from scipy.stats import bootstrap  # takes a while to load

    interval = bootstrap(
        (np.bincount(label, weights=values), of_label),
        lambda total, count, axis: total.sum(axis=axis) / count.sum(axis=axis),
        n_resamples=_N_REPLICATE,
        batch=max(1, _MOST_DRAWN // len(of_label)),
        vectorized=True,
        paired=True,
        confidence_level=0.95,
        method="percentile",
        rng=stream(len(of_label), "suite", "means"),
    ).confidence_interval
    return MeanOverSeeds(mean, float(interval.low), float(interval.high), n)


def worsening(key: str, change: float) -> float:
    """Compute the change of a metric, positive for the worse."""
    return -change if metric_named(key).better == "more" else change


def format_metric(key: str, value: float | None, sign: bool = False) -> str:
    """Format a metric with its unit; counts, which are means over seeds here, with one decimal."""
    metric = metric_named(key)
    return format_number(value, metric.decimals or 1, metric.unit, sign=sign)


def format_beside(key: str, change: float, allowed: float, sign: bool = True) -> tuple[str, str]:
    """Format a change and the allowed one with units, alike only if equal; an allowed change that is not 0 has a digit of it."""
    metric = metric_named(key)
    unit, decimals = metric.unit, metric.decimals or 1
    while decimals < _MOST_DIGITS:
        texts = [format_number(abs(each), decimals) for each in (change, allowed)]
        is_shown = float(texts[1]) > 0 or not allowed
        if is_shown and (texts[0] != texts[1] or isclose(abs(change), allowed)):
            break
        decimals += 1
    return format_number(change, decimals, unit, sign=sign), format_number(allowed, decimals, unit)


def format_range(key: str, least: float, most: float) -> str:
    """Format a range of a metric with its unit, "0.063 to 0.096 m"; one value where both are written alike."""
    low, high = format_metric(key, least), format_metric(key, most)
    return high if low == high else f"{low.split()[0]} to {high}"


_COMPARISONS: Mapping[str, Callable[[float, float], bool]] = {
    ">=": operator.ge,
    "<=": operator.le,
    ">": operator.gt,
    "<": operator.lt,
    "==": operator.eq,
}

_BOUND = re.compile(r"\s*(>=|<=|==|>|<)?\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*", re.ASCII)

_ROUNDING = 1e-9
_MOST_DIGITS = 9


def _bound(value: str | float) -> str:
    """Parse a bound like `>= 0.97`; a whole number alone means equality, which a mean of others hardly ever keeps."""
    found = None if isinstance(value, bool) else _BOUND.fullmatch(str(value))
    if found is None:
        raise ValueError('a whole number, or a bound as in ">= 0.97", is expected')
    if found[1] is None and not float(found[2]).is_integer():
        raise ValueError(f'a bound as in ">= {found[2]}" or "<= {found[2]}" is expected; equality is "== {found[2]}"')
    return f"{found[1] or '=='} {found[2]}"


Bound = Annotated[str, BeforeValidator(_bound, json_schema_input_type=str | float)]


def within_range(bounds: dict[str, str]) -> dict[str, str]:
    """Return bounds by metric. Raises ValueError for one whose limit is no value of its metric, or that no value meets."""
    for key, bound in bounds.items():
        sign, _, text = bound.partition(" ")
        (least, most), limit = metric_range(key), float(text)
        if not (isfinite(limit) and least <= limit <= most) or (sign, limit) in ((">", most), ("<", least)):
            raise ValueError(f"{key}: {bound!r} is outside its range; a bound within {least:g} to {most:g} is expected")
    return bounds


def holds(mean: float, bound: str) -> bool:
    """Check a mean against a bound."""
    sign, _, limit = bound.partition(" ")
    # means of floats: that of a hundred times 0.97 is 0.97
    rounded = float(limit) if abs(mean - float(limit)) <= _ROUNDING else mean
    return _COMPARISONS[sign](rounded, float(limit))
