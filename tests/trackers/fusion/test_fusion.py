"""One tracker on any subset of a rig: it follows people by any sensors, and says which one contradicts the rest."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
import synthetic_home
import synthetic_meeting
from synthetic_room import empty_room, observe, rig, straight_walk, wandering

from trackers.check import CORRUPTIONS, check_tracker
from trackers.errors import InputError
from trackers.feeding import track_frames
from trackers.filters.imm import Imm
from trackers.fusion.agreement import Agreement
from trackers.fusion.association import pair
from trackers.fusion.heads import FreePlaces, Heads, gained, sights_of_one, unit_points
from trackers.fusion.look import Look
from trackers.fusion.options import FusionOptions
from trackers.fusion.person_state import HEAD, LEGS, PersonMotion
from trackers.fusion.person_tracks import People
from trackers.fusion.posture import SILHOUETTE_SHOWN, Posture
from trackers.fusion.track_manager import FusionTrackManager
from trackers.observations import NS_PER_S
from trackers.presets import make_tracker
from trackers.rig import Rig
from trackers.vision.head_colours import COLOURS

WALK = straight_walk([(-1.2, 1.2), (1.2, 2.2), (0.0, 2.8)], [(0.5, 0.0), (-0.5, 0.0), (0.0, -0.2)], 24)


@cache
def recording(room: str) -> tuple[Rig, list[Any], list[Any]]:
    """Return a rig, its empty room and what it saw of people who walk."""
    if room == "home":
        on = synthetic_home.rig(2)
        return on, list(synthetic_home.empty_room(on)), synthetic_home.observe(on, synthetic_home.walks(2, 24))
    if room == "meeting":
        on = synthetic_meeting.rig(2)
        return (
            on,
            list(synthetic_meeting.empty_room(on)),
            list(synthetic_meeting.observe(on, synthetic_meeting.walks(2, 12))),
        )
    if room == "crowd":
        crowd = wandering(5, 26, np.random.default_rng(3))
        return rig(), list(empty_room(np.random.default_rng(1))), observe(crowd, 4, images=False)
    return rig(), list(empty_room(np.random.default_rng(1))), observe(WALK, 5)


def subset(room: str, sensors: str) -> tuple[Rig, list[Any], list[Any]]:
    """Return a recording as if the rig had the sensors whose names start so alone."""
    on, empty, seen = recording(room)
    names = [name for name in on.sensors if name.startswith(tuple(sensors.split("+")))]
    some = on.model_copy(update={"sensors": {name: on.sensors[name] for name in names}, "main": None})
    return some, [each for each in empty if each.sensor in names], [each for each in seen if each.sensor in names]


def frames_of(on: Rig, empty: list[Any], seen: list[Any], options: dict[str, Any] | None = None) -> list[Any]:
    """Return the frames of the tracker."""
    return list(track_frames(make_tracker("fusion", on, empty, None, options), on, seen))


@pytest.mark.parametrize(
    ("room", "sensors", "n"),
    [
        ("laser", "waist", 3),
        ("laser", "knee", 3),
        ("laser", "waist+knee", 3),
        ("laser", "waist+knee+camera", 3),
        ("home", "floor", 2),
        ("home", "camera", 2),
        ("home", "camera+floor", 2),
        ("meeting", "stereo", 2),
    ],
)
def test_any_subset_of_a_rig_follows_each_person_by_one_track(room: str, sensors: str, n: int) -> None:
    frames = frames_of(*subset(room, sensors))
    assert {len(frame.tracks) for frame in frames[len(frames) // 2 :]} == {n}
    assert len({track.id for frame in frames[len(frames) // 2 :] for track in frame.tracks}) == n


def test_a_camera_shows_heads_and_scanners_alone_do_not() -> None:
    assert all(np.isfinite(each.head_z) for each in frames_of(*subset("meeting", "stereo"))[-1].tracks)
    assert all(np.isnan(each.head_z) for each in frames_of(*subset("laser", "waist"))[-1].tracks)


@pytest.mark.parametrize(("from_s", "to_s"), [(0.8, 1.6), (-0.1, np.inf), (0.05, np.inf), (0.15, np.inf)])
def test_frames_go_on_at_other_sensors_stamps_while_the_main_one_is_silent(from_s: float, to_s: float) -> None:
    """From the start, or after a scan or two, it is waited for for a second."""
    on, empty, seen = subset("laser", "waist+knee")
    start = seen[0].t
    silent = [each for each in seen if each.sensor == "knee" or not from_s < each.t - start < to_s]
    stamps = np.array([start, *(frame.stamp_ns * 1e-9 for frame in frames_of(on, empty, silent))])
    assert np.diff(stamps[stamps - start > (0.0 if np.isfinite(to_s) else 1.0)]).max() < 0.35
    assert stamps[-1] > seen[-1].t - 0.35


def test_a_camera_that_hangs_elsewhere_is_named() -> None:
    on, empty, _ = recording("laser")
    seen = observe(straight_walk([(-1.2, 1.2), (1.2, 2.2), (0.0, 2.8)], [(0.4, 0.0), (-0.4, 0.0), (0.0, -0.2)], 50), 5)
    pose = on.sensors["camera"].room_from_sensor
    turned = on.sensors["camera"].model_copy(
        update={"room_from_sensor": pose.model_copy(update={"rpy": (pose.rpy[0], pose.rpy[1], pose.rpy[2] + 0.5)})}
    )
    on = on.model_copy(update={"sensors": {**on.sensors, "camera": turned}})
    tracker = make_tracker("fusion", on, empty)
    list(track_frames(tracker, on, seen))
    assert any("camera" in each for each in tracker.warnings)  # pyright: ignore[reportAttributeAccessIssue]


@pytest.mark.parametrize("seed", [4, 5, 6])
def test_a_sensor_whose_errors_stay_alike_on_straight_ways_is_not_named(seed: int) -> None:
    """A camera's place is off by some centimetres for as long as people walk one way, as a delay would make it."""
    on, empty, _ = recording("laser")
    walk = straight_walk([(-1.2, 1.2), (1.2, 2.2)], [(0.4, 0.0), (-0.4, 0.0)], 60)
    tracker = make_tracker("fusion", on, empty)
    list(track_frames(tracker, on, observe(walk, seed)))
    assert tracker.warnings == []  # pyright: ignore[reportAttributeAccessIssue]


