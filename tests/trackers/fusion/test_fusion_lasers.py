"""Scanners in `fusion`: who is a person at the first look, legs before their feet, and tracks that leave the area."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import two_scanners
from scipy.stats import multivariate_normal
from synthetic_room import Walk, empty_room, observe, rig, straight_walk

from trackers.arrays import Array
from trackers.filters.imm import Imm
from trackers.fusion.association import log_density, pair
from trackers.fusion.look import NEW, Expected, Look
from trackers.fusion.options import FusionOptions
from trackers.fusion.person_state import LEGS, PersonMotion, seen, with_legs_free
from trackers.fusion.person_tracks import People
from trackers.fusion.posture import LEGS_SHOWN, SILHOUETTE_SHOWN
from trackers.fusion.scanner_sources import scanners_of
from trackers.fusion.track_manager import FusionTrackManager
from trackers.observations import NS_PER_S, LaserScan
from trackers.presets import make_tracker
from trackers.tracking.roster import NEVER_NS

WALK = straight_walk([(-1.2, 1.2), (1.2, 2.2), (0.0, 2.8)], [(0.5, 0.0), (-0.5, 0.0), (0.0, -0.2)], 24)
EMPTY = list(empty_room(np.random.default_rng(1)))


@pytest.mark.parametrize("role", ["waist", "knee"])
def test_a_first_look_shows_people_before_a_wall_and_before_the_open_where_the_empty_room_is_known(role: str) -> None:
    on = rig(waist=role == "waist", knee=role == "knee", camera=False)
    scans = [each for each in observe(WALK, 5, images=False) if each.sensor == role]
    waited_ns, far_m = {}, 3.2  # beyond the people
    opened = [replace(each, ranges_m=np.where(each.ranges_m > far_m, np.inf, each.ranges_m)) for each in scans]
    for knows, before, given in (("knows", EMPTY, opened), ("learns", [], scans), ("learns the open", [], opened)):
        tracker = make_tracker("fusion", on, before)
        detected_ns, frames = [], []
        for scan in given:
            frames += tracker.update(scan)
            detected_ns += [each.stamp_ns for each in tracker.detections()]
        waited_ns[knows] = next(each.stamp_ns for each in frames if each.tracks) - detected_ns[0]
    assert waited_ns["knows"] == 0 < waited_ns["learns the open"] >= waited_ns["learns"]


@pytest.mark.parametrize("late_s", [0.0, 0.03, 0.05])
def test_scans_up_to_half_a_period_apart_are_one_look(late_s: float) -> None:
    """Two scanners that face each other show the legs of a person from both sides: each leg is one measurement, by both."""
    tracker = make_tracker("fusion", two_scanners.RIG, two_scanners.EMPTY)
    scans = two_scanners.observed(straight_walk([(0.3, 1.2)], [(0.0, 0.5)], 12), late_s)
    shown = []
    for scan in scans:
        tracker.update(scan)
        shown += tracker.detections()
    later = [each for each in shown if each.stamp_ns > 1.4 * NS_PER_S]
    assert later and all(len(each.sensors) == 2 for each in later)


def standing(place: Array, by_trunk: Array | None = None) -> Expected:
    """Expect people who stand at these places."""
    n = len(place)
    no = np.zeros(n, np.bool_)
    shown = no if by_trunk is None else by_trunk
    nothing = np.zeros((n, 2))
    head = np.pad(place, ((0, 0), (0, 1)))
    return Expected(place, head, nothing, np.zeros(n), nothing, shown, np.full(n, np.nan), no, ~no)


def look_at_legs(walk: Walk, facing: Array, speed_m_s: float, expected_at: Array | None = None) -> Look:
    on, scans = rig(waist=False, camera=False), observe(walk, 5, images=False)
    scanners = scanners_of(on, EMPTY, FusionOptions(), None)[0]
    place = walk.position[0] if expected_at is None else expected_at
    n = len(place)
    expected = replace(
        standing(place),
        head=np.column_stack([place, np.full(n, 1.55)]),
        speed_m_s=np.full(n, speed_m_s),
        facing=np.tile(facing, (n, 1)),
    )
    knee = next(each for each in scans if isinstance(each, LaserScan) and each.sensor == "knee")
    look = scanners.look({"knee": knee}, expected, knee.stamp_ns)
    assert look is not None
    return look


def test_knees_are_before_the_feet_on_the_way_of_a_walker() -> None:
    """At 45 cm the shanks of a walker lean 8 cm ahead; whose way is not known is where the legs are."""
    walk = straight_walk([(0.0, 1.5)], [(1.0, 0.0)], 2)
    feet = look_at_legs(walk, np.array([1.0, 0.0]), 1.0).position
    knees = look_at_legs(walk, np.zeros(2), 1.0).position
    np.testing.assert_allclose(knees - feet, [[0.08, 0.0]], atol=0.01)
    stands = look_at_legs(walk, np.array([1.0, 0.0]), 0.0).position
    assert 0 < (knees - stands)[0, 0] < 0.05


def test_the_leg_that_a_single_one_hides_is_behind_it() -> None:
    """Two legs in line with the scanner: it shows the nearer one alone, and the middle of both is farther away than its axis."""
    hides = replace(straight_walk([(0.0, 1.5)], [(1.0, 0.0)], 2), phase=np.zeros((2, 1)))
    shown = look_at_legs(hides, np.zeros(2), 0.0)
    (x, y), (near,) = shown.position[0], shown.shown
    assert len(shown.position) == 1 and near.y < 1.45
    assert np.hypot(x, y) - np.hypot(near.x, near.y) == pytest.approx(0.045, abs=0.005)


def people_at(*places: tuple[float, float]) -> People:
    at = np.array(places)
    people = People.started(Imm(PersonMotion()).start(at, None, 0.1**2), at, 0, 1, 1)
    return people.changed(existence=np.full(len(at), 0.99))


def test_nobody_begins_within_reach_of_who_rests() -> None:
    """Legs and arms of who lies are up to seven tenths of the stature from the place, or from the seat.

    A measurement that errs along the line from there may be of them too; one that errs across it is not.
    """
    manager = FusionTrackManager(FusionOptions(), None, Imm(PersonMotion()))
    people = people_at((0.0, 0.0), (10.0, 0.0), (20.0, 0.0))
    posture = people.posture.changed(
        probability=np.array([[0.0, 0.1, 0.9], [0.0, 0.1, 0.9], [0.9, 0.1, 0.0]]),
        seat=np.array([[0.5, 0.0], [np.nan, np.nan], [np.nan, np.nan]]),
    )
    people = people.changed(
        roster=people.roster.changed(confirmed=np.ones(3, np.bool_)),
        posture=posture,
        stature_m=np.array([1.8, 1.2, 1.8]),
    )
    at = np.array([[-1.2, 0.0], [-1.3, 0.0], [1.7, 0.0], [1.8, 0.0], [10.8, 0.0], [10.9, 0.0], [20.3, 0.0]])
    exact, along, across = (np.tile(np.diag(each), (len(at), 1, 1)) for each in ([0.0, 0.0], [0.01, 0.0], [0.0, 0.01]))
    assert manager.clear_of_seats(people, at, exact).tolist() == [False, True, False, True, False, True, True]
    assert manager.clear_of_seats(people, at, along).tolist() == [False] * 6 + [True]
    assert (manager.clear_of_seats(people, at, across) == manager.clear_of_seats(people, at, exact)).all()
    nobody = people.select(np.zeros(3, np.bool_))
    assert manager.clear_of_seats(nobody, at, along).all()


def test_nobody_is_outside_the_area() -> None:
    """A look that would show nobody, wherever they are, says nothing of a person inside and ends a track outside."""
    options, imm = FusionOptions(), Imm(PersonMotion())
    manager = FusionTrackManager(options, [(-2, -2), (2, -2), (2, 2), (-2, 2)], imm)
    people = people_at((0.0, 0.0), (3.0, 0.0))
    people = people.changed(roster=replace(people.roster, measured_ns=np.zeros(2, np.int64)))
    nothing = np.empty((0, 2))
    look = Look(
        ("knee",), options.legs, nothing, np.empty((0, 2, 2)), np.empty(0, np.intp), np.empty(0, np.intp),
        lambda points: np.ones(points.shape[1:]), LEGS_SHOWN, is_sharp=True,
    )  # fmt: skip
    after = manager.updated_missed(people, look, 1.0, 0.1, NS_PER_S)
    assert after.existence[0] > 0.98 and after.existence[1] < 0.2


def test_what_may_be_the_legs_of_who_rests_is_not_confirmed_as_another_person() -> None:
    """The track began before the person was known to sit; beside a walker it is another person."""
    manager = FusionTrackManager(FusionOptions(), None, Imm(PersonMotion()))
    for stands, n in ((0.1, 2), (0.9, 3)):
        people = people_at((0.0, 0.0), (0.6, 0.0), (3.0, 0.0))
        roster = people.roster.changed(
            confirmed=np.array([True, False, False]), n_measured=np.full(3, 9), measured_ns=np.full(3, NS_PER_S)
        )
        posture = people.posture.changed(probability=np.tile([stands, 1 - stands, 0.0], (3, 1)))
        after = manager.confirmed(people.changed(roster=roster, posture=posture), NS_PER_S, 0.1)
        assert len(after) == n and after.roster.confirmed.all()


def scan_of(scanner: str, missed: float) -> Look:
    """Return a look of one scanner that shows nobody; missed: how probably it would not show a person, wherever."""
    return Look(
        (scanner,), FusionOptions().legs, np.empty((0, 2)), np.empty((0, 2, 2)), np.empty(0, np.intp), np.empty(0, np.intp),
        lambda points: np.full(points.shape[1:], missed), LEGS_SHOWN, is_sharp=True,
    )  # fmt: skip


def test_who_lies_is_there_while_furniture_hides_them_from_legs_and_floors() -> None:
    """Minutes long, whatever the rate; of who stands there a scanner would show the legs."""
    manager, known = FusionTrackManager(FusionOptions(), None, Imm(PersonMotion())), {}
    for rate_hz in (5, 25):
        people = people_at((0.0, 0.0), (5.0, 0.0))
        people = people.changed(posture=people.posture.changed(probability=np.array([[0, 0.01, 0.99], [1.0, 0, 0]])))
        for k in range(120 * rate_hz):
            seen_ns = round(k * NS_PER_S / rate_hz) + 1
            people = manager.updated_missed(people, scan_of("knee", 0.1), min(1.0, 10 / rate_hz), 1 / rate_hz, seen_ns)
        known[rate_hz] = people.existence
        assert people.existence[0] > 0.5 and people.existence[1] < 0.2
    np.testing.assert_allclose(known[5][0], known[25][0], atol=0.15)


@pytest.mark.parametrize(
    ("scans", "lasts"),
    [
        ([("slow", 0.1)], False),
        ([("slow", 0.9)], False),  # hidden or not: split beams do not come twice
        ([("fast", 0.1)], False),
        ([("fast", 0.9)], True),  # the slow one may still show it
        ([("fast", 0.9), ("slow", 0.9)], False),
    ],
)
def test_a_tentative_track_that_its_scanners_do_not_show_again_ends(
    scans: list[tuple[str, float]], lasts: bool
) -> None:
    manager = FusionTrackManager(FusionOptions(), None, Imm(PersonMotion()))
    people = people_at((0.0, 0.0), (1.0, 0.0), (2.0, 0.0))  # tentative, confirmed, and one that a camera has shown too
    people = people.changed(
        roster=people.roster.changed(confirmed=np.array([False, True, False])),
        seen_ns=np.array([[0, NEVER_NS], [0, NEVER_NS], [0, 0]]),
        seen_at=np.zeros((3, 2, 2)),
    )
    assert len(manager.without_noise(people, {0: scan_of("slow", 0.1)}, 0)) == 3
    for number, (scanner, missed) in enumerate(scans, start=1):
        people = manager.without_noise(people, {0: scan_of(scanner, missed)}, number * NS_PER_S // 25)
    assert people.place[:, 0].tolist() == ([0.0] if lasts else []) + [1.0, 2.0]


def legs_at(x_m: float) -> Look:
    return Look(
        ("knee",), FusionOptions().legs, np.array([[x_m, 0.0]]), np.eye(2)[None] * 0.05**2, np.zeros(1, np.intp),
        np.full(1, -1), lambda points: np.ones(points.shape[1:]), LEGS_SHOWN, is_sharp=True, observes=LEGS,
    )  # fmt: skip


@pytest.mark.parametrize(("x_m", "phase", "is_new"), [(1.0, 0.0, True), (0.75, 0.0, False), (1.0, np.pi / 2, False)])
def test_a_single_leg_out_of_reach_is_nobodys_who_is_known(x_m: float, phase: float, is_new: bool) -> None:
    """Two legs are a person, who may be the hidden one; so may be a leg within a stride of where that one is expected."""
    walk = replace(straight_walk([(0.0, 1.5)], [(1.0, 0.0)], 2), phase=np.full((2, 1), phase))
    look = look_at_legs(walk, np.zeros(2), 0.0, np.array([[x_m, 1.5]]))
    assert (look.owner == NEW).tolist() == [is_new]


def test_what_is_nobodys_who_is_known_begins_a_track_and_moves_no_hidden_one() -> None:
    manager, people = FusionTrackManager(FusionOptions(), None, Imm(PersonMotion())), people_at((0.0, 0.0))
    hidden = people.in_state(replace(people.state, covariance=people.state.covariance * 25))
    for owner, is_hidden_one in ((-1, True), (NEW, False)):
        look = replace(legs_at(0.9), owner=np.full(1, owner), starts=np.ones(1, np.intp))
        found = pair(hidden, look, np.full(1, 0.9), np.zeros(1, np.bool_))
        assert found.row.size == is_hidden_one
        assert len(manager.initiated(hidden, {0: look}, [np.empty(0, np.intp)], NS_PER_S)) == 2 - is_hidden_one


def test_legs_of_who_sits_down_are_theirs_while_the_trunk_is_seen() -> None:
    """Within a second they are half a metre before the trunk; they may be another's where no trunk tells where the person is."""
    people, missed = people_at((0.0, 0.0)), np.full(1, 0.5)
    people = people.in_state(replace(people.state, covariance=people.state.covariance * 0.1))
    for x_m, by_trunk, are_theirs in (
        (0.05, False, True),
        (0.45, True, True),
        (0.45, False, False),
        (2.0, True, False),
    ):
        found = pair(people, legs_at(x_m), missed, np.array([by_trunk]))
        assert found.row.size == are_theirs
        if are_theirs:
            assert found.legs_moved[0] > 0.9 if x_m > 0.4 else found.legs_moved[0] < 0.02
    stands = replace(people.posture, probability=np.array([[0.999, 0.0009, 0.0001]]))
    found = pair(people.changed(posture=stands), legs_at(0.8), np.full(1, 0.9), np.ones(1, np.bool_))
    assert not found.row.size, "legs beside a person who stands, and whose own may be hidden, are another's"
    moved = with_legs_free(people.state, np.zeros(1, np.intp), np.full(1, 0.3**2))
    assert (moved.covariance[7, 7] - people.state.covariance[7, 7] > 0.08).all()
    np.testing.assert_array_equal(moved.covariance[:7, :7], people.state.covariance[:7, :7])


