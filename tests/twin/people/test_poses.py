"""What lies between two ticks of the people's clock."""

from __future__ import annotations

import numpy as np
import pytest

from twin.people.gait.gait_state import FLOOR_ROWS, ROWS, GaitState
from twin.people.posture.posture_rows import OFF_FEET, POSTURE_ROWS, TICK_S, PoseHistory, minimum_jerk, support
from twin.scenario import load_scenario
from twin.world.scene import build_scene, populate


@pytest.mark.parametrize("name", ["lab-five-people", "home-three-people"])
def test_people_posed_ahead_are_where_they_are_one_time_after_the_other(name):
    scenario = load_scenario(name)
    scene = build_scene(scenario, pictures=False)
    usual, ahead = populate(scenario, scene), populate(scenario, scene)
    times = [round(k * 1e8) / 1e9 for k in range(1, 40)]
    for first in range(0, len(times), 10):
        ahead.prepare(times[first : first + 10])
        for t in times[first : first + 10]:
            usual.advance(t)
            np.testing.assert_array_equal(ahead.qpos(t), usual.qpos(t))
            for what in ("feet", "truth"):
                one, other = (vars(getattr(people, what)(t)) for people in (ahead, usual))
                assert all(np.array_equal(one[field], other[field]) for field in other), (t, what)


def test_who_gets_up_never_weighs_less_than_nothing():
    memory = PoseHistory(1)
    for tick in range(41):
        posture = np.zeros((POSTURE_ROWS, 1))
        posture[OFF_FEET] = 1.0 if tick % 4 == 0 else 0.5  # about to put the feet down at every fourth tick
        state = GaitState(np.zeros((FLOOR_ROWS, 1), dtype=complex), np.zeros((ROWS, 1)))
        memory.append(state, posture, np.ones(1, dtype=bool))
    rounded_down = np.array([0.3, 0.6, 0.7])
    assert (rounded_down / TICK_S % 1 > 0.5).all()  # 0.3 / 0.025 is 11.999999999999998
    assert [support(memory.at(t)[1])[0].item() for t in rounded_down] == [0.0, 0.0, 0.0]


def test_a_way_ends_where_it_ends():
    share = minimum_jerk(np.linspace(0.0, 1.0, 100_001), 0.495, 0.782)
    assert share.min() == 0.0
    assert share.max() == 1.0
