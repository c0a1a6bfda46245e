"""`scripts/bench`: measure, print one row a figure, exit 1 where one falls short."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

from benchmarks import (
    bag_drill,
    camera_floor,
    cameras,
    cases,
    drawn_people,
    drawn_rooms,
    environment,
    faults,
    filters,
    gate_bugs,
    hall,
    hall_groups,
    kills,
    laser_learning,
    learning,
    metamorphic,
    people,
    processes,
    rates,
    real_twins,
    recorded_legs,
    rgbd_head,
    runs,
    sensors,
    splits,
    spread,
    start_up,
    studies,
    suites,
    tracking,
    truth,
    vision,
    vision_only,
)
from benchmarks.figure import Figure
from benchmarks.fuzz import run as fuzz

BENCHMARKS: dict[str, Callable[[], Iterator[Figure]]] = {
    "start-up": start_up.measure,
    "laser": sensors.laser,
    "fisheye": sensors.fisheye,
    "silhouettes": sensors.silhouettes,
    "floor-real-time": people.floor_real_time,
    "floor-truth": people.floor_truth,
    "crowd-building": people.crowd_building,
    "recorded-paths": people.recorded_paths,
    "camera": cameras.picture,
    "still-rooms": cameras.still_rooms,
    "switches": cameras.switches,
    "depth": cameras.depth,
    "four-cameras": cameras.four_cameras,
    "hall": hall.measure,
    "hall-groups": hall_groups.measure,
    "laser-learning": laser_learning.measure,
    "processes": processes.measure,
    "truth": truth.shares,
    "environment": environment.measure,
    "vision": vision.measure,
    "learning": learning.measure,
    "splits": splits.figure,
    "splits-choice": splits.choice,
    "camera-floor": camera_floor.measure,
    "rgbd-head": rgbd_head.measure,
    "scanner-noise": faults.scanner_noise,
    "faults": faults.cost,
    "real-twins": real_twins.measure,
    "rates": rates.measure,
    "suite-speed": suites.speed_up,
    "suite-cost": suites.cost,
    "suite-regression": suites.regression,
    "suite-spread": spread.measure,
    "suite-gate": suites.gate,
    "suite-harmless": suites.harmless,
    "gate-bugs": gate_bugs.measure,
    "gate-bugs-regression": gate_bugs.with_regression,
    "study-candidate": studies.placement,
    "study-coverage": studies.coverage,
    "study-sets": studies.sets,
    "study-foretold": studies.foretold,
    "study-proven": studies.proven,
    "table-one": tracking.table_one,
    "tracker-cost": tracking.cost,
    "fusion-cost": tracking.fusion_cost,
    "imm": filters.imm,
    "vision-only": vision_only.measure,
    "figure-7": filters.figure7,
    "labelled-legs": recorded_legs.measure,
    "real-time": runs.real_time,
    "runs": runs.cpu,
    "growth": runs.growth,
    "memory": runs.memory,
    "metamorphic": metamorphic.measure,
    "drawn-people": drawn_people.measure,
    "drawn-rooms": drawn_rooms.measure,
    "fuzz": fuzz.measure,
    "bags": bag_drill.measure,
    "kills": kills.measure,
    "cases": cases.measure,
}


def main() -> int:
    """Run the benchmarks asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", action="append", choices=list(BENCHMARKS), help="measure this one; may be repeated")
    parser.add_argument("--json", type=Path, help="write the rows to this file")
    arguments = parser.parse_args()
    rows = []
    for name in arguments.only or BENCHMARKS:
        for figure in BENCHMARKS[name]():
            rows.append(figure.row())
            print(json.dumps(rows[-1], ensure_ascii=False), flush=True)
    if arguments.json is not None:
        arguments.json.write_text(json.dumps(rows, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
    return 1 if any(row["holds"] is False for row in rows) else 0


sys.exit(main())
