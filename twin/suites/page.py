"""Page of a suite: one row per scenario with small multiples of its metrics and a film strip of its worst second."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from markupsafe import Markup

from twin.evaluate.accuracy import WITHIN, calibration_curve
from twin.messages import counted
from twin.recording.atomic_file import write_atomic
from twin.report.metrics_table import HEADLINE_METRICS, format_number
from twin.report.page import calibration_chart
from twin.report.palette import IDENTITY_COLOURS, data_uri, hex_colour, page_template
from twin.suites.comparison import Change, Comparison, SuiteOutcome
from twin.suites.filmstrip import STRIP, colour_of, incident_links, marker, scale_of, small_multiple
from twin.suites.metrics import (
    FEWEST,
    METRICS,
    PERSON_FRAMES,
    RATES,
    RECORDING_METRICS,
    SHOWN,
    format_metric,
    format_range,
    known_of,
    mean_over_seeds,
    metric_named,
)
from twin.suites.permutation_test import ALPHA
from twin.suites.result_files import case_page
from twin.suites.result_tables import change_cells
from twin.suites.results import (
    BEHIND_HOTA,
    REFERENCE_METRICS,
    Group,
    GroupKey,
    PairedCase,
    ReferenceDifference,
    RequirementCheck,
    Results,
    differences_by_scenario,
    differences_from,
    note_on_frames,
    room_of,
    worst_cases,
)
from twin.suites.store import ResultStore


def write_page(path: Path, outcome: SuiteOutcome) -> None:
    """Write the page of a run into its folder; it takes its name when complete. Raises InputError as a file does."""
    store, folder, results, facts = outcome.store, outcome.folder, outcome.results, outcome.store.facts()
    _write(
        path,
        title=f"{results.suite}: a suite",
        description=facts["description"],
        results=results,
        before=outcome.before,
        comparison=outcome.comparison,
        baseline=outcome.baseline,
        requirements=outcome.requirements,
        links=_links(outcome.comparison, results, store, folder, path.parent),
        worst=[
            _worst(case, facts.get("worst_filmstrips", {}), folder)
            for case in (worst_cases(results, facts["reference"]) if facts.get("reference") else [])
        ],
        sections=[
            section | {"filmstrip": _filmstrip(section["cases"], facts.get("filmstrips", {}), store, folder)}
            for section in _sections(results, outcome.before)
        ],
        seconds=facts["seconds"],
        reference=facts.get("reference"),
        link=lambda case_id: case_page(folder, case_id).relative_to(folder).as_posix(),
    )


def _links(
    comparison: Comparison | None, results: Results, store: ResultStore, folder: Path, page: Path
) -> dict[int, tuple[str, str]]:
    """Link each change to its incident in the run in `folder`, relative to the folder `page`."""
    worse = comparison.worse if comparison is not None else ()
    return {
        id(change): (
            Path(os.path.relpath(each.page, page)).as_posix(),
            f"{each.case}{', ' if each.case else ''}{each.t_s:.1f} s: {each.what}",
        )
        for change, each in incident_links(worse, results, store, folder)
    }


def write_comparison_page(
    path: Path,
    comparison: Comparison,
    before: Results,
    now: Results,
    title: str,
    run: tuple[ResultStore, Path] | None = None,
) -> None:
    """Write a page of two runs, linked to the incidents of `run` (results and folder); raises InputError as a file does."""
    sections = [section | {"filmstrip": None, "cases": []} for section in _sections(now, before)]
    _write(
        path,
        title=title,
        results=now,
        before=before,
        comparison=comparison,
        links=_links(comparison, now, *run, path.parent) if run is not None else {},
        sections=sections,
    )


def _write(
    path: Path,
    *,
    results: Results,
    comparison: Comparison | None,
    links: Mapping[int, tuple[str, str]],
    requirements: Sequence[RequirementCheck] = (),
    reference: str | None = None,
    **content: Any,
) -> None:
    """Write a page; content: further variables of the template, those of a run alone by default as of a comparison."""
    of_run = {"baseline": "", "description": "", "worst": [], "seconds": None, "link": None}
    headline = [each for each in comparison.detectable if each.metric in HEADLINE_METRICS] if comparison else []
    trackers = [(name, colour_of(slot), Markup(marker(slot, 11, 7))) for name, slot in _slots(results).items()]
    rows = differences_from(results, reference) if reference is not None else []
    strata = differences_by_scenario(results, reference) if reference is not None else {}
    shown = comparison or Comparison((), ())
    page = page_template("twin.suites", "page.html.j2").render(
        results=results,
        trackers=trackers,
        slots=[hex_colour(colour) for colour in IDENTITY_COLOURS],
        failed=[(case, (case.error or "").splitlines()) for case in results.failed],
        compared=comparison is not None,
        warnings=shown.warnings,
        n_compared=len(shown.changes),
        identical=shown.identical,
        alpha=ALPHA,
        detectable=[
            (
                metric_named(each.metric),
                *(format_range(each.metric, *losses) for losses in (each.everywhere, each.in_scenario, each.in_case)),
            )
            for each in shown.detectable
        ],
        detectable_trackers=sorted({tracker for each in headline for tracker in each.of_tracker}),
        detectable_of=[
            (
                metric_named(each.metric),
                {name: format_metric(each.metric, loss) for name, loss in each.of_tracker.items()},
            )
            for each in headline
        ],
        violated=[(each, METRICS[each.metric].name) for each in requirements if each.violated],
        n_requirement=len(requirements),
        worse=[_change(each, links) for each in shown.worse],
        better=[_change(each, links) for each in shown.better],
        reference=reference,
        reference_metrics=[RATES.get(metric, METRICS[metric]) for metric in REFERENCE_METRICS],
        note_on_frames=note_on_frames(results),
        behind_hota=BEHIND_HOTA,
        fewest=FEWEST,
        undirected=RECORDING_METRICS,
        place=results.place,
        reference_rows=[_reference_row(row) for row in rows],
        calibration=_calibration(results),
        strata=[(*place, [_reference_row(row) for row in found]) for place, found in strata.items()],
        n_done=sum(len(group.seeds) for group in results.groups.values()),
        **(of_run | content),
    )
    write_atomic(path, page)


def _sections(results: Results, before: Results | None) -> list[dict[str, Any]]:
    """Collect the contents of the page's sections, one per scenario and variant."""
    rows: dict[tuple[str, str], list[tuple[GroupKey, Group]]] = {}
    for key, group in results.groups.items():
        rows.setdefault((key.scenario, key.overrides), []).append((key, group))
    scales = {metric: scale_of(metric, results.groups.values()) for metric in (*HEADLINE_METRICS, *RECORDING_METRICS)}
    slots = _slots(results)
    sections = []
    for (scenario, overrides), found in rows.items():
        trackers = [(key.tracker, group) for key, group in found]
        old = {key.tracker: before.groups[key] for key, _ in found if before is not None and key in before.groups}
        sections.append(
            {
                "scenario": scenario,
                "variant": found[0][1].variant,
                "overrides": json.loads(overrides),
                "multiples": [
                    (METRICS[metric], Markup(small_multiple(metric, scales[metric], trackers, slots, old)))
                    for metric in known_of(HEADLINE_METRICS, (group.values for _, group in trackers))
                ],
                "trackers": [name for name, _ in trackers],
                "n": [f"{group.n} in {counted(len(group.seeds), 'seed')}" for _, group in trackers]
                if any(group.values(PERSON_FRAMES) for _, group in trackers)
                else [],
                "table": [
                    (METRICS[metric], [_cell(metric, group) for _, group in trackers])
                    for metric in (*SHOWN, *RECORDING_METRICS)
                    if any(group.values(metric) for _, group in trackers)
                ],
                "cases": [
                    (name, [(seed, group.cases.get(seed)) for seed in sorted(group.seeds)]) for name, group in trackers
                ],
            }
        )
    return sections


