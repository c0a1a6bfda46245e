"""People by their legs, from a scanner that stands and from one that drives."""

from dataclasses import replace
from itertools import zip_longest

import numpy as np
import pytest
from driving_room import POSTS, WALKER, drive, legs_of, scan_at

from trackers.configuration import leaves_of
from trackers.errors import InputError
from trackers.feeding import track_frames
from trackers.frames.scan_matching import between, compose, inverse, placed
from trackers.laser_legs.evidence import assigned
from trackers.laser_legs.options import LaserLegsOptions
from trackers.laser_legs.tracker import likeliest
from trackers.observations import NS_PER_S, Odometry
from trackers.presets import make_tracker
from trackers.rig import LaserSensor, OdometrySensor, Pose, Rig
from trackers.tracks import report_frame


def rig_at(pose) -> Rig:
    x, y, yaw = (float(each) for each in pose)
    return Rig(sensors={"scan": LaserSensor(topic="/scan", room_from_sensor=Pose(xyz=(x, y, 0.3), rpy=(0, 0, yaw)))})


def scanned(path, motions, people):
    """Scans of people (x, y, vx, vy) who walk on straight lines."""
    scans = []
    for k, (pose, motion) in enumerate(zip(path, motions, strict=True)):
        t = 0.1 * k
        legs = [leg for person in people for leg in legs_of(person, t)]
        scans.append(scan_at(pose, t, 0.05, motion, [*POSTS, *legs]))
    return scans


def tracked(path, motions, people, **options):
    """Frames of the tracker, with such people."""
    rig = rig_at(path[0])
    tracker = make_tracker("laser-legs", rig, (), np.random.default_rng(0), options)
    return list(track_frames(tracker, rig, scanned(path, motions, people))), tracker


STANDING = np.tile([-2.0, -1.0, 0.3], (50, 1)), np.zeros((50, 3))


def misses(frames, walker, frame_of=lambda k, place: place, since: int = 15) -> int:
    found = 0
    for k, frame in enumerate(frames[since:], since):
        place = frame_of(k, np.array([walker[0] + walker[2] * 0.1 * k, walker[1] + walker[3] * 0.1 * k]))
        found += any(np.hypot(each.x - place[0], each.y - place[1]) < 0.4 for each in frame.tracks)
    return len(frames) - since - found


@pytest.mark.parametrize("way", [STANDING, drive()], ids=["stands", "drives"])
def test_somebody_who_walks_is_one_track_in_the_fixed_frame_and_posts_are_none(way):
    frames, tracker = tracked(*way, [WALKER], report_in="matched")
    assert misses(frames, WALKER) <= 3
    assert len({track.id for frame in frames for track in frame.tracks}) == 1
    assert tracker.warnings == []
    speeds = [np.hypot(track.vx, track.vy) for frame in frames[25:] for track in frame.tracks]
    assert np.median(speeds) == pytest.approx(np.hypot(0.3, 0.6), abs=0.2)


@pytest.mark.parametrize("way", [STANDING, drive()], ids=["stands", "drives"])
def test_a_person_in_full_view_is_reported_from_the_second_scan_on(way):
    frames, _ = tracked(*way, [WALKER])
    assert not frames[0].tracks
    assert all(len(frame.tracks) == 1 for frame in frames[1:4])


@pytest.mark.parametrize("way", [STANDING, drive()], ids=["stands", "drives"])
def test_where_there_is_no_person_there_is_hardly_a_track(way):
    frames, _ = tracked(*way, [])
    assert sum(len(frame.tracks) for frame in frames) <= 3


def test_a_slow_scanner_reports_at_its_first_look_who_comes_to_a_place_seen_free_before():
    rig = rig_at(STANDING[0][0])
    tracker = make_tracker("laser-legs", rig, (), np.random.default_rng(0), {"report_in": "matched"})
    scans = []
    for k in range(14):
        legs = legs_of(WALKER, 0.3 * (k - 10)) if k >= 10 else []
        scans.append(scan_at(STANDING[0][0], 0.3 * k, 0.05, np.zeros(3), [*POSTS, *legs]))
    frames = list(track_frames(tracker, rig, scans))
    assert [len(frame.tracks) for frame in frames] == [0] * 10 + [1] * 4


@pytest.mark.parametrize(("aside", "ids"), [(1.5, {1}), (3.0, {1, 2})], ids=["within reach", "too far"])
def test_who_comes_out_of_hiding_within_reach_is_the_same_person(aside, ids):
    scans = []
    for k in range(40):
        person = (0.5, 1.2, 0.3, -0.6) if k < 15 else (0.5 + aside, 1.2, 0.3, -0.6)
        legs = [] if 15 <= k < 25 else legs_of(person, 0.1 * k)
        scans.append(scan_at(STANDING[0][0], 0.1 * k, 0.05, np.zeros(3), [*POSTS, *legs]))
    rig = rig_at(STANDING[0][0])
    tracker = make_tracker("laser-legs", rig, (), np.random.default_rng(0), {"report_in": "matched"})
    frames = list(track_frames(tracker, rig, scans))
    assert {track.id for frame in frames for track in frame.tracks} == ids
    assert any(frame.tracks for frame in frames[-10:])