def test_a_suspect_source_is_compared_by_what_it_states_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its measurements count less for tracks, and a suspicion does not judge itself by that."""
    sigmas_m: dict[bool, list[float]] = {False: [], True: []}

    class Suspecting(Agreement):
        def take(self, number: int, sigma_m: Any, asked: Any, shown: Any) -> None:
            sigmas_m[bool(self.suspect[number])].extend(sigma_m.tolist())
            super().take(number, sigma_m, asked, shown)

        def found(self) -> list[str]:
            found = super().found()
            self.suspect[1:] = len(sigmas_m[False]) > 40
            return found

    monkeypatch.setattr("trackers.fusion.tracker.Agreement", Suspecting)
    frames_of(*subset("laser", "waist+knee"))
    assert max(sigmas_m[True]) < 1.5 * max(sigmas_m[False])


@pytest.mark.parametrize(("sensors", "tell"), [("knee", False), ("knee+camera", True), ("waist+knee", True)])
def test_legs_tell_of_who_sits_where_something_else_shows_the_person(
    sensors: str, tell: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A place that legs alone have shown is where the legs are, whether the person sits or stands."""
    told, by_legs = [], Posture.by_legs

    def counted(posture: Posture, row: Any, *arguments: Any) -> Posture:
        told.extend(row)
        return by_legs(posture, row, *arguments)

    monkeypatch.setattr(Posture, "by_legs", counted)
    frames_of(*subset("laser", sensors))
    assert bool(told) == tell


def test_a_suspect_floor_tells_no_weights() -> None:
    look = replace(look_of([(0.0, 0.0)]), load_n=np.array([700.0]), starts=np.array([2]))
    suspect = Agreement([["floor"]]).of_suspect(look, 0)
    assert suspect.load_n is None
    assert not suspect.starts.any()
    assert suspect.covariance[0, 0, 0] > look.covariance[0, 0, 0]


