"""The shipped scenarios: nobody passes through another or through furniture, and everybody does what they are told."""

from __future__ import annotations

import numpy as np
import pytest
from benchmarks.penetration import count_penetrations, furniture_in_use

from twin import models
from twin.people.script.recorded import close_calls
from twin.scenario import load_scenario
from twin.world.world import World

pytestmark = pytest.mark.slow

EVERY_S = 0.3
LONGEST_PERSON_S = 400.0  # how much is looked at of a scenario with many people: half a minute for a dozen


@pytest.mark.sample(5)
@pytest.mark.parametrize("name", models.names("scenarios"))
def test_no_bodies_pass_through_anything(name: str) -> None:
    scenario = load_scenario(name)
    world = World(scenario)
    assert set(world.population.names) == set(world.scene.ids)
    if close_calls(scenario.people, scenario.duration_s):
        return  # recorded paths that are meant to come so close, as a warning says
    times = np.arange(0.0, min(scenario.duration_s, 60.0, LONGEST_PERSON_S / max(len(scenario.people), 1)), EVERY_S)
    count = count_penetrations(world, times, lambda _: furniture_in_use(world))
    if name == "library-hall-busy":  # where eleven wander in each other's way, forearms swing into one another
        assert count.with_overlap <= 3 and all(one.depth_m < 0.1 for one in count.deepest.values()), str(count)
    else:
        assert count.with_overlap == 0, str(count)
