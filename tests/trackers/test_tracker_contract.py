"""What every tracker promises, over every preset; and that check_tracker sees it broken."""

import sys
from dataclasses import replace
from functools import cache
from typing import ClassVar

import numpy as np
import pytest
import synthetic_home
import synthetic_meeting
import threadpoolctl  # scikit-learn's
from synthetic_room import empty_room, observe, rig, straight_walk

from trackers.check import CORRUPTIONS, check_tracker
from trackers.feeding import FedTracker, track_frames
from trackers.observations import NS_PER_S, DepthImage, FloorFrame
from trackers.presets import PRESETS, make_tracker
from trackers.rig import FloorSensor, Rig, StereoSensor
from trackers.tracks import (
    Detection,
    Reporting,
    Track,
    TrackFrame,
    background_learned_causally,
    detections_of,
    discarded,
    finish_of,
    misreported,
    takes_any_order,
    unused_sensors,
    warnings,
)

RIG = rig()
BACKGROUND = empty_room(np.random.default_rng(99), 5)
WALK = straight_walk([(-1.2, 1.2), (1.2, 2.2), (0.0, 2.5)], [(0.5, 0.0), (-0.5, 0.0), (0.0, -0.2)], 16)
HOME = synthetic_home.rig()
"""For the trackers that need a pressure floor and cameras."""
MEETING = synthetic_meeting.rig()
"""For the trackers that need stereo cameras."""

BY_CLASS = {PRESETS[name].target: name for name in reversed(PRESETS)}
"""The first preset of each class: it lives through every fault, with and without an empty room."""
OTHER_RULES = (
    "laser-fisheye-imm-paper",
    "laser-vision-learning-laser",
    "camera-floor-particle-paper",
    "camera-floor-particle-floor",
    "rgbd-head-paper",
    "floor-colour-kalman",
)
"""Those that go ways of their own through the class: rules of the paper, other sensors. They live through every fault too."""


@cache
def observations_of(name):
    """A rig that the tracker fits, the empty room, and a recording."""
    if "rgbd" in name:
        walks = synthetic_meeting.walks(1, 8)
        return MEETING, synthetic_meeting.empty_room(MEETING), synthetic_meeting.observe(MEETING, walks)
    if "floor" not in name:
        return RIG, BACKGROUND, observe(WALK, 5)
    return HOME, synthetic_home.empty_room(HOME), synthetic_home.observe(HOME, synthetic_home.walks(2, 12))


def world_of(name):
    return observations_of("rgbd" if "rgbd" in name else "floor" if "floor" in name else "laser")


def violations_of(name, known):
    known_start = {"start": [{"place": (0.9, 0.0, 1.6), "yaw_deg": 0.0}]} if "rgbd-head-paper" in name else None

    def make(on, room, rng):
        return make_tracker(name, on, room, rng, known_start)

    on, room, observations = world_of(name)
    if on is RIG and not known:
        observations = observations[9:]  # learned: the walkers' start is the room
    return check_tracker(make, on, observations, room if known else [])


@pytest.mark.sample(5)
@pytest.mark.parametrize(
    ("name", "known"),
    [(name, True) for name in (*BY_CLASS.values(), *OTHER_RULES)] + [(name, False) for name in BY_CLASS.values()],
    ids=lambda value: value if isinstance(value, str) else "empty room" if value else "no background",
)
def test_trackers_keep_the_contract_through_every_fault(name, known):
    assert violations_of(name, known) == []


@pytest.mark.sample(5)
@pytest.mark.parametrize("name", [name for name in PRESETS if name not in (*BY_CLASS.values(), *OTHER_RULES)])
def test_presets_that_differ_in_values_keep_the_contract_through_some_faults(name, monkeypatch):
    """Each through two, so that together they meet all of them; how a room is learned is no matter of their values."""
    every, number = list(CORRUPTIONS), 2 * list(PRESETS).index(name)
    some = {every[k % len(every)]: CORRUPTIONS[every[k % len(every)]] for k in (number, number + 1)}
    monkeypatch.setattr("trackers.check.CORRUPTIONS", some)
    assert violations_of(name, known=True) == []


