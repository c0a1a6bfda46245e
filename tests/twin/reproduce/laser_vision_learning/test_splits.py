"""Identities at splits by classifiers alone: two people who pass each other, and a pair that nothing tells apart."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from trackers.laser_vision_learning.looks import LooksOptions
from trackers.learning.boosting import BoostingOptions
from twin.recording.reader import Recording
from twin.reproduce.laser_vision_learning.splits import VARIANTS, decide, near_identical_clothes, split_truth
from twin.run.live import run_scenario
from twin.scenario import load_scenario

PASSING = """
name: passing
room: library_hall
area: [[-3, -3], [3, -3], [3, 3], [-3, 3]]
duration_s: 5
background: none
people:
  ann: {shirt: red, trousers: black, start: [-1.4, 0.0], script: {kind: walk, waypoints: [[1.4, 0.4]], speed_m_s: 0.9}}
  bob: {shirt: white, trousers: white, start: [1.4, 0.2], script: {kind: walk, waypoints: [[-1.4, -0.2]], speed_m_s: 0.9}}
sensors:
  camera: {kind: camera, rate_hz: 10, size: [320, 240], vertical_field_of_view_deg: 60,
           mount: {xyz: [0, -4.5, 5], yaw_deg: 90, pitch_deg: 45}}
"""
FEW = LooksOptions(by="classifier", boosting=BoostingOptions(trees=10, kept=7))


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("passing")
    (folder / "passing.yaml").write_text(PASSING)
    run_scenario(load_scenario(folder / "passing.yaml"), trackers=(), out=folder / "out", video=False)
    return folder / "out" / "recording.mcap"


def test_two_who_met_are_identified_when_they_part(recording: Path) -> None:
    decisions = decide(recording, {"few": FEW}, "correlated")["few"]
    assert [(each.first_id, each.second_id) for each in decisions] == [(1, 2)]
    assert decisions[0].margin > 0.5
    again = decide(recording, {"few": FEW, "other": FEW}, "correlated")
    assert again["few"] == again["other"] == decisions


def test_a_classifier_that_never_learned_does_not_decide(recording: Path) -> None:
    blind = FEW.model_copy(update={"least_patches": 41})
    decisions = decide(recording, {"blind": blind}, "correlated")["blind"]
    assert [each.margin for each in decisions] == [0]


def test_no_person_is_learned_from_while_a_tracker_could_confuse_them(recording: Path) -> None:
    truth = split_truth(Recording(recording), "correlated")
    ((first, second, start, end),) = truth.parted
    assert {first, second} == {0, 1}
    assert not truth.apart[start:end].any()
    assert truth.apart[:start].all()
    distance = np.linalg.norm(truth.positions_m[:, 0] - truth.positions_m[:, 1], axis=1)
    assert start <= distance.argmin() < end


def test_near_identical_clothes_are_overrides_of_a_scenario() -> None:
    people = load_scenario("lab-five-people", near_identical_clothes(load_scenario("lab-five-people").people)).people
    assert len({each.shirt for each in people.values()}) == 5
    assert all(str(each.trousers).startswith("#2") for each in people.values())


def test_every_variant_that_was_tried_differs_from_what_was_chosen() -> None:
    assert VARIANTS["colours"] == LooksOptions()
    chosen = VARIANTS["patches, as chosen"]
    assert [name for name, options in VARIANTS.items() if options == chosen] == ["patches, as chosen"]
