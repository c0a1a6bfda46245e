"""The tracker of heads by stereo cameras: ellipses, weights against scalar references, who is followed, what it lives through."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.spatial.transform import Rotation
from synthetic_meeting import HEAD_M, LENS, empty_room, met, observe, rig, walks

from trackers.area import Pose
from trackers.cameras import CameraGroup, Ellipsoids, PlacedCamera
from trackers.environment import Environment
from trackers.errors import InputError
from trackers.feeding import track_frames
from trackers.likelihood.stereo_head import StereoHeadOptions, StereoHeads
from trackers.observations import NS_PER_S, DepthImage
from trackers.presets import PRESETS, make_tracker
from trackers.rgbd_head.calibration import CalibrationCheck, HeadOffsets, is_turned
from trackers.rgbd_head.evaluators import Evaluator
from trackers.rgbd_head.options import RgbdHeadOptions
from trackers.rgbd_head.rules import PAPER
from trackers.rgbd_head.tracker import RgbdHead
from trackers.rig import LaserSensor, Rig, StereoSensor
from trackers.tracks import TrackFrame
from trackers.vision.front_end import CameraFrontEnd, FrontEndOptions
from trackers.vision.head_colours import COLOURS, SHIPPED, HeadColours, colour_numbers, load_head_model
from trackers.vision.head_outlines import cells_shown, inner_points, outlines, ring_points
from trackers.vision.stereo_picture import PackedPicture, StereoCamera

RIG, ROOM = rig(), empty_room(rig())
WALK = walks(3, 25)
SEEN = observe(RIG, WALK)
MODEL = load_head_model()


def camera_and_picture() -> tuple[StereoCamera, PackedPicture]:
    """The first camera, and its picture of the eleventh frame."""
    sensor, image = RIG.sensors["stereo_1"], SEEN[40]
    assert isinstance(sensor, StereoSensor)
    assert isinstance(image, DepthImage)
    camera = StereoCamera(CameraFrontEnd("stereo_1", sensor, ROOM, FrontEndOptions()), sensor, MODEL.skin)
    picture = camera.pack(image)
    assert picture is not None
    return camera, picture


CAMERA = camera_and_picture()[0].camera


def follow(observations=SEEN, on=RIG, room=ROOM, name="rgbd-head", **options) -> list[TrackFrame]:
    return list(track_frames(make_tracker(name, on, room, np.random.default_rng(0), options), on, observations))


@cache
def followed() -> list[TrackFrame]:
    """What the tracker as it is makes of the recording as it is."""
    return follow()


def changed(change, from_s=0.0, sensors=None):
    """The recording with pictures changed from a time on; None takes one away."""
    found = []
    for each in SEEN:
        each = change(each) if each.t >= from_s and (sensors is None or each.sensor in sensors) else each
        found += [] if each is None else [each]
    return found


def end_errors(frames, walk=WALK):
    """How far from each person's head the nearest track's is at the end [m], and where it faces off [rad]."""
    last = np.array([[t.head_x, t.head_y, t.head_z, t.head_yaw] for t in frames[-1].tracks]).reshape(-1, 4)
    people = walk[len(frames) - 1]
    away = np.linalg.norm(people[:, None, :3] - last[:, :3], axis=-1)
    turned = last[away.argmin(axis=1), 3] - people[:, 3] if len(last) else np.full(len(people), np.pi)
    return away.min(axis=1, initial=9.0), np.abs((turned + np.pi) % (2 * np.pi) - np.pi)


heads_somewhere = st.tuples(
    st.floats(-1.5, 1.5), st.floats(-1.2, 1.2), st.floats(0.8, 1.8), st.floats(-np.pi, np.pi)
).map(lambda head: np.array(head)[:, None])


@settings(max_examples=60, deadline=None)
@given(heads_somewhere, st.booleans())
def test_ellipses_are_those_of_exact_projection(head, bent):
    lens = LENS.model_copy(update={"distortion": (-0.1, 0.02, 0.001, -0.001, 0.0)}) if bent else LENS
    camera = PlacedCamera(lens, RIG.sensors["stereo_1"].room_from_sensor)
    ours = outlines(CameraGroup([camera]), head[:, None], HEAD_M)
    exact, _ = camera.ellipses(Ellipsoids.upright(head[:3].T, HEAD_M, head[3]))
    size = np.sqrt(np.linalg.eigvalsh(exact.shape[0])[1])
    axes = np.stack([ours.across[:, 0], ours.down[:, 0]], axis=-1)
    assert np.abs(ours.centre[:, 0] - exact.centre[0]).max() < 0.03 * size
    assert np.abs(axes @ axes.T - exact.shape[0]).max() < 0.06 * size**2


@settings(max_examples=40, deadline=None)
@given(heads_somewhere)
def test_the_surface_is_where_rays_meet_it(head):
    ours, disc = outlines(CameraGroup([CAMERA]), head[:, None], HEAD_M), inner_points(24)
    u, v = ours.pixels(disc)
    rays = CAMERA.rays(np.stack([u[:, 0], v[:, 0]], axis=-1).astype(float))
    exact, _ = met(rays, CAMERA.eye_m, head[:3, 0], HEAD_M, head[3, 0])
    inner = np.hypot(*disc.T) < 0.9  # at the rim rays may miss it
    assert np.abs(exact - ours.range_m - ours.ahead_m(disc)[:, 0])[inner].max() < 0.012


def test_a_camera_before_the_face_sees_face_and_one_behind_sees_hair():
    front = CAMERA.eye_m + np.array([1.5, 1.5, -0.9])
    bearing = np.arctan2(*(CAMERA.eye_m - front)[1::-1])
    shares = MODEL.share[cells_shown(64)]
    looks = outlines(CameraGroup([CAMERA]), np.array([[*front, bearing], [*front, bearing + np.pi]]).T[:, None], HEAD_M)
    towards, away = shares[:, looks.aspects()].mean(axis=0)
    assert towards > 0.4 and away < 0.25


def one_by_one(camera, picture, head, table, options):
    """The two weights of one head, a pixel at a time, as the paper's equations and our rules say it in words."""
    seen_as = outlines(CameraGroup([camera.camera]), head[:, None, None], options.semi_axes_m)
    filled, skin, inside, logs, off, known = 0, 0, 0, 0.0, 0.0, 0
    inner = inner_points(options.points)
    for k, (x, y) in enumerate(inner):
        u, v = seen_as.centre[:, 0] + x * seen_as.across[:, 0] + y * seen_as.down[:, 0]
        column, row = int(np.floor(u + 0.5)), int(np.floor(v + 0.5))
        within = 0 <= column < LENS.width and 0 <= row < LENS.height
        pixel = int(picture.pixels[row, column]) if within else 0
        code = pixel & 0xFFFF
        inside, filled, skin = inside + within, filled + bool(code & 1 << 10), skin + bool(code & 1 << 11)
        if table is not None:
            step = MODEL.share_steps[cells_shown(options.points)[k, seen_as.aspects()[0]]]
            logs += table[step * COLOURS + (code & (COLOURS - 1))]
        away = 1e-3 * (pixel >> 16)
        if away == 0:
            continue
        known += 1
        surface = seen_as.range_m[0] + seen_as.ahead_m(inner)[k, 0]
        if options.depth is not None:
            sigma = options.depth.sigma_m + options.depth.sigma_per_m * seen_as.range_m[0] ** 2
            off += min(abs(away - surface) / sigma, options.depth.most)
        else:
            on_ray = np.array([np.sqrt(seen_as.off_ray_m2(inner)[k, 0]), surface])
            middle = np.array([0.0, seen_as.range_m[0]])
            point = on_ray / np.linalg.norm(on_ray) * away
            far = abs(np.linalg.norm(point - middle) - np.linalg.norm(on_ray - middle))
            most_m = options.depth_in_metres.most_m
            off += far if most_m is None else min(far, most_m)
    n, colour = len(inner), options.skin_share
    if table is not None:
        weight = options.person_colour.power * logs / n
    else:
        expected = float(colour.expected(seen_as.facing)[0])
        weight = np.log(max(colour.linear[0] - colour.linear[1] * abs(skin / inside - expected), 1e-3))
    if options.silhouette is not None:
        shares, above = max(filled / n, options.silhouette.floor), options.silhouette.above
        ring = ring_points(options.silhouette.ring_points, options.silhouette.ring)
        arc = (
            []
            if above is None
            else above * np.array([[np.cos(a), -np.sin(a)] for a in np.radians([56.25, 78.75, 101.25, 123.75])])
        )
        for points in (ring, arc):
            free = 0
            for x, y in points:
                u, v = seen_as.centre[:, 0] + x * seen_as.across[:, 0] + y * seen_as.down[:, 0]
                column, row = int(np.floor(u + 0.5)), int(np.floor(v + 0.5))
                within = 0 <= column < LENS.width and 0 <= row < LENS.height
                free += not (within and picture.pixels[row, column] & 1 << 10)
            if len(points):
                shares *= max(free / len(points), options.silhouette.floor)
        weight += options.silhouette.power * np.log(shares)
    if options.depth is not None:
        return weight, -options.depth.power * off / n
    a, b = options.depth_in_metres.linear
    return weight, np.log(max(a - b * off / known, 1e-3)) if known else 0.0


