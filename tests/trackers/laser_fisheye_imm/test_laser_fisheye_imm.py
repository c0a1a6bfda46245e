"""The tracker end to end, in the flat synthetic room."""

import logging
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import two_scanners
from synthetic_room import AREA, empty_room, observe, rig, scan, score, straight_walk, wandering

from trackers.area import Area
from trackers.errors import InputError
from trackers.feeding import track_frames
from trackers.laser.group import scanners_by_role
from trackers.laser_fisheye_imm.detection import Detector
from trackers.laser_fisheye_imm.options import LaserFisheyeImmOptions
from trackers.laser_fisheye_imm.tracker import LaserFisheyeImm
from trackers.observations import NS_PER_S, Image, LaserScan
from trackers.presets import make_tracker
from trackers.rig import LaserSensor, Pose, Rig
from trackers.tracking.synced_frames import SyncedFrame

BACKGROUND = empty_room(np.random.default_rng(99))
CROSSING = straight_walk(
    [(-1.6, 1.0), (1.6, 1.7), (-1.7, 2.7), (-0.3, 2.25), (1.8, 2.5)],
    [(0.75, 0.0), (-0.75, -0.05), (0.6, 0.02), (-0.1, 0.08), (-0.05, -0.15)],
    42,
)


@cache
def crossing_tracked(name="laser-fisheye-imm", seed=7, images=True):
    """What a tracker as it is makes of the five who cross."""
    return tracked(CROSSING, name, observations=observe(CROSSING, seed, images))


def tracked(walk, name="laser-fisheye-imm", on=None, background=BACKGROUND, images=True, observations=None, **options):
    on = on or rig()
    tracker = make_tracker(name, on, background, None, options)
    given = observe(walk, 7, images) if observations is None else observations
    return list(track_frames(tracker, on, given)), tracker


def test_five_people_cross_and_keep_their_ids():
    frames, tracker = crossing_tracked()
    result = score(CROSSING, frames)
    assert len(frames) == len(CROSSING)
    assert result.switches == result.misidentified == 0
    assert result.n_id == 5
    assert result.misses == 0
    assert result.error_m < 0.1
    assert tracker.losses.total() == 0


@pytest.mark.parametrize(("least", "n_before"), [(4, 0), (1000, 1), (None, 1)])
def test_ids_count_from_one_and_whom_few_samples_show_is_not_shown_before_the_second_scan(least, n_before):
    frames, _ = tracked(CROSSING, track_management={"confirm_samples": least})
    first = next(frame for frame in frames if frame.tracks)
    assert first.stamp_ns - frames[0].stamp_ns == n_before * 0.1 * NS_PER_S
    assert {track.id for frame in frames for track in frame.tracks} == {1, 2, 3, 4, 5}


def test_smoothed_output_is_late_begins_earlier_lies_nearer_and_says_so():
    by_two = {"confirm_samples": None}
    at_once, _ = tracked(CROSSING, track_management=by_two)
    smoothed, tracker = tracked(CROSSING, smoothed_s=0.5, track_management=by_two)
    assert [each.stamp_ns for each in smoothed] == [each.stamp_ns for each in at_once]
    assert "leave 0.5 s late, smoothed" in tracker.warnings[0]
    assert len(smoothed[0].tracks) > len(at_once[0].tracks) == 0
    assert score(CROSSING, smoothed).error_m < 0.95 * score(CROSSING, at_once).error_m
    assert {track.id for frame in smoothed for track in frame.tracks} == {1, 2, 3, 4, 5}


@pytest.mark.parametrize(("management", "n_more"), [({}, 0), ({"exists_above": 0.1}, 1), ({"survival_s": None}, 15)])
def test_who_is_gone_in_plain_view_is_not_reported_for_long(management, n_more):
    there, gone = straight_walk([(-1.0, 1.0)], [(0.0, 0.0)], 40), straight_walk([(9.0, 9.0)], [(0.0, 0.0)], 40)
    rng = np.random.default_rng(5)
    given = [
        scan(there if k < 20 else gone, k, height, round((1 + 0.1 * k) * NS_PER_S), rng)
        for k in range(40)
        for height in ("waist", "knee")
    ]
    frames, _ = tracked(there, name="laser-imm", observations=given, track_management=management)
    assert max(k for k, frame in enumerate(frames) if frame.tracks) == 19 + n_more  # `coast_s` at most