@pytest.mark.parametrize("name", PRESETS)
def test_every_preset_reports_a_frame_at_every_stamp_of_the_main_sensor(name):
    on, room, observations = world_of(name)
    observations = [item for item in observations if item.t < observations[0].t + 0.65]
    frames = list(track_frames(make_tracker(name, on, room), on, observations))
    stamps = [item.stamp_ns for item in observations if item.sensor == on.main_sensor]
    assert [frame.stamp_ns for frame in frames] == stamps


@pytest.mark.parametrize("name", BY_CLASS.values())
def test_stamps_below_0_give_the_same_tracks(name):
    on, room, observations = world_of(name)
    observations = [item for item in observations if item.t < observations[0].t + 1.05]
    by_ns = 1000 * NS_PER_S
    earlier = [replace(each, stamp_ns=each.stamp_ns - by_ns) for each in observations]
    first, below = (list(track_frames(make_tracker(name, on, room), on, given)) for given in (observations, earlier))
    assert len(first) >= 2
    assert [(frame.stamp_ns - by_ns, frame.tracks) for frame in first] == [
        (each.stamp_ns, each.tracks) for each in below
    ]


@pytest.mark.parametrize("name", BY_CLASS.values())
def test_tracks_do_not_depend_on_how_many_threads_multiply(name):
    on, room, observations = world_of(name)
    observations = [item for item in observations if item.t < observations[0].t + 1.05]
    frames = []
    for threads in (1, 2):
        with threadpoolctl.threadpool_limits(threads, "blas"):
            frames.append(list(track_frames(make_tracker(name, on, room), on, observations)))
    assert len(frames[0]) >= 2
    assert repr(frames[0]) == repr(frames[1])


class Stub:
    """A tracker that reports one person at each waist scan."""

    def __init__(self, rig, background=(), rng=None, **options):
        self.rng = rng
        self.n = 0

    def track(self):
        return Track(1, 0.0, 0.0)

    def update(self, observation):
        if observation.sensor != "waist":
            return []
        self.n += 1
        return [TrackFrame(observation.stamp_ns, (self.track(),))]

    def tracks(self):
        return []


def broken(**methods):
    return type("Broken", (Stub,), methods)


STATE = {"made": 0}


def unrepeatable(self):
    STATE["made"] += 1
    return Track(1, float(STATE["made"]), 0.0)


def writes(self, observation):
    array = observation.ranges_m if observation.sensor == "waist" else np.zeros(1)
    array[0] = 1.0
    return Stub.update(self, observation)


def chokes_on_nan(self, observation):
    if observation.sensor == "waist" and np.isnan(observation.ranges_m).all():
        raise ZeroDivisionError("no returns")
    return Stub.update(self, observation)