def test_who_walks_backwards_has_been_learned_the_wrong_way_round() -> None:
    """Colours of face and hair are forgotten within half a second, and the head faces the way; a walker's ahead stay."""
    heads = Heads.over(3)
    colours = heads.colours.learned(
        np.arange(3), np.zeros(3, np.intp), np.full(3, 5), np.full((2, COLOURS), 1 / COLOURS)
    )
    east, west = (np.exp(8 * np.cos((np.arange(72) + 0.5) * np.pi / 36 - at)) for at in (0.0, np.pi))
    facing = np.array([east, west, west])
    heads = heads.changed(facing=facing / facing.sum(axis=1, keepdims=True), colours=colours)
    velocity = np.array([[1.0, 0.0], [1.0, 0.0], [0.0, 0.0]])  # ahead, backwards, standing
    for _ in range(5):
        heads = heads.turned(0.1, velocity).changed(facing=heads.facing)  # pictures that insist
    assert (heads.colours.hair.sum(axis=1) > 0).tolist() == [True, False, True]
    heads = heads.changed(facing=facing)
    for _ in range(5):
        heads = heads.turned(0.1, velocity)
    np.testing.assert_allclose(heads.direction[0][:2], 0.0, atol=0.1)
    assert abs(heads.direction[0][2]) > 3.0


def test_a_source_that_does_not_show_what_another_one_shows_tells_so_at_any_stamp() -> None:
    """A track that cameras alone show, where a floor would feel a person, is likely to be none: at one stamp as at the next."""
    manager = FusionTrackManager(FusionOptions(), None, Imm(PersonMotion()))
    ns, floor = NS_PER_S, 1
    people = people_at([(0.0, 0.0), (2.0, 0.0), (4.0, 0.0)])
    people = people.changed(
        roster=people.roster.changed(measured_ns=np.array([ns, ns, 0])),
        seen_ns=np.array([[ns, 0], [ns, ns], [0, 0]]),
        existence=np.full(3, 0.9),
    )
    after = manager.contradicted(people, floor, np.full(3, 0.2), ns).existence
    odds = after[0] / (1 - after[0])
    np.testing.assert_allclose(odds, 0.2 * 0.9 / 0.1)  # by what the floor would miss
    assert after[1] == after[2] == 0.9  # shown, or missed by all


