"""People who walk abreast: as near as asked, as near as shoulders allow, and never through each other."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from benchmarks.penetration import count_penetrations

from trackers.configuration import validate
from twin.scenario import Scenario
from twin.world.world import World

START = {"start": [-3.2, 1.7], "heading_deg": 0}
LASER = {"kind": "laser", "role": "waist", "rate_hz": 10, "mount": {"xyz": [0, 0.5, 0.9], "yaw_deg": 90}}
TIMES_S = np.arange(0.0, 5.0, 0.1)


def company(distance_m: float, looks: dict[str, Any], sides: tuple[str, ...]) -> Scenario:
    walk = {"kind": "walk", "waypoints": [[2.0, 1.7]], "speed_m_s": 1.1}
    people = {"lead": {**START, **looks, "script": walk}}
    for side in sides:
        follow = {"kind": "follow", "person": "lead", "beside": side, "distance_m": distance_m}
        start = [-3.2, 2.5 if side == "left" else 0.9]
        people[side] = {**START, "start": start, **looks, "script": follow}
    content = {"name": "company", "room": "plaza", "duration_s": 5, "people": people, "sensors": {"waist": LASER}}
    return validate(Scenario, content, "test")


def seen_by_the_first(scenario: Scenario) -> np.ndarray:
    """Places of the others in the frame of the first, (t, k) ahead + left i [m]."""
    people, seen = World(scenario).people, []
    for t in TIMES_S:
        people.advance(float(t))
        truth = people.truth(float(t))
        first = people.names.index("lead")
        place = (truth.x + 1j * truth.y - truth.x[first] - 1j * truth.y[first]) * np.exp(-1j * truth.yaw[first])
        seen.append(np.delete(place, first))
    return np.array(seen)


@pytest.mark.parametrize(
    ("distance_m", "looks", "sides", "least_m", "most_m"),
    [
        (0.5, {"height_m": 1.75, "build": 1.0, "bag": "none"}, ("left",), 0.45, 0.58),
        (0.5, {"build": 1.18, "coat": "navy", "bag": "none"}, ("left", "right"), 0.5, 0.65),
        (0.7, {"bag": "none"}, ("right",), 0.65, 0.75),
    ],
)
def test_abreast_and_not_through_each_other(
    distance_m: float, looks: dict[str, Any], sides: tuple[str, ...], least_m: float, most_m: float
) -> None:
    scenario = company(distance_m, looks, sides)
    seen = seen_by_the_first(scenario)[25:45]  # once they have drawn level, and before they halt
    assert least_m < np.median(np.abs(seen)) < most_m
    assert np.abs(seen.real).mean() < 0.05  # abreast: neither before nor behind
    held = count_penetrations(World(scenario), TIMES_S)
    assert held.depth_m <= 0.01, str(held)


def test_only_companions_come_so_near() -> None:
    scenario = company(0.5, {"bag": "none"}, ("left",))
    alone = {"start": [1.5, 1.4], "heading_deg": 180, "script": {"kind": "walk", "waypoints": [[-3.0, 1.7]]}}
    content = scenario.model_dump(mode="json", exclude_none=True)
    content["people"]["stranger"] = alone
    seen = seen_by_the_first(validate(Scenario, content, "test"))
    assert np.abs(seen[:, 1]).min() > 0.55  # the middles keep 0.65; the pelvis sways
