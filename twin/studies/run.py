"""Run a study: search placements, validate the recommended one, and write the results; or measure a scenario's own sensors."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from trackers.errors import InputError
from trackers.user_input.plain_data import dump_yaml
from twin.console import PlainConsole, print_warning, print_warnings
from twin.models import cache_folder
from twin.recording.atomic_file import write_atomic
from twin.report.palette import data_uri
from twin.room.building import check_mounts
from twin.run.inputs import NONE_TRUSTED, TrustedClasses
from twin.run.out_folder import check_others
from twin.scenario import Scenario, load_scenario
from twin.scenario.load import dump_scenario
from twin.studies.apply_placement import write_scenario
from twin.studies.candidate_set import BASELINE, building_of
from twin.studies.coverage import PoseCoverage, at_least, count_bits
from twin.studies.interactive_plan import plan_data, section
from twin.studies.page import study_template, write_page
from twin.studies.plots import heat_map, plan_sensors
from twin.studies.preflight import prepare
from twin.studies.results import StudyResults, summarize, write_table
from twin.studies.search import Result, Searcher, check_search_size
from twin.studies.spec import Coverage
from twin.studies.store import FILE, WRITTEN, check_folder, open_store
from twin.studies.trials import TrialRunner, losses, pareto_fronts, placement_id
from twin.studies.validation import (
    displaced_differences,
    held_out_differences,
    indistinguishable,
    rank_correlations,
    values_with_one_fewer,
)
from twin.studies.visibility import (
    SampledWorld,
    SensorVisibility,
    floor_resolution,
    is_scanner,
    looking_sensors,
    packed,
    visited_cells,
)
from twin.suites.cache import RecordingCache, cache_limit_bytes
from twin.suites.cluster import Workers
from twin.suites.dask_runner import ProgressListener
from twin.world.world import PrecomputedScene, precompute_people


@contextmanager
def run_study(
    name: str | Path,
    out: Path | None,
    place: Workers,
    *,
    resume: bool = False,
    seed_offset: int = 0,
    trusted: TrustedClasses = NONE_TRUSTED,
) -> Iterator[tuple[StudyResults, Path]]:
    """Search and validate; yield the results and the folder (default: out/study-<name>), locked during the block.

    Raises InputError for bad input, before anything is written.
    """
    start = time.perf_counter()
    prepared = prepare(name, seed_offset=seed_offset, trusted=trusted)
    study = prepared.study
    print_warnings(prepared.warnings)
    folder = out if out is not None else Path("out") / f"study-{study.name}"
    cache = RecordingCache(cache_folder(), cache_limit_bytes())
    check_search_size(study, prepared.candidate_set, str(prepared.path))
    facts = study.model_dump(mode="json", by_alias=True)
    check_folder(folder, facts, resume)  # before the first evaluation, which takes a run
    run = TrialRunner(prepared, cache)
    coverage = PoseCoverage(study, prepared.candidate_set, cache)
    searcher = Searcher(study, prepared.candidate_set, coverage, run.evaluate)
    run.trials = searcher.result.trials
    first = None if resume and (folder / FILE).exists() else run.check_metrics()
    listener = ProgressListener(warned=print_warning)
    with open_store(folder, facts, place, resume, listener, run.progress) as evaluations:
        run.evaluations = evaluations
        if first is not None:
            evaluations.record(*first)
        result = searcher.run()
        results = _results(run, coverage, result, start)
        print_warnings(results.warnings)
        for trial in (*results.front, *results.best_of_each_count):
            if trial.coverage is None:
                trial.measure_coverage(coverage)
        if any(each.kind == "coverage" for each in study.objectives) and not results.best.coverage:
            print_warning(
                f"{prepared.path}: coverage: no placement shows anything as it asks: by at least {study.coverage.at_least}, with "
                f"{study.coverage.beams} beams or {study.coverage.px_per_m:g} px/m; the recommended one is as good as any"
            )
        for device, n_pose in coverage.blind_devices().items():
            print_warning(
                f"{prepared.path}: devices.{device}: shows nothing of the area or of people from any of {n_pose} poses; another "
                "height, direction or place is expected"
            )
        yield results, folder


def _results(run: TrialRunner, coverage: PoseCoverage, result: Result, start_s: float) -> StudyResults:
    study, candidate_set = run.study, run.candidate_set
    objective, baseline = study.objectives[0], result.trials[BASELINE]
    tried = [each for each in result.trials.values() if not each.failure]
    whole = [each for each in tried if not study.validated or len(each.seeds) >= study.search.replicates[-1]]
    budget = study.constraints.budget
    mine = [each for each in whole if each is not baseline or budget is None or baseline.price <= budget]
    if not mine or all(each is baseline for each in whole):
        failure = next((each.failure for each in result.trials.values() if each.failure), "none was found")
        raise InputError(
            f"{run.prepared.path}: no placement could be tried on all seeds ({failure}); other places or weaker constraints are "
            "expected"
        )
    loss = losses(mine, study.objectives, study.scenarios)
    front = [each for each, number in zip(mine, pareto_fronts(loss), strict=True) if number == 0]
    best = mine[int(np.lexsort(loss.T[::-1])[0])]  # of equals by the first objective, the best by the next
    if study.cheapest_within is not None:
        near = np.flatnonzero(loss[:, 0] <= loss[:, 0].min() + study.cheapest_within + 1e-12)
        best = mine[min(near, key=lambda place: (mine[place].price, loss[place, 0]))]
    if best.coverage is None:
        best.measure_coverage(coverage)
    held = [row for each in study.validated for row in held_out_differences(run, best, each)]
    less = values_with_one_fewer(run, coverage, best)
    off = displaced_differences(run, best, study.validated[0]) if study.validated else []
    shown, evaluations = {placement_id(BASELINE), placement_id(best.placement)}, run.evaluations
    return StudyResults(
        run.prepared, coverage, result, baseline, best, tuple(sorted(front, key=lambda each: each.price)),
        tuple(indistinguishable(tried, best, objective, study)), tuple(held), tuple(less), tuple(off),
        tuple(rank_correlations(tried, candidate_set, objective, study)),
        evaluations.n_evaluated if evaluations is not None else 0, time.perf_counter() - start_s, run.cache,
        tuple(evaluations.warnings_of(shown)) if evaluations is not None else (),
    )  # fmt: skip


def write_results(folder: Path, results: StudyResults) -> dict[str, Path]:
    """Write every file except the evaluations, each under its name when complete; return their paths."""
    files = {Path(name).stem: folder / name for name in WRITTEN}
    study = results.prepared.study
    trials = list(results.result.trials.values())
    write_table(files["candidates"], trials, results)
    write_table(files["pareto"], results.front, results)
    file = next(iter(results.prepared.files.values()))
    moved = results.scenario_with(results.best.placement)
    write_scenario(
        files["recommended"], load_scenario(file), moved, file, f"{moved.name}-recommended",
        f"{moved.name} with its sensors as the study {study.name} recommends.",
    )  # fmt: skip
    write_atomic(files["study"], dump_yaml(study.model_dump(mode="json", exclude_none=True, by_alias=True)))
    write_atomic(files["summary"], json.dumps(summarize(results), indent=2, ensure_ascii=False) + "\n")
    write_page(files["report"], results)
    return files


_CELLS = 10_000
_SCENARIO = "scenario.yaml"


def write_coverage(scenario: Scenario, folder: Path, asked: Coverage) -> dict[str, Any]:
    """Write coverage.json, coverage.html and the resolved scenario; return the metrics.

    asked: beams, px_per_m and samples count. Raises InputError without scanners and cameras, for a sensor inside a wall or
    outside the building, and where a field given is of sensors that are not there.
    """
    check_others(folder, (_SCENARIO, "coverage.html"), "coverage.json")
    names, samples = looking_sensors(scenario), asked.samples
    _check_sensors(scenario, names, asked)
    precomputed = PrecomputedScene.of(scenario, *precompute_people(scenario))
    times = ((np.arange(samples) + 0.5) / samples * scenario.duration_s).tolist()
    sampled = SampledWorld(scenario, precomputed, times)
    area, building = sampled.area, building_of(precomputed.scene)
    looking = {name: SensorVisibility(scenario, name, asked) for name in names}
    check_mounts(scenario, scenario.sensors, sampled.empty(), precomputed.scene.floor)
    visible = {name: each.people(sampled) for name, each in looking.items()}
    floor = floor_resolution(scenario, looking, sampled.empty(), area, asked, _CELLS)
    bits = packed(np.array(list(visible.values())))
    n = max(sampled.n_person_frame, 1)
    seen = floor.n_seeing > 0
    visited = visited_cells([sampled], floor.cells)
    found: dict[str, Any] = {
        "scenario": scenario.name,
        "seed": scenario.seed,
        "beams": asked.beams,
        "px_per_m": asked.px_per_m,
        "person_frames": sampled.n_person_frame,
        "area_visited": float(visited.mean()),
        "area_unseen": float((~seen).mean()),
        "area_unseen_unvisited": float((~seen & ~visited).mean()),
        "warnings": [
            *filter(None, [floor.unvisited_warning(visited, sampled.n_person_frame)]),
            *floor.blind_warnings(scenario),
        ],
        "people_seen_by_at_least": {str(k): count_bits(at_least(bits, k)) / n for k in range(1, len(names) + 1)},
        "floor_seen_by_at_least": {str(k): float((floor.n_seeing >= k).mean()) for k in range(1, len(names) + 1)},
        "sensors": {
            name: {
                "people": float(visible[name].mean()) if len(visible[name]) else None,
                "floor": float((floor.of_sensor[name] >= floor.least[name]).mean()),
                "wanted": f"{floor.least[name]:g} {'beams on a body' if is_scanner(scenario, name) else 'px/m'}",
            }
            for name in names
        },
    }
    sensors, maps = plan_sensors(scenario, names, building), []
    for scanners, mine, best, least in floor.best_of_kind(scenario):
        label = "beams on a body" if scanners else "px/m"
        drawn = heat_map(floor.cells, best, floor.cell_m, sensors, building, area, label=label, least=least)
        maps.append((f"{', '.join(mine)}: {label}, empty room; red: fewer than {least:g}.", data_uri(drawn)))
    folder.mkdir(parents=True, exist_ok=True)
    plan = plan_data(scenario, names, building, area, asked, floor.cell_m, extends=_SCENARIO, folder=folder)
    page = study_template("coverage.html.j2").render(
        found=found, maps=maps, sensors=sensors, samples=samples, folder=folder, **section(plan)
    )
    write_atomic(folder / "coverage.json", json.dumps(found, indent=2) + "\n")
    write_atomic(folder / _SCENARIO, dump_scenario(scenario))
    write_atomic(folder / "coverage.html", page)
    return found


def _check_sensors(scenario: Scenario, names: Sequence[str], asked: Coverage) -> None:
    """Raise InputError without sensors that look, and where a field given is of sensors that are not there."""
    if not names:
        raise InputError(f"{scenario.source}: sensors: none is a scanner or a camera; one that looks is expected")
    kinds = {is_scanner(scenario, name) for name in names}
    for field, scanners, what in (("beams", True, "scanner"), ("px_per_m", False, "camera")):
        if field in asked.model_fields_set and scanners not in kinds:
            raise InputError(
                f"--{field.replace('_', '-')} {getattr(asked, field):g}: has no effect on {scenario.name}, which has no {what}; "
                f"one that has a {what} is expected"
            )


def print_coverage(found: dict[str, Any]) -> None:
    """Print the metrics: one line per number of sensors, one line per sensor; warnings on stderr."""
    print_warnings(found["warnings"])
    console = PlainConsole()
    for k, share in found["people_seen_by_at_least"].items():
        floor = found["floor_seen_by_at_least"][k]
        console.print(
            f"seen by at least {k}: {100 * share:.1f} % of {found['person_frames']} person-frames, {100 * floor:.1f} % of "
            "the floor"
        )
    for name, each in found["sensors"].items():
        people = "–" if each["people"] is None else f"{100 * each['people']:.1f} %"
        console.print(
            f"{name}: {people} of person-frames, {100 * each['floor']:.1f} % of the floor, at {each['wanted']} or more"
        )