def test_the_papers_options_are_options_of_the_system():
    RgbdHeadOptions.model_validate(PAPER)


@pytest.mark.parametrize(
    "rules", [{}, {"silhouette": {"above": 2.2}}, PAPER["stereo_head"]], ids=["ours", "fusion", "paper"]
)
def test_weights_are_those_of_one_head_after_another(rules):
    options = StereoHeadOptions(**rules)
    camera, picture = camera_and_picture()
    rng = np.random.default_rng(3)
    heads = WALK[10, np.arange(60) % 3].T + rng.normal(size=(4, 60)) * np.array([[0.1], [0.1], [0.1], [1.0]])
    heads = heads.astype(np.float32)
    table = HeadColours.unknown(1).expected(MODEL.common).tables if options.person_colour is not None else None
    weights = StereoHeads([camera.camera], MODEL, options).log_likelihood([picture], heads[:, None, None], table)[0]
    scalar = [
        one_by_one(camera, picture, head, None if table is None else table[0], options)
        for head in heads.T.astype(float)
    ]
    np.testing.assert_allclose(np.stack([weights.colour, weights.depth], axis=-1), scalar, rtol=3e-4, atol=1e-4)
    assert min(np.ptp(weights.colour), np.ptp(weights.depth)) > 0.2


@pytest.mark.parametrize("by_person", [True, False])
def test_directions_are_weighed_as_hypotheses_that_face_there(by_person):
    rules = {"person_colour": {} if by_person else None, "skin_share": None if by_person else {}}
    round_m = (0.09, 0.09, 0.125)  # whose outline is the same however it is turned
    given = {"points": 64, "semi_axes_m": round_m, "silhouette": None, "depth": None}
    options = StereoHeadOptions.model_validate(given | rules)
    camera, picture = camera_and_picture()
    likelihood, colours = StereoHeads([camera.camera], MODEL, options), HeadColours.unknown(3).expected(MODEL.common)
    heads, turns = WALK[10].T, np.arange(72) * 2 * np.pi / 72
    look = likelihood.close_look([picture], heads[:, None])
    found = likelihood.facing(look, colours.tables if by_person else None)[0]
    # the middle of a step of the angle between nose and camera, as the cells have it
    bearing = np.arctan2(*(CAMERA.eye_m[:2, None] - heads[:2])[::-1])
    step = 2 * np.pi / 72
    middle = bearing - (np.floor(bearing / step) + 0.5) * step
    faces = np.broadcast_to(heads[..., None], (4, 3, 72)).astype(np.float32)
    faces[3] = turns + middle[:, None]
    weights = likelihood.log_likelihood([picture], faces[:, None], colours.tables if by_person else None)[0]
    assert weights.seen.any() and np.ptp(found, axis=1).max() > 0.5
    np.testing.assert_allclose(found, weights.colour.reshape(3, 72), atol=0.02 if by_person else 0.05)