def test_a_density_is_that_of_the_mixture_over_the_modes() -> None:
    """A mode in which a person hardly is lends its width to no measurement: SciPy's densities, each by its probability."""
    people = people_at((0.0, 0.0), (1.0, 0.5))
    rng = np.random.default_rng(3)
    probability = rng.dirichlet(np.ones(len(people.state.probability)), len(people)).T
    covariance = people.state.covariance * (1 + 9 * rng.random(probability.shape))
    state = replace(people.state, probability=probability, covariance=covariance)
    look = legs_at(0.3)
    density, _ = log_density(state, look)
    mean, S = seen(state, look.observes)
    expected = [
        np.log(sum(
            of * multivariate_normal(mean[row, mode], S[row, mode] + look.covariance[0]).pdf(look.position[0])
            for mode, of in enumerate(probability[:, row])
        ))
        for row in range(len(people))
    ]  # fmt: skip
    np.testing.assert_allclose(density[:, 0], expected, rtol=1e-9)


def ahead(scan: LaserScan, range_m: float, half_width_m: float) -> LaserScan:
    """Return a scan with a thing straight ahead."""
    near = np.abs(scan.angles_rad) < half_width_m / range_m
    return replace(scan, ranges_m=np.where(near, range_m, scan.ranges_m))


@pytest.mark.parametrize("hidden", [True, False])
def test_a_single_leg_begins_a_track_where_no_scanner_at_waist_height_would_show_a_trunk(hidden: bool) -> None:
    waists, knees = scanners_of(rig(camera=False), EMPTY, FusionOptions(), None)
    scan = {each.sensor: each for each in EMPTY if isinstance(each, LaserScan)}
    nobody = standing(np.empty((0, 2)))
    waist, knee = scan["waist"], ahead(scan["knee"], 1.5, 0.05)
    if hidden:
        waist = ahead(waist, 0.7, 0.3)
    waists.look({"waist": waist}, nobody, waist.stamp_ns)
    look = knees.look({"knee": knee}, nobody, knee.stamp_ns)
    assert look is not None and len(look.position) == 1
    assert (look.starts[0] > 0) == hidden
    alone = scanners_of(rig(waist=False, camera=False), EMPTY, FusionOptions(), None)[0].look(
        {"knee": knee}, nobody, knee.stamp_ns
    )
    assert alone is not None
    one = np.array([0])
    assert look.evidence_of(one) < alone.evidence_of(one) == 1.0


