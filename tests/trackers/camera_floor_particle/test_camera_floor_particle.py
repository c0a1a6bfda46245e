"""The tracker by cameras and a pressure floor: who is followed, and what it lives through."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from synthetic_home import LOAD, PERIOD_S, empty_room, observe, rig, walks

from trackers.area import Area, Pose
from trackers.camera_floor_particle.body_filter import PAN_BINS, BodyFilter, excluded, smoothed
from trackers.camera_floor_particle.initiation import hull_over
from trackers.camera_floor_particle.options import (
    CameraFloorParticleOptions,
    ExclusionOptions,
    FacingOptions,
    MotionOptions,
)
from trackers.camera_floor_particle.pan import (
    GRID,
    HeadViews,
    Sights,
    learned,
    looks,
    pan_bin,
    turned,
    unit,
    walk as walk_of,
)
from trackers.errors import InputError
from trackers.feeding import track_frames
from trackers.filters.circular import diffused, drawn
from trackers.filters.particle import Cloud
from trackers.likelihood.floor import FloorClusterOptions, FloorFrontEnd, FloorLikelihoodOptions
from trackers.observations import NS_PER_S, FloorFrame, Image
from trackers.presets import make_tracker
from trackers.rig import placed_camera
from trackers.tracks import TrackFrame, warnings
from trackers.vision.foreground import shows_floor
from trackers.vision.front_end import FrontEndOptions, front_ends
from trackers.vision.views import CameraViews, padded_roots

RIG, ROOM = rig(), empty_room(rig())
WALK = walks(3, 40)
SEEN = observe(RIG, WALK)


def follow(observations=SEEN, on=RIG, room=ROOM, name="camera-floor-particle", **options) -> list[TrackFrame]:
    return list(track_frames(make_tracker(name, on, room, np.random.default_rng(0), options), on, observations))


@cache
def followed() -> list[TrackFrame]:
    """What the tracker as it is makes of the recording as it is."""
    return follow()


def test_the_velocity_keeps_its_share_of_the_last_one():
    before, way = np.array([[1.0, 0.0, 0.0]]), np.array([[0.0, 0.1, 0.0]])
    assert smoothed(before, way, 0.1, MotionOptions(memory=0.0)) == pytest.approx(np.array([[0.0, 1.0, 0.0]]))
    motion = MotionOptions(memory=0.8)
    assert smoothed(before, way, 0.05, motion) == pytest.approx(np.array([[0.8, 0.4, 0.0]]))
    # as long a way in two steps, or in one of twice the time, leaves as much of what was before
    halfway = smoothed(before, way / 2, 0.05, motion)
    assert smoothed(halfway, way / 2, 0.05, motion) == pytest.approx(smoothed(before, way, 0.1, motion))


def end_errors(frames, walk=WALK):
    """Distance of each person to the nearest track at the end, and the tracks' numbers [m]."""
    last = np.array([[track.x, track.y] for track in frames[-1].tracks]).reshape(-1, 2)
    away = np.linalg.norm(walk[len(frames) - 1][:, None] - last, axis=-1)
    return away.min(axis=1, initial=9.0), [frames[-1].tracks[k].id for k in away.argmin(axis=1)] if len(last) else []


def changed(kind, change, from_s=0.0, sensors=None):
    """The recording with observations of a kind changed from a time on; None takes one away."""
    found = []
    for each in SEEN:
        due = isinstance(each, kind) and each.t >= from_s and (sensors is None or each.sensor in sensors)
        each = change(each) if due else each
        found += [] if each is None else [each]
    return found


def black(image):
    return replace(image, rgb=np.zeros_like(image.rgb))


def floor_of(values):
    return lambda frame: replace(frame, values=np.full_like(frame.values, values))