def test_weights_do_not_depend_on_who_else_is_weighed():
    camera, picture = camera_and_picture()
    likelihood = StereoHeads([camera.camera], MODEL, StereoHeadOptions())
    heads = (WALK[10].T[..., None] + np.linspace(-0.1, 0.1, 64)).astype(np.float32)
    tables = HeadColours.unknown(3).expected(MODEL.common).tables
    together = likelihood.log_likelihood([picture], heads[:, None], tables)[0]
    for k in range(3):
        alone = likelihood.log_likelihood([picture], heads[:, None, k : k + 1], tables[k : k + 1])[0]
        assert (alone.colour == together.colour.reshape(3, 64)[k]).all()
        assert (alone.depth == together.depth.reshape(3, 64)[k]).all()


def test_colours_are_learned_as_face_and_as_hair():
    rng = np.random.default_rng(0)
    face, hair = (
        int(colour_numbers(np.full((1, 1, 3), rgb, np.uint8))[0, 0]) for rgb in ((120, 70, 40), (200, 170, 90))
    )
    colours = HeadColours.unknown(1)
    for _ in range(20):
        step = rng.integers(0, 8, 100)
        shown = np.where(rng.random(100) < step / 7, face, hair)
        colours = colours.learned(np.zeros(100, int), step, shown, MODEL.common)
    table = colours.expected(MODEL.common).tables.reshape(8, COLOURS)
    assert table[7, face] > table[0, face] + 1 and table[0, hair] > table[7, hair] + 1