def test_velocities_are_the_walkers():
    frames, _ = crossing_tracked()
    errors = []
    for k in range(12, len(CROSSING)):
        for track in frames[k].tracks:
            if track.status == "coasting":
                continue  # its velocity is a guess
            person = np.argmin(np.hypot(*(CROSSING.position[k] - (track.x, track.y)).T))
            truth = (CROSSING.position[k, person] - CROSSING.position[k - 1, person]) / 0.1
            errors.append(np.hypot(track.vx - truth[0], track.vy - truth[1]))
    assert np.median(errors) < 0.15
    assert np.percentile(errors, 95) < 0.45


def test_a_new_track_goes_the_way_its_first_two_measurements_say():
    runners = straight_walk([(-1.6, 1.0), (-1.6, 1.9), (-1.6, 2.7)], [(2.0, 0.0)] * 3, 8)
    frames, _ = tracked(runners)
    k = 1 + next(k for k, frame in enumerate(frames) if frame.tracks)
    assert len(frames[k].tracks) == 3
    assert np.mean([track.vx for track in frames[k].tracks]) > 1.0
    assert np.mean([track.x for track in frames[k].tracks]) == pytest.approx(runners.position[k, 0, 0], abs=0.08)


def test_somebody_hidden_at_both_heights_comes_back_as_who_they_were():
    # one walks behind another who stands close to the scanners, out of sight for a second
    walk = straight_walk([(0.0, 0.8), (-1.3, 2.2)], [(0.0, 0.0), (0.7, 0.0)], 38)
    frames, _ = tracked(walk)
    walker = {track.id for frame in frames for track in frame.tracks if track.y > 1.5}
    assert len(walker) == 1
    assert "coasting" in {track.status for frame in frames for track in frame.tracks if track.y > 1.5}
    assert score(walk, frames).switches == 0


def test_whoever_stops_out_of_sight_is_looked_for_where_nobody_could_see_them():
    # walks in behind somebody and stops there at once, unseen; to walk on would be to come into sight
    walk = straight_walk([(0.0, 1.6), (-1.3, 2.3)], [(0.0, 0.0), (1.2, 0.0)], 24)
    position = walk.position.copy()
    position[11:, 1] = position[11, 1]
    walk = replace(walk, position=position)

    def farthest_off(**waist):
        frames, _ = tracked(walk, layers=("waist",), waist=waist)
        coasting = [
            abs(track.x - position[k, 1, 0])
            for k, frame in enumerate(frames)
            for track in frame.tracks
            if track.y > 2 and track.status == "coasting"
        ]
        assert len(coasting) > 5
        return max(coasting)

    assert farthest_off() < 0.2 < 0.3 < farthest_off(p_detect=0)


def test_nobody_is_outside_the_area():
    detector = Detector(rig(), BACKGROUND, LaserFisheyeImmOptions(), Area(AREA, 0.3))
    inside_outside = np.array([[0.0, 9.0], [1.5, 1.5]])
    assert detector.missed(SyncedFrame(0), inside_outside).tolist() == [1, 0]


def test_knees_help_where_the_waist_is_hidden():
    walk = straight_walk([(0.0, 1.0), (-0.6, 1.9)], [(0.0, 0.0), (0.35, 0.0)], 40)
    with_knees, _ = tracked(walk, name="laser-imm")
    without, _ = tracked(walk, name="laser-imm", layers=("waist",))

    def coasted(frames):
        return sum(track.status == "coasting" for frame in frames for track in frame.tracks)

    assert coasted(with_knees) < coasted(without)


@pytest.mark.parametrize("off_m", [-0.08, 0.08, 0.15])
def test_where_the_waist_is_seen_knees_add_nothing(off_m):
    """Trunk or legs, never both: knees that are seen elsewhere change no bit of who is seen whole, and all of a rig of knees."""
    walk = straight_walk([(-1.2, 1.2)], [(0.6, 0.0)], 40)
    given = observe(walk, 7, images=False)
    off = [
        replace(each, ranges_m=each.ranges_m + np.float32(off_m) * (each.ranges_m < 2.4))
        if each.sensor == "knee"
        else each
        for each in given
    ]
    right, wrong = (tracked(walk, name="laser-imm", observations=each)[0] for each in (given, off))
    assert right == wrong and sum(len(frame.tracks) for frame in right) > 30
    knees = rig(waist=False, camera=False)
    right, wrong = (tracked(walk, name="laser-imm", on=knees, observations=each)[0] for each in (given, off))
    ranges = [
        [np.hypot(track.x, track.y) for frame in frames[10:] for track in frame.tracks] for frames in (right, wrong)
    ]
    assert np.median(ranges[1]) - np.median(ranges[0]) == pytest.approx(off_m, abs=0.03)


