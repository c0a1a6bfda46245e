"""People moved once: whoever looks at them later gets the same bits."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import pytest

from trackers.feeding import track_frames
from trackers.presets import make_tracker
from trackers.prior import Prior
from twin.people.poses import PopulationMotion
from twin.scenario import Scenario, load_scenario
from twin.streams import stream
from twin.truth.truth_types import TruthFrame
from twin.world.simulation import Simulation
from twin.world.world import PrecomputedScene, precompute_people

pytestmark = pytest.mark.slow

_SWEEP = ["sensors.waist.sweep_time_s=0.08", "sensors.knee.rate_hz=7.3", "sensors.knee.jitter_s=0.2"]


def told(scenario: Scenario, precomputed: PrecomputedScene | None) -> tuple[list[bytes], list[TruthFrame]]:
    truth: list[TruthFrame] = []
    with Simulation(scenario, on_truth=truth.append, precomputed=precomputed) as simulation:
        background = [bytes(each.data) for each in simulation.background_messages()]
        return [*background, *(bytes(each.encoded.data) for each in simulation.deliveries())], truth


@pytest.mark.sample(2)
@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("lab-five-people", ["duration_s=0.8", *_SWEEP]),  # scanners that sweep, a fisheye camera
        ("home-three-people", ["duration_s=0.5", "sensors.floor.rate_hz=17"]),  # a pressure floor
        ("home-cameras", ["duration_s=0.4", "sensors.camera_1.motion_blur={exposure_s: 0.05, instants: 3}"]),
        ("meeting-three-people", ["duration_s=0.5"]),  # stereo cameras
        ("library-hall", ["duration_s=1.1", "sensors.camera=null", "seed=3"]),  # people who come later
    ],
)
def test_every_sensor_reports_the_same_bits_of_people_who_moved_before(
    name: str, changes: list[str], tmp_path: Path
) -> None:
    scenario = load_scenario(name, ["background_frames=2", *changes])
    precompute_people(scenario)[0].save(tmp_path / "motion.npz")
    precomputed = PrecomputedScene.of(scenario, PopulationMotion.load(tmp_path / "motion.npz"))

    usual = told(scenario, None)
    assert told(scenario, precomputed) == usual
    assert told(scenario, precomputed)[0] == usual[0]  # and again: one look leaves nothing behind


def bits(motion: PopulationMotion) -> list[bytes]:
    return [getattr(motion, each.name).tobytes() for each in fields(motion)]


def test_a_motion_keeps_the_sign_of_zero(tmp_path: Path) -> None:
    motion = precompute_people(load_scenario("lab-five-people", ["duration_s=0.2"]))[0]
    motion.posture[0, 0, 0] = -0.0
    motion.save(tmp_path / "motion.npz")
    assert bits(PopulationMotion.load(tmp_path / "motion.npz")) == bits(motion)


def test_sensors_elsewhere_change_no_motion() -> None:
    scenario = load_scenario("lab-five-people", ["duration_s=1"])
    elsewhere = load_scenario("lab-five-people", ["duration_s=1", "sensors.waist.mount.xyz=[1, 0.1, 0.9]"])
    assert bits(precompute_people(scenario)[0]) == bits(precompute_people(elsewhere)[0])


def test_a_moment_after_the_motion_is_refused() -> None:
    scenario = load_scenario("lab-five-people", ["duration_s=0.2"])
    precomputed = PrecomputedScene.of(scenario, *precompute_people(scenario))
    with (
        Simulation(scenario, images=False, precomputed=precomputed) as simulation,
        pytest.raises(ValueError, match="ends after"),
    ):
        simulation.world.snapshot(5.0)


def test_tracks_are_those_of_a_run(tmp_path: Path) -> None:
    scenario = load_scenario("lab-five-people", ["duration_s=1.5"])
    precomputed = PrecomputedScene.of(scenario, *precompute_people(scenario))
    frames = []
    for each in (precomputed, None):
        with Simulation(scenario, precomputed=each) as simulation:
            prior = Prior(background=simulation.background())
            rng = stream(scenario.seed, "tracker", "laser-fisheye-imm")
            tracker = make_tracker("laser-fisheye-imm", simulation.rig, prior, rng)
            frames.append(list(track_frames(tracker, simulation.rig, simulation)))
    assert frames[0] == frames[1]
