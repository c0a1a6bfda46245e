"""What lies between two ticks of the people's clock."""

from __future__ import annotations

import numpy as np

from twin.people.gait.gait_state import FLOOR_ROWS, ROWS, GaitState
from twin.people.poses import TICK_S, PoseHistory
from twin.people.posture.posture_rows import OFF_FEET, POSTURE_ROWS, minimum_jerk, support


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