def test_colours_keep_apart_whom_positions_confuse():
    """Two meet, hide one another, and go back where they came from: motion alone predicts that they pass."""
    there = straight_walk([(-0.9, 1.6), (0.9, 2.1)], [(0.8, 0.0), (-0.8, 0.0)], 11)
    path = np.concatenate([there.position, there.position[::-1]])
    back = np.where(np.arange(22)[:, None] < 11, there.heading[0], there.heading[0] + np.pi)
    walk = replace(there, position=path, heading=back, phase=np.concatenate([there.phase, there.phase[::-1]]))
    stand = replace(
        walk,
        position=np.concatenate([np.repeat(path[:1], 10, 0), path]),
        heading=np.concatenate([np.repeat(back[:1], 10, 0), back]),
        phase=np.concatenate([np.repeat(walk.phase[:1], 10, 0), walk.phase]),
    )
    frames, _ = tracked(stand)
    assert score(stand, frames).misidentified == 0


@pytest.mark.parametrize("name", ["laser-imm", "laser-kalman", "waist-fisheye-imm", "waist-fisheye-kalman"])
def test_fewer_sensors_degrade_but_do_not_break(name):
    frames, _ = crossing_tracked(name)
    result = score(CROSSING, frames)
    owed = (len(CROSSING) - 10) * 5
    assert result.misses < 0.15 * owed
    assert result.error_m < 0.12


@pytest.mark.parametrize(
    "on", [rig(camera=False), rig(knee=False), rig(waist=False), rig(waist=False, camera=False), rig(roles=False)]
)
def test_rigs_that_lack_something(on):
    walk = straight_walk([(-1.2, 1.2), (1.2, 2.2)], [(0.6, 0.0), (-0.6, 0.0)], 40)
    frames, _ = tracked(walk, on=on, images="camera" in on.sensors)
    result = score(walk, frames)
    assert result.switches == 0
    assert result.misses < 8
    assert len(frames) == len(walk)


def test_without_an_empty_room_the_background_is_learned_and_said_so(caplog):
    walk = straight_walk([(-1.7, 1.2), (1.7, 2.2)], [(0.7, 0.0), (-0.7, 0.0)], 45)
    with caplog.at_level(logging.WARNING):
        frames, tracker = tracked(walk, background=[])
    assert tracker.background_learned_causally
    assert "learned" in caplog.text
    result = score(walk, frames, skip=15)
    assert result.switches == 0
    assert result.misses < 6
    assert not crossing_tracked()[1].background_learned_causally


def test_scanners_without_an_empty_room_are_named_where_others_have_one(caplog):
    lasers = sorted(rig().lasers())
    for lacking in ([], lasers[:1], lasers):
        caplog.clear()
        with caplog.at_level(logging.WARNING):
            make_tracker(
                "laser-fisheye-imm", rig(), [each for each in BACKGROUND if each.sensor not in lacking], None, {}
            )
        assert ("learned" in caplog.text) == bool(lacking)
        assert [each for each in lasers if each in caplog.text] == (lacking if len(lacking) < len(lasers) else [])


@pytest.mark.parametrize("is_open", [True, False])
def test_with_a_learned_background_who_stands_before_the_open_is_a_person_once_they_moved(is_open):
    """A surface at the end of the range returns now and then, so only a step tells; what comes before a wall is somebody."""
    standing = straight_walk([(0.0, 1.5)], [(0.0, 0.0)], 30)
    arriving = [replace(o, stamp_ns=o.stamp_ns + 3 * NS_PER_S) for o in observe(standing, 5, False)]
    given = [*observe(straight_walk(np.empty((0, 2)), np.empty((0, 2)), 30), 4, False), *arriving]
    if is_open:
        far_m = 2.2  # behind whoever stands there
        given = [
            replace(o, ranges_m=np.where(o.ranges_m > far_m, np.inf, o.ranges_m).astype(np.float32)) for o in given
        ]
    tracks = [frame.tracks for frame in tracked(standing, "laser-imm", background=[], observations=given)[0]]
    assert bool(tracks[-1]) != is_open and (not is_open or not any(tracks))
    at_once = tracked(
        standing, "laser-imm", background=[], observations=given, track_management={"confirm_moved_m": 0}
    )[0]
    assert at_once[-1].tracks
    assert tracked(standing, "laser-imm", observations=given)[0][-1].tracks  # the empty room is known