def test_a_track_begun_by_one_leg_takes_more_hits_than_one_begun_by_a_trunk() -> None:
    of_new, p_detect = FusionTrackManager.existence_of_new, np.full(4, 0.95)
    assert of_new(p_detect[:1], np.ones(1)) == pytest.approx(0.5)
    whole = [of_new(p_detect[:n], np.ones(n)) for n in (1, 2, 3, 4)]
    half = [of_new(p_detect[:n], np.full(n, 0.5)) for n in (1, 2, 3, 4)]
    assert (np.diff(whole) > 0).all() and (np.diff(half) > 0).all() and (np.array(half) < whole).all()
    assert half[1] == pytest.approx(whole[0]) and half[3] == pytest.approx(whole[1])
    assert of_new(np.array([0.999]), np.full(1, 0.5)) > 0.05  # else it would end before the second one
    manager = FusionTrackManager(FusionOptions(), None, Imm(PersonMotion()))
    nobody = people_at((0.0, 0.0)).select(np.zeros(1, np.bool_))
    begun = {}
    for evidence in (1.0, 0.5):
        look = Look(
            ("knee",), FusionOptions().legs, np.array([[0.0, 0.0], [5.0, 5.0]]), np.tile(0.1**2 * np.eye(2), (2, 1, 1)),
            np.array([0, 1]), np.full(2, NEW), lambda points: np.zeros(points.shape[1:]), LEGS_SHOWN,
            is_sharp=True, evidence=np.array([1.0, evidence]),
        )  # fmt: skip
        begun[evidence] = manager.initiated(nobody, {0: look}, [np.empty(0, np.intp)], 0)
        assert len(begun[evidence]) == 1 and begun[evidence].positions[0, 0] == pytest.approx(5.0)
    assert begun[0.5].existence[0] < begun[1.0].existence[0] == pytest.approx(0.5)


