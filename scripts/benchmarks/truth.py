"""Cost of truth: its parts as shares of a run that simulates, renders and encodes, without tracker and recording."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import ExitStack

import twin.world.truth_details
import twin.world.world
from benchmarks.figure import Figure
from benchmarks.timed import timed
from twin.scenario import Scenario, load_scenario
from twin.world.simulation import Simulation
from twin.world.truth_details import TruthDetails

_SCENARIOS = ("lab-five-people",)
_MEASURED_S = 6.0


def shares() -> Iterator[Figure]:
    """Boxes, visible fractions, and rays with situations: none of them dominates the run."""
    for name in _SCENARIOS:
        yield from _shares(name, load_scenario(name, [f"duration_s={_MEASURED_S}", "background_frames=1"]))


def _shares(name: str, scenario: Scenario) -> Iterator[Figure]:
    def ignore(_: object) -> None:
        pass

    with ExitStack() as stack:
        seen = stack.enter_context(timed(twin.world.world, "visible_share"))
        boxed = stack.enter_context(timed(TruthDetails, "_boxes"))
        looked = stack.enter_context(timed(TruthDetails, "look"))
        outlined, gathered = (stack.enter_context(timed(TruthDetails, name)) for name in ("correlated", "people"))
        simulation = stack.enter_context(Simulation(scenario, on_truth=ignore, on_detail=ignore))
        simulation.look(0)  # renderers, tables and outlines are made when first needed
        start = time.perf_counter()
        for _ in simulation:
            pass
        total = time.perf_counter() - start
    yield Figure(f"{name}: boxes, share of the run", 1e2 * boxed.seconds / total, "%", "<= 20")
    yield Figure(f"{name}: visible fractions, share of the run", 1e2 * seen.seconds / total, "%", "<= 20")
    rest = looked.seconds - boxed.seconds + outlined.seconds + gathered.seconds
    yield Figure(f"{name}: rays and situations, share of the run", 1e2 * rest / total, "%", "<= 10")
