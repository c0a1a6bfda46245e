"""Tables of a suite's results: on the terminal, and in Markdown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import groupby
from pathlib import Path

from twin.console import PlainConsole, print_table, without_empty
from twin.messages import counted, printable
from twin.report.metrics_table import HEADLINE_METRICS, format_number
from twin.suites.comparison import EVERY_TRACKER, Change, Comparison, SuiteOutcome
from twin.suites.expansion import with_variant
from twin.suites.filmstrip import incident_links, significance
from twin.suites.metrics import (
    FEWEST,
    METRICS,
    RATES,
    RECORDING_METRICS,
    MeanOverSeeds,
    format_beside,
    format_metric,
    format_range,
    known_of,
    mean_over_seeds,
    metric_named,
    pooled_shares,
)
from twin.suites.permutation_test import ALPHA
from twin.suites.results import (
    BEHIND_HOTA,
    REFERENCE_METRICS,
    Group,
    GroupKey,
    ReferenceDifference,
    RequirementCheck,
    Results,
    differences_by_scenario,
    differences_from,
    note_on_frames,
)
from twin.suites.store import ResultStore

_MOST_ROWS = 30
_MOST_SMALL_ROWS = 10


def print_results(results: Results, reference: str | None = None) -> None:
    """Print means over seeds, one row per scenario, variant and tracker; differences from `reference`; failed cases."""
    rows, metrics = [], known_of(HEADLINE_METRICS, (each.values for each in results.groups.values()))
    for key, group in results.groups.items():
        name = with_variant(key.scenario, group.variant)
        cells = [_mean_text(metric, mean_over_seeds(group.values(metric))) for metric in metrics]
        rows.append([name, key.tracker, str(len(group.seeds)), group.n, *cells])
    console = PlainConsole()
    console.print(f"{results.suite}: means over seeds, gate 0.5 m")
    heads = [results.place, "tracker", "seeds", "person-frames", *map(_heading, metrics)]
    print_table(*without_empty(heads, rows, names=2), names=2)
    if note := note_on_frames(results):
        console.print(note, soft_wrap=True)
    if reference is not None:
        console.print(
            f"compared with {reference}, paired by scenario and seed; *: the 95 % interval leaves out 0 "
            f"(from {FEWEST} rooms and seeds on)"
        )
        _print_differences(results, reference)
        console.print("all cases together, by the frames of each person")
        _print_pooled(results)
    for case in results.failed[:_MOST_ROWS]:
        error = (case.error or "").splitlines()
        console.print(
            f"failed after {counted(case.attempts, 'attempt')}: {case.id}: {error[0] if error else ''}",
            soft_wrap=True,
        )
    if results.unfinished:
        console.print(f"not finished: {counted(results.unfinished, 'case')}")


def _heading(metric: str) -> str:
    """Format a metric's name and unit as a heading."""
    figure = METRICS[metric]
    return f"{figure.name}{f' [{figure.unit}]' if figure.unit else ''}"


def _reference_heading(metric: str) -> str:
    """Format a metric's name and unit as a heading of differences from a reference."""
    return f"{RATES[metric].name} {RATES[metric].unit}" if metric in RATES else _heading(metric)


def _print_differences(results: Results, reference: str) -> None:
    """Print the mean differences of every other tracker from the reference: over all scenarios, and in each."""
    strata = differences_by_scenario(results, reference)
    rows: list[list[str] | None] = [["all", *_reference_cells(row)] for row in differences_from(results, reference)]
    for (scenario, variant), own in strata.items():
        rows += [None, *([with_variant(scenario, variant), *_reference_cells(row)] for row in own)]
    heads = [
        results.place,
        "tracker",
        "cases",
        *map(_reference_heading, REFERENCE_METRICS),
        f"behind by > {BEHIND_HOTA:g} HOTA",
    ]
    if len(strata) > 1:
        print_table(*without_empty(heads, rows, names=2), names=2)
    else:
        print_table(
            *without_empty(heads[1:], [row[1:] for row in rows if row is not None and row[0] == "all"], names=1)
        )


_WITH_INTERVAL = ("mota", "hota")
"""Metrics whose differences are shown with their 95 % interval."""


def _interval(metric: str, found: MeanOverSeeds) -> str:
    if found.low is None or found.high is None:
        return ""
    low, high = (format_metric(metric, bound, True).split()[0] for bound in (found.low, found.high))
    return f" {low} to {high}"


def _reference_cells(row: ReferenceDifference) -> list[str]:
    cells = [
        "–"
        if found is None
        else format_metric(metric, found.mean, True).split()[0]
        + ("*" if row.verdict(metric) else "")
        + (_interval(metric, found) if metric in _WITH_INTERVAL else "")
        for metric, found in row.differences.items()
    ]
    return [row.tracker, str(row.n_case), *cells, "–" if row.behind is None else f"{row.behind:.1%}"]