def test_one_leg_behind_a_person_is_reported_later_than_a_trunk() -> None:
    """In a known room a trunk is reported from the first scan on, one leg where no trunk would be seen from the third."""
    tracker = make_tracker("fusion", rig(camera=False), EMPTY)
    empty = {each.sensor: each for each in EMPTY if isinstance(each, LaserScan)}
    shown = {"trunk": 0, "leg": 0}
    frames = []
    for k in range(8):
        ns = (k + 1) * NS_PER_S // 10
        for scan in (ahead(empty["waist"], 0.7, 0.3), ahead(empty["knee"], 2.2, 0.02)):
            frames += tracker.update(replace(scan, stamp_ns=ns))
    for frame in [*frames, *tracker.finish()]:
        shown["trunk"] += any(each.y < 1.2 for each in frame.tracks)
        shown["leg"] += any(each.y > 1.8 for each in frame.tracks)
    assert 0 < shown["leg"] <= shown["trunk"] - 2


def test_what_may_be_of_another_track_tells_less_of_one_that_it_is_given_to() -> None:
    """A silhouette at a ghost's place, which may as well be the known person's whom the picture shows nowhere else."""
    options, ghost = FusionOptions(), (0.0, 0.0)
    ratios = []
    for x_m in (3.0, 1.0, 0.5):
        people = people_at(ghost, (x_m, 0.0))
        look = Look(
            ("camera",), options.camera, np.zeros((1, 2)), 0.3**2 * np.eye(2)[None], np.zeros(1, np.intp), np.full(1, -1),
            lambda points: np.full(points.shape[1:], 0.2), SILHOUETTE_SHOWN, evidence=np.array([0.5]),
        )  # fmt: skip
        pairs = pair(people, look, np.full(2, 0.2), np.zeros(2, np.bool_))
        assert pairs.row.tolist() == [0] and pairs.evidence.tolist() == [0.5]
        ratios.append(pairs.log_ratio[0])
    alone = pair(people_at(ghost), look, np.full(1, 0.2), np.zeros(1, np.bool_)).log_ratio[0]
    assert alone == pytest.approx(ratios[0]) and ratios[0] > ratios[1] > ratios[2]


