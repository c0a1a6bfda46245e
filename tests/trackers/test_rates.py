"""Trackers by scanners follow people whatever the scanners' rates are, and whether their stamps are even."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from trackers.observations import Observation
from trackers.presets import make_tracker
from trackers.rig import Rig
from twin import Simulation, evaluate_tracks, load_scenario, stream, track_frames, track_table, truth_table

pytestmark = pytest.mark.slow

TRACKERS = ("laser-imm", "laser-kalman", "laser-vision-learning-laser", "sort")
Recorded = tuple[Rig, list[Observation], list[Observation], list]


def recorded(*changes: str) -> Recorded:
    """Rig, empty room, observations and truth of the lab's scanners."""
    truth: list = []
    scenario = load_scenario("lab-five-people", ["duration_s=8", "seed=1007", *changes])
    with Simulation(scenario, images=False, on_truth=truth.append) as simulation:
        return simulation.rig, list(simulation.background()), list(simulation), truth


def mota(tracker: str, of: Recorded) -> float:
    rig, background, observations, truth = of
    made = make_tracker(tracker, rig, background, stream(0, "tracker", tracker))
    frames = list(track_frames(made, rig, observations))
    return evaluate_tracks(truth_table(truth), track_table(frames))["mota"]


def both(rate_hz: float, *more: str) -> Iterator[str]:
    for name in ("waist", "knee"):
        yield f"sensors.{name}.rate_hz={rate_hz}"
        yield from (f"sensors.{name}.{change}" for change in more)


@pytest.fixture(scope="module")
def usual() -> dict[str, float]:
    of = recorded()
    return {tracker: mota(tracker, of) for tracker in TRACKERS}


@pytest.mark.parametrize("rate_hz", [4.0, 9.97, 25.0])
def test_uneven_stamps_of_any_rate_are_followed(rate_hz: float, usual: dict[str, float]) -> None:
    of = recorded(*both(rate_hz, "jitter_s=0.002"))
    for tracker in TRACKERS:
        assert mota(tracker, of) >= (0.9 if rate_hz <= 5 else 0.95) * usual[tracker], tracker


@pytest.mark.parametrize(
    "changes",
    [
        ("sensors.waist.rate_hz=12.5", "sensors.knee.rate_hz=7"),
        ("sensors.waist.rate_hz=5", "sensors.knee.rate_hz=13"),
        tuple(both(6, "dropout=0.15", "jitter_s=0.01")),
    ],
)
def test_unlike_rates_and_lost_scans_are_followed(changes: tuple[str, ...], usual: dict[str, float]) -> None:
    of = recorded(*changes)
    for tracker in TRACKERS:
        # in eight seconds a start that is two lost scans later is a tenth of the figure
        assert mota(tracker, of) >= 0.85 * usual[tracker], tracker


def test_a_scanner_that_changes_its_rate_midway_is_followed_on(usual: dict[str, float]) -> None:
    rig, background, observations, truth = recorded(*both(20))
    numbers = {name: 0 for name in rig.sensors}
    kept = []
    for each in observations:
        numbers[each.sensor] += 1
        if each.t < 4 or numbers[each.sensor] % 4 == 0:  # 20 Hz, then 5
            kept.append(each)
    seen = {each.stamp_ns for each in kept}
    truth = [frame for frame in truth if frame.stamp_ns in seen]
    for tracker in TRACKERS:
        assert mota(tracker, (rig, background, kept, truth)) >= 0.9 * usual[tracker], tracker