@pytest.mark.parametrize("back_s", [0.0, 0.05, 0.5, 30.0])
def test_time_that_stands_still_or_goes_back_is_dropped_and_counted(back_s):
    given = observe(CROSSING, 1, images=False)
    before, after = given[: len(given) // 2], given[len(given) // 2 :]
    again = [replace(o, stamp_ns=before[-1].stamp_ns - round(back_s * NS_PER_S)) for o in before[-2:]]
    frames, tracker = tracked(CROSSING, "laser-imm", observations=[*before, *again, *after])
    assert tracker.losses.total() == len(again)
    assert frames == crossing_tracked("laser-imm", 1, images=False)[0]


def test_images_that_never_come_delay_but_do_not_stop():
    frames, tracker = tracked(CROSSING, images=False)
    assert len(frames) == len(CROSSING)
    assert score(CROSSING, frames).misses < 30
    assert tracker.losses.total() == 0


def test_a_gap_longer_than_the_coasting_time_ends_everybody_a_shorter_one_nobody():
    walk = straight_walk([(-0.5, 1.2), (0.6, 2.0)], [(0.0, 0.05), (0.0, -0.05)], 40)
    given = observe(walk, 3)

    def shifted(gap_s):
        half = len(given) // 2
        return [*given[:half], *(replace(o, stamp_ns=o.stamp_ns + round(gap_s * NS_PER_S)) for o in given[half:])]

    short = tracked(walk, observations=shifted(1.0))[0]
    assert {track.id for frame in short for track in frame.tracks} == {1, 2}
    long = tracked(walk, observations=shifted(2.0))[0]
    assert {track.id for frame in long for track in frame.tracks} == {1, 2, 3, 4}
    # a robot's clock that is set, and one that started at 1970: as any long gap, and as soon done
    for jump_s in (30 * 86_400, 1_700_000_000):
        jumped = tracked(walk, observations=shifted(jump_s))[0]
        assert len(jumped) == len(long)
        for frame, expected in zip(jumped, long, strict=True):
            assert [(track.id, track.status) for track in frame.tracks] == [(t.id, t.status) for t in expected.tracks]
            for track, other in zip(frame.tracks, expected.tracks, strict=True):
                assert (track.x, track.y) == pytest.approx((other.x, other.y), abs=1e-3)


def hung(observations, sensors, from_s, to_s=np.inf):
    """A recording in which some sensors repeat their last reading under new stamps for a while."""
    last, told = {}, []
    for item in observations:
        if not (item.sensor in sensors and from_s * NS_PER_S <= item.stamp_ns < to_s * NS_PER_S):
            last[item.sensor] = item
        told.append(replace(last[item.sensor], stamp_ns=item.stamp_ns))
    return told


@pytest.mark.parametrize("sensor", ["waist", "knee"])
def test_a_scanner_that_hangs_for_a_second_costs_nobody_their_id(sensor):
    frames, tracker = tracked(CROSSING, observations=hung(observe(CROSSING, 7), {sensor}, 2.5, 3.5))
    result = score(CROSSING, frames)
    assert tracker.losses.total() == 10
    assert result.switches == result.misidentified == 0
    assert result.n_id == 5
    assert result.error_m < 0.1


def test_where_all_scanners_hang_frames_go_on_and_nobody_is_believed_for_longer_than_tracks_coast():
    frames, _ = tracked(CROSSING, observations=hung(observe(CROSSING, 7), {"waist", "knee"}, 2.5))
    assert len(frames) == len(CROSSING)
    assert {track.status for frame in frames[15:] for track in frame.tracks} == {"coasting"}
    assert frames[20].tracks
    assert not any(frame.tracks for frame in frames[31:])


def test_people_outside_the_area_are_not_tracked():
    walk = straight_walk([(0.0, 1.5)], [(0.0, 0.0)], 20)
    elsewhere = rig().model_copy(update={"area": ((1.0, 0.6), (2.0, 0.6), (2.0, 2.8), (1.0, 2.8))})
    frames, _ = tracked(walk, on=elsewhere)
    assert not any(frame.tracks for frame in frames)
    frames, _ = tracked(walk, on=elsewhere.model_copy(update={"area": None}))
    assert frames[-1].tracks


def test_whoever_leaves_the_area_is_not_coasted_on_outside():
    walk = straight_walk([(1.0, 1.5)], [(1.0, 0.0)], 25)
    frames, _ = tracked(walk, on=rig())
    far = max(track.x for frame in frames for track in frame.tracks)
    assert far <= AREA[1][0] + 0.3 + 1e-9
    assert not frames[-1].tracks


def test_a_rig_elsewhere_gives_the_same_room_positions():
    """The room frame is the rig's matter: turning and shifting every sensor turns and shifts the tracks."""
    walk = straight_walk([(-1.2, 1.2), (1.2, 2.2)], [(0.6, 0.0), (-0.6, 0.0)], 30)
    here, _ = tracked(walk, "laser-imm", on=rig(camera=False).model_copy(update={"area": None}))
    sensors = {
        name: sensor.model_copy(update={"room_from_sensor": Pose(xyz=(3.0, 4.0, sensor.room_from_sensor.xyz[2]))})
        for name, sensor in rig(camera=False).sensors.items()
    }
    there, _ = tracked(walk, "laser-imm", on=Rig(sensors=sensors))
    for one, other in zip(here[-1].tracks, there[-1].tracks, strict=True):
        assert (other.x - 3.0, other.y - 4.0) == pytest.approx((one.y, -one.x), abs=1e-6)


def test_the_order_of_people_does_not_matter():
    frames, _ = crossing_tracked("laser-imm")
    permuted, _ = tracked(CROSSING.permuted([3, 1, 4, 0, 2]), "laser-imm")
    assert permuted == frames


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 0.0])
def test_scans_that_show_nothing_track_nobody(value):
    given = [replace(o, ranges_m=np.full_like(o.ranges_m, value)) for o in observe(CROSSING, 1, images=False)]
    for background in (BACKGROUND, []):
        frames, _ = tracked(CROSSING, "laser-imm", observations=given, background=background)
        assert len(frames) == len(CROSSING)
        assert not any(frame.tracks for frame in frames)