def _worst(case: PairedCase, filmstrips: Mapping[str, float], folder: Path) -> dict[str, Any]:
    """Collect a case far behind the reference: its HOTA beside the reference's, its page and film strip."""
    picture = (
        folder / "cases" / case.case_id / STRIP if case.case_id is not None and case.case_id in filmstrips else None
    )
    return {
        "name": f"{case.variant or case.key.scenario}, seed {case.seed}",
        "tracker": case.key.tracker,
        "hota": format_metric("hota", case.metrics["hota"]),
        "reference": format_metric("hota", case.reference["hota"]),
        "case": case.case_id,
        "filmstrip": data_uri(picture.read_bytes()) if picture is not None and picture.is_file() else None,
        "t_s": filmstrips.get(case.case_id or ""),
    }


def _filmstrip(
    cases: list[tuple[str, list[tuple[int, str | None]]]],
    filmstrips: Mapping[str, float],
    store: ResultStore,
    folder: Path,
) -> dict[str, Any] | None:
    """Find the film strip of a section; None where there is none."""
    for tracker, seeds in cases:
        for seed, case_id in seeds:
            if case_id is None or case_id not in filmstrips:
                continue
            picture = folder / "cases" / case_id / STRIP
            if picture.is_file():
                return {
                    "source": data_uri(picture.read_bytes()),
                    "case": case_id,
                    "who": f"{tracker}, seed {seed}",
                    "caption": f"{tracker}, seed {seed}, at {filmstrips[case_id]:.1f} s: "
                    f"{store.incidents(case_id)[0].what}, the worst of this scenario",
                }
    return None


