"""Measure the coverage of a scenario's own sensors, as metrics and as maps on a page."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Template

from trackers.errors import InputError
from twin.console import PlainConsole, print_warnings
from twin.recording.atomic_file import open_atomic
from twin.reproduce.page import data_uri
from twin.scenario import Scenario
from twin.scenario.load import dump_scenario
from twin.scenario.pressure_floor import FloorDescription
from twin.studies.candidate_set import building_of
from twin.studies.coverage import at_least, count_bits
from twin.studies.interactive_plan import plan_data, section
from twin.studies.page import environment
from twin.studies.plots import heat_map, is_scanner, plan_sensors
from twin.studies.spec import Coverage
from twin.studies.visibility import (
    SampledWorld,
    SensorVisibility,
    floor_cells,
    packed,
    unvisited_warning,
    visited_cells,
)
from twin.world.precomputed import PrecomputedScene, precompute_motion

_CELLS = 10_000
_SCENARIO = "scenario.yaml"


def write_coverage(scenario: Scenario, folder: Path, *, beams: int, px_per_m: float, samples: int) -> dict[str, Any]:
    """Write coverage.json, coverage.html and the resolved scenario; return the metrics.

    Raises InputError without scanners and cameras.
    """
    names = [name for name, each in scenario.sensors.items() if not isinstance(each, FloorDescription)]
    if not names:
        raise InputError(
            f"scenario {scenario.name!r}: sensors: none is a scanner or a camera; one that looks is expected"
        )
    asked = Coverage(beams=beams, px_per_m=px_per_m, samples=samples)
    precomputed = PrecomputedScene.of(scenario, precompute_motion(scenario))
    times = ((np.arange(samples) + 0.5) / samples * scenario.duration_s).tolist()
    sampled = SampledWorld(scenario, precomputed, times)
    area = sampled.area
    cell_m = max(0.05, float(np.sqrt(np.prod(np.ptp(area, axis=0)) / _CELLS)))
    cells = floor_cells(area, cell_m)
    building = building_of(precomputed.scene)
    visibilities = {name: SensorVisibility(scenario, name, asked) for name in names}
    visible = {name: visibility.people(sampled) for name, visibility in visibilities.items()}
    sharp = {name: visibility.resolution(sampled.empty(), cells) for name, visibility in visibilities.items()}
    least = {name: float(beams) if is_scanner(scenario, name) else px_per_m for name in names}
    bits = packed(np.array(list(visible.values())))
    n = max(sampled.n_person_frame, 1)
    seen = np.any([sharp[name][-1] >= least[name] for name in names], axis=0)
    visited = visited_cells([sampled], cells)
    found: dict[str, Any] = {
        "scenario": scenario.name,
        "seed": scenario.seed,
        "beams": beams,
        "px_per_m": px_per_m,
        "person_frames": sampled.n_person_frame,
        "area_visited": float(visited.mean()),
        "area_unseen": float((~seen).mean()),
        "area_unseen_unvisited": float((~seen & ~visited).mean()),
        "warnings": list(filter(None, [unvisited_warning(visited, seen, sampled.n_person_frame)])),
        "people_seen_by_at_least": {str(k): count_bits(at_least(bits, k)) / n for k in range(1, len(names) + 1)},
        "floor_seen_by_at_least": {
            str(k): float((np.sum([sharp[name][-1] >= least[name] for name in names], axis=0) >= k).mean())
            for k in range(1, len(names) + 1)
        },
        "sensors": {
            name: {
                "people": float(visible[name].mean()) if len(visible[name]) else None,
                "floor": float((sharp[name][-1] >= least[name]).mean()),
            }
            for name in names
        },
    }
    sensors = plan_sensors(scenario, names, building)
    maps = []
    for scanners, label in ((True, "beams on a body"), (False, "px/m")):
        mine = [name for name in names if is_scanner(scenario, name) == scanners]
        if mine:
            best = np.max([sharp[name][-1] for name in mine], axis=0)
            drawn = heat_map(cells, best, cell_m, sensors, building, area, label=label, least=least[mine[0]])
            maps.append(
                (f"{', '.join(mine)}: {label}, empty room; red: fewer than {least[mine[0]]:g}.", data_uri(drawn))
            )
    folder.mkdir(parents=True, exist_ok=True)
    with open_atomic(folder / "coverage.json") as stream:
        json.dump(found, stream, indent=2)
        stream.write("\n")
    template: Template = environment().get_template("coverage.html.j2")
    plan = plan_data(scenario, names, building, area, asked, cell_m, extends=_SCENARIO, folder=folder)
    with open_atomic(folder / _SCENARIO) as stream:
        stream.write(dump_scenario(scenario))
    with open_atomic(folder / "coverage.html") as stream:
        stream.write(
            template.render(found=found, maps=maps, sensors=sensors, samples=samples, folder=folder, **section(plan))
        )
    return found


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
        console.print(f"{name}: {people} of person-frames, {100 * each['floor']:.1f} % of the floor")