def test_hundreds_of_clusters_are_survived():
    rng = np.random.default_rng(0)
    on = rig(camera=False).model_copy(update={"area": None})
    tracker = make_tracker("laser-imm", on)
    frames = []
    for k in range(12):
        for height in ("waist", "knee"):
            ranges = np.repeat(rng.uniform(0.5, 7.0, 400), 8).astype(np.float32)
            ranges[::8] = 7.9
            if k == 0:
                ranges[:] = 7.9
            frames += tracker.update(LaserScan(height, k * NS_PER_S // 10, ranges, -np.pi / 2, np.pi / 3200, 0.02, 8.0))
    assert len(frames) == 12
    assert all(np.isfinite([(track.x, track.y) for track in frame.tracks]).all() for frame in frames)


def test_a_dense_crowd_without_background_stays_finite():
    walk = wandering(10, 40, np.random.default_rng(0), apart_m=0.42)
    frames, _ = tracked(walk, background=[])
    assert all(np.isfinite([(t.x, t.y, t.vx, t.vy) for t in frame.tracks]).all() for frame in frames)


def test_a_rig_without_a_laser_is_refused_with_what_is_needed():
    with pytest.raises(InputError, match="no laser at all.*role"):
        LaserFisheyeImm(rig(waist=False, knee=False))
    with pytest.raises(InputError, match="waist height: knee"):
        LaserFisheyeImm(rig(waist=False, camera=False), layers=("waist",))


def test_a_single_scanner_is_taken_for_what_its_height_says():
    def alone(height_m):
        pose = Pose(xyz=(0, 0, height_m))
        return Rig(sensors={"scan": LaserSensor(topic="/scan", room_from_sensor=pose)})

    for height_m, role in ((0.0, "knee"), (0.3, "knee"), (0.9, "waist")):
        assert scanners_by_role(alone(height_m), ("waist", "knee")) == {role: ("scan",)}
    assert scanners_by_role(alone(0.0), ("waist",)) == {"waist": ("scan",)}


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"appearance": {"wieght": 2}}, "appearance.wieght.*weight"),
        ({"trunk": {"gate": 2}}, "trunk.gate.*gate_m"),
        ({"filter": "particle"}, "filter"),
        ({"layers": ()}, "layers"),
        ({"trunk": {"variance_m2": 0}}, "trunk.variance_m2"),
    ],
)
def test_wrong_options_are_named(options, message):
    with pytest.raises(InputError, match=message):
        LaserFisheyeImm(rig(), **options)


