"""Who is who after a merge: by looks where they are known, by motion where not, and told either way."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from trackers.area import Pose
from trackers.cameras import PinholeIntrinsics
from trackers.errors import InputError
from trackers.filters.particle import Cloud
from trackers.laser_vision_learning.identities import IdentityOptions
from trackers.laser_vision_learning.looks import LooksOptions
from trackers.laser_vision_learning.reidentification import Recognition, RecognitionOptions
from trackers.laser_vision_learning.situations import Situations
from trackers.laser_vision_learning.walking_model import SPEED, WalkerTracks
from trackers.observations import NS_PER_S, Image
from trackers.rig import PinholeSensor, placed_camera
from trackers.tracking.roster import Roster

SENSOR = PinholeSensor(
    topic="/camera/image/compressed",
    room_from_sensor=Pose(xyz=(0.0, -6.0, 6.0), rpy=(-2.2, 0.0, 0.0)),
    intrinsics=PinholeIntrinsics(width=320, height=240, fx=250, fy=250, cx=159.5, cy=119.5),
)
RED, BLUE, GREEN = (180, 40, 40), (40, 40, 180), (40, 160, 40)
PERIOD_NS = 40_000_000
AREA_M = 3.0
"""Radius of the area."""
LOOKS = LooksOptions()


def picture(places, colours, ns: int) -> Image:
    """People as boxes of one colour, the nearer ones before the others, with noise."""
    rgb = np.full((240, 320, 3), 120.0)
    boxes, _ = placed_camera(SENSOR).person_boxes(np.reshape(places, (-1, 2)), 1.75, 0.45)
    for one in np.argsort([-y for _, y in places]):
        left, top, right, bottom = (round(each) for each in boxes[one])
        cv2.rectangle(rgb, (left, top), (right, bottom), colours[one], -1)
    rgb += np.random.default_rng(ns).normal(0, 12, rgb.shape)
    return Image("camera", ns, np.clip(rgb, 0, 255).astype(np.uint8))


class Meeting:
    """Tracks that are told where they are and in what situation; the recognition deals out their identities."""

    def __init__(self, n: int, identities: IdentityOptions = IdentityOptions(), **options):
        self.recognition = Recognition(
            SENSOR,
            [],
            RecognitionOptions(**options),
            LOOKS,
            identities,
            np.random.default_rng(0),
            lambda places: np.hypot(*places.T) < AREA_M,
        )
        self.ids, self.serial, self.ns, self.decisions = np.arange(1, n + 1), np.arange(n), 0, []
        self.born_ns = np.zeros(n, int)
        nobody = Roster.started(Cloud.of(np.zeros((5, 0, 60))), 0)
        self.people = WalkerTracks(np.zeros(0, int), nobody, np.zeros(0), np.zeros(0, int), np.zeros(0, int))

    def frames(
        self, count: int, places, colours=None, interacting=True, together=(), wide_m=0.05, speed_m_s=0.0, missed=()
    ) -> WalkerTracks:
        """speed_m_s: of all, along x; `together`: index pairs who are merged and confused; `colours` None: no picture comes;
        missed: indices of those that no scanner shows."""
        n = len(places)
        confused = np.zeros((n, n), bool)
        for one, other in together:
            confused[one, other] = confused[other, one] = True
        near = np.full((n, n), interacting) & ~np.eye(n, dtype=bool)
        for _ in range(count):
            self.ns += PERIOD_NS
            state = np.zeros((5, n, 60))
            state[:2] = np.array(places, float).T[..., None]
            state[:2] += np.random.default_rng(self.ns).normal(0, wide_m, (2, n, 60))
            state[2:4] = [[[0.0]], [[speed_m_s]]]
            measured_ns, many = np.full(n, self.ns), np.full(n, 9)
            measured_ns[list(missed)] -= NS_PER_S
            roster = Roster(self.ids, Cloud.of(state), self.born_ns[:n], measured_ns, many, np.ones(n, bool))
            now = Situations(self.serial, near, confused, confused, np.full((n, n), self.ns), confused)
            image = None if colours is None else picture(places, colours, self.ns)
            self.people = self.recognition.work(
                WalkerTracks(self.serial, roster, np.zeros(n), np.full(n, -1), np.zeros(n, int)), now, image, self.ns
            )
            self.ids = self.people.roster.id
            self.decisions += self.recognition.decisions
        return self.people


APART = [(-0.6, 0.0), (0.6, 0.0)]
TOGETHER = [(-0.1, 0.0), (0.1, 0.0)]


def met_and_parted(colours_after, colours=(RED, BLUE), pictures_before=8, **options) -> Meeting:
    two = Meeting(2, **options)
    two.frames(pictures_before, APART, colours)
    two.frames(5, TOGETHER, colours, together=[(0, 1)])
    two.frames(20, APART, colours_after)
    return two


def test_who_was_exchanged_in_a_merge_is_exchanged_back_by_looks_and_who_was_not_stays():
    exchanged = met_and_parted((BLUE, RED))
    assert exchanged.ids.tolist() == [2, 1]
    (decision,) = exchanged.decisions
    assert decision.before == (1, 2) and decision.after == (2, 1) and decision.by_looks == (True, True)
    same = met_and_parted((RED, BLUE))
    assert same.ids.tolist() == [1, 2]
    assert same.decisions[0].by_looks == (True, True)


def test_looks_go_with_the_identity():
    """A second merge after an exchange is decided as well as the first."""
    two = met_and_parted((BLUE, RED))
    two.frames(5, TOGETHER, (BLUE, RED), together=[(0, 1)])
    two.frames(20, APART, (RED, BLUE))
    assert two.ids.tolist() == [1, 2]


@pytest.mark.parametrize(
    ("why", "after", "options"),
    [
        ("untrained", (BLUE, RED), {"pictures_before": 0}),
        ("alike", (RED, RED), {"colours": (RED, RED)}),
        ("no picture comes", None, {}),
        ("switched off", (BLUE, RED), {"at_splits": False}),
    ],
)
def test_where_looks_say_nothing_motion_decides(why, after, options):
    two = met_and_parted(after, **options)
    assert two.ids.tolist() == [1, 2]
    assert two.decisions == []


def test_a_track_in_doubt_is_not_learned_from():
    """Two who look alike stay so; the exchanged are learned from only after the exchange was found."""
    alike = met_and_parted((RED, RED), colours=(RED, RED))
    assert alike.recognition.deciding(alike.serial).all()
    assert (alike.recognition._looks.n_learned <= 8).all()
    exchanged = met_and_parted((BLUE, RED))
    assert not exchanged.recognition.deciding(exchanged.serial).any()
    assert (exchanged.recognition._looks.n_learned > 20).all()


@pytest.mark.parametrize(
    ("change", "after"), [({}, [2, 1]), ({"margin": 900.0}, [1, 2]), ({"pictures": 50}, [1, 2])], ids=str
)
def test_identities_are_exchanged_by_enough_pictures_that_tell_enough(change, after):
    assert met_and_parted((BLUE, RED), identities=IdentityOptions(**change)).ids.tolist() == after


@pytest.mark.parametrize("jointly", [False, True])
def test_a_verdict_of_all_together_stays_open_until_the_last_was_seen(jointly):
    two = Meeting(2, IdentityOptions(jointly=jointly))
    two.frames(8, APART, (RED, BLUE))
    two.frames(5, TOGETHER, (RED, BLUE), together=[(0, 1)])
    two.frames(20, APART, (BLUE, RED), missed=[1])
    assert two.recognition.deciding(two.serial).any() == jointly
    two.frames(20, APART, (BLUE, RED))
    assert not two.recognition.deciding(two.serial).any() and two.ids.tolist() == [2, 1]


def test_tracks_that_never_met_keep_their_identities_whatever_they_look_like():
    two = Meeting(2)
    two.frames(10, APART, (RED, BLUE))
    two.frames(30, APART, (BLUE, RED))
    assert two.ids.tolist() == [1, 2] and two.decisions == []


@pytest.mark.parametrize(("remember_s", "found"), [(60.0, 2), (0.1, 3)])
def test_a_new_track_of_a_person_whose_track_was_deleted_has_their_identity(remember_s, found):
    two = Meeting(2, remember_s=remember_s)
    two.frames(8, APART, (RED, BLUE))
    two.ids, two.serial = two.ids[:1], two.serial[:1]
    two.frames(5, APART[:1], (RED,), interacting=False)
    two.ids, two.serial = np.array([1, 3]), np.array([0, 2])
    two.frames(8, APART, (RED, BLUE))
    assert two.ids.tolist() == [1, found]
    two.ids, two.serial = np.array([1, 4]), np.array([0, 3])
    two.frames(8, APART, (RED, GREEN))
    assert two.ids.tolist() == [1, 4]


@pytest.mark.parametrize(("who", "found"), [(BLUE, [1, 2]), (GREEN, [1, 3])])
def test_who_came_up_as_another_track_while_the_own_one_was_astray_is_found_when_that_one_ends(who, found):
    two, nobody = Meeting(2), (120, 120, 120)
    two.frames(8, APART, (RED, BLUE))
    two.frames(5, TOGETHER, (RED, BLUE), together=[(0, 1)])
    two.ids, two.serial, two.born_ns = np.append(two.ids, 3), np.arange(3), np.array([0, 0, two.ns + PERIOD_NS])
    two.frames(12, [APART[0], (-1.4, 0.6), APART[1]], (RED, nobody, who), missed=[1])
    assert sorted(two.ids.tolist()) == [1, 2, 3]
    two.ids, two.serial, two.born_ns = two.ids[[0, 2]], np.array([0, 2]), two.born_ns[[0, 2]]
    two.frames(20, APART, (RED, who))
    assert two.ids.tolist() == found


@pytest.mark.parametrize(
    ("last_m", "speed_m_s", "found"), [(2.0, 0.0, 2), (3.5, 0.0, 3), (2.8, 1.0, 3), (2.8, -1.0, 2)]
)
def test_nobody_who_comes_is_a_person_who_has_left_the_area(last_m, speed_m_s, found):
    two = Meeting(2)
    two.frames(8, APART, (RED, BLUE))
    two.frames(1, [APART[0], (last_m, 0.0)], (RED, BLUE), speed_m_s=speed_m_s)
    two.ids, two.serial = two.ids[:1], two.serial[:1]
    two.frames(5, APART[:1], (RED,), interacting=False)
    two.ids, two.serial = np.array([1, 3]), np.array([0, 2])
    two.frames(8, APART, (RED, BLUE))
    assert two.ids.tolist() == [1, found]


def test_of_three_one_comes_out_and_two_go_on():
    three = Meeting(3)
    places, colours = [(-1.0, 0.0), (0.0, 0.0), (1.0, 0.0)], (RED, BLUE, GREEN)
    three.frames(12, places, colours)
    three.frames(5, [(-0.1, 0), (0.0, 0.1), (0.1, 0)], colours, together=[(0, 1), (1, 2), (0, 2)])
    # the track of the first goes off with the third person, the others stay together
    three.frames(20, [(1.2, 0.0), (-0.3, 0.0), (0.2, 0.0)], (GREEN, BLUE, RED), together=[(1, 2)])
    assert three.ids[0] == 3
    three.frames(20, [(1.2, 0.0), (-0.6, 0.0), (0.3, 0.0)], (GREEN, BLUE, RED))
    assert three.ids.tolist() == [3, 2, 1]


def test_a_member_that_leaves_meanwhile_may_have_been_the_other():
    two = Meeting(2)
    two.frames(8, APART, (RED, BLUE))
    two.frames(5, TOGETHER, (RED, BLUE), together=[(0, 1)])
    two.frames(2, APART, (BLUE, RED))
    two.ids, two.serial = two.ids[:1], two.serial[:1]
    two.frames(20, APART[:1], (BLUE,))
    assert two.ids.tolist() == [2]


def test_while_nobody_interacts_the_picture_is_not_read():
    class Unread:
        @property
        def shape(self):
            raise AssertionError("the picture was read")

    two = Meeting(2)
    people = two.frames(3, APART, None, interacting=False)
    now = Situations.none(two.serial)
    image = Image("camera", two.ns, np.zeros((120, 160, 3), np.uint8))
    object.__setattr__(image, "rgb", Unread())
    two.recognition.work(people, now, image, two.ns)


def test_a_frozen_camera_teaches_nothing_and_another_size_is_refused():
    two = Meeting(2)
    image = picture(APART, (RED, BLUE), 0)
    people = two.frames(1, APART, None)
    nobody, never = np.zeros((2, 2), bool), np.zeros((2, 2), int)
    now = Situations(two.serial, ~np.eye(2, dtype=bool), nobody, nobody, never, nobody)
    for _ in range(3):
        two.recognition.work(people, now, image, two.ns)
    assert (two.recognition._looks.learned_ns == two.ns).sum() == 2
    learned = two.recognition._looks
    two.recognition.work(people, now, image, two.ns + PERIOD_NS)
    assert two.recognition._looks is learned
    half = Image("camera", two.ns, image.rgb[::2, ::2])
    with pytest.raises(InputError, match=r"picture of 'camera' at .* is 160 x 120; 320 x 240"):
        two.recognition.work(people, now, half, two.ns)


@pytest.mark.parametrize("late_s", [0.04, -0.04])
def test_people_are_looked_for_where_they_were_as_the_picture_was_taken(late_s, monkeypatch):
    two, looked_at = Meeting(2), []
    people = two.frames(1, APART, None)
    state = people.cloud.state.copy()
    state[SPEED] = 1.5  # along x
    people = people.changed(roster=people.roster.changed(state=Cloud.of(state)))
    monkeypatch.setattr(
        two.recognition.learner, "trained", lambda looks, shown, *_: looked_at.append(shown.places) or looks
    )
    nobody = np.zeros((2, 2), bool)
    now = Situations(two.serial, ~np.eye(2, dtype=bool), nobody, nobody, np.zeros((2, 2), int), nobody)
    two.recognition.work(people, now, picture(APART, (RED, BLUE), two.ns + round(late_s * NS_PER_S)), two.ns)
    np.testing.assert_allclose(looked_at[0] - people.places, [(1.5 * late_s, 0), (1.5 * late_s, 0)], atol=1e-6)


@pytest.mark.parametrize("place", [(-3.6, 0.0), (9.0, 0.0)], ids=["at the border", "outside"])
def test_who_is_cut_by_the_border_or_outside_harms_nobody(place):
    two = Meeting(2)
    beside = (place[0] + 0.6, place[1])
    two.frames(6, [place, beside], (RED, BLUE))
    two.frames(4, [place, (place[0] + 0.1, 0.0)], (RED, BLUE), together=[(0, 1)])
    two.frames(20, [place, beside], (RED, BLUE))
    assert two.ids.tolist() == [1, 2]


def test_who_is_correlated_and_seen_by_no_scanner_is_drawn_to_their_looks():
    before, after = drawn_to_looks(correlated=True)
    assert after < 0.85 * before
    before, after = drawn_to_looks(correlated=False)
    assert after == before


def drawn_to_looks(correlated: bool) -> tuple[float, float]:
    """Return how far the person whom no scanner sees is off, before the picture and after it [m]."""
    truly = np.array([(-0.6, 0.0), (-0.2, 0.0)])
    believed = [(-0.6, 0.0), (-0.35, 0.15)]
    n, pairs, off = 2, ~np.eye(2, dtype=bool), []
    for pictures in range(10, 14):
        two = Meeting(2, correlated=correlated)
        two.frames(pictures, APART, (RED, BLUE))
        two.ns += PERIOD_NS
        people = two.frames(1, believed, None, wide_m=0.2)
        unseen = people.roster.changed(measured_ns=np.array([two.ns, two.ns - PERIOD_NS]))
        people = people.changed(roster=unseen)
        now = Situations(two.serial, pairs, pairs, ~pairs & False, np.zeros((n, n), int), np.zeros((n, n), bool))
        drawn = two.recognition.work(people, now, picture(truly, (RED, BLUE), two.ns), two.ns)
        assert len(two.recognition.maps) == correlated
        off.append([np.hypot(*(each.places[1] - truly[1])) for each in (people, drawn)])
        np.testing.assert_array_equal(drawn.places[0], people.places[0])  # whom the scanners see, they place
    before, after = np.mean(off, axis=0)
    return before, after
