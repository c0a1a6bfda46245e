"""What the existence of a track is told of the scene around it."""

import numpy as np

from trackers.filters.imm import Imm
from trackers.filters.motion import VelocityMotion
from trackers.laser_legs.evidence import TRACK_FEATURES, LegTracks

_IMM = Imm(VelocityMotion(), measurement_covariance=np.eye(2) * 0.01)


def scene(log_odds, age, n_leglike: int = 0):
    """Features of tracks 3 m apart, by name."""
    n = len(log_odds)
    places = np.column_stack([3.0 * np.arange(n), np.full(n, 2.0)])
    tracks = LegTracks.started(_IMM.start(places), 0, np.zeros(2), -2.4, 0.0).changed(
        log_odds=np.array(log_odds, float)
    )
    zeros = np.zeros(n)
    values = tracks.features(
        places, zeros, zeros, np.array(age, float), zeros, 0, np.zeros((1, 2)), 0.0, 0.01, 0.1, n_leglike
    )
    return dict(zip(TRACK_FEATURES, values.T, strict=True))


def test_a_track_is_told_of_all_others_how_many_and_what_share_are_people():
    among_people, among_posts = scene([-2.0, 9.0, 9.0, 9.0], [5.0] * 4), scene([-2.0, -9.0, -9.0, -9.0], [5.0] * 4)
    np.testing.assert_allclose(among_people["people"][0], 3, atol=1e-3)
    np.testing.assert_allclose(among_posts["people"][0], 0, atol=1e-3)
    assert among_people["others"][0] > 0.6
    assert among_posts["others"][0] < 0.1
    # nobody is counted for themselves
    np.testing.assert_allclose(among_people["people"][1], 2 + 1 / (1 + np.exp(2)), atol=1e-3)


def test_what_was_just_seen_first_says_nothing_of_the_scene_yet():
    alone, new = scene([-2.0], [5.0]), scene([-2.0, 9.0, -9.0], [5.0, 0.0, 0.0])
    assert new["others"][0] == alone["others"][0]
    assert new["people"][0] == 0


def test_a_track_is_told_how_much_of_its_scan_looks_like_legs():
    few, many = scene([0.0], [1.0], n_leglike=2), scene([0.0], [1.0], n_leglike=20)
    assert many["leglike"][0] > few["leglike"][0]
