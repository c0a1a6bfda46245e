"""The plain baseline runs wherever a scanner stands, so that every table of ours can show it."""

import pytest

from trackers.feeding import track_frames
from trackers.presets import make_tracker
from twin import models
from twin.scenario import load_scenario
from twin.scenario.housings import driven
from twin.world.simulation import Simulation

pytestmark = pytest.mark.slow

SCENARIOS = {name: load_scenario(name) for name in models.names("scenarios")}
SCANNED = [
    name
    for name, each in SCENARIOS.items()
    if not driven(each) and any(sensor.kind == "laser" for sensor in each.sensors.values())
]


@pytest.mark.sample(3)
@pytest.mark.parametrize("name", SCANNED)
def test_sort_follows_people_in_every_shipped_scenario_with_a_scanner(name: str) -> None:
    truth = []
    with Simulation(
        load_scenario(name, ["duration_s=2", "background_frames=3"]), images=False, on_truth=truth.append
    ) as simulation:
        tracker = make_tracker("sort", simulation.rig, simulation.background())
        frames = list(track_frames(tracker, simulation.rig, simulation))
    assert len(SCANNED) >= 6
    assert frames[-1].tracks
    people = [(person.x, person.y) for person in truth[-1].people]
    nearest = [min((track.x - x) ** 2 + (track.y - y) ** 2 for x, y in people) for track in frames[-1].tracks]
    assert sum(square < 0.5**2 for square in nearest) >= 0.7 * len(nearest)
    assert tracker.losses.total() <= 3