def test_an_image_of_another_size_than_the_rigs_is_refused():
    tracker = LaserFisheyeImm(rig(), BACKGROUND)
    given = observe(CROSSING, 0, images=False)[:2]
    for each in given:
        tracker.update(each)
    with pytest.raises(InputError, match="camera.*intrinsics"):
        tracker.update(Image("camera", given[0].stamp_ns, np.zeros((4, 4, 3), np.uint8)))


def test_waiting_frames_come_with_finish():
    tracker = make_tracker("laser-imm", rig(camera=False), BACKGROUND)
    given = observe(CROSSING, 0, images=False)
    frames = [frame for o in given if o.sensor == "waist" for frame in tracker.update(o)]
    assert len(frames) == len(CROSSING) - 2
    assert len(tracker.finish()) == 2
    assert tracker.finish() == []


def test_a_hidden_track_is_reported_while_its_person_is_probably_within_the_radius():
    # in behind the other, and there for good: where in the shadow nobody can say after a while
    walk = straight_walk([(0.0, 0.8), (-1.3, 2.3)], [(0.0, 0.0), (0.8, 0.0)], 45)
    position = walk.position.copy()
    position[14:, 1] = position[14, 1]
    walk = replace(walk, position=position)

    def n_coasting(within_m: float | None) -> int:
        frames, _ = tracked(walk, layers=("waist",), track_management={"within_m": within_m})
        return sum(track.status == "coasting" for frame in frames for track in frame.tracks if track.y > 1.7)

    counts = [n_coasting(within_m) for within_m in (0.1, 0.3, 0.5, None)]
    assert counts == sorted(counts) and counts[0] < counts[-1]


def test_whoever_is_hidden_for_longer_than_tracks_coast_is_known_again():
    # in behind the other, a second and a half there, and back to where they came from
    walk = straight_walk([(0.0, 0.8), (-1.3, 2.3)], [(0.0, 0.0), (0.8, 0.0)], 45)
    position = walk.position.copy()
    position[14:29, 1] = position[14, 1]
    position[29:, 1] = position[14, 1] - [0.08, 0] * np.arange(16)[:, None]
    walk = replace(walk, position=position)

    def ids(**management):
        frames, _ = tracked(walk, layers=("waist",), track_management=management)
        return {track.id for frame in frames for track in frame.tracks if track.y > 1.7}

    assert len(ids()) == 1
    assert len(ids(survival_s=1.0)) == 2


@pytest.mark.parametrize("rate_hz", [13.0, 23.0, 40.0])
def test_a_faster_scanner_that_sees_only_a_wall_delays_nobody(rate_hz):
    walk = straight_walk([(-0.8, 1.5)], [(0.5, 0.0)], 30)
    empty = [each for each in two_scanners.EMPTY if each.sensor == "front"]
    front = [two_scanners.one_scan(walk, k, 1 + 0.1 * k, False, 3) for k in range(len(walk))]
    wall = replace(front[0], sensor="back", ranges_m=np.full_like(front[0].ranges_m, 0.6))
    noise = np.random.default_rng(5)

    def facing_wall(t_s):
        ranges_m = np.round(wall.ranges_m + noise.normal(0, 0.005, wall.ranges_m.size), 3).astype(np.float32)
        return replace(wall, stamp_ns=round(t_s * NS_PER_S), ranges_m=ranges_m)

    faster = [facing_wall(1.02 + k / rate_hz) for k in range(int(2.9 * rate_hz))]
    both = sorted([*front, *faster], key=lambda each: each.stamp_ns)
    background = [*empty, *(facing_wall(0.1 * k) for k in range(6))]
    alone, _ = tracked(walk, "laser-imm", two_scanners.RIG, background, observations=front)
    together, _ = tracked(walk, "laser-imm", two_scanners.RIG, background, observations=both)
    first_ns = [next(frame.stamp_ns for frame in frames if frame.tracks) for frames in (alone, together)]
    assert first_ns[1] - first_ns[0] <= 0.06 * NS_PER_S  # a scan may join a frame of the other scanner
    assert {track.id for frame in together for track in frame.tracks} == {1}
