"""`summary.json`: a run of a suite in short, for programs."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from twin.recording.whole_file import whole_file
from twin.suites.comparison import Change, Comparison
from twin.suites.promises import Kept
from twin.suites.results import Results, gated_values
from twin.suites.store import ResultStore


def write_summary(
    path: Path,
    store: ResultStore,
    results: Results,
    comparison: Comparison | None,
    promises: Sequence[Kept] = (),
) -> None:
    """Write the means over seeds with their 95 % intervals, what failed, and what changed; raises InputError as a file does."""
    facts, cases = store.facts(), store.cases()
    document: dict[str, Any] = {
        "suite": results.suite,
        "cases": {
            "total": len(cases),
            "done": sum(len(group.seeds) for group in results.groups.values()),
            "failed": len(results.failed),
            "unfinished": results.unfinished,
        },
        "seconds": facts["seconds"],
        "versions": dict(results.versions),
        "renderers": list(results.renderers),
        "doubts": dict(results.doubts),
        "groups": [
            {
                "scenario": key.scenario,
                "variant": group.variant,
                "overrides": json.loads(key.overrides),
                "tracker": key.tracker,
                "seeds": sorted(group.seeds),
                "figures": {metric: asdict(mean) for metric, mean in gated_values(group)},
            }
            for key, group in results.groups.items()
        ],
        "failed": [{"case_id": case.id, "attempts": case.attempts, "error": case.error} for case in results.failed],
    }
    if comparison is not None:
        document["comparison"] = {
            "worse": [_row(change) for change in comparison.worse],
            "better": [_row(change) for change in comparison.better],
            "warnings": list(comparison.warnings),
            "identical": comparison.identical,
            "smallest_loss_noticed": {
                each.metric: {
                    "everywhere": each.everywhere,
                    "of_tracker": dict(each.of_tracker),
                    "in_scenario": each.in_scenario,
                    "in_case": each.in_case,
                }
                for each in comparison.power
            },
        }
    if promises:
        document["promises"] = [
            {
                "scenario": each.key.scenario,
                "variant": each.variant,
                "tracker": each.key.tracker,
                "metric": each.metric,
                "bound": each.bound,
                "mean": each.mean,
                "kept": not each.broken,
            }
            for each in promises
        ]
    with whole_file(path) as stream:
        json.dump(document, stream, indent=2, ensure_ascii=False, allow_nan=False)
        stream.write("\n")


def _row(change: Change) -> dict[str, Any]:
    return {
        "scenario": change.key.scenario,
        "variant": change.variant,
        "tracker": change.key.tracker,
        "metric": change.metric,
        "before": change.before,
        "now": change.now,
        "allowed": change.allowed,
        "p": change.p,
        "p_better": change.p_better,
        "fallen_seed": change.fallen,
        "seeds": change.n_seed,
    }
