"""Misses and false positives are told apart by what the truth says of sight, stay and posture."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from test_evaluate import still, tracks_of

from twin.evaluate.causes import FALSE_POSITIVES, MISSES
from twin.evaluate.summary import evaluate_tracks, evaluate_with_details
from twin.recording.tables import TruthTable, truth_table
from twin.truth.truth_types import PersonTruth, TruthFrame

PERIOD_NS = 100_000_000


def person(at: tuple[float, float] = (0.0, 0.0), **changed: Any) -> PersonTruth:
    x, y = at
    usual = {"z": 0.9, "head_z": 1.6, "in_area": True, "visible": {"waist": 1.0, "camera": 1.0}}
    return PersonTruth(id=1, x=x, y=y, yaw=0.0, head_x=x, head_y=y, head_yaw=0.0, vx=0.0, vy=0.0, **(usual | changed))


def truth(*people: PersonTruth | None) -> TruthTable:
    frames = [TruthFrame(k * PERIOD_NS, () if each is None else (each,)) for k, each in enumerate(people)]
    return truth_table(frames)


def causes(table: TruthTable, tracks: dict, unused: tuple[str, ...] = ()) -> dict[str, int]:
    """The causes that occurred, with their frames."""
    evaluation = evaluate_with_details(table, tracks_of(tracks, range(10)), unused=unused)
    assert set(evaluation.metrics["errors"]["missed"]) == set(MISSES)
    assert set(evaluation.metrics["errors"]["false_positive"]) == set(FALSE_POSITIVES)
    both = evaluation.metrics["errors"]["missed"] | evaluation.metrics["errors"]["false_positive"]
    assert sum(both.values()) == evaluation.misses.sum() + evaluation.false_positives.sum()
    return {cause: frames for cause, frames in both.items() if frames}


def test_a_miss_before_the_first_match_of_a_stay_is_start_up():
    there = truth(*[person()] * 4, None, None, *[person()] * 4)
    seven = still(0, 0, [2, 3, 8, 9])
    assert causes(there, {7: seven}) == {"start_up": 4}
    assert causes(there, {7: still(0, 0, [0, 1, 6, 7])}) == {"seen": 4}


def test_hidden_people_and_unused_sensors_are_causes_of_their_own():
    hidden, by_camera = {"waist": 0.0, "camera": 0.0}, {"waist": 0.0, "camera": 0.4}
    there = truth(*[person()] * 4, *[person(visible=hidden)] * 3, *[person(visible=by_camera)] * 3)
    tracks = {7: still(0, 0, range(4))}
    assert causes(there, tracks) == {"unseen": 3, "seen": 3}
    assert causes(there, tracks, unused=("camera",)) == {"unseen": 3, "unused": 3}


def test_tracks_far_from_people_are_ghosts_while_they_coast_and_clutter_else():
    hidden = {"waist": 0.0, "camera": 0.0}
    there = truth(*[person()] * 5, *[person((0, 2))] * 2, *[person((0, 2), visible=hidden)] * 3)
    seven = still(0, 0, range(5)) | still(0, 0, range(5, 10), "coasting")
    tracks = {7: seven, 8: still(0, 2, range(5, 10)), 9: still(4, 4, range(2)), 10: still(5, 5, [3], "coasting")}
    # the hidden one's own track is 8 by then
    assert causes(there, tracks) == {"ghost": 3, "ghost_unseen": 3, "clutter": 2}
    assert causes(there, {7: still(0, 0, range(10)), 8: still(0.3, 0, range(5))}) == {
        "double": 5,
        "clutter": 5,
        "seen": 2,
        "unseen": 3,
    }


def test_postures_follow_from_the_pelvis_and_the_head():
    sits, lies = person(z=0.5, head_z=1.2), person(z=0.55, head_z=0.6)
    there = truth(*[person()] * 4, *[sits] * 3, *[lies] * 3)
    errors = evaluate_with_details(there, tracks_of({7: still(9, 9, [0])}, range(10))).errors
    missed = errors.cause == "start_up"
    assert errors.posture[missed].tolist() == ["upright"] * 4 + ["low"] * 3 + ["lying"] * 3
    assert np.allclose(errors.xy[~missed], 9) and errors.posture[~missed].tolist() == [""]


def test_without_sensors_in_the_truth_all_people_are_seen():
    there = truth(*[person(visible={})] * 4)
    assert evaluate_tracks(there, tracks_of({7: still(0, 0, [0])}, range(4)))["errors"]["missed"]["seen"] == 3


@pytest.mark.parametrize("gate_m", [0.1, 0.5, 1.0])
def test_every_error_is_counted_once_at_any_gate(gate_m):
    there = truth(*[person((0.15 * k, 0)) for k in range(10)])
    evaluation = evaluate_with_details(there, tracks_of({7: still(0, 0, range(10))}, range(10)), gate_m)
    assert evaluation.errors.stamps_ns.size == evaluation.misses.sum() + evaluation.false_positives.sum() > 0