def _print_pooled(results: Results) -> None:
    """Print the shares of `pooled_shares`, one row per tracker."""
    cases: dict[str, list[Mapping[str, float | None]]] = {}
    for key, group in results.groups.items():
        cases.setdefault(key.tracker, []).extend(group.seeds.values())
    shares = {tracker: pooled_shares(each) for tracker, each in cases.items()}
    rows = []
    for tracker, found in shares.items():
        people = sum(case.get("judged.person_frames") or 0.0 for case in cases[tracker])
        cells = ["–" if share is None else f"{share:.2%}".replace("-", "−") for share in found.values()]
        rows.append([tracker, f"{people:.0f}", *cells])
    print_table(*without_empty(["tracker", "person-frames", *next(iter(shares.values()), {})], rows, names=1))


def print_comparison(
    comparison: Comparison,
    results: Results,
    run: tuple[ResultStore, Path] | None,
    shown: Sequence[str] = ("worse", "better"),
    page: str = "report.html",
) -> None:
    """Print worse metrics, their changes and incidents in `run` (results and folder), then better ones; notes on stderr.

    page: the one that lists them all.
    """
    console = PlainConsole()
    for warning in comparison.warnings:
        PlainConsole(stderr=True).print(f"twin: warning: {warning}", soft_wrap=True)
    for word in shown:
        changes = comparison.worse if word == "worse" else comparison.better
        if changes:
            console.print(f"{len(changes)} metric{'s' if len(changes) > 1 else ''} got {word}")
            _print_changes(changes[:_MOST_ROWS], results.place)
            if len(changes) > _MOST_ROWS:
                console.print(f"and {len(changes) - _MOST_ROWS} more that got {word}, all in {page}")
        if word == "worse" and run is not None:
            places: dict[str, list[str]] = {}
            for _, each in incident_links(changes[:_MOST_ROWS], results, *run):
                places.setdefault(each.place, []).append(f"{each.t_s:.1f} s ({each.what})")
            for place, times in places.items():
                console.print(f"see {place} at {', '.join(dict.fromkeys(times))}", soft_wrap=True)
    if comparison.identical:
        console.print(f"every recording and metric has the same bits: {len(comparison.changes)} compared")
    elif not comparison.worse:
        console.print(f"nothing got worse: {len(comparison.changes)} metrics compared")
    if other := _within_chance(comparison):
        console.print(
            f"{len(other)} changed by no more than the tolerance, or by more but with a p above {ALPHA}; the largest:"
        )
        _print_changes(other[:_MOST_SMALL_ROWS], results.place)
    console.print(
        "minimum detectable change: the smallest loss, equal in every recording, that raises an alarm while nothing else "
        "changes. One that differs between recordings must be larger, and larger again where much else changes. Ranges are over "
        "trackers and scenarios, by the scatter of their earlier seeds",
        soft_wrap=True,
    )
    _print_detectable(comparison)


def _within_chance(comparison: Comparison) -> list[Change]:
    """Return the headline metrics that changed and count neither as worse nor better, by change over tolerance."""
    changed = [
        each
        for each in comparison.changes
        if each.metric in HEADLINE_METRICS and each.change and not (each.worse or each.better)
    ]
    return sorted(changed, key=lambda each: -each.excess)


def _print_detectable(comparison: Comparison) -> None:
    """Print the minimum detectable change of the headline metrics."""
    shown = [each for each in comparison.detectable if each.metric in HEADLINE_METRICS]
    rows: list[list[str]] = []

    def add(name: str, losses: Sequence[tuple[float, float] | None]) -> None:
        cells = [
            "" if loss is None else format_range(each.metric, *loss).removesuffix(f" {METRICS[each.metric].unit}")
            for each, loss in zip(shown, losses, strict=True)
        ]
        rows.append([name, *cells])

    for tracker in sorted({tracker for each in shown for tracker in each.of_tracker}):
        own = [each.of_tracker.get(tracker) for each in shown]
        add(f"in all scenarios of {tracker}", [None if loss is None else (loss, loss) for loss in own])
    add("in all seeds of one scenario", [each.in_scenario for each in shown])
    add("in one case alone", [each.in_case for each in shown])
    print_table(["the loss is", *(_heading(each.metric) for each in shown)], rows)


def print_requirements(requirements: Sequence[RequirementCheck]) -> None:
    """Print the requirements that are not met, and the number of those met."""
    if not requirements:
        return
    console = PlainConsole()
    broken = [each for each in requirements if each.violated]
    for each in broken[:_MOST_ROWS]:
        name = with_variant(each.key.scenario, each.variant)
        text = f"requirement not met: {name}, {each.key.tracker}: {each.sentence()}"
        console.print(text, soft_wrap=True)
    console.print(f"{len(requirements) - len(broken)} of {len(requirements)} requirements met")