@pytest.mark.parametrize(
    ("kind", "complaint"),
    [
        (broken(track=unrepeatable), "other tracks from the same"),
        (
            broken(track=lambda self: Track(1, np.nan, 0.0)),
            "x or y is NaN; the first: x of track 1 is nan (float) at 1.",
        ),
        (
            broken(track=lambda self: Track(1, 0.0, 0.0, vx=np.inf)),
            "infinite number; the first: vx of track 1 is inf (float) at",
        ),
        (broken(track=lambda self: Track(0, 0.0, 0.0)), "from 1 up"),
        (
            broken(track=lambda self: Track(1.5, 0.0, 0.0)),
            "up to 2**63 - 1; the first: id is 1.5 (float) at 1.",
        ),
        (
            broken(track=lambda self: Track(2**63, 0.0, 0.0)),
            "up to 2**63 - 1; the first: id is 9223372036854775808 (int)",
        ),
        (broken(track=lambda self: Track(1, 0.0, 0.0, radius95_m=0.0)), "a radius95_m is not above 0"),
        (broken(track=lambda self: Track(1, "0.0", 0.0)), "x of a track is of type str; a number is expected"),
        (broken(track=lambda self: Track(1, 0.0, 0.0, z=np.zeros(1))), "z of a track is of type ndarray; a number"),
        (broken(track=lambda self: (1, 0.0, 0.0)), "a track is of type tuple; trackers.tracks.Track is expected"),
        (broken(track=lambda self: {"id": 1}), "a track is of type dict; trackers.tracks.Track is expected"),
        (broken(update=lambda self, observation: sys.exit(3)), "plain run: raised SystemExit: 3 ("),
        (broken(__init__=lambda self, *made: sys.exit(3)), "its constructor raised SystemExit: 3 ("),
        (
            broken(track=lambda self: Track(1, 0.0, 0.0, status="lost")),
            "coasting; the first: status of track 1 is 'lost' (str)",
        ),
        (broken(update=writes), "written to"),
        (broken(update=chokes_on_nan), "scans without a reading: raised ZeroDivisionError"),
        (broken(__init__=lambda self, *made: 1 / 0), "its constructor raised ZeroDivisionError"),
        (broken(update=lambda self, observation: 1 / 0), "plain run: raised ZeroDivisionError"),
        (broken(takes_any_order=True), "twice: stamps do not rise from frame to frame; the first: "),
        (broken(takes_any_order=True), "a second late: stamps do not rise"),
        (broken(tracks=None), "tracks"),
        (broken(update=lambda self, observation: []), "nobody was ever tracked"),
        (broken(takes_any_order="yes"), "takes_any_order is 'yes'; True or False is expected"),
        (broken(discarded=None), "discarded is None; an int from 0 up is expected"),
        (broken(discarded=-1), "discarded is -1; an int from 0 up"),
        (
            broken(discarded=property(lambda self: self.n and self.n / 2)),
            "plain run: discarded is 6.0; an int from 0 up",
        ),
        (broken(unused_sensors="knee"), "unused_sensors is 'knee'; a list of the rig's sensors (waist, knee, camera)"),
        (broken(unused_sensors=["floor"]), "unused_sensors is ['floor']; a list of the rig's sensors"),
        (broken(warnings="late"), "warnings is 'late'; a list of words is expected"),
        (broken(background_learned_causally=1), "background_learned_causally is 1; True or False is expected"),
        (broken(finish=[]), "finish is []; a method is expected"),
        (broken(finish=lambda self: None), "finish() gave NoneType; a list of TrackFrame is expected"),
        (broken(finish=lambda self: [None]), "update or finish gave NoneType; a list of TrackFrame is expected"),
        (broken(detections=[]), "detections is []; a method is expected"),
        (broken(detections=lambda self: [(1, 2)]), "detections() gave tuple; a list of Detection is expected"),
        (
            broken(detections=lambda self: [Detection(0, ("attic",), "waist", 0.0, 0.0)]),
            "camera); the first: sensors is ('attic',)",
        ),
        (broken(detections=lambda self: [Detection(0, ("waist",), "waist", np.nan, 0.0)]), "detection's x or y is NaN"),
    ],
)
def test_check_tracker_names_what_is_broken(kind, complaint):
    given = [replace(item, ranges_m=item.ranges_m.copy()) for item in observe(WALK, 5, images=False)[:24]]
    violations = check_tracker(lambda on, room, rng: kind(on, room, rng), RIG, given, BACKGROUND)
    assert any(complaint in violation for violation in violations), violations
    of_the_plain_run = [each.removeprefix("plain run") for each in violations if each.startswith("plain run")]
    assert not [each for each in violations if each.endswith(tuple(of_the_plain_run)) and "plain run" not in each]


def test_a_tracker_that_reports_at_each_scan_keeps_the_contract():
    given = observe(WALK, 5)
    assert check_tracker(Stub, RIG, given, BACKGROUND) == []
    told = broken(
        unused_sensors=("knee",),
        background_learned_causally=True,
        discarded=3,
        finish=lambda self: [],
        detections=lambda self: [Detection(0, ("waist",), "waist", 0.0, 0.0)],
    )
    assert check_tracker(told, RIG, given, BACKGROUND) == []


PARTS = {name for name in (*vars(Reporting), *Reporting.__annotations__) if not name.startswith("_")}


def test_a_whole_tracker_has_what_the_protocol_lists():
    wholes = [make_tracker(name, RIG, BACKGROUND) for name in ("laser-fisheye-imm", "laser-legs")]  # the second drives
    assert [part for part in sorted(PARTS) if not any(hasattr(whole, part) for whole in wholes)] == []


class Asked(Stub):
    """Notes what is asked of it that it does not have."""

    asked: ClassVar[set[str]] = set()

    def __getattr__(self, name):
        if not name.startswith("_"):
            self.asked.add(name)
        raise AttributeError(name)