def _change(change: Change, links: Mapping[int, tuple[str, str]]) -> dict[str, Any]:
    _, tracker, *cells, _ = change_cells(change)
    who = {"scenario": change.key.scenario, "variant": change.variant, "tracker": tracker}
    return {**who, "cells": cells, "look": links.get(id(change))}


def _reference_row(row: ReferenceDifference) -> tuple[str, int, list[tuple[str, str, str]], str]:
    return row.tracker, row.n_case, _differences(row), "–" if row.behind is None else f"{row.behind:.1%}"


def _differences(row: ReferenceDifference) -> list[tuple[str, str, str]]:
    """Format mean difference, interval and verdict of each metric of a tracker against the reference, without unit."""
    cells = []
    for metric, found in row.differences.items():
        if found is None:
            cells.append(("–", "", ""))
            continue
        mean, low, high = (
            format_number(value, METRICS[metric].decimals or 1, sign=True)
            for value in (found.mean, found.low, found.high)
        )
        cells.append((mean, "" if found.low is None else f"{low} to {high}", row.verdict(metric)))
    return cells


def _cell(metric: str, group: Group) -> str:
    mean = mean_over_seeds(group.values(metric))
    if mean is None:
        return "–"
    decimals = METRICS[metric].decimals or 1
    text = f"{mean.mean:.{decimals}f}"
    if mean.low is not None:
        text += f" ({mean.low:.{decimals}f} to {mean.high:.{decimals}f})"
    return text.replace("-", "−")


def _calibration(results: Results) -> tuple[Markup, list[tuple[str, int, str]]] | None:
    """Draw the calibration curves of the trackers that state radii, over all cases with equal weight.

    Adds n and the share found within 95 %, with a bootstrap interval over rooms and seeds. None where no tracker states radii.
    """
    slots, curves, rows = _slots(results), [], []
    for name, slot in slots.items():
        places, cases = [], []
        for key, group in results.groups.items():
            for seed, each in group.seeds.items() if key.tracker == name else ():
                if each.get(f"{WITHIN}.n"):
                    places.append((room_of(key, group, seed), seed))
                    cases.append(each)
        if not cases:
            continue
        n = [each[f"{WITHIN}.n"] or 0.0 for each in cases]
        of_cases = [calibration_curve(each) for each in cases]
        curve = [
            (points[0][0], sum(k * found for k, (_, found) in zip(n, points, strict=True)) / sum(n))
            for points in zip(*of_cases, strict=True)
        ]
        curves.append((name, slot, curve))
        within = mean_over_seeds([dict(each)[0.95] for each in of_cases], places)
        assert within is not None
        interval = "" if within.low is None else f" ({within.low:.1%} to {within.high:.1%})"
        rows.append((name, int(sum(n)), f"{within.mean:.1%}{interval}"))
    return (Markup(calibration_chart(curves)), rows) if curves else None


def _slots(results: Results) -> dict[str, int]:
    """Assign numbers to the trackers in order of appearance."""
    names = dict.fromkeys(key.tracker for key in results.groups)
    return {name: place for place, name in enumerate(names)}
