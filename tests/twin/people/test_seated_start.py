"""People who sit from the start on."""

from __future__ import annotations

import numpy as np
import pytest

from trackers.errors import InputError
from twin import Simulation, load_scenario

_CHANGES = [
    "duration_s=9",
    "people={anna: {height_m: 1.7, script: [{kind: sit, seat: chair_1, seated: true, for_s: 2}, {kind: stand}]}}",
    *(f"sensors.stereo_{k}=null" for k in (1, 2, 3, 4)),
    "sensors.waist={kind: laser, role: waist, rate_hz: 5, mount: {xyz: [-2.9, -2.4, 0.95], yaw_deg: 40}}",
]


def heads(changes):
    told = []
    with Simulation(load_scenario("meeting-three-people", changes), on_truth=told.append) as simulation:
        list(simulation)
    return np.array([[one.head_x, one.head_y, one.head_z, one.head_yaw] for each in told for one in each.people])


def test_who_is_seated_from_the_start_sits_where_others_sit_down_and_stands_up():
    seated = heads(_CHANGES)
    assert np.ptp(seated[:10, :3], axis=0).max() < 0.02  # quiet until they rise
    assert 1.1 < seated[0, 2] < 1.35 and seated[-1, 2] > 1.5
    walks_there = [change.replace("seated: true, for_s: 2", "for_s: 60") for change in _CHANGES[1:]]
    sits_down = heads(["duration_s=25", *walks_there])
    assert np.abs(sits_down[-1, :3] - seated[0, :3]).max() < 0.06


@pytest.mark.parametrize(
    "person",
    [
        "{start: [0, 1.9], script: {kind: sit, seat: chair_1, seated: true}}",
        "{heading_deg: 3, script: {kind: sit, seat: chair_1, seated: true}}",
        "{script: [{kind: stand, for_s: 1}, {kind: sit, seat: chair_1, seated: true}]}",
    ],
)
def test_seated_from_the_start_is_the_first_thing_and_says_where(person):
    with pytest.raises(InputError, match="seated from the start"):
        load_scenario("meeting-three-people", [f"people={{anna: {person}}}"])