@pytest.mark.parametrize("report_in", ["rig", "sensor"])
def test_reports_are_about_the_scanner_where_the_rig_says_that_it_stands_or_options_ask_for_it(report_in):
    path, motions = drive()
    frames, tracker = tracked(path, motions, [WALKER], report_in=report_in)
    start = path[0] if report_in == "rig" else np.zeros(3)

    def about_the_scanner(k, place):
        return placed(start, placed(between(path[k], np.zeros(3)), np.asarray(place)))

    assert misses(frames, WALKER, about_the_scanner) <= 3
    assert report_frame(tracker) == {"rig": None, "sensor": "scan"}[report_in]


@pytest.mark.parametrize("stands_upright", [True, False], ids=["clockwise", "upside down"])
def test_a_clockwise_scanner_that_drives_places_each_beam_at_its_own_time(stands_upright):
    path, motions = (each[:30] for each in drive())
    x, y, yaw = path[0]
    scans = []
    for k, (pose, motion) in enumerate(zip(path, motions, strict=True)):
        scans.append(scan_at(pose, 0.1 * k, 0.09, motion, [*POSTS, *legs_of(WALKER, 0.1 * k)]))
    tracks = {}
    for side in (1, -1):  # the room, and as in a mirror
        roll = 0.0 if side == 1 or stands_upright else np.pi
        pose = Pose(xyz=(x, side * y, 0.3), rpy=(roll, 0, side * yaw))
        rig = Rig(sensors={"scan": LaserSensor(topic="/scan", room_from_sensor=pose)})
        turn = side if stands_upright else 1
        told = [
            replace(each, angle_min_rad=turn * each.angle_min_rad, angle_increment_rad=turn * each.angle_increment_rad)
            for each in scans
        ]
        tracker = make_tracker("laser-legs", rig, (), np.random.default_rng(0), {"report_in": "matched"})
        frames = track_frames(tracker, rig, told)
        tracks[side] = [(frame.stamp_ns, each.id, each.x, side * each.y) for frame in frames for each in frame.tracks]
    assert len(tracks[1]) > 10
    np.testing.assert_allclose(tracks[1], tracks[-1], atol=1e-6)


def test_legs_go_two_to_each_person_and_a_stride_apart_at_most():
    people = np.array([[0.0, 0.0], [2.0, 0.0]])
    legs = np.array([[0.0, 0.1], [0.0, -0.15], [0.05, 0.3], [1.5, 0.0], [2.45, 0.0], [5.0, 0.0]])
    owner = assigned(people, np.full(2, 0.1), np.full(2, 0.55), legs, np.array([2.0, 2, 0, 2, 3, 3]))
    np.testing.assert_array_equal(owner, [0, 0, -1, -1, 1, -1])
    assert assigned(people[:0], np.empty(0), np.empty(0), legs, np.zeros(6)).tolist() == [-1] * 6


def test_a_person_not_seen_for_a_while_takes_no_leg_from_one_who_is_known_to_stand_there():
    known, lost = np.array([[0.0, 0.0], [0.5, 0.0]])
    legs = np.array([[0.2, 0.0]])
    spread_m = np.array([0.05, 0.6])
    for order in ([0, 1], [1, 0]):
        people = np.stack([known, lost])[order]
        owner = assigned(people, spread_m[order], 0.55 + spread_m[order], legs, np.array([2.0]))
        assert owner.tolist() == [order.index(0)]
    farther = np.array([[-0.4, 0.0]])  # in reach of a place that is not known well, and of it alone
    assert assigned(lost[None], spread_m[1:], np.array([1.15]), farther, np.array([2.0])).tolist() == [0]
    assert assigned(lost[None], spread_m[:1], np.array([1.15]), farther, np.array([2.0])).tolist() == [-1]


@pytest.mark.parametrize(("evidence", "owner"), [(2.0, 0), (-2.0, -1)])
def test_what_hardly_looks_like_a_leg_must_be_nearer_to_be_one(evidence, owner):
    leg = np.array([[0.45, 0.0]])
    assert assigned(np.zeros((1, 2)), np.array([0.1]), np.array([0.6]), leg, np.array([evidence])).tolist() == [owner]


def test_of_two_clusters_a_person_has_the_one_that_looks_more_like_a_leg():
    clusters = np.array([[0.1, 0.0], [-0.75, 0.0], [0.0, 0.15]])
    owner = assigned(np.zeros((1, 2)), np.array([0.1]), np.array([0.9]), clusters, np.array([-1.5, 2.0, 2.0]))
    np.testing.assert_array_equal(owner, [0, -1, 0])
    owner = assigned(
        np.zeros((1, 2)), np.array([0.1]), np.array([0.9]), clusters[[0, 2, 2]], np.array([-1.9, 2.0, 2.0])
    )
    np.testing.assert_array_equal(owner, [-1, 0, 0])