def test_who_feeds_and_checks_a_tracker_asks_for_what_the_protocol_lists_and_for_nothing_else():
    Asked.asked.clear()
    assert check_tracker(Asked, RIG, observe(WALK, 5, images=False), BACKGROUND) == []
    fed = FedTracker(Asked(RIG), RIG)
    fed.update(BACKGROUND[0])
    fed.finish()
    assert fed.discarded == 0 and not fed.losses and not list(warnings(fed.tracker))
    assert Asked.asked == PARTS


def test_what_a_tracker_does_not_tell_is_its_default():
    mute = Stub(RIG)
    assert not takes_any_order(mute) and discarded(mute) == 0 and list(unused_sensors(mute)) == []
    assert not background_learned_causally(mute)
    assert finish_of(mute) is None and detections_of(mute) is None
    assert misreported(mute, RIG) == []


RIG_OF_ALL = Rig(
    sensors={
        "waist": RIG.sensors["waist"],
        "depth": StereoSensor.model_validate(
            {
                "kind": "stereo",
                "topic": "/depth/image/compressed",
                "depth_topic": "/depth/depth/compressed",
                "intrinsics": {"width": 8, "height": 6, "fx": 8, "fy": 8, "cx": 3.5, "cy": 2.5},
                "baseline_m": 0.1,
            }
        ),
        "floor": FloorSensor.model_validate(
            {"kind": "floor", "topic": "/floor", "rows": 4, "columns": 5, "pitch_m": 0.2}
        ),
    }
)


def of_all_kinds(n: int) -> list:
    """Scans of an empty room, depth pictures and floor frames that differ from moment to moment."""
    rng = np.random.default_rng(1)
    given: list = []
    for k in range(n):
        ns = round(0.1 * k * NS_PER_S)
        given += [
            replace(BACKGROUND[0], sensor="waist", stamp_ns=ns),
            DepthImage(
                "depth", ns, rng.integers(1, 255, (6, 8, 3), np.uint8), rng.uniform(1, 3, (6, 8)).astype(np.float32)
            ),
            FloorFrame("floor", ns, rng.integers(1, 99, (4, 5), np.uint8)),
        ]
    return given


@pytest.mark.parametrize(
    ("chokes", "complaint"),
    [
        (lambda item: isinstance(item, DepthImage) and not item.rgb.any(), "black pictures"),
        (lambda item: isinstance(item, DepthImage) and (item.rgb == 255).all(), "white pictures"),
        (lambda item: isinstance(item, DepthImage) and not item.depth_m.any(), "pictures without depth"),
        (
            lambda item: isinstance(item, DepthImage) and (item.depth_m < 0.01).all() and item.depth_m.any(),
            "a depth of 1 mm",
        ),
        (lambda item: isinstance(item, FloorFrame) and not item.values.any(), "a floor that feels nothing"),
        (lambda item: isinstance(item, FloorFrame) and (item.values == 255).all(), "a saturated floor"),
        (lambda item: isinstance(item, FloorFrame) and item.values[0, 0] == 200, "a stuck element"),
    ],
)
def test_check_tracker_spoils_pictures_depth_and_floors(chokes, complaint):
    def update(self, observation):
        if chokes(observation):
            raise ZeroDivisionError("choked")
        return Stub.update(self, observation)

    kind = broken(update=update)
    violations = check_tracker(lambda on, room, rng: kind(on, room, rng), RIG_OF_ALL, of_all_kinds(12))
    assert any(complaint in violation and "choked" in violation for violation in violations), violations


def test_a_sensor_that_falls_silent_is_silent_and_one_that_freezes_repeats_itself():
    given = of_all_kinds(9)
    silent = CORRUPTIONS["a sensor that falls silent"](given)
    assert [item.sensor for item in silent].count("waist") == 3
    frozen = CORRUPTIONS["sensors that freeze"](given)
    assert [item.stamp_ns for item in frozen] == [item.stamp_ns for item in given]
    floors = [item.values.tobytes() for item in frozen if isinstance(item, FloorFrame)]
    assert len(set(floors[:4])) == 4 and len(set(floors[4:])) == 1
