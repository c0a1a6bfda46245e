"""Looks that are learned from drawn people: who is known, who is trained when, and what is recognised."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest

from trackers.area import Pose
from trackers.cameras import PinholeIntrinsics, PlacedCamera
from trackers.filters.particle import Cloud
from trackers.laser_vision_learning.colours import learner_of
from trackers.laser_vision_learning.looks import Learner, Looks, LooksOptions, PeopleInPicture
from trackers.laser_vision_learning.score_maps import in_levels
from trackers.learning.boosting import BoostingOptions

CAMERA = PlacedCamera(
    PinholeIntrinsics(width=320, height=240, fx=250, fy=250, cx=159.5, cy=119.5),
    Pose(xyz=(0.0, -6.0, 6.0), rpy=(-2.2, 0.0, 0.0)),
)
RED, BLUE, GREEN, GREY = (180, 40, 40), (40, 40, 180), (40, 160, 40), (120, 120, 120)
PAIR = np.array([[-0.5, 0.0], [0.5, 0.0]])
SMALL = LooksOptions(by="classifier", boosting=BoostingOptions(trees=10, kept=7), classifiers_a_frame=2)
COLOURS = LooksOptions()
BOTH, EVERYBODY = np.arange(2), ~np.eye(2, dtype=bool)


def drawn(positions: np.ndarray, colours: list[tuple[int, int, int]], seed: int = 0) -> PeopleInPicture:
    """A noisy picture of people as boxes of one colour, the nearer ones before the others."""
    rgb = np.full((240, 320, 3), GREY, float)
    boxes, _ = CAMERA.person_boxes(positions, 1.75, 0.45)
    for place in np.argsort(-positions[:, 1]):
        left, top, right, bottom = (round(each) for each in boxes[place])
        cv2.rectangle(rgb, (left, top), (right, bottom), colours[place], -1)
    rgb += np.random.default_rng(seed).normal(0, 12, rgb.shape)
    return PeopleInPicture(np.clip(rgb, 0, 255).astype(np.uint8), positions)


def taught(options: LooksOptions = SMALL, pictures: int = 3, colours: Any = (RED, BLUE)) -> tuple[Learner, Looks]:
    learner, rng = learner_of(CAMERA, options), np.random.default_rng(0)
    looks = Looks.unknown(2, learner.options)
    for ns in range(pictures):
        looks = learner.trained(looks, drawn(PAIR, list(colours), ns), EVERYBODY, np.ones(2, bool), ns, rng)
    return learner, looks


@pytest.mark.parametrize("options", [SMALL, COLOURS], ids=["classifier", "colours"])
def test_people_are_told_apart_where_they_come_out(options: LooksOptions) -> None:
    learner, looks = taught(options)
    assert looks.known.all()
    after = np.array([[1.0, 1.0], [-1.0, -0.5]])
    scores = learner.scores(looks, drawn(after, [RED, BLUE], 9), BOTH, BOTH, np.random.default_rng(1))
    assert (scores.diagonal() > 0.4).all()
    assert (scores[[0, 1], [1, 0]] < -0.4).all()


def test_the_same_pictures_teach_the_same_bits() -> None:
    one, other = (taught()[1] for _ in range(2))
    np.testing.assert_array_equal(one.strong.alpha, other.strong.alpha)
    np.testing.assert_array_equal(one.strong.trees.threshold, other.strong.trees.threshold)


@pytest.mark.parametrize("why", ["nobody near", "nobody clear", "one clear"])
def test_with_nobody_to_learn_from_the_picture_is_not_looked_at(why: str) -> None:
    learner = Learner(CAMERA, SMALL)
    looks = Looks.unknown(2, learner.options)
    near = EVERYBODY & (why != "nobody near")
    clear = np.array([why != "nobody clear", why == "nobody near"])
    unseen = PeopleInPicture(np.empty((0, 0, 3), np.uint8), PAIR)
    assert learner.trained(looks, unseen, near, clear, 1, np.random.default_rng(0)) is looks
    assert not looks.known.any()


def test_who_has_waited_longest_is_served_first() -> None:
    options = SMALL.model_copy(update={"classifiers_a_frame": 2})
    learner, rng, looks = Learner(CAMERA, options), np.random.default_rng(0), Looks.unknown(3, options)
    positions = np.array([[-0.8, 0.0], [0.0, 0.0], [0.8, 0.0]])
    for ns in range(1, 13):
        people = drawn(positions, [RED, BLUE, GREEN], ns)
        looks = learner.trained(looks, people, ~np.eye(3, dtype=bool), np.ones(3, bool), ns, rng)
        assert (looks.learned_ns == ns).sum() == 2
        assert (looks.learned_ns >= ns - 1).all() or ns == 1


def test_who_is_hidden_from_the_camera_learns_nothing_and_teaches_nothing() -> None:
    learner, rng = Learner(CAMERA, SMALL), np.random.default_rng(0)
    behind = np.array([[0.0, 0.0], [0.0, 0.25]])
    looks = Looks.unknown(2, learner.options)
    after = learner.trained(looks, drawn(behind, [RED, BLUE]), EVERYBODY, np.ones(2, bool), 1, rng)
    assert not after.known.any()
    _, known = taught()
    scores = learner.scores(known, drawn(behind, [RED, BLUE]), BOTH, BOTH, rng)
    assert np.isfinite(scores[0]).all()
    assert np.isnan(scores[1]).all()


def test_who_is_cut_by_the_border_is_looked_at_as_far_as_can_be() -> None:
    learner, looks = taught()
    edge = np.array([[-3.7, 0.0], [-9.0, 0.0]])
    scores = learner.scores(looks, drawn(edge, [RED, BLUE]), BOTH, BOTH, np.random.default_rng(0))
    assert scores[0, 0] > 0.4
    assert np.isnan(scores[1]).all()


def test_an_unknown_track_scores_nothing() -> None:
    learner, looks = taught()
    more = looks.joined(Looks.unknown(1, learner.options))
    scores = learner.scores(more, drawn(PAIR, [RED, BLUE]), BOTH, np.array([0, 2]), np.random.default_rng(0))
    assert np.isfinite(scores[:, 0]).all()
    assert np.isnan(scores[:, 1]).all()


@pytest.mark.parametrize("options", [SMALL, COLOURS], ids=["classifier", "colours"])
def test_people_who_look_alike_are_not_told_apart(options: LooksOptions) -> None:
    learner, looks = taught(options, pictures=6, colours=(RED, RED))
    scores = learner.scores(looks, drawn(PAIR, [RED, RED], 9), BOTH, BOTH, np.random.default_rng(0))
    assert np.abs(np.diff(scores, axis=1)).max() < 0.4


def test_colours_are_told_from_those_of_everybody_and_from_the_room_by_the_mask() -> None:
    learner, looks = taught(COLOURS)
    rng, people = np.random.default_rng(0), drawn(PAIR, [RED, BLUE], 9)
    far = replace(people, places=PAIR + 100.0)
    assert np.isnan(learner.scores(looks, far, BOTH, BOTH, rng)).all()
    room = replace(people, foreground=np.zeros(people.rgb.shape[:2], bool))
    assert np.isnan(learner.scores(looks, room, BOTH, BOTH, rng)).all()
    # with a third who looks like the first, the first is told less surely
    third = looks.select(np.array([0, 1, 0]))
    alone, beside = (learner.scores(each, people, BOTH, BOTH, rng)[0, 0] for each in (looks, third))
    assert beside < 0.5 * alone


@pytest.mark.parametrize(
    "options", [SMALL.model_copy(update={"background": 20}), COLOURS], ids=["classifier", "colours"]
)
def test_particles_are_drawn_to_where_the_map_shows_their_own(options: LooksOptions) -> None:
    """Both clouds begin between the two."""
    learner, looks = taught(options, pictures=5)
    rng = np.random.default_rng(3)
    expected = np.array([[-0.2, 0.0], [0.2, 0.0]])
    maps = learner.score_maps(looks, replace(drawn(PAIR, [RED, BLUE], 7), places=expected), BOTH, BOTH, rng)
    assert maps.informative.all()
    cloud = Cloud.of(rng.normal(0, 0.5, (2, 2, 800)))
    after = in_levels(
        cloud, learner.likelihood(maps), 3, lambda state, rng: state + rng.normal(0, 0.02, state.shape), rng
    )
    x = after.expectation(after.state[0])
    assert x[0] < -0.2
    assert x[1] > 0.2


def test_the_maps_of_who_is_unknown_say_nothing() -> None:
    learner = Learner(CAMERA, SMALL)
    maps = learner.score_maps(
        Looks.unknown(2, learner.options), drawn(PAIR, [RED, BLUE]), BOTH, BOTH, np.random.default_rng(0)
    )
    assert not maps.informative.any()
    assert (learner.likelihood(maps)(np.zeros((3, 2, 10))) == 0).all()