def test_of_two_tracks_in_one_place_the_likelier_one_is_reported():
    places = np.array([[0.0, 0.0], [0.2, 0.0], [3.0, 0.0], [3.4, 0.0], [6.0, 0.0], [6.1, 0.0]])
    assert likeliest(places, np.array([0.5, 2.0, 1.0, 1.5, 1.0, 1.0]), 0.35).tolist() == [
        False,
        True,
        True,
        True,
        True,
        False,
    ]
    assert likeliest(places[:0], np.empty(0), 0.35).tolist() == []


def matrix_of(pose, pitch: float = 0.0) -> np.ndarray:
    return Pose(xyz=(float(pose[0]), float(pose[1]), 0.0), rpy=(0.0, pitch, float(pose[2]))).matrix


def test_two_robots_tell_of_one_person_in_one_frame():
    paths = [drive()[0], drive(turn=-0.4)[0] + [1.0, 0.0, 0.0]]
    motions = [drive()[1], drive(turn=-0.4)[1]]
    sensors = {}
    for k, path in enumerate(paths):
        x, y, yaw = path[0].tolist()
        sensors[f"base_{k}"] = OdometrySensor(topic=f"/odom_{k}", room_from_sensor=Pose(xyz=(x, y, 0), rpy=(0, 0, yaw)))
        sensors[f"scan_{k}"] = LaserSensor(
            topic=f"/scan_{k}", mounted_on=f"base_{k}", room_from_sensor=Pose(xyz=(0, 0, 0.3))
        )
    rig, fed = Rig(sensors=sensors), []
    for step in range(len(paths[0])):
        for k, path in enumerate(paths):
            t = 0.1 * step + 0.04 * k
            legs = legs_of(WALKER, t)
            odometry = between(path[0], path[step]) * (1.1 - 0.2 * k, 1.0, 1.0)
            scan = scan_at(path[step], t, 0.05, motions[k][step], [*POSTS, *legs])
            fed += [Odometry(f"base_{k}", scan.stamp_ns, matrix_of(odometry)), replace(scan, sensor=f"scan_{k}")]
    tracker = make_tracker("laser-legs", rig, (), np.random.default_rng(0))
    frames = [frame for frame in track_frames(tracker, rig, fed) if frame.stamp_ns % (NS_PER_S // 10) == 0]
    first = compose(paths[0][0], between(paths[0][0], paths[0]) * (1.1, 1.0, 1.0))
    reported = compose(first, inverse(paths[0]))  # by the odometry of the first robot
    assert misses(frames, WALKER, lambda k, place: placed(reported[k], place)) <= 4
    assert max(len(frame.tracks) for frame in frames[20:]) == 1


@pytest.mark.parametrize("sees", [0, 1])
def test_people_whom_one_of_two_low_scanners_sees_are_found_whatever_its_stamps(sees):
    pose = STANDING[0][0]
    rig = Rig(
        sensors={f"scan_{k}": rig_at(pose).sensors["scan"].model_copy(update={"topic": f"/scan_{k}"}) for k in range(2)}
    )
    fed = []
    for step in range(50):
        for k in range(2):
            t = 0.1 * step + 0.04 * k
            legs = legs_of(WALKER, t)
            scan = scan_at(pose, t, 0.05, np.zeros(3), [*POSTS, *(legs if k == sees else [])])
            fed.append(replace(scan, sensor=f"scan_{k}"))
    tracker = make_tracker("laser-legs", rig, (), np.random.default_rng(0), {"report_in": "matched"})
    frames = [frame for frame in track_frames(tracker, rig, fed) if frame.stamp_ns % (NS_PER_S // 10) == 0]
    assert misses(frames, WALKER) <= 3
    assert {track.status for frame in frames[20:30] for track in frame.tracks} == {"confirmed"}


def test_every_option_changes_the_tracks():
    path, motions = (each[:24] for each in drive())
    bumped = path + np.where(np.arange(24) < 12, 0.0, 1.0)[:, None] * (0.5, 0.3, 0.9)  # so that a scan fits badly
    ways = [
        (path, scanned(path, motions, [WALKER, (0.2, 2.2, 0.0, 0.0)])),
        (bumped, scanned(bumped, motions, [WALKER])),
    ]

    def said(**options):
        for way, scans in ways:
            rig = rig_at(way[0])
            tracker = make_tracker("laser-legs", rig, (), np.random.default_rng(0), options)
            yield from map(repr, track_frames(tracker, rig, scans))

    usual = list(said())

    def has_effect(path, value) -> bool:
        far = [0.001 * value, 0.97, 3 * value + 0.3, 60.0] if isinstance(value, float) else []
        for other in {str: ["matched", "sensor"], int: [1, 40], float: far}[type(value)]:
            *above, name = path.split(".")
            given = {name: other}
            for each in reversed(above):
                given = {each: given}
            try:
                if any(one != another for one, another in zip_longest(said(**given), usual)):
                    return True
            except InputError:
                continue
        return False

    elsewhere = "track_management."  # in test_option_effects.py
    tried = {path: value for path, value in leaves_of(LaserLegsOptions()) if not path.startswith(elsewhere)}
    assert [path for path, value in tried.items() if not has_effect(path, value)] == []
