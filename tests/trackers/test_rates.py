"""Trackers by scanners follow people whatever the scanners' rates are, and whether their stamps are even."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from trackers.observations import Observation
from trackers.presets import make_tracker
from trackers.rig import Rig
from trackers.tracks import TrackFrame
from twin import Simulation, evaluate_tracks, load_scenario, stream, track_frames, track_table, truth_table

pytestmark = pytest.mark.slow

TRACKERS = ("laser-imm", "laser-kalman", "laser-legs", "laser-vision-learning-laser", "sort")
Recorded = tuple[Rig, list[Observation], list[Observation], list]


def recorded(*changes: str) -> Recorded:
    """Rig, empty room, observations and truth of the lab's scanners."""
    truth: list = []
    scenario = load_scenario("lab-five-people", ["duration_s=5", "seed=1007", *changes])
    with Simulation(scenario, images=False, on_truth=truth.append) as simulation:
        return simulation.rig, list(simulation.background()), list(simulation), truth


def followed(tracker: str, of: Recorded) -> tuple[float, float]:
    """MOTA, and the share of people's speed that the tracks report; of particles, means over three streams."""
    rig, background, observations, truth = of
    found = []
    for seed in range(3 if tracker.startswith("laser-vision-learning") else 1):
        made = make_tracker(tracker, rig, background, stream(seed, "tracker", tracker))
        frames = list(track_frames(made, rig, observations))
        mota = evaluate_tracks(truth_table(truth), track_table(frames))["mota"]
        found.append((mota, share_of_speed(frames, truth)))
    mota, share = np.mean(found, axis=0)
    return float(mota), float(share)


def assert_follows(tracker: str, of: Recorded, usual: dict[str, tuple[float, float]], least: float) -> None:
    """People are followed nearly as well as usual, and at their speed: a filter with a step of its own finds another one."""
    (mota, share), (usual_mota, usual_share) = followed(tracker, of), usual[tracker]
    assert mota >= least * usual_mota, tracker
    assert share == pytest.approx(usual_share, rel=0.2), tracker


def share_of_speed(frames: list[TrackFrame], truth: list) -> float:
    """Reported velocity along the true one, over it, by least squares over measured tracks within 0.3 m of a person."""
    people_at = {frame.stamp_ns: frame.people for frame in truth}
    along = square = 0.0
    for frame in frames:
        people = np.array([(one.x, one.y, one.vx, one.vy) for one in people_at.get(frame.stamp_ns, ())]).reshape(-1, 4)
        for track in frame.tracks:
            away = np.hypot(people[:, 0] - track.x, people[:, 1] - track.y)
            if track.status == "confirmed" and away.min(initial=1.0) < 0.3:
                vx, vy = people[away.argmin(), 2:]
                along += track.vx * vx + track.vy * vy
                square += vx**2 + vy**2
    return along / square


def both(rate_hz: float, *more: str) -> Iterator[str]:
    for name in ("waist", "knee"):
        yield f"sensors.{name}.rate_hz={rate_hz}"
        yield from (f"sensors.{name}.{change}" for change in more)


@pytest.fixture(scope="module")
def usual() -> dict[str, tuple[float, float]]:
    of = recorded()
    return {tracker: followed(tracker, of) for tracker in TRACKERS}


@pytest.mark.parametrize("rate_hz", [4.0, 25.0])
def test_uneven_stamps_of_any_rate_are_followed(rate_hz: float, usual: dict[str, tuple[float, float]]) -> None:
    of = recorded(*both(rate_hz, "jitter_s=0.002"))
    for tracker in TRACKERS:
        assert_follows(tracker, of, usual, 0.9 if rate_hz <= 5 else 0.95)


@pytest.mark.parametrize(
    "changes",
    [
        ("sensors.waist.rate_hz=12.5", "sensors.knee.rate_hz=7"),
        ("sensors.waist.rate_hz=5", "sensors.knee.rate_hz=13"),
        tuple(both(6, "dropout=0.15", "jitter_s=0.01")),
    ],
)
def test_unlike_rates_and_lost_scans_are_followed(
    changes: tuple[str, ...], usual: dict[str, tuple[float, float]]
) -> None:
    of = recorded(*changes)
    for tracker in TRACKERS:
        # in five seconds a start that is two lost scans later is a tenth of the figure
        assert_follows(tracker, of, usual, 0.85)


def test_a_scanner_that_changes_its_rate_midway_is_followed_on(usual: dict[str, tuple[float, float]]) -> None:
    rig, background, observations, truth = recorded(*both(20))
    numbers = {name: 0 for name in rig.sensors}
    kept = []
    for each in observations:
        numbers[each.sensor] += 1
        if each.t < 2.5 or numbers[each.sensor] % 4 == 0:  # 20 Hz, then 5
            kept.append(each)
    seen = {each.stamp_ns for each in kept}
    truth = [frame for frame in truth if frame.stamp_ns in seen]
    for tracker in TRACKERS:
        assert_follows(tracker, (rig, background, kept, truth), usual, 0.9)


@pytest.mark.parametrize("tracker", [*TRACKERS, "fusion"])
def test_a_scan_that_the_main_sensor_loses_leaves_no_hole_where_another_one_reports(tracker: str) -> None:
    rig, background, observations, _ = recorded("duration_s=3")
    of_main = [each.stamp_ns for each in observations if each.sensor == rig.main_sensor]
    lost = set(of_main[5::6])
    kept = [each for each in observations if not (each.sensor == rig.main_sensor and each.stamp_ns in lost)]
    stamps = [frame.stamp_ns for frame in track_frames(make_tracker(tracker, rig, background), rig, kept)]
    assert np.diff(stamps).max() == np.diff(of_main).max()
    assert np.diff(stamps).min() == np.diff(of_main).min()  # nor are there two frames for one
