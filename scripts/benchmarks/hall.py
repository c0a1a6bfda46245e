"""The library hall when it is full: a camera of 640 × 480 and two scanners at 25 Hz, and where their time goes."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import ExitStack

import numpy as np

import twin.world.body_pool
import twin.world.simulation
import twin.world.world
from benchmarks.figure import Figure
from benchmarks.timed import timed
from twin.people.crowd.routes import Routes
from twin.people.population import Population
from twin.scenario import load_scenario
from twin.truth.situations import INTERACTION_M
from twin.truth.truth_types import TruthFrame
from twin.world.simulation import Simulation

_FROM_S, _TO_S = 40.0, 54.0
"""The lecture in the reading room is over, and more than fifteen people are in the hall [s]."""


def measure() -> Iterator[Figure]:
    """Truth and every sensor's messages, made and read: simulated time over time spent, and on what."""
    scenario = load_scenario("library-hall", [f"duration_s={_TO_S}", "background=none"])
    frames: list[TruthFrame] = []
    with ExitStack() as stack:
        routes = stack.enter_context(timed(Routes, "__init__"))
        bodies = stack.enter_context(timed(twin.world.body_pool, "person_spec"))
        start = time.process_time()
        simulation = stack.enter_context(Simulation(scenario, on_truth=frames.append))
        yield Figure("hall: building the room and everybody's bodies, CPU time", time.process_time() - start, "s", "")
        yield Figure("hall: the routes, of its wall time", routes.seconds, "s", "")
        yield Figure("hall: one body, of its wall time", 1e3 * bodies.seconds / len(scenario.people), "ms", "")
        parts = {
            "truth": stack.enter_context(timed(twin.world.world.World, "truth")),
            "truth, of that visible shares": stack.enter_context(timed(twin.world.world, "visible_share")),
            "people, also within the truth": stack.enter_context(timed(Population, "advance")),
            "messages": stack.enter_context(timed(twin.world.simulation, "encode")),
        }
        deliveries = simulation.deliveries()
        next(each for each in deliveries if each.stamp_ns >= 1e9 * _FROM_S)
        frames.clear()
        before = {name: part.seconds for name, part in parts.items()} | _sensors(simulation)
        wall, cpu = time.perf_counter(), time.process_time()
        for _ in deliveries:
            pass
        wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
        after = {name: part.seconds for name, part in parts.items()} | _sensors(simulation)
    people = [len(frame.people) for frame in frames]
    yield Figure("hall: people in the room, mean", float(np.mean(people)), "", ">= 15")
    yield Figure("hall: people in the room, most", float(max(people)), "", "")
    yield Figure(f"hall: people closer than {INTERACTION_M:g} m to somebody", 100 * _share_close(frames), "%", "")
    seconds = _TO_S - _FROM_S
    yield Figure("hall: camera of 640 × 480 and two scanners at 25 Hz", seconds / wall, "× real time", ">= 0.5")
    yield Figure("hall: the same by CPU time", seconds / cpu, "× real time", "")
    for name in after:
        yield Figure(f"hall: {name}, each 40 ms", 1e3 * (after[name] - before[name]) / len(frames), "ms", "")


def _share_close(frames: list[TruthFrame]) -> float:
    """Share of the person-frames in the tracked area that have somebody closer than `INTERACTION_M`."""
    close = total = 0
    for frame in frames:
        place = np.array([[person.x, person.y] for person in frame.people]).reshape(-1, 2)
        inside = np.array([person.in_area for person in frame.people], dtype=bool)
        apart = np.linalg.norm(place[:, None] - place, axis=-1) + np.where(np.eye(len(place), dtype=bool), np.inf, 0.0)
        close += int((inside & (apart < INTERACTION_M).any(axis=1)).sum())
        total += int(inside.sum())
    return close / total


def _sensors(simulation: Simulation) -> dict[str, float]:
    """By sensor, what its observations have cost so far [s]."""
    costs = simulation.sensor_costs()
    return {name: (each["frames"] or 0) * (each["ms_mean"] or 0.0) / 1e3 for name, each in costs.items()}
