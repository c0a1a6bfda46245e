"""Whether it is the light that has changed, or the people."""

from __future__ import annotations

import numpy as np
import pytest
from synthetic_room import empty_room, rig
from test_laser_fisheye_association import NOW, PERIOD_S, ago, detections, followed

from trackers.filters.imm import Imm
from trackers.laser_fisheye_imm.detection import Seen
from trackers.laser_fisheye_imm.light import light_changed
from trackers.laser_fisheye_imm.people import People
from trackers.laser_fisheye_imm.tracker import LaserFisheyeImm

PLACES = np.array([[-1.0, 2.0], [0.0, 2.0], [1.0, 2.0]])
RED, GREEN, BLUE, DARK = np.eye(4)


def followed_and_seen(
    looks: list[np.ndarray], shift_m=0.0, n_look=9, unseen_s=(PERIOD_S,) * 3, comparable=True
) -> tuple[People, Seen]:
    """People in red, green and blue, and a moment in which they look like `looks`."""
    count = len(PLACES)
    state = Imm().start(PLACES, np.zeros((count, 2)), 0.02, 0.1)
    people = People.started(state, PLACES, NOW, np.array([RED, GREEN, BLUE]), np.full(count, n_look))
    mask, places = np.full(len(looks), comparable), PLACES + np.array([0.0, shift_m])
    seen = Seen(detections(*places), detections(), np.empty(0, np.bool_), None, np.array(looks), mask, mask)
    return followed(people, ago(*unseen_s)), seen


def changed(looks: list[np.ndarray], **situation) -> bool:
    return light_changed(*followed_and_seen(looks, **situation), near_m=0.3, unlike=0.37)


@pytest.mark.parametrize(
    ("looks", "expected"),
    [
        ([RED, GREEN, BLUE], False),
        ([DARK, DARK, DARK], True),
        ([DARK, DARK, BLUE], True),
        ([DARK, GREEN, BLUE], False),
    ],
)
def test_the_light_is_another_where_most_look_unlike_themselves(looks, expected):
    assert changed(looks) is expected


@pytest.mark.parametrize(
    "unknown",
    [
        {"n_look": 0},
        {"comparable": False},
        {"unseen_s": (PERIOD_S, 1.0, 1.0)},  # of one alone it cannot be told
        {"shift_m": 0.5},  # these may be others
    ],
)
def test_where_nobody_surely_is_themselves_nothing_is_told(unknown):
    assert changed([DARK, DARK, DARK], **unknown) is False


@pytest.mark.parametrize(("options", "known"), [({}, False), ({"other_above": 1.0}, True)])
def test_when_the_light_changes_the_tracker_forgets_what_everybody_wore(options, known):
    tracker = LaserFisheyeImm(rig(), empty_room(np.random.default_rng(1)), None, **options)
    tracker._people, seen = followed_and_seen([DARK, DARK, DARK])
    tracker._forget_clothes(seen)
    assert tracker._people.clothes.known.tolist() == [known] * 3


def test_clothes_that_were_forgotten_are_learned_as_if_never_seen():
    people, _ = followed_and_seen([RED, GREEN, BLUE])
    forgotten = people.clothes.forgotten()
    assert forgotten.distance(np.array([RED]), np.ones(1, np.bool_)) is None
    learned = forgotten.learned(np.array([1]), np.array([DARK]), np.zeros(1, np.bool_), 0, 0.4)
    np.testing.assert_array_equal(learned.reference[1], DARK)
