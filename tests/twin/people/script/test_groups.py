"""Groups walk as measured ones do, change sides, talk in a ring, part, and never go through each other."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from benchmarks.penetration import count_penetrations

from trackers.configuration import validate
from trackers.errors import InputError
from twin.scenario import Scenario
from twin.world.world import World

LASER = {"kind": "laser", "role": "waist", "rate_hz": 10, "mount": {"xyz": [0, 0.5, 0.9], "yaw_deg": 90}}
STARTS = {"ann": [0, 0], "bob": [0, 1.2], "cyd": [0, -1.2], "dan": [-1.2, 0]}
STEP_S = 0.1


def group(size: int, duration_s: float, seed: int = 0, then: Any = (), **leads: Any) -> Scenario:
    people: dict[str, Any] = {
        name: {"start": start, "heading_deg": 0, "script": {"kind": "join", "person": "ann"}}
        for name, start in list(STARTS.items())[:size]
    }
    people["ann"]["script"] = [{"kind": "lead", **leads}, *then]
    content = {
        "name": "group", "room": "plaza", "duration_s": duration_s, "seed": seed, "people": people,
        "area": [[-8, -6], [8, -6], [8, 6], [-8, 6]], "sensors": {"waist": LASER},
    }  # fmt: skip
    return validate(Scenario, content, "test")


def walked(scenario: Scenario) -> tuple[np.ndarray, np.ndarray]:
    """Places (t, n) x + iy [m] and headings (t, n) [rad] in the order of names, ann first."""
    people, places, headings = World(scenario).people, [], []
    for t in np.arange(0.0, scenario.duration_s, STEP_S):
        people.advance(float(t))
        truth = people.truth(float(t))
        places.append(truth.x + 1j * truth.y)
        headings.append(truth.yaw)
    return np.array(places), np.array(headings)


def seen_by_ann(places: np.ndarray, headings: np.ndarray) -> np.ndarray:
    """The others in the frame of the first, ahead + left i [m]."""
    return (places[:, 1:] - places[:, :1]) * np.exp(-1j * headings[:, :1])


@pytest.fixture(scope="module")
def pairs() -> list[tuple[np.ndarray, np.ndarray]]:
    return [walked(group(2, 13, seed, talk_share=0.0, change_share=0.0, stretch_s=20)) for seed in range(3)]


def test_pairs_walk_abreast_at_the_measured_distance(pairs: list[tuple[np.ndarray, np.ndarray]]) -> None:
    """Moussaïd et al. 2010, table 1: neighbours are about 0.8 m apart, beside each other."""
    seen = np.concatenate([seen_by_ann(*each)[30:, 0] for each in pairs])
    assert 0.6 < np.median(np.abs(seen)) < 0.95
    assert np.mean(np.abs(seen.imag) > np.abs(seen.real)) > 0.7


def test_pairs_are_slower_than_people_alone(pairs: list[tuple[np.ndarray, np.ndarray]]) -> None:
    """Moussaïd et al. 2010, figure 2: 1.26 − 0.04 n m/s at low density."""
    speed = np.concatenate([np.abs(np.diff(places[30:, 0])) / STEP_S for places, _ in pairs])
    assert np.median(speed) == pytest.approx(1.26 - 0.04 * 2, abs=0.12)


def test_people_change_sides() -> None:
    near = {"near_s": (2, 2), "far_s": (1, 1)}
    lateral = seen_by_ann(*walked(group(2, 10, 3, talk_share=0.0, change_share=1.0, stretch_s=20, **near)))[:, 0].imag
    lateral = lateral[np.abs(lateral) > 0.4]
    assert (np.sign(lateral[1:]) != np.sign(lateral[:-1])).any()


def test_neighbours_are_near_for_as_long_as_said() -> None:
    """The time counts from when all are near, not from when they begin to draw near."""
    leads = {"talk_share": 0.0, "change_share": 0.0, "stretch_s": 40, "spacing_m": (0.5, 1.4), "near_s": (1.5, 1.5)}
    places, _ = walked(group(3, 20, seed=1, **leads))
    near = np.abs(places[:-1, 1:] - places[:-1, :1]).max(axis=1) < 0.72
    ends = np.flatnonzero(np.diff(np.concatenate([[0], near.astype(int), [0]])))
    times_s = (ends[1::2] - ends[::2]) * STEP_S
    assert len(times_s) > 1
    assert (times_s > 1.4).all()


def test_the_middle_of_three_lags() -> None:
    places, headings = walked(group(3, 10, talk_share=0.0, change_share=0.0, stretch_s=20, formation="v"))
    seen = np.concatenate([np.zeros((len(places), 1)), seen_by_ann(places, headings)], axis=1)[40:]
    middle = np.argsort(seen.imag, axis=1)[:, 1]
    lag = seen.real.mean(axis=1) - seen.real[np.arange(len(seen)), middle]
    assert np.median(lag) > 0.05


def test_a_group_talks_in_a_ring_and_parts() -> None:
    away = {"kind": "walk", "waypoints": [[7.5, 0]]}
    scenario = group(3, 12, then=[away], talk_share=1.0, talk_s=(5, 5), stretch_s=0.5, for_s=7)
    places, headings = walked(scenario)
    ring = slice(48, 58)
    assert np.abs(np.diff(places[ring], axis=0)).max() < 0.06  # they stand
    inwards = places[ring].mean(axis=1, keepdims=True) - places[ring]
    assert (np.cos(np.angle(inwards) - headings[ring]) > 0.8).all()
    assert np.abs(places[-1, 1:] - places[-1, 0]).min() > 2.0


@pytest.mark.parametrize(("size", "formation"), [(2, "abreast"), (4, "v"), (4, "file")])
def test_nobody_goes_through_anybody(size: int, formation: str) -> None:
    scenario = group(size, 8, seed=5, formation=formation, spacing_m=(0.45, 0.6), far_s=(0.5, 1), stretch_s=3)
    held = count_penetrations(World(scenario), np.arange(0.0, 8.0, 0.2))
    assert held.depth_m <= 0.01, str(held)


def test_a_range_in_the_wrong_order_is_refused() -> None:
    with pytest.raises(InputError, match=r"people\.ann\.script\.0.*near_s \[4, 2\] is not a range"):
        group(2, 5, near_s=(4, 2))