@pytest.mark.parametrize("room", ["home", "meeting"])
def test_cameras_and_floors_keep_the_contract_through_some_faults(room: str, monkeypatch: pytest.MonkeyPatch) -> None:
    on, empty, seen = recording(room)
    some = dict(list(CORRUPTIONS.items())[::3])
    monkeypatch.setattr("trackers.check.CORRUPTIONS", some)
    assert check_tracker(lambda *made: make_tracker("fusion", *made), on, seen[: len(seen) // 2], empty) == []


def test_a_rig_on_a_moving_base_alone_is_refused() -> None:
    on, _, _ = subset("laser", "waist")
    moving = on.sensors["waist"].model_copy(update={"mounted_on": "base"})
    with pytest.raises(InputError, match="moving base"):
        make_tracker("fusion", on.model_copy(update={"sensors": {"waist": moving}}))


def test_points_of_the_unit_gaussian_have_its_mean_and_covariance() -> None:
    z = unit_points(96)
    np.testing.assert_allclose(z.mean(axis=0), 0, atol=1e-12)
    np.testing.assert_allclose(z.T @ z / len(z), np.eye(3), atol=1e-12)


def test_a_late_stamp_is_worked_at_its_own_time() -> None:
    """Knees that are stamped 40 ms after the trunks give other tracks than those stamped together, and still one a person."""
    on, empty, seen = subset("laser", "waist+knee")
    later = [replace(each, stamp_ns=each.stamp_ns + 40_000_000) if each.sensor == "knee" else each for each in seen]
    assert len(frames_of(on, empty, later)[-1].tracks) == 3


def test_the_order_of_cameras_does_not_matter() -> None:
    """All cameras of one stamp are associated with the same predictions: tracks differ by rounding, here below 1 µm."""
    on, empty, seen = subset("home", "camera+floor")
    names = [*sorted(on.cameras(), reverse=True), *on.floors()]
    turned = on.model_copy(update={"sensors": {name: on.sensors[name] for name in names}})
    first, second = frames_of(on, empty, seen), frames_of(turned, empty, seen)
    for before, after in zip(first, second, strict=True):
        assert [each.id for each in before.tracks] == [each.id for each in after.tracks]
        for one, other in zip(before.tracks, after.tracks, strict=True):
            x, y = (np.array([of.x, of.y, of.head_x, of.head_y, of.head_z, of.radius95_m]) for of in (one, other))
            np.testing.assert_allclose(x, y, atol=1e-6)


def look_of(positions: list[tuple[float, float]]) -> Look:
    """Return a look that shows people at these places."""
    n = len(positions)
    return Look(
        ("camera",), FusionOptions().camera, np.array(positions), np.tile(0.1**2 * np.eye(2), (n, 1, 1)),
        np.zeros(n, np.intp), np.full(n, -1), lambda points: np.full(points.shape[1:], 0.2), SILHOUETTE_SHOWN,
    )  # fmt: skip


def people_at(places: list[tuple[float, float]]) -> People:
    at = np.array(places)
    people = People.started(Imm(PersonMotion()).start(at, None, 0.3**2), at, 0, 1, 2)
    return people.changed(existence=np.full(len(at), 0.999))


def test_measurements_go_to_tracks_in_one_assignment_and_none_is_shared() -> None:
    """Each of two people has the measurement that leaves the other one theirs, though one is nearest to both."""
    people = people_at([(0.0, 0.0), (0.8, 0.0)])
    for positions, paired in (
        ([(0.5, 0.0), (1.3, 0.0)], {0: 0, 1: 1}),
        ([(0.7, 0.0)], {1: 0}),
        ([(0.0, 3.0)], {}),
    ):
        found = pair(people, look_of(positions), np.full(2, 0.2), np.zeros(2, np.bool_))
        assert dict(zip(found.row.tolist(), found.column.tolist(), strict=True)) == paired


def test_a_head_moves_its_body_in_the_share_of_their_variances() -> None:
    """A body's place is known to 10 cm and the offset of its head to 5 cm: a head 5 cm to the side is 4 cm of body's."""
    imm = Imm(PersonMotion())
    state = imm.start(np.zeros((1, 2)), None, 0.1**2)
    head = np.array([[0.05, 0.0, 1.55]])
    people = People.started(imm.update(state, np.array([0]), head, 1e-9 * np.eye(3)[None], HEAD), head[:, :2], 0, 1, 1)
    np.testing.assert_allclose(people.positions, [[0.04, 0.0]], atol=1e-6)
    np.testing.assert_allclose(people.head, head, atol=1e-6)


@pytest.mark.parametrize("sigma_m", [0.03, 0.1, 0.3, 1.0])
def test_the_place_of_one_head_is_no_others_the_surer_the_less(sigma_m: float) -> None:
    expected = np.array([[0.0, 0.0, 1.7], [1.0, 0.0, 1.6], [1.2, 0.2, 1.7]])
    covariance = np.stack([np.eye(3) * each**2 for each in (0.5, sigma_m, sigma_m)])
    sought, others = np.array([0]), np.array([0, 1])  # of the third head nothing is asked
    places = np.stack([[[x, 0.0, z] for x in (-2.0, 0.0, 1.0, 4.0)] for z in (1.6, 1.7)]).reshape(1, 8, 3)
    free = np.exp(FreePlaces.of(sought, others, expected, covariance).log(places)).reshape(2, 4)
    np.testing.assert_array_equal(free[0], free[1])  # whatever the height: nobody stands on another
    assert 1e-3 <= free[0, 2] == free.min() and free[0, 2] == pytest.approx(
        sigma_m**2 / (sigma_m**2 + 0.09**2), abs=1e-3
    )
    assert free[0, [0, 3]] == pytest.approx(1.0, abs=1e-2)
    surer = np.exp(FreePlaces.of(sought, others, expected, covariance / 4).log(places)).reshape(2, 4)
    assert surer[0, 2] < free[0, 2]
    np.testing.assert_array_equal(
        FreePlaces.of(sought, sought, expected, covariance).log(places), 0.0
    )  # nobody is in their own way


def test_a_camera_without_distances_that_shows_a_head_alone_leaves_its_range_open() -> None:
    eyes_m, flat = np.array([(0.0, 0.0, 1.5), (0.0, 4.0, 1.5), (4.0, 0.0, 1.5)]), np.array([True, True, False])
    showing = np.array([[True, True, False], [False, True, False], [False, False, True]])
    found = sights_of_one(showing, np.tile([2.0, 0.0, 1.5], (3, 1)), eyes_m, flat)
    np.testing.assert_allclose(found, [[1.0, 0, 0], [0, 0, 0], [0, 0, 0]])


def test_loads_are_where_a_standing_person_is_and_teach_where_a_sitting_persons_feet_are() -> None:
    """A head over the pelvis and feet 40 cm before it, 6 s long: who stands is between them, who sits under the head."""
    imm, head, options = Imm(PersonMotion()), np.array([[0.0, 0.0, 1.25]]), FusionOptions().head
    place, legs = {}, {}
    for posture, p in {"stands": (1.0, 0, 0), "sits": (0.0, 1, 0)}.items():
        people = People.started(imm.start(np.zeros((1, 2)), None, 0.1**2), np.zeros((1, 2)), 0, 1, 1)
        people = people.changed(posture=people.posture.changed(probability=np.array([p])))
        for _ in range(60):
            people = people.in_state(imm.predict(people.state, 0.1)).with_parts_later(0.1, options)
            state = imm.update(people.state, np.array([0]), np.array([[0.4, 0.0]]), 0.1**2 * np.eye(2)[None], LEGS)
            people = people.in_state(imm.update(state, np.array([0]), head, 0.05**2 * np.eye(3)[None], HEAD))
        place[posture], legs[posture] = people.positions[0, 0], people.legs[0, 0]
    assert 0.1 <= place["stands"] < 0.3 and abs(legs["stands"]) < 0.1
    assert 0.0 <= place["sits"] < 0.06 and abs(place["sits"] + legs["sits"] - 0.4) < 0.1


def test_a_stature_is_known_while_pictures_that_should_show_the_head_do() -> None:
    """Of walkers, pictures show the first at last, cannot show the second, and should show the third; who stands may sit down."""
    at, velocity = np.array([(0.0, 0.0), (2.0, 0.0), (4.0, 0.0), (6.0, 0.0)]), np.zeros((4, 2))
    velocity[:3, 0] = 1.0
    people = People.started(Imm(PersonMotion()).start(at, velocity, 0.3**2), at, 0, 1, 2)
    people = people.changed(stature_m=np.array([1.5, 1.6, 1.7, 1.8]))
    for ns in range(0, 2_000_000_000, 100_000_000):
        shown = np.array([ns % 1_000_000_000 == 0, True, False, False])
        people = people.with_heads(people.heads, np.array([True, False, True, True]) & ~shown, ns)
    assert np.isnan(people.stature_m).tolist() == [False, False, True, False]
    assert people.stature_m2[2] > people.stature_m2[[0, 1, 3]].max()


def test_a_measurement_is_what_makes_the_prior_the_posterior_and_none_where_hardly_anything_was_learned() -> None:
    """Along an axis whose variance hardly sinks, a shift of the mean is an error of the sums, and no measurement far away."""
    prior, shift = np.diag([0.01, 0.02, 0.04])[None], np.array([[0.05, 0.05, 0.0]])
    place, R = gained(np.zeros((1, 3)), prior, shift, np.diag([0.0099, 0.005, 0.04])[None])
    gain = prior @ np.linalg.inv(prior + R)
    assert (gain @ place[..., None])[0, :, 0] == pytest.approx([0.0, 0.05, 0.0], abs=1e-3)
    assert np.diagonal((np.eye(3) - gain) @ prior, axis1=1, axis2=2)[0] == pytest.approx([0.01, 0.005, 0.04], rel=0.02)
