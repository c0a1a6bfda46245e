"""What a study leaves in its folder: tables, the scenario that it recommends, itself resolved, and its answers for programs."""

from __future__ import annotations

import csv
import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from twin.recording.whole_file import whole_file
from twin.scenario import load_scenario
from twin.studies.layout import OWN, Candidate
from twin.studies.page import write_page
from twin.studies.placed import write_scenario
from twin.studies.run import Answers
from twin.studies.sets import Found
from twin.studies.trial import Trial
from twin.studies.trying import name_of


def write_answers(folder: Path, answers: Answers) -> dict[str, Path]:
    """Write every file but the evaluations, each under its name when it is whole; their paths."""
    files = {
        "candidates": folder / "candidates.csv",
        "pareto": folder / "pareto.csv",
        "recommended": folder / "recommended.yaml",
        "study": folder / "study.yaml",
        "summary": folder / "summary.json",
        "report": folder / "report.html",
    }
    study = answers.prepared.study
    trials = list(answers.result.trials.values())
    _write_table(files["candidates"], trials, answers)
    _write_table(files["pareto"], answers.front, answers)
    file = next(iter(answers.prepared.files.values()))
    moved = answers.placed(answers.best.candidate)
    write_scenario(
        files["recommended"], load_scenario(file), moved, file, f"{moved.name}-recommended",
        f"{moved.name} with its sensors as the study {study.name} recommends.",
    )  # fmt: skip
    with whole_file(files["study"]) as stream:
        yaml.safe_dump(
            study.model_dump(mode="json", exclude_none=True, by_alias=True), stream, sort_keys=False, allow_unicode=True
        )
    with whole_file(files["summary"]) as stream:
        json.dump(summary_of(answers), stream, indent=2, ensure_ascii=False)
        stream.write("\n")
    write_page(files["report"], answers)
    return files


def summary_of(answers: Answers) -> dict[str, Any]:
    """The answers in short."""
    study, objective = answers.prepared.study, answers.objective

    def told(trial: Trial) -> dict[str, Any]:
        return {
            "candidate": name_of(trial.candidate),
            "places": places_of(answers, trial.candidate),
            "price": trial.price,
            "seeds": len(trial.seeds),
            **{each.column: number(trial.value(each, study.scenarios)) for each in study.objectives if not trial.why},
            "coverage": trial.coverage,
            **({"against": trial.why} if trial.why else {}),
        }

    return {
        "study": study.name,
        "objective": objective.column,
        "own": told(answers.own),
        "best": told(answers.best),
        "pareto": [told(each) for each in answers.front],
        "alike": [name_of(each.candidate) for each, _ in answers.alike],
        "held_out": [_plain(each) for each in answers.held_out],
        "one_fewer": [{"candidate": name_of(each), objective.column: value} for each, value in answers.fewer],
        "misplaced": [_plain(each) for each in answers.misplaced],
        "moved_by": [{"what": what, "rank_correlation": number(rho), "candidates": n} for what, rho, n in answers.moved_by],
        "proven": [
            {"devices": count, "greedy": first.value, "greedy_bound": first.bound, **_proof(first, best)}
            for count, first, best in answers.result.proven
        ],
        "refused": answers.prepared.layout.refused,
        "candidates": len(answers.result.trials),
        "evaluated_in_this_run": answers.evaluated,
        "seconds_of_this_run": round(answers.spent_s, 1),
    }  # fmt: skip


def _proof(first: Found, best: Found | None) -> dict[str, Any]:
    if best is None:
        return {}
    share = first.value / best.value if best.value else 1.0
    return {"exact": best.value, "exact_is": best.told(), "greedy_over_exact": share}


def _plain(row: Any) -> dict[str, Any]:
    return {key: number(each) if isinstance(each, float) else each for key, each in asdict(row).items()}


def number(value: float | None) -> float | None:
    """A number as JSON has it: none for what is none."""
    return None if value is None or not np.isfinite(value) else float(value)


def places_of(answers: Answers, candidate: Candidate) -> str:
    """Where a candidate has its sensors, in a line."""
    layout, study = answers.prepared.layout, answers.prepared.study
    if candidate == OWN:
        return "the scenario's own"
    told = []
    for each in candidate:
        option = layout.options[each]
        kind = study.move[option.device].kinds[option.kind].name
        for mount in option.mounts:
            x, y, z = mount.xyz
            tilt = f" tilt {mount.pitch_deg:g}°" if mount.pitch_deg else ""
            told.append(
                f"{option.device}{'' if kind == 'as-is' else ' ' + kind} ({x:g} {y:g} {z:g}) yaw {mount.yaw_deg:g}°{tilt}"
            )
    return "; ".join(told)


def _write_table(path: Path, trials: Sequence[Trial], answers: Answers) -> None:
    """One row a candidate: place, price, coverage, each figure's mean with its standard error, replicates, what is against it."""
    study = answers.prepared.study
    names = sorted(
        {
            (tracker, figure)
            for each in trials
            for row in each.figures.values()
            for tracker in row
            for figure in row[tracker]
        }
    )
    names = [each for each in names if not each[1].startswith("ms_per_frame")]
    columns = ["candidate", "places", "price", "coverage", "coverage_worst", "replicates", "against"]
    figures = [f"{tracker}: {figure}" for tracker, figure in names]
    wanted = [each.column for each in study.objectives if each.kind == "metric" and each.column not in figures]
    with whole_file(path) as stream:
        table = csv.writer(stream, lineterminator="\n")
        table.writerow([*columns, *wanted, *(text for each in figures for text in (each, f"{each} (standard error)"))])
        for trial in trials:
            row: list[Any] = [name_of(trial.candidate), places_of(answers, trial.candidate), f"{trial.price:g}"]
            row += ["" if each is None else f"{each:.6f}" for each in (trial.coverage, trial.coverage_worst)]
            row += [len(trial.seeds), trial.why]
            for each in study.objectives:
                if each.column in wanted:
                    row.append("" if trial.why or not trial.seeds else f"{trial.value(each, study.scenarios):.6f}")
            for tracker, figure in names:
                values = [each[tracker][figure] for each in trial.figures.values() if tracker in each]
                known = np.array([each for each in values if each is not None], dtype=float)
                error = known.std(ddof=1) / np.sqrt(len(known)) if len(known) > 1 else np.nan
                row += [f"{known.mean():.6f}" if len(known) else "", f"{error:.6f}" if np.isfinite(error) else ""]
            table.writerow(row)
