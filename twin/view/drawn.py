"""A contact sheet of scenes drawn at random: one scenario under many seeds, each from within and from above."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from trackers.observations import NS_PER_S
from twin.progress import OnProgress
from twin.report.panels import BACKDROP
from twin.report.people_sheet import check_picture_name, tiled, write_png
from twin.scenario import load_scenario
from twin.view.moment import Sheet, framed
from twin.world.simulation import Simulation

_TILE_PX = (320, 240)
_COLUMNS = 3


def write_drawn(
    scenario: str,
    changes: Sequence[str],
    seeds: Sequence[int],
    t: float,
    path: Path,
    *,
    on_progress: OnProgress = lambda what, done, total: None,
) -> tuple[str, ...]:
    """Write a PNG of a scenario at time t [s] under each seed: the room with its people, and the plan with all scans.

    Returns what can be in the scenarios, but is hardly meant, one sentence each. Raises InputError for a bad scenario, a
    time outside of it, and a file that cannot be written.
    """
    check_picture_name(path)
    tiles, warnings = [], []
    for number, seed in enumerate(seeds, start=1):
        loaded = load_scenario(scenario, [*changes, f"seed={seed}"])
        with Simulation(loaded, images=False) as simulation:
            looks = simulation.look(round(t * NS_PER_S))
            sheet = Sheet(simulation, t, _TILE_PX)
            label = f"seed {seed}: {len(loaded.people)} people, {', '.join(loaded.sensors)}"
            tiles.append(framed(label, np.hstack([sheet.room(), sheet.plan(looks)])))
            warnings += [f"seed {seed}: {warning}" for warning in simulation.warnings]
        on_progress("drawing", number, len(seeds))
    write_png(path, tiled(tiles, min(_COLUMNS, len(tiles)), BACKDROP))
    return tuple(warnings)