def test_three_heads_are_found_and_followed():
    frames = followed()
    away, turned = end_errors(frames)
    assert (away < 0.06).all() and (turned < 0.7).all()
    assert {track.id for frame in frames[10:] for track in frame.tracks} == {1, 2, 3}
    assert all(len(frame.tracks) == 3 for frame in frames[15:])
    for track in frames[-1].tracks:
        assert (track.x, track.y) == (track.head_x, track.head_y) and np.isnan(track.z)


def test_pictures_are_weighed_at_their_own_stamps():
    walk, seen = walks(1, 16), []
    for k, name in enumerate(RIG.sensors):
        later = walk.copy()  # where everybody is when each camera looks
        later[..., 0] = 0.9 * np.cos(0.6 * (0.2 * np.arange(16)[:, None] + 0.05 * k))
        pictures = observe(Rig(sensors={name: RIG.sensors[name]}), later, seed=k)
        seen += [replace(each, stamp_ns=each.stamp_ns + k * NS_PER_S // 20) for each in pictures]
    seen.sort(key=lambda each: each.stamp_ns)
    errors = [
        np.mean([end_errors(frames[:k], walk)[0] for k in range(8, 16)])
        for frames in (follow(seen, own_stamps=own) for own in (True, False))
    ]
    assert errors[0] < 0.018 < errors[1]


def test_what_is_behind_somebody_by_how_far_distances_may_be_off_is_theirs():
    camera, _ = camera_and_picture()
    evaluator, image = Evaluator(camera, MODEL, StereoHeadOptions()), SEEN[40]
    assert isinstance(image, DepthImage) and evaluator.take(image)
    points = evaluator.unassigned(np.empty((0, 2)), 0.5)
    point = points[:, np.linalg.norm(points[:3].T - CAMERA.eye_m, axis=1).argmax()]
    ahead = (point[:2] - CAMERA.eye_m[:2]) / np.linalg.norm(point[:2] - CAMERA.eye_m[:2])
    aside = np.array([-ahead[1], ahead[0]])

    def is_unassigned(known_m):
        return bool((evaluator.unassigned(known_m[None], 0.5) == point[:, None]).all(axis=0).any())

    assert not is_unassigned(point[:2] - 0.6 * ahead) and not is_unassigned(point[:2] + 0.45 * aside)
    assert is_unassigned(point[:2] - 0.6 * aside) and is_unassigned(point[:2] - 1.5 * ahead)


def test_a_known_start_is_followed_from_there():
    start = [{"place": WALK[0, 1, :3].tolist(), "yaw_deg": float(np.degrees(WALK[0, 1, 3]))}]
    frames = follow(start=start)
    assert [track.id for track in frames[0].tracks] == [1]
    assert end_errors(frames)[0][1] < 0.06 and all(len(frame.tracks) == 1 for frame in frames)


def test_the_same_seed_gives_the_same_tracks_whatever_order_pictures_come_in():
    shuffled = [SEEN[k + j] for k in range(0, len(SEEN), 4) for j in (2, 0, 3, 1)]
    first = followed()  # repr, as NaN is not NaN
    assert repr(first) == repr(follow())
    assert repr(follow(shuffled)) == repr(first)


def depthless(image):
    return replace(image, depth_m=np.zeros_like(image.depth_m))


def black(image):
    return replace(image, rgb=np.zeros_like(image.rgb))


@pytest.mark.parametrize(
    ("what", "spoiled"),
    [
        ("a depth picture of holes", changed(depthless, 1.0, ["stereo_2"])),
        ("no depth at all", changed(depthless, 2.0)),
        ("a blind camera", changed(black, 1.0, ["stereo_1"])),
        ("three blind cameras", changed(black, 3.0, ["stereo_1", "stereo_2", "stereo_3"])),
        ("a camera that is gone", changed(lambda _: None, 1.0, ["stereo_3"])),
        ("a late camera", changed(lambda each: replace(each, stamp_ns=each.stamp_ns + 10**7), 1.0, ["stereo_2"])),
        ("half the light", changed(lambda each: replace(each, rgb=each.rgb // 2), 1.0)),
        ("a frozen camera", changed(lambda each: replace(SEEN[5 * 4 + 1], stamp_ns=each.stamp_ns), 1.0, ["stereo_2"])),
        ("doubled pictures", [each for one in SEEN for each in (one, one)]),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_heads_are_followed_through(what, spoiled):
    away, _ = end_errors(follow(spoiled))
    assert (away < (0.4 if "three" in what else 0.25)).all(), what  # one camera sees no depth well


def test_one_camera_is_enough_to_find_and_follow():
    one = rig(1)
    frames = follow([each for each in SEEN if each.sensor in one.sensors], one, empty_room(one))
    assert (np.sort(end_errors(frames)[0])[:2] < 0.25).all()


def test_nobody_is_nobody_and_who_leaves_is_gone_after_coasting():
    assert all(not frame.tracks for frame in follow(observe(RIG, np.empty((8, 0, 4)))))
    empty = observe(RIG, np.empty((16, 0, 4)), seed=4)
    gone = [replace(each, stamp_ns=each.stamp_ns + 5 * NS_PER_S) for each in empty]
    frames = follow([*SEEN, *gone])
    statuses = {track.status for frame in frames[26:30] for track in frame.tracks}
    assert statuses == {"coasting"} and not frames[-1].tracks


def test_when_a_clock_began_confirms_nobody_earlier():
    limits = {"track_management": {"confirm_hits": 2, "confirm_s": 0.6}}
    later = [replace(each, stamp_ns=each.stamp_ns + 100 * NS_PER_S) for each in SEEN[:80]]
    counts = [[len(frame.tracks) for frame in follow(seen, **limits)] for seen in (SEEN[:80], later)]
    assert counts[0] == counts[1] and counts[0][2] == 0 < counts[0][-1]


def test_without_pictures_of_the_empty_room_the_background_is_learned():
    tracker = make_tracker("rgbd-head", RIG, (), np.random.default_rng(0), {})
    assert tracker.background_learned_causally
    away, _ = end_errors(list(track_frames(tracker, RIG, SEEN)))
    assert (away < 0.3).sum() >= 2


def test_a_head_outside_every_picture_is_nowhere_and_stops_nothing():
    frames = follow(start=[{"place": [9.0, 9.0, 1.5], "yaw_deg": 0}, {"place": WALK[0, 1, :3].tolist(), "yaw_deg": 0}])
    assert {track.id: track.status for track in frames[-1].tracks}[1] == "coasting"
    assert end_errors(frames)[0][1] < 0.06


class Box(Environment):
    """The walls of the synthetic room as a scanner would have them."""

    def agreement(self, points, within_m=0.15) -> float:
        low, high = np.array([-2.5, -2.1, 0.0]), np.array([2.5, 2.1, 2.7])
        return float((np.minimum(np.abs(points - low), np.abs(points - high)).min(axis=1) <= within_m).mean())


@pytest.mark.parametrize(("turn_deg", "named"), [(0.0, False), (1.5, False), (6.0, True), (-6.0, True)])
def test_a_camera_that_hangs_otherwise_than_the_rig_says_is_named(turn_deg, named):
    depth_m = next(each for each in ROOM if each.sensor == "stereo_1").depth_m
    pose = RIG.sensors["stereo_1"].room_from_sensor
    roll, pitch, yaw = pose.rpy
    told = PlacedCamera(LENS, pose.model_copy(update={"rpy": (roll, pitch, yaw + np.radians(turn_deg))}))
    assert is_turned(told, depth_m, object.__new__(Box)) == named


class Elsewhere(Environment):
    """A room of which the camera sees next to nothing that it knows: what fits is chance."""

    def agreement(self, points, within_m=0.15) -> float:
        return 0.25 + 0.04 * float(np.sin(1e3 * points.sum()))


def test_a_camera_that_sees_little_of_the_known_room_is_not_blamed():
    depth_m = next(each for each in ROOM if each.sensor == "stereo_1").depth_m
    poses = [RIG.sensors[name].room_from_sensor for name in RIG.sensors if name.startswith("stereo")]
    cameras = [PlacedCamera(LENS, pose) for pose in poses]
    assert not any(is_turned(camera, depth_m, object.__new__(Elsewhere)) for camera in cameras)


def told_otherwise(sensor: str, turn_deg: float, axis: int, on=RIG, moved_m=(0.0, 0.0, 0.0)) -> Rig:
    """The rig with a camera believed to be turned about an axis of its picture, and moved along its axes."""
    camera = on.sensors[sensor]
    turn, true = Rotation.from_rotvec(np.radians(turn_deg) * np.eye(3)[axis]).as_matrix(), camera.room_from_sensor
    pose = Pose.from_matrix(true.rotation @ turn, tuple((true.xyz + true.rotation @ moved_m).tolist()))
    return Rig(sensors={**on.sensors, sensor: camera.model_copy(update={"room_from_sensor": pose})}, area=on.area)


@pytest.fixture(scope="module")
def longer():
    """Nine seconds, as each camera is looked at in its turn."""
    return observe(RIG, walks(3, 45))


@pytest.mark.sample(4)
@pytest.mark.parametrize(
    ("told", "named"),
    [
        (RIG, []),
        (told_otherwise("stereo_1", 5, 1), ["stereo_1"]),
        (told_otherwise("stereo_3", -5, 0), ["stereo_3"]),
        (told_otherwise("stereo_2", 8, 0), ["stereo_2"]),
        (told_otherwise("stereo_4", 2, 1), []),
        (told_otherwise("stereo_2", 0, 0, moved_m=(0.2, 0.0, 0.0)), ["stereo_2"]),
        (told_otherwise("stereo_4", 0, 0, moved_m=(0.0, -0.2, 0.0)), ["stereo_4"]),
    ],
    ids=["right", "5° aside", "5° down", "8° up", "2° aside", "20 cm aside", "20 cm up"],
)
def test_a_camera_that_shows_heads_elsewhere_is_named(told, named, longer):
    tracker = make_tracker("rgbd-head", told, ROOM, np.random.default_rng(0), {"environment": None})
    list(track_frames(tracker, told, longer))
    assert [each.partition(" shows heads elsewhere")[0] for each in tracker.warnings] == named


def test_a_camera_that_is_named_is_left_out(longer):
    """With a camera that hangs 5° aside tracks are drawn aside from time to time, and without it they are not."""
    told = told_otherwise("stereo_1", 5, 1)
    means = {}
    for leave_out in (False, True):
        given = {"environment": None, "leave_out": leave_out}
        tracker = make_tracker("rgbd-head", told, ROOM, np.random.default_rng(0), given)
        frames = list(track_frames(tracker, told, longer))
        means[leave_out] = np.mean([end_errors(frames[:k], walks(3, 45))[0] for k in range(36, 46)])
        assert ["not used any more" in each for each in tracker.warnings] == [leave_out]
    assert means[True] < 0.025 and means[True] < 0.6 * means[False]


def test_who_is_not_named_changes_nothing(longer):
    first, second = (
        list(track_frames(make_tracker("rgbd-head", RIG, ROOM, options={"leave_out": leave_out}), RIG, longer))
        for leave_out in (False, True)
    )
    assert repr(first) == repr(second)


def test_most_cameras_hang_right():
    names = ["a", "b", "c", "d"]
    assert CalibrationCheck(names, ["b"], True).left_out == {"b"}
    assert not CalibrationCheck(names, ["b"], False).left_out
    both = CalibrationCheck(names, ["b", "c"], True)  # rather the room is another one
    assert not both.left_out and len(both.warnings) == 2
    assert not CalibrationCheck(["a", "b"], ["b"], True).left_out


def test_by_heads_one_camera_after_another_is_doubted_until_half_remain():
    names, eyes = ["a", "b", "c", "d", "e"], 3 * np.array([[1, 0, 1], [0, 1, 1], [-1, 0, 1], [0, -1, 1], [1, 1, 1.0]])
    # each looks at the origin: a head that moves by δ is shown across the line of sight, at its distance
    across = [np.linalg.svd(eye[None])[2][1:] / np.linalg.norm(eye) for eye in eyes]
    doubts = CalibrationCheck(names, [], True)
    for wrong in ("a", "b", "c"):
        for _ in range(40):
            doubts.take(
                {
                    name: HeadOffsets(np.array([[0.1 if name == wrong else 0.0, 0.0]]), seen[None])
                    for name, seen in zip(names, across, strict=True)
                    if name not in doubts.left_out
                },
                np.array([True]),
            )
    assert doubts.left_out == {"a", "b"}
    assert [each.partition(" ")[0] for each in doubts.warnings] == ["a", "b", "c"]
    assert ["not used any more" in each for each in doubts.warnings] == [True, True, False]


def test_of_two_cameras_nobody_can_tell_which_hangs_otherwise():
    both = told_otherwise("stereo_1", 8, 1, rig(2))
    tracker = make_tracker("rgbd-head", both, empty_room(rig(2)), options={"environment": None})
    list(track_frames(tracker, both, [each for each in SEEN if each.sensor in both.sensors]))
    assert not tracker.warnings


def test_what_is_lacking_of_the_room_is_told():
    assert "goes without the room's environment" in make_tracker("rgbd-head", RIG, ROOM).warnings[0]
    assert not make_tracker("rgbd-head-paper-no-environment", RIG, ROOM).warnings
    with pytest.raises(InputError, match="cameras: there is no stereo camera 'left'; valid are stereo_1, stereo_2"):
        make_tracker("rgbd-head", RIG, ROOM, options={"cameras": ["left"]})
    tracker = make_tracker("rgbd-head", RIG, ROOM, options={"cameras": ["stereo_2"]})
    assert tracker.unused_sensors == ["stereo_1", "stereo_3", "stereo_4"]


def test_all_backs_and_hidden_faces_are_followed():
    walk = WALK.copy()
    heads = [
        replace(each, rgb=np.where(is_skin(each.rgb)[..., None], (40, 30, 25), each.rgb).astype(np.uint8))
        for each in observe(RIG, walk)
    ]
    assert (end_errors(follow(heads))[0] < 0.08).all()


def is_skin(rgb):
    hue, saturation, value = cv2.split(cv2.cvtColor(rgb, cv2.COLOR_RGB2HSV))
    return (hue > 5) & (hue < 20) & (saturation > 40) & (value > 150)


def test_bad_input_is_told():
    with pytest.raises(InputError, match=r"none of the rig's sensors \(low\) is a stereo camera"):
        RgbdHead(Rig(sensors={"low": LaserSensor(topic="/scan")}))
    with pytest.raises(InputError, match="image of 'stereo_1' has shape"):
        follow([replace(SEEN[0], rgb=np.zeros((60, 80, 3), np.uint8), depth_m=np.ones((60, 80), np.float32))])
    with pytest.raises(InputError, match="head"):
        make_tracker("rgbd-head", RIG, ROOM, options={"heads": 0})
    with pytest.raises(InputError, match="cannot be read"):
        load_head_model(SHIPPED.with_name("nothing.npz"))


def test_presets_of_the_paper_have_no_rule_of_ours():
    for name in [each for each in PRESETS if each.startswith("rgbd-head-paper")]:
        options = make_tracker(name, RIG, ROOM).options
        assert options.stereo_head.person_colour is options.stereo_head.depth is options.stereo_head.silhouette is None
        assert options.motion.walking == 0 and not options.motion.directions


@pytest.mark.parametrize(
    ("former", "current"),
    [
        ({"weights": {"colour": {"by_person": False}}}, {"stereo_head": {"person_colour": None, "skin_share": {}}}),
        ({"weights": {"colour": {"used": False}}}, {"stereo_head": {"person_colour": None}}),
        ({"weights": {"colour": {"power": 3.0}}}, {"stereo_head": {"person_colour": {"power": 3.0}}}),
        ({"weights": {"depth": {"by_range": False}}}, {"stereo_head": {"depth": None, "depth_in_metres": {}}}),
        ({"weights": {"depth": {"sigma_m": 0.1}}}, {"stereo_head": {"depth": {"sigma_m": 0.1}}}),
        ({"weights": {"silhouette": {"power": 0}}}, {"stereo_head": {"silhouette": None}}),
        ({"weights": {"shadows": "everywhere"}}, {"front_end": {"shadow_region": "everywhere"}}),
        ({"life": {"gone_s": 1.0, "unseen": 0.1}}, {"track_management": {"coast_s": 1.0}, "stereo_head": {"out_of_view": 0.1}}),
        ({"environment": {"used": False}}, {"environment": None}),
    ],
)  # fmt: skip
def test_former_options_are_read_as_today_s(former, current):
    assert RgbdHead(RIG, ROOM, **former).options == RgbdHead(RIG, ROOM, **current).options