def test_a_single_leg_is_of_the_person_with_whom_the_legs_were_shared_out() -> None:
    """A leg is up to half a stride from its person: by its place alone it may be nearer to a hidden one beside."""
    knees = scanners_of(rig(waist=False, camera=False), EMPTY, FusionOptions(), None)[0]
    empty = next(each for each in EMPTY if isinstance(each, LaserScan) and each.sensor == "knee")
    place = np.array([[0.9, 2.3], [0.1, 1.6]])
    expected = standing(place)
    one = knees.look({"knee": ahead(empty, 1.5, 0.05)}, expected, empty.stamp_ns)
    assert one is not None and one.owner.tolist() == [1]
    both = ahead(empty, 1.5, 0.18)
    gap = np.abs(both.angles_rad) < 0.08 / 1.5
    both = replace(both, ranges_m=np.where(gap, empty.ranges_m, both.ranges_m))
    two = knees.look({"knee": both}, expected, empty.stamp_ns)
    assert two is not None and two.owner.tolist() == [-1]


@pytest.mark.parametrize("shown", [True, False])
def test_a_third_leg_beside_a_measured_trunk_is_no_hidden_persons(shown: bool) -> None:
    """Both legs of who was measured are theirs, and a bag beside is nobody's; where no trunk was, it may be a hidden person's."""
    knees = scanners_of(rig(camera=False), EMPTY, FusionOptions(), None)[1]
    empty = next(each for each in EMPTY if isinstance(each, LaserScan) and each.sensor == "knee")
    scan = empty
    for x_m in (-0.1, 0.1, 0.27):
        thing = np.abs(scan.angles_rad + x_m / 1.5) < 0.04 / 1.5
        scan = replace(scan, ranges_m=np.where(thing, 1.5, scan.ranges_m))
    place = np.array([[0.0, 1.6], [0.5, 1.6]])
    look = knees.look({"knee": scan}, standing(place, np.array([shown, False])), empty.stamp_ns)
    assert look is not None and len(look.position) == (1 if shown else 2)
    np.testing.assert_allclose(look.position[0], place[0], atol=0.08)
    assert not look.starts.any()


