"""The same recording said otherwise gives the same tracks; the whole of it is `scripts/bench --only metamorphic`."""

from functools import cache

import numpy as np
import pytest
import synthetic_home
from benchmarks.restated import (
    CLOSE,
    EXACT,
    OTHER_SEEDS,
    REDRAWN,
    ROUNDING_M,
    UNLIKE,
    Restated,
    Scene,
    deviation_m,
    disagreement,
    redrawn_disagreement,
)
from synthetic_room import empty_room, observe, rig, wandering

IN_THE_TESTS = {
    name: each for name, each in EXACT.items() if name not in ("clock from 1970 on, an hour", "clock of 2026")
}
"""Restatements tried here: of four clocks the one that starts at nought and the one farthest from it."""
LASERS = ("sort", "laser-imm", "laser-kalman", "laser-vision-learning-laser")
SAMPLING = ("laser-vision-learning-laser",)


@cache
def lasers(known: bool) -> Scene:
    walk = wandering(3, 36, np.random.default_rng(3))
    room = empty_room(np.random.default_rng(99), 5) if known else []
    return Scene(rig(camera=False), room, observe(walk, 5, images=False))


@cache
def tracked(tracker: str, known: bool):
    """What the tracker makes of the scene as it is."""
    first = lasers(known).frames(tracker)
    assert sum(len(frame.tracks) for frame in first) > 40
    return first


@cache
def spread(tracker: str) -> float:
    """How much of the tracks in a known room another seed changes."""
    first, scene = tracked(tracker, True), lasers(True)
    return max(disagreement(first, Restated(scene), scene.frames(tracker, seed)) for seed in OTHER_SEEDS)


@cache
def at_home():
    """A floor and cameras, and what their trackers make of them as they are."""
    home = synthetic_home.rig(2)
    seen = synthetic_home.observe(home, synthetic_home.walks(2, 12))
    scene = Scene(home, synthetic_home.empty_room(home), seen)
    first = {tracker: scene.frames(tracker) for tracker in ("floor-kalman", "camera-floor-particle-floor", "fusion")}
    assert all(any(frame.tracks for frame in frames) for frames in first.values())
    return scene, first


@pytest.mark.parametrize(
    ("tracker", "known"),
    [(tracker, True) for tracker in (*LASERS, "fusion") if tracker != "laser-kalman"]
    + [(tracker, False) for tracker in ("sort", "laser-imm")],
    ids=lambda value: value if isinstance(value, str) else "known room" if value else "learned room",
)
@pytest.mark.parametrize("name", IN_THE_TESTS)
def test_the_same_readings_give_the_same_tracks(name, tracker, known):
    first = tracked(tracker, known)
    restated = EXACT[name](lasers(known))
    if tracker in SAMPLING and name in REDRAWN:
        most = spread(tracker) + UNLIKE
        assert redrawn_disagreement(first, restated, tracker, most) <= most
        return
    assert deviation_m(first, restated, restated.scene.frames(tracker)) <= ROUNDING_M


@pytest.mark.parametrize(
    "name",
    [
        "turned by 37°, moved by 1 km",
        "mirrored",
        "sensors upside down",
        "clockwise scanners",
        "clock of 2200",
        "clock that runs up to 0",
        "other order",
    ],
)
def test_legs_are_the_same_however_the_scans_are_told(name):
    first = tracked("laser-legs", True)
    restated = EXACT[name](lasers(True))
    assert deviation_m(first, restated, restated.scene.frames("laser-legs")) <= ROUNDING_M


@pytest.mark.parametrize("name", ["turned by 37°, moved by 1 km", "mirrored", "clock of 2200"])
def test_another_filter_of_the_same_detections_does_not_care_either(name):
    """`laser-kalman` is `laser-imm` but for its filter, which places and times reach."""
    first = tracked("laser-kalman", True)
    restated = EXACT[name](lasers(True))
    assert deviation_m(first, restated, restated.scene.frames("laser-kalman")) <= ROUNDING_M


@pytest.mark.parametrize("tracker", [tracker for tracker in LASERS if tracker != "laser-kalman"])
@pytest.mark.parametrize("name", CLOSE)
def test_fewer_or_more_readings_give_tracks_as_good(name, tracker):
    first = tracked(tracker, True)
    restated = CLOSE[name](lasers(True))
    frames = restated.scene.frames(tracker)
    settled = frames[len(frames) // 4].stamp_ns  # confirmed by then, also where the run begins later
    settled_first = [each for each in first if each.stamp_ns >= settled]
    assert disagreement(settled_first, restated, frames) <= spread(tracker) + 2 * UNLIKE


@pytest.mark.parametrize("name", [each for each in IN_THE_TESTS if each not in REDRAWN and "clockwise" not in each])
def test_a_floor_and_cameras_do_not_care_either(name):
    scene, first = at_home()
    restated = EXACT[name](scene)
    for tracker, frames in first.items():
        assert deviation_m(frames, restated, restated.scene.frames(tracker)) <= ROUNDING_M


def test_what_differs_is_told():
    first = tracked("sort", True)
    scene = lasers(True)
    halved = Scene(scene.rig, scene.background, scene.observations[: len(scene.observations) // 2])
    assert deviation_m(first, Restated(scene), halved.frames("sort")) == np.inf
    assert disagreement(first, Restated(scene), halved.frames("sort")) > 0.2
    assert disagreement(first, Restated(scene, back=lambda place: place + 1.0), first) > 0.9
    assert deviation_m(
        first, Restated(scene, back=lambda place: place + np.array([0.03, 0.04])), first
    ) == pytest.approx(0.05)
