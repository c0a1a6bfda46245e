"""Features of clusters, and the shipped classifier of legs."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from trackers.errors import InputError
from trackers.laser.legs.classifier import Forest, read_classifier, read_forest, shipped, write_forests
from trackers.laser.legs.features import NAMES, cluster_features, leg_clusters, own_samples
from trackers.observations import LaserScan

LEGS = ((1.5, 0.12), (1.6, -0.13))
POST = (2.0, 1.5)


def scan_of(circles, step_deg: float = 0.5, wall_m: float = 4.0, span_deg: float = 180.0) -> LaserScan:
    """A scan of circles (x, y, radius) [m] before a round wall."""
    count = round(span_deg / step_deg) + (span_deg < 360)
    angle = np.deg2rad(-span_deg / 2 + step_deg * np.arange(count))
    ranges = np.full(count, wall_m)
    for x, y, radius in circles:
        along, across = x * np.cos(angle) + y * np.sin(angle), y * np.cos(angle) - x * np.sin(angle)
        met = (np.abs(across) < radius) & (along > 0)
        ranges[met] = np.minimum(ranges[met], along[met] - np.sqrt(radius**2 - across[met] ** 2))
    return LaserScan("scan", 0, ranges.astype(np.float32), float(angle[0]), float(np.deg2rad(step_deg)), 0.05, 10.0)


PERSON = scan_of([(*place, 0.06) for place in LEGS])


def at(scan: LaserScan, x: float, y: float) -> int:
    """The cluster at a place."""
    return int(np.hypot(*(leg_clusters(scan).middle - (x, y)).T).argmin())


def features(scan: LaserScan):
    return cluster_features(scan, leg_clusters(scan))


def test_every_feature_is_a_number_whatever_the_scan_shows():
    rng = np.random.default_rng(0)
    for _ in range(20):
        ranges = rng.choice([0.5, 1.0, 1.02, 3.0, np.inf, np.nan, 0.0], 60).astype(np.float32)
        scan = LaserScan("scan", 0, ranges, -np.pi, 2 * np.pi / 60, 0.05, 10.0)
        assert np.isfinite(features(scan)).all()
        assert features(scan).shape == (len(leg_clusters(scan)), len(NAMES))
    assert features(replace(PERSON, ranges_m=PERSON.ranges_m * np.nan)).shape == (0, len(NAMES))


def test_a_mirrored_scene_has_the_same_features_but_for_the_sign_of_turns():
    mirrored = replace(PERSON, ranges_m=PERSON.ranges_m[::-1].copy())
    same = [place for place, name in enumerate(NAMES) if name not in ("curvature", "bulge")]
    np.testing.assert_allclose(features(mirrored)[::-1][:, same], features(PERSON)[:, same], atol=1e-6)


def test_a_full_turn_has_the_same_features_wherever_its_seam_lies():
    scan = scan_of([(*place, 0.06) for place in LEGS], span_deg=360.0)
    turned = replace(scan, ranges_m=np.roll(scan.ranges_m, 361))  # the seam goes through a leg's side
    for x, y in LEGS:
        one, other = features(scan)[at(scan, x, y)], features(turned)[at(turned, *(np.array((x, y)) @ turn(361 * 0.5)))]
        np.testing.assert_allclose(one, other, atol=1e-5)


def turn(degrees: float) -> np.ndarray:
    cos, sin = np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))
    return np.array([[cos, sin], [-sin, cos]])


def test_samples_of_clusters_are_theirs():
    clusters = leg_clusters(PERSON)
    beam, starts = own_samples(PERSON, clusters)
    np.testing.assert_array_equal(beam[starts], clusters.first_beam)
    assert beam.size == clusters.n_sample.sum() == PERSON.ranges_m.size


def test_two_legs_are_legs_and_a_wall_a_box_and_a_pillar_are_none():
    things = scan_of([*((*place, 0.06) for place in LEGS), (2.5, 1.8, 0.35), (2.2, -1.8, 0.012)])
    evidence = shipped().evidence(things, leg_clusters(things))
    assert all(evidence[at(things, *place)] > 1 for place in LEGS)
    assert all(evidence[at(things, *place)] < -1 for place in ((2.5, 1.8), (2.2, -1.8), (4.0, 0.0)))


def test_a_forest_goes_left_and_right_as_its_questions_say(tmp_path: Path):
    forest = Forest(np.array([[0, 1, 1]]), np.array([[0.5, 2.0, 1e9]]), np.array([[1.0, 2.0, 3.0, 4.0]]), 10.0)
    asked = np.array([[0.0, 1.0], [0.0, 3.0], [1.0, 0.0], [1.0, 9.0]])
    np.testing.assert_array_equal(forest.score(asked), [11, 12, 13, 13])
    write_forests({"mine": forest}, tmp_path / "forest.npz")
    np.testing.assert_array_equal(read_forest(tmp_path / "forest.npz", "mine", 2).score(asked), forest.score(asked))
    assert forest.score(np.empty((0, 2))).shape == (0,)


def test_a_file_that_is_no_classifier_is_refused(tmp_path: Path):
    path = tmp_path / "wrong.npz"
    np.savez(path, alone_feature=np.zeros((2, 3), np.uint8))
    with pytest.raises(InputError, match=r"alone_threshold is missing.*learn-legs"):
        read_classifier(path)