def test_a_tentative_track_measured_twice_is_no_noise() -> None:
    """One measurement by beams split at an edge is not repeated there; one leg of a walker is missed by many scans."""
    manager = FusionTrackManager(FusionOptions(), None, Imm(PersonMotion()))
    people, nobody = people_at((0.0, 0.0), (3.0, 0.0)), np.empty(0, np.intp)
    people = people.changed(
        roster=people.roster.changed(n_measured=np.array([1, 2])), seen_ns=np.zeros((2, 1), np.int64)
    )
    look = Look(
        ("knee",), FusionOptions().legs, np.empty((0, 2)), np.empty((0, 2, 2)), nobody, nobody,
        lambda points: np.ones(points.shape[1:]), LEGS_SHOWN, is_sharp=True,
    )  # fmt: skip
    left = manager.without_noise(people, {0: look}, NS_PER_S // 10)
    np.testing.assert_allclose(left.positions, [[3.0, 0.0]])


def test_two_hidden_people_who_may_be_at_one_place_stay_two() -> None:
    """A younger track goes where both are known to be at one place; not where each may be anywhere."""
    manager = FusionTrackManager(FusionOptions(), None, Imm(PersonMotion()))
    people = people_at((0.0, 0.0), (0.05, 0.0))
    people = people.changed(roster=people.roster.changed(confirmed=np.ones(2, np.bool_)))
    for sigma_m, left in ((0.03, 1), (0.3, 2)):
        known = people.in_state(replace(people.state, covariance=people.state.covariance * (sigma_m / 0.1) ** 2))
        for _ in range(10):
            known = manager.without_doubles(known, 0.1)
        assert len(known) == left
