"""What every tracker promises, on what the twin's sensors report."""

from __future__ import annotations

import numpy as np
import pytest

from trackers.check import check_tracker
from trackers.feeding import track_frames
from trackers.observations import Observation
from trackers.presets import PRESETS, make_tracker
from trackers.rig import Rig
from trackers.tracks import TrackFrame
from twin.evaluate import evaluate_tracks
from twin.recording.tables import track_table, truth_table
from twin.scenario import Scenario, load_scenario
from twin.truth.truth_types import TruthFrame
from twin.world.simulation import Simulation

pytestmark = pytest.mark.slow

Observed = tuple[Rig, list[Observation], list[Observation], list[TruthFrame]]


def observe(scenario: Scenario) -> Observed:
    truth: list[TruthFrame] = []
    with Simulation(scenario, on_truth=truth.append) as simulation:
        return simulation.rig, simulation.background(), list(simulation), truth


FITTING = [name for name in PRESETS if "floor" not in name and not name.startswith("rgbd")]
"""Those that do without the pressure floor and the stereo cameras that the lab has not."""


FIRST_OF_CLASS = list({PRESETS[name].target: name for name in reversed(FITTING)}.values())
SCENARIO = load_scenario("lab-five-people", ["duration_s=4", "seed=1000"])
COMPARED_S = 2.0


@pytest.fixture(scope="module")
def lab() -> Observed:
    return observe(SCENARIO)


@pytest.fixture(scope="module")
def turned() -> Observed:
    """The same people in another order, for as long as they are compared."""
    people = dict(reversed(SCENARIO.people.items()))
    return observe(SCENARIO.model_copy(update={"people": people, "duration_s": COMPARED_S}))


@pytest.fixture(scope="module")
def begun(lab: Observed) -> Observed:
    rig, background, observations, truth = lab
    return rig, background, [each for each in observations if each.t < COMPARED_S], truth


_FOLLOWED: dict[tuple[str, int], list[TrackFrame]] = {}


def follow(name: str, observed: Observed) -> list[TrackFrame]:
    """Frames of a preset, worked out once for each recording (the fixtures hold them for as long as the tests run)."""
    rig, background, observations, _ = observed
    if (key := (name, id(observations))) not in _FOLLOWED:
        tracker = make_tracker(name, rig, background, np.random.default_rng(0), {})
        _FOLLOWED[key] = list(track_frames(tracker, rig, observations))
    return _FOLLOWED[key]


@pytest.mark.sample(2)
@pytest.mark.parametrize("name", FIRST_OF_CLASS)
def test_the_contract_holds(name: str, lab: Observed) -> None:
    """A second of real readings; presets of other values meet the faults in the trackers' own contract test."""
    rig, background, observations, _ = lab
    observations = [each for each in observations if each.t < observations[0].t + 1.05]
    faults = check_tracker(lambda on, empty, rng: make_tracker(name, on, empty, rng, {}), rig, observations, background)
    assert faults == []


@pytest.mark.sample(5)
@pytest.mark.parametrize("name", [name for name in FITTING if name != "laser-fisheye-imm-paper"])
def test_five_people_are_followed(name: str, lab: Observed) -> None:
    figures = evaluate_tracks(truth_table(lab[3]), track_table(follow(name, lab)))
    assert figures["mota"] > 0.6  # the first half second of four is lost to confirmation
    # a camera alone at breast height sees how far somebody is by their size, not by their feet
    assert figures["motp_m"] < (0.25 if name.endswith("-vision") else 0.15)


def test_the_system_as_published_finds_the_people(lab: Observed) -> None:
    """Its confirmation takes half a second of four, and legs start a false track now and then."""
    frames = follow("laser-fisheye-imm-paper", lab)
    assert [frame.stamp_ns for frame in frames] == [frame.stamp_ns for frame in follow("laser-fisheye-imm", lab)]
    figures = evaluate_tracks(truth_table(lab[3]), track_table(frames))
    assert figures["misses"] < 0.3 * 5 * len(frames)  # an eighth is lost to confirmation
    assert 0.05 < figures["motp_m"] < 0.15


@pytest.mark.sample(3)
@pytest.mark.parametrize("name", FIRST_OF_CLASS)
def test_the_order_of_people_makes_no_difference(name: str, begun: Observed, turned: Observed) -> None:
    frames = follow(name, begun)
    assert follow(name, turned) == frames and len(frames[-1].tracks) == 5


@pytest.mark.parametrize("name", ["laser-fisheye-imm", "laser-kalman"])
def test_without_scans_of_the_empty_room_people_are_still_found(name: str, lab: Observed) -> None:
    rig, _, observations, truth = lab
    tracker = make_tracker(name, rig, [], np.random.default_rng(0), {})
    frames = list(track_frames(tracker, rig, observations))
    assert tracker.background_learned_causally  # pyright: ignore
    assert evaluate_tracks(truth_table(truth), track_table(frames))["mota"] > 0.2
