"""No option without effect: an absurd value of any option of a laser tracker changes its tracks, or is refused."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
import synthetic_home
import synthetic_meeting
import two_scanners
from pydantic import BaseModel
from synthetic_room import empty_room, observe, rig, straight_walk, wandering

from trackers.configuration import leaves_of
from trackers.errors import InputError
from trackers.feeding import track_frames
from trackers.observations import Observation
from trackers.presets import make_tracker
from trackers.rig import Rig

Recording = tuple[Rig, list[Observation], list[Observation]]

SEEN_ELSEWHERE = {
    "step_s": "tests/trackers/test_rates.py",
    "max_wait_s": "tests/trackers/tracking/test_synced_frames.py: a sensor that is late",
    "camera": "tests/trackers/test_presets.py: a choice of sensors",
    "waist.fuse_m": "tests/trackers/test_laser_group.py: two scanners of one height",
    "track_management.reid_m": "tests/trackers/tracking/test_track_manager.py: a person who was out of sight",
    "track_management.reid_speed_m_s": "tests/trackers/test_laser_fisheye_association.py: a person who was out of sight",
    "posture.seated_m": "tests/trackers/test_laser_fisheye_posture.py: people who sit",
    "posture.lies_down_s": "tests/trackers/test_laser_fisheye_posture.py: people who lie down",
    "posture.stays_s": "tests/trackers/test_laser_fisheye_posture.py: people who lie",
}
"""Options whose effect takes people or sensors that short recordings lack, and the test that sees it."""

NOT_SHOWN = {
    "laser-vision-learning-laser": {
        "situations.interacting_m": "changes what is said of a track, not the track",
        "situations.correlated_m": "changes what is said of a track, not the track",
        "track_management.confirm_hits": "takes a scanner below 5 Hz",
        "track_management.tentative_coast_s": "takes a tentative track that flickers",
        "track_management.report_margin_m": "takes people outside the area",
    }
}
"""Options of single presets whose effect no short recording shows, and what it would take."""

PRESETS_TRIED = ("sort", "laser-imm", "laser-vision-learning-laser")
"""One preset of each laser tracker, without pictures: a run takes a tenth of a second."""


@cache
def recordings(preset: str) -> tuple[Recording, ...]:
    """Short recordings: people who hide one another, with and without scans of the empty room, by one scanner and by two."""
    if "floor" in preset:
        on = synthetic_home.rig(2)
        places = synthetic_home.walks(2, 24)
        return ((on, list(synthetic_home.empty_room(on)), synthetic_home.observe(on, places)),)
    if "rgbd" in preset:
        on = synthetic_meeting.rig(2)
        heads = synthetic_meeting.walks(2, 16)
        return ((on, list(synthetic_meeting.empty_room(on)), list(synthetic_meeting.observe(on, heads))),)
    crowd = wandering(5, 26, np.random.default_rng(3))
    crossing = straight_walk([(-1.2, 1.2), (0.9, 1.9), (-0.3, 2.7)], [(1.0, 0.0), (-0.9, 0.0), (0.9, 0.0)], 24)
    pictures = "vision" in preset or "fisheye" in preset
    empty = list(empty_room(np.random.default_rng(1)))
    return (
        (rig(camera=pictures), empty, observe(crowd, 4, images=pictures)),
        (two_scanners.RIG, list(two_scanners.EMPTY), list(two_scanners.observed(crossing))),
        (rig(camera=pictures), empty, observe(crossing, 5, images=pictures)),
        (rig(camera=pictures), [], observe(crowd, 4, images=pictures)),
    )


def frames(preset: str, recording: Recording, options: dict[str, Any]) -> list[Any]:
    """Everything that a tracker says of a recording."""
    on, empty, given = recording
    tracker = make_tracker(preset, on, empty, np.random.default_rng(0), options)
    return [
        (
            frame.stamp_ns,
            [
                (each.id, each.x, each.y, each.head_x, each.head_yaw, each.status, each.radius95_m)
                for each in frame.tracks
            ],
        )
        for frame in track_frames(tracker, on, given)
    ]


@cache
def usual(preset: str, number: int) -> str:
    return repr(frames(preset, recordings(preset)[number], {}))


def absurd(value: Any) -> list[Any]:
    """Return values far from this one, up and down; some will be refused."""
    if isinstance(value, bool):
        return [not value]
    if value is None:
        return [1e-3, 1e3, 1]
    if isinstance(value, str):
        return ["no such thing"]
    if isinstance(value, tuple):
        return [value[:1], tuple(absurd(each)[0] for each in value)]
    if isinstance(value, int):
        return [1, 10 * value + 7, 0]
    far = [0.001 * value, 0.999, 1000 * value + 50.0, 3 * value + 0.3, 0.0, -1.0]
    return [other for other in far if other != value]


def nested(path: str, value: Any) -> dict[str, Any]:
    for name in reversed(path.split(".")):
        value = {name: value}
    return value


def has_effect(preset: str, path: str, value: Any) -> bool:
    """Whether an absurd value of the option changes any recording's tracks, or every one is refused."""
    refused = True
    for number, recording in enumerate(recordings(preset)):
        for other in absurd(value):
            try:
                if repr(frames(preset, recording, nested(path, other))) != usual(preset, number):
                    return True
            except InputError:
                continue
            refused = False
    return refused


def options_of(preset: str) -> BaseModel:
    on, empty, _ = recordings(preset)[0]
    try:
        return make_tracker(preset, on, empty).options  # pyright: ignore[reportAttributeAccessIssue]
    except InputError:
        on, empty, _ = recordings("laser-fisheye-imm")[0]
        return make_tracker(preset, on, empty).options  # pyright: ignore[reportAttributeAccessIssue]


@pytest.mark.parametrize("preset", PRESETS_TRIED)
def test_every_option_of_a_tracker_has_an_effect_or_is_refused(preset: str) -> None:
    exempt = SEEN_ELSEWHERE | NOT_SHOWN.get(preset, {})
    idle = [
        path
        for path, value in leaves_of(options_of(preset))
        if path not in exempt and not has_effect(preset, path, value)
    ]
    assert idle == []