def test_three_people_keep_their_numbers_and_heads_are_on_top():
    frames = followed()
    errors, ids = end_errors(frames)
    assert (errors < 0.15).all() and sorted(ids) == [1, 2, 3]
    began = {track.id: (track.x, track.y) for frame in frames for track in reversed(frame.tracks)}
    assert len(began) == 3
    for track in frames[-1].tracks:
        assert 1.4 < track.head_z < 1.8 and 0.6 < track.z < 1.3
        assert np.hypot(track.head_x - track.x, track.head_y - track.y) < 0.2


@pytest.mark.sample(5)
@pytest.mark.parametrize(
    ("what", "spoiled"),
    [
        ("a black camera", changed(Image, black, 1.0, ["camera_1"])),
        ("three black cameras", changed(Image, black, 2.0, ["camera_1", "camera_2", "camera_3"])),
        ("a silent camera", changed(Image, lambda _: None, 1.0, ["camera_2"])),
        (
            "a late camera",
            changed(Image, lambda each: replace(each, stamp_ns=each.stamp_ns + NS_PER_S // 50), 1.0, ["camera_2"]),
        ),
        ("less light", changed(Image, lambda each: replace(each, rgb=(each.rgb * 0.5).astype(np.uint8)), 1.0)),
        ("a floor of zeros", changed(FloorFrame, floor_of(0), 1.5)),
        ("a saturated floor", changed(FloorFrame, floor_of(255), 1.5)),
        ("a silent floor", changed(FloorFrame, lambda _: None, 1.5)),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_people_are_followed_through(what, spoiled):
    frames = follow(spoiled)
    errors, ids = end_errors(frames)
    assert (errors < 0.4).all(), what
    assert sorted(ids) == [1, 2, 3], what


@pytest.mark.parametrize(("what", "value"), [("no person's weight", 0), ("weight almost everywhere", 255)])
def test_a_floor_broken_from_the_start_finds_nobody_and_is_named(what, value):
    tracker = make_tracker("camera-floor-particle", RIG, ROOM, np.random.default_rng(0))
    frames = list(track_frames(tracker, RIG, changed(FloorFrame, floor_of(value))[:60]))
    assert len(frames) > 10 and not any(frame.tracks for frame in frames)
    (said,) = warnings(tracker)
    assert said.startswith(f"floor has borne {what}")
    assert not warnings(tracker_after(SEEN[:60]))


def tracker_after(observations):
    """The tracker when it has seen these."""
    tracker = make_tracker("camera-floor-particle", RIG, ROOM, np.random.default_rng(0))
    list(track_frames(tracker, RIG, observations))
    return tracker


def test_a_floor_that_breaks_later_and_comes_back_goes_on():
    broken = [
        replace(each, values=np.full_like(each.values, 255))
        if isinstance(each, FloorFrame) and 1 < each.t < 2
        else each
        for each in SEEN
    ]
    errors, ids = end_errors(follow(broken))
    assert (errors < 0.3).all() and sorted(ids) == [1, 2, 3]


def test_a_frozen_camera_says_nothing():
    first = {}
    frozen = changed(
        Image, lambda each: replace(first.setdefault(each.sensor, each), stamp_ns=each.stamp_ns), 1.0, ["camera_1"]
    )
    errors, _ = end_errors(follow(frozen))
    assert (errors < 0.3).all()


def test_particles_and_windows_are_told_of_everybody():
    frame = followed()[-1]
    assert [each.id for each in frame.maps] == 2 * [track.id for track in frame.tracks]
    for number, each in enumerate(frame.maps):
        track, is_head = frame.tracks[number % 3], number >= 3
        middle = np.array([track.head_x, track.head_y, track.head_z] if is_head else [track.x, track.y, track.z])
        assert np.abs(each.places.mean(axis=0) - middle).max() < 0.15 and each.window is not None
        for camera in map(placed_camera, RIG.cameras().values()):
            box, (pixel, seen) = each.window(camera), camera.project(middle)
            assert (box is not None) == bool(seen)
            if box is not None:
                np.testing.assert_allclose(np.add(box[:2], np.divide(box[2:], 2)), pixel, atol=1e-6)
                assert box[3] > box[2] > 0


@pytest.mark.parametrize("n_camera", [1, 2, 3])
def test_fewer_cameras_do(n_camera):
    on = rig(n_camera)
    errors, ids = end_errors(follow(observe(on, WALK), on, empty_room(on)))
    assert (errors < 0.45).all() and len(set(ids)) == 3


def test_without_cameras_the_floor_alone_is_followed():
    on = rig(0)
    frames = follow(observe(on, WALK), on, empty_room(on))
    assert (end_errors(frames)[0] < 0.4).all()
    assert all(np.isnan([track.z, track.head_x, track.head_yaw]).all() for track in frames[-1].tracks)


def test_without_a_floor_it_says_what_is_missing():
    with pytest.raises(InputError, match="camera-floor-particle: none of the rig's sensors.*kind floor"):
        follow(on=rig(floor=False))


def test_without_an_empty_room_it_is_learned_and_said():
    tracker = make_tracker("camera-floor-particle", RIG, [], np.random.default_rng(0))
    assert getattr(tracker, "background_learned_causally", False)
    seen = [*observe(RIG, np.empty((10, 0, 2)), 2), *observe(RIG, WALK, start_s=1.0)]
    assert len(follow(seen, room=[])[-1].tracks) >= 3


def test_pictures_of_another_size_are_refused():
    with pytest.raises(InputError, match="rig's intrinsics say"):
        follow(changed(Image, lambda each: replace(each, rgb=each.rgb[::2]), 1.0))


@pytest.mark.parametrize("n_person", [0, 5])
def test_nobody_and_many(n_person):
    walk = walks(n_person, 12)
    frames = follow(observe(RIG, walk))
    assert len(frames[-1].tracks) == n_person


def test_ten_people_are_followed_under_numbers_of_their_own():
    t, k = PERIOD_S * np.arange(20.0)[:, None], np.arange(10)
    x = 0.65 * (k % 5) - 1.3 + 0.1 * np.cos(0.8 * t + k)
    walk: NDArray[np.float64] = np.stack([x, np.broadcast_to(1.3 * (k // 5) - 0.65, x.shape)], axis=-1, dtype=float)
    frames = follow(observe(RIG, walk))
    errors, ids = end_errors(frames, walk)
    assert all(len({track.id for track in frame.tracks}) == len(frame.tracks) for frame in frames)
    followed = errors < 0.25
    assert followed.sum() >= 8 and len(set(np.array(ids)[followed])) == followed.sum()


def test_a_stuck_element_is_nobody_and_hides_nobody():
    def stuck(frame):
        values = frame.values.copy()
        values[1, 16] = LOAD
        return replace(frame, values=values)

    frames = follow(changed(FloorFrame, stuck))
    assert {len(frame.tracks) for frame in frames[4:]} == {3}


@pytest.mark.parametrize(("stuck_s", "n_cluster"), [(1.0, 0), (None, 1)])
def test_a_load_over_which_no_camera_shows_a_person_is_the_floors_own_after_a_while(stuck_s, n_cluster):
    floor = next(iter(RIG.floors().values()))
    values = np.zeros((floor.rows, floor.columns), np.uint8)
    values[2:4, 2:4] = LOAD
    front_end = FloorFrontEnd(floor, [], FloorClusterOptions(), stuck_s=stuck_s)
    found = []
    for ns in range(NS_PER_S, 4 * NS_PER_S, NS_PER_S // 5):
        loads = front_end.loads(FloorFrame("floor", ns, values), ns)
        assert loads is not None
        found.append(len(loads.clusters))
        front_end.learn_own(loads, np.ones(len(loads.clusters), bool), ns)
    assert found[0] == 1 and found[-1] == n_cluster


def test_two_feet_with_an_element_between_start_one_track():
    feet = np.zeros((14, 18), np.uint8)
    feet[7, [7, 9]] = LOAD  # 0.4 m apart
    stands = np.broadcast_to([-0.1, 0.1], (6, 1, 2))
    seen = [replace(each, values=feet) if isinstance(each, FloorFrame) else each for each in observe(RIG, stands)]
    assert [len(frame.tracks) for frame in follow(seen)] == [0, 0, 1, 1, 1, 1]


def test_where_others_fill_the_sight_of_all_cameras_nobody_is_carved():
    about = np.array([(0.9, 0.74), (-0.9, 0.74), (0.9, -0.74), (-0.9, -0.74)])
    tracker = make_tracker("camera-floor-particle", RIG, ROOM, np.random.default_rng(0))
    list(track_frames(tracker, RIG, observe(RIG, np.broadcast_to(about, (5, 4, 2)))))
    state = tracker.debug_state()
    assert state.people is not None and len(state.people) == 4
    assert len(hull_over(np.zeros(2), state.views)[0]) > 0
    hull, maybe = hull_over(np.zeros(2), state.views, state.people)
    assert len(hull) == 0 and maybe
    for k in range(4):  # each of them still is, where the others are known
        others = state.people.select(np.arange(4) != k)
        assert len(hull_over(state.people.place[k, :2], state.views, others)[0]) > 0


def test_heads_are_initiated_where_most_cameras_show_them():
    about = np.array([(-1.2, -0.4), (0.6, -0.4), (-0.15, -1.15)])  # before each other for two cameras
    tracks = follow(observe(RIG, np.broadcast_to(about, (3, 3, 2))))[-1].tracks
    heads = np.array([(track.head_x, track.head_y) for track in tracks])
    off_m = np.linalg.norm(about[:, None] - heads, axis=-1)
    assert len(heads) == 3 and (off_m.min(axis=1) < 0.06).all()


def test_who_comes_back_in_the_same_clothes_has_the_old_number():
    walk = WALK[:, :2]
    alone, both = walk[:, :1], walk
    seen = [*observe(RIG, both[:10]), *observe(RIG, alone[10:25], start_s=1.0), *observe(RIG, both[25:35], start_s=2.5)]
    frames = follow(seen, track_management={"coast_s": 0.5})
    assert len(frames[22].tracks) == 1
    errors, ids = end_errors(frames, walk)
    assert (errors < 0.3).all() and sorted(ids) == [1, 2]
    _, ids = end_errors(follow(seen, track_management={"coast_s": 0.5, "reid_distance": 0.0}), walk)
    assert sorted(ids) == [1, 3]


def test_who_is_felt_in_every_other_frame_waits_for_a_track_as_long_as_the_option_says():
    period_ns = round(PERIOD_S * NS_PER_S)
    flicker = changed(
        FloorFrame, lambda each: each if each.stamp_ns // period_ns % 2 else replace(each, values=0 * each.values)
    )
    patient = follow(flicker[:80], track_management={"tentative_coast_s": 2.5 * PERIOD_S})
    assert any(frame.tracks for frame in patient)
    assert not any(frame.tracks for frame in follow(flicker[:80], track_management={"tentative_coast_s": 0.0}))


def test_the_same_recording_gives_the_same_bits():
    assert repr(follow()[-1]) == repr(followed()[-1])


def test_everybody_dropped_coasts_and_says_so():
    frames = follow(changed(FloorFrame, floor_of(0), 2.0), load={"no_load": "drop", "smoothing_m": 0.0})
    assert {track.status for track in frames[25].tracks} == {"coasting"}


def test_a_body_is_drawn_under_its_head_unless_that_is_held_low():
    tracker = make_tracker("camera-floor-particle", RIG, ROOM, np.random.default_rng(0))
    list(track_frames(tracker, RIG, SEEN[:30]))
    people = tracker.debug_state().people
    people = people.changed(head_velocity=np.zeros_like(people.head_velocity))
    filter_ = BodyFilter(CameraFloorParticleOptions(), None)
    places = np.repeat(people.head_place, 2, axis=0).T
    places[0, 1::2] += 0.1
    of = np.repeat(np.arange(len(people)), 2)
    upright = people.changed(height_m=people.head_place[:, 2])
    bent = people.changed(height_m=people.head_place[:, 2] + 0.6)
    for who, fall in ((upright, 0.5 * (0.1 / 0.06) ** 2), (bent, 0.5 * (0.1 / 0.54) ** 2)):
        under, aside = filter_._under_head(who, 0.05)(places, of).reshape(-1, 2).T
        np.testing.assert_allclose(under - aside, fall, rtol=1e-9)


@settings(max_examples=30, deadline=None)
@given(st.integers(2, 4), st.integers(1, 30), st.integers(0, 2**32 - 1))
def test_exclusion_by_the_grid_is_that_of_all_pairs(n_person, n_particle, seed):
    rng = np.random.default_rng(seed)
    places = rng.integers(0, 60, (2, n_person, n_particle)).astype(float) * 0.02 + 0.01
    options = ExclusionOptions(likelier_stays=False)
    off = np.abs(places[:, :, :, None, None] - places[:, None, None]).max(axis=0)  # (n, p, n, p)
    others = ~np.eye(n_person, dtype=bool)[:, None, :, None]
    expected = ((off < options.side_m + 0.011) & others).any(axis=(2, 3))
    np.testing.assert_array_equal(excluded(places, np.arange(float(n_person)), options), expected)
    ours = excluded(places, np.arange(float(n_person)), ExclusionOptions())
    assert not ours[-1].any() and not (ours & ~expected).any(), "the likeliest keeps all particles"


def test_the_load_over_a_cluster_is_its_share_by_element_or_smoothed():
    floor = RIG.floors()["floor"]
    values = np.zeros((14, 18), np.uint8)
    values[3, 4], values[3, 5] = 100, 50
    centres = floor.centres[3, [4, 5, 9]].T
    paper = FloorLikelihoodOptions(smoothing_m=0.0, no_load="drop")
    loads = FloorFrontEnd(floor, [], FloorClusterOptions(), paper).loads(FloorFrame("floor", 0, values), 0)
    assert loads is not None
    load_n = floor.load_n(values)
    share = np.exp(loads.likelihood.log_likelihood(centres))
    np.testing.assert_allclose(share, [load_n[3, 4] / load_n.sum(), load_n[3, 5] / load_n.sum(), 0.0])
    smoothed = FloorFrontEnd(floor, [], FloorClusterOptions()).loads(FloorFrame("floor", 0, values), 0)
    assert smoothed is not None
    between = smoothed.likelihood.log_likelihood(centres)
    assert between[0] > between[2] > -np.inf


def moved(on, sensor, yaw_deg=0.0, moved_m=(0.0, 0.0, 0.0)):
    """The rig with a sensor believed to be turned about the vertical and moved."""
    camera = on.sensors[sensor]
    pose = camera.room_from_sensor
    yaw = Rotation.from_euler("z", yaw_deg, degrees=True).as_matrix()
    believed = Pose.from_matrix(yaw @ pose.rotation, tuple((pose.translation + moved_m).tolist()))
    return on.model_copy(
        update={"sensors": {**on.sensors, sensor: camera.model_copy(update={"room_from_sensor": believed})}}
    )


@pytest.mark.parametrize(
    ("believed", "doubted"),
    [
        (RIG, []),
        (moved(RIG, "camera_2", yaw_deg=5.0), ["camera_2"]),
        (moved(RIG, "camera_3", moved_m=(0.07, -0.07, 0.0)), ["camera_3"]),
    ],
    ids=["right", "turned", "moved"],
)
def test_a_camera_that_hangs_elsewhere_is_named_while_somebody_walks(believed, doubted):
    walk = walks(1, 70)  # 5 s of it at more than a stroll, by pictures at half the cameras' usual rate
    tracker = make_tracker("camera-floor-particle", believed, ROOM, np.random.default_rng(0))
    list(track_frames(tracker, believed, observe(RIG, walk)))
    assert [each.partition(" shows")[0] for each in warnings(tracker)] == doubted


def test_old_and_broken_frames_say_nothing():
    watch = FloorFrontEnd(RIG.floors()["floor"], [], FloorClusterOptions())
    frame = FloorFrame("floor", 0, np.full((14, 18), 90, np.uint8))
    assert watch.loads(frame, 0) is None and watch.loads(None, 0) is None
    assert watch.loads(replace(frame, values=np.zeros((14, 18), np.uint8)), round(PERIOD_S * 20 * NS_PER_S)) is None


@pytest.mark.parametrize("pixels", ["foreground", "all"])
def test_windows_are_like_references_by_the_bhattacharyya_coefficient(pixels):
    options = CameraFloorParticleOptions.model_validate({"head": {"window": {"pixels": pixels, "stride": 1}}})
    views = CameraViews(front_ends(RIG.cameras(), ROOM, FrontEndOptions())).views(
        {each.sensor: each for each in SEEN[:4]}
    )
    places = np.column_stack([*np.c_[WALK[0], [1.3, 1.3, 1.3]], [0.9, 0.0, 1.2]])
    look = views.look(places)
    at, seen = look.pixels, look.seen
    view, window = views[1], options.head.window
    there = np.flatnonzero(seen[1])
    roots = np.sqrt(np.random.default_rng(0).dirichlet(np.ones(110), 2))
    alike = view.similarity(places[:, there], at[1, there], window, padded_roots(roots), np.arange(len(there)) % 2)
    for place, pixel, root, found in zip(
        places[:, there].T, at[1, there], roots[np.arange(len(there)) % 2], alike, strict=True
    ):
        counts = view.samples(place[:, None], pixel[None], window, window.samples).histograms()[0]
        whole = counts.sum() if pixels == "all" else np.prod(window.samples)
        np.testing.assert_allclose(found, np.sqrt(counts / whole) @ root, rtol=1e-6)
    assert len(there) >= 3 and alike.max() > 0.1


def test_shadows_fall_where_a_camera_sees_the_floor():
    camera = placed_camera(RIG.cameras()["camera_1"])
    area = Area(((-1.8, -1.4), (1.8, -1.4), (1.8, 1.4), (-1.8, 1.4)))
    floor, anywhere = shows_floor(camera, area), shows_floor(camera, None)
    for place, within in (((0.0, 0.0), True), ((1.7, 1.3), True), ((2.6, 1.6), False)):
        (u, v), seen = camera.project(np.array([*place, 0.0]))
        assert seen and floor[round(v), round(u)] == within and anywhere[round(v), round(u)]
    assert not anywhere[0].any() and not (floor & ~anywhere).any(), "the horizon is in the picture"


def test_pans_come_round():
    turn = 2 * np.pi / PAN_BINS
    np.testing.assert_array_equal(pan_bin(np.array([0, turn, -turn, 2 * np.pi])), [0, 1, PAN_BINS - 1, 0])


def test_skin_is_believed_as_far_as_it_is_where_people_walk():
    people = tracker_after(SEEN).debug_state().people
    walking = people.changed(
        course=np.tile([0.0, 1.0], (3, 1)), velocity=np.tile([0.0, 1.0, 0.0], (3, 1)), skin_true=np.ones(3)
    )
    east = np.full(72, 1 / 72)[None].repeat(3, axis=0)
    looks_of = np.arange(3)
    for where, trust in ((np.pi / 2, 1.0), (-np.pi / 2, -1.0), (0.0, 0.0)):
        after = walking.changed(facing=east)
        seen = HeadViews(
            looks_of,
            np.zeros(3),
            np.zeros((3, 1)),
            np.zeros((3, PAN_BINS)),
            np.full(3, 0.4 * np.exp(1j * where)),
            np.zeros(3, np.bool_),
        )
        for _ in range(200):
            after = turned(after, PERIOD_S, 0.1, seen, FacingOptions())
        np.testing.assert_allclose(after.skin_true, trust, atol=0.02)
        np.testing.assert_allclose(np.angle(np.exp(1j * (after.pan - np.pi / 2))), 0, atol=0.1)
    standing = walking.changed(course=np.zeros((3, 2)), velocity=np.zeros((3, 3)), facing=east)
    assert (turned(standing, PERIOD_S, 0.1, seen, FacingOptions()).skin_true == 1).all()


def test_who_turns_is_taken_to_look_ahead_of_their_course():
    people = tracker_after(SEEN).debug_state().people
    people = people.changed(course=np.tile([1.0, 0.0], (3, 1)), velocity=np.tile([1.0, 0.25, 0.0], (3, 1)))
    heading, speed = walk_of(people)
    np.testing.assert_allclose(heading, np.arctan2(0.5, 1.0))
    np.testing.assert_allclose(speed, 1.0)


def test_beliefs_about_the_pan_spread_and_are_drawn_from():
    belief = np.zeros((1, len(GRID)))
    belief[0, 0] = 1.0
    sigma = np.deg2rad(20.0)
    spread = diffused(belief, sigma)[0]
    around = np.arange(-3, 4) * 2 * np.pi
    wrapped = np.exp(-0.5 * ((GRID[:, None] + around) / sigma) ** 2).sum(axis=1)  # the sum itself
    np.testing.assert_allclose(spread, wrapped / wrapped.sum(), atol=1e-9)
    pans = drawn(spread[None], 20_000, np.random.default_rng(0))[0]
    share = np.bincount(np.rint(pans / GRID[1]).astype(int), minlength=len(GRID)) / 20_000
    np.testing.assert_allclose(share, spread, atol=0.01)


def test_a_head_below_its_crown_is_not_learned_from():
    state = tracker_after(SEEN).debug_state()
    people, options = state.people, CameraFloorParticleOptions().head
    sure = np.where(np.arange(len(GRID)) == 0, 1.0, 0.0)[None].repeat(len(people), axis=0)
    people = people.changed(pan_known=np.ones(len(people), np.bool_), facing=sure)
    for below_m, covered in ((0.0, False), (0.25, True)):
        lower = people.changed(head_place=people.head_place - [0.0, 0.0, below_m])
        seen = looks(lower, state.views, Sights.of(lower, state.views), options)
        assert len(seen.rows) >= 3 * len(people) and (seen.covered == covered).mean() > 0.75
        seen = seen._replace(covered=np.full(len(seen.rows), covered))
        assert (learned(lower, seen, 60.0).hair != lower.hair).any() != covered


def test_a_head_that_slid_down_its_person_comes_back_on_top():
    """A head's particles and colours are put upon the chest, as where a person began while sitting; the others stay."""
    later = len(SEEN) // 2
    tracker = tracker_after(SEEN[:later])
    people = tracker.debug_state().people
    assert len(people) == 3
    first = np.arange(3) == 0
    down = np.array([0.0, 0.0, 0.35]) * first[:, None]
    state = people.head.state.copy()
    state[:3] -= down.T[..., None]
    slid = people.changed(head=Cloud(state, people.head.weights), head_place=people.head_place - down)
    views = tracker.debug_state().views
    chest = looks(slid, views, Sights.of(slid, views), CameraFloorParticleOptions().head)
    hair = unit(np.where(first[:, None, None], chest.roots[chest.rows == 0].mean(axis=0), people.hair))
    tracker._people = slid.changed(hair=5 * hair)
    for each in SEEN[later:]:
        tracker.update(each)
    tracker.finish()
    after = tracker.debug_state().people
    assert (np.abs(after.head_place[:, 2] - people.head_place[:, 2]) < 0.12).all()
    assert after.ids.tolist() == people.ids.tolist()