def change_cells(change: Change) -> list[str]:
    """Format scenario, tracker, metric, before, now, change, allowed change, significance and number of seeds."""
    metric = change.metric
    changed = (
        ["missing", "", ""]
        if change.now is None
        else [
            format_metric(metric, change.now),
            *format_beside(metric, change.change, change.allowed),
        ]
    )
    return [
        with_variant(change.key.scenario, change.variant),
        change.key.tracker,
        metric_named(metric).name,
        format_metric(metric, change.before),
        *changed,
        significance(change),
        str(change.n_seed),
    ]


def _print_changes(changes: Sequence[Change], place: str) -> None:
    heads = (place, "tracker", "metric", "before", "now", "change", "allowed", "significance", "seeds")
    print_table(heads, [change_cells(change) for change in changes], names=3)


def _mean_text(metric: str, mean: MeanOverSeeds | None) -> str:
    return format_number(None if mean is None else mean.mean, METRICS[metric].decimals or 1)


_SHOWN = ("mota", "idf1", "hota", "id_switches", "misidentifications", "lost_tracks")


def markdown_table(results: Results) -> str:
    """Format means over seeds, one row per scenario, variant and tracker; the best of each scenario in bold."""
    metrics = known_of(_SHOWN, (each.values for each in results.groups.values()))
    heads = [METRICS[metric].name for metric in metrics]
    lines = [
        _line([results.place, "tracker", "seeds", "person-frames", *heads]),
        _line(["---", "---", *["--:"] * (2 + len(heads))]),
    ]
    for _, rows in groupby(results.groups.items(), key=lambda row: (row[0].scenario, row[0].overrides)):
        lines += _rows_of_scenario(list(rows), metrics)
    note = note_on_frames(results)
    return "\n".join([*lines, *([f"\nNote: {_cell(note)}."] if note else [])])


def markdown_verdict(outcome: SuiteOutcome) -> str:
    """Format the verdict in one line, and below it what got worse and the requirements not met."""
    comparison = outcome.comparison
    word, _, rest = outcome.verdict().partition(" ")
    lines = [f"{outcome.results.suite}: {word if outcome.passed else f'**{word}**'} {_cell(rest)}."]
    for each in outcome.violated:
        name = with_variant(each.key.scenario, each.variant)
        lines.append(f"- not met: {_cell(f'{name}, `{each.key.tracker}`: {each.sentence()}')}")
    if comparison is not None and comparison.worse:
        lines += ["", markdown_comparison(comparison)]
    return "\n".join(lines)


def markdown_comparison(comparison: Comparison) -> str:
    """Format worse and better metrics, one row each, and the notes; one line where nothing got worse."""
    heads = ["", "scenario", "tracker", "metric", "before", "now", "change", "allowed", "significance", "seeds"]
    changes = [("worse", each) for each in comparison.worse] + [("better", each) for each in comparison.better]
    lines = [
        f"{len(comparison.changes)} metrics compared: {len(comparison.worse)} worse, {len(comparison.better)} better."
    ]
    if changes:
        lines += ["", _line(heads), _line(["---"] * 4 + ["--:"] * 6)]
    for word, change in changes:
        name, tracker, *cells = change_cells(change)
        tracker = tracker if tracker == EVERY_TRACKER else f"`{tracker}`"
        lines.append(_line([f"**{word}**" if word == "worse" else word, name, tracker, *cells]))
    return "\n".join([*lines, *(f"\nWarning: {_cell(warning)}" for warning in comparison.warnings)])


def _rows_of_scenario(rows: list[tuple[GroupKey, Group]], metrics: Sequence[str]) -> list[str]:
    columns = [_column(metric, [group for _, group in rows]) for metric in metrics]
    lines = []
    for place, (key, group) in enumerate(rows):
        cells = [
            with_variant(key.scenario, group.variant) if place == 0 else "",
            f"`{key.tracker}`",
            str(len(group.seeds)),
            group.n,
            *[column[place] for column in columns],
        ]
        lines.append(_line(cells))
    return lines


def _column(metric: str, groups: list[Group]) -> list[str]:
    """Format a metric of each tracker; the best in bold, unless all are equal or none is better."""
    means = [mean_over_seeds(group.values(metric)) for group in groups]
    figure = METRICS[metric]
    texts = ["–" if mean is None else f"{mean.mean:.{figure.decimals or 1}f}" for mean in means]
    known = {float(text) for text in texts if text != "–"}
    if len(known) > 1 and metric not in RECORDING_METRICS:
        best = max(known) if figure.better == "more" else min(known)
        texts = [f"**{text}**" if text != "–" and float(text) == best else text for text in texts]
    return [text.replace("-", "−") for text in texts]


def _line(cells: list[str]) -> str:
    return f"| {' | '.join(map(_cell, cells))} |"


def _cell(text: str) -> str:
    """Escape a user's text for a table cell: it neither ends the cell nor is a tag."""
    return printable(" ".join(text.split())).replace("|", "\\|").replace("<", "&lt;")
