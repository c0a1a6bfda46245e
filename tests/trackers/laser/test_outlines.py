"""The axis of a body from the outline that a scanner at waist height sees of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from trackers.errors import InputError
from trackers.laser.clusters import find_clusters
from trackers.laser.layer import WaistOptions
from trackers.laser.legs.classifier import read_forest
from trackers.laser.outlines import N_FEATURE, SHIPPED, mirrored, outline_features, shipped
from trackers.observations import LaserScan

STEP_RAD = np.deg2rad(0.5)


def scan_of(centre: tuple[float, float], half: tuple[float, float], hidden_from_rad: float = np.pi) -> LaserScan:
    """Scan an ellipse with its axes along x and y, before nothing; bearings from `hidden_from_rad` on meet a post at 1 m."""
    angle = np.arange(-np.pi / 2, np.pi / 2, STEP_RAD)
    ray, origin = np.array([np.cos(angle), np.sin(angle)]) / np.reshape(half, (2, 1)), -np.divide(centre, half)
    a, b, c = (ray**2).sum(axis=0), origin @ ray, origin @ origin - 1
    root = b**2 - a * c
    ranges = np.where(root >= 0, (-b - np.sqrt(np.maximum(root, 0))) / a, np.inf)
    ranges[(angle >= hidden_from_rad) & (angle < hidden_from_rad + 0.3)] = 1.0
    return LaserScan("waist", 0, ranges.astype(np.float32), -np.pi / 2, STEP_RAD, 0.05, 20.0, 0.0)


def axes_of(scan: LaserScan) -> tuple[np.ndarray, np.ndarray]:
    """Return the axes and variances of what is farther than the post."""
    foreground = np.isfinite(scan.ranges_m) & (scan.ranges_m > 1.5)
    return shipped().axes(scan, foreground, find_clusters(scan, foreground, WaistOptions().cluster))


@pytest.mark.parametrize("half", [(0.11, 0.19), (0.19, 0.11), (0.15, 0.15)])
def test_the_axis_of_a_body_in_full_view_is_behind_what_is_seen(half: tuple[float, float]):
    for centre in ((3.0, 0.0), (4.0, 1.5), (2.5, -1.0)):
        axis, variance = axes_of(scan_of(centre, half))
        assert len(axis) == 1
        assert np.hypot(*(axis[0] - centre)) < 0.06
        assert variance[0] < 0.05**2


def test_a_body_that_is_partly_hidden_goes_on_behind_and_is_known_less_exactly():
    centre, half = (3.0, 0.0), (0.13, 0.22)
    (seen,), (sure,) = axes_of(scan_of(centre, half))
    (part,), (unsure,) = axes_of(scan_of(centre, half, hidden_from_rad=-0.02))
    assert unsure > 2 * sure
    assert abs(part[1]) < 0.08  # the middle of what is seen of it is 12 cm to the right
    assert np.hypot(*(seen - centre)) < 0.05


def test_a_mirrored_body_has_the_mirrored_axis():
    scan = scan_of((3.0, 0.4), (0.12, 0.2), hidden_from_rad=0.15)
    angle = scan.angles_rad
    image = LaserScan("waist", 0, scan.ranges_m[::-1].copy(), -angle[-1], STEP_RAD, 0.05, 20.0, 0.0)
    axis, variance = axes_of(scan)
    mirror, also = axes_of(image)
    np.testing.assert_allclose(mirror, axis * (1, -1), rtol=0, atol=1e-9)
    np.testing.assert_allclose(also, variance, rtol=1e-9)


def test_features_are_mirrored_twice_to_themselves():
    scan = scan_of((3.0, 0.4), (0.12, 0.2))
    foreground = np.isfinite(scan.ranges_m)
    features = outline_features(scan, foreground, find_clusters(scan, foreground, WaistOptions().cluster))
    assert features.shape == (1, N_FEATURE)
    assert np.isfinite(features).all()
    np.testing.assert_array_equal(mirrored(mirrored(features)), features)


def test_no_cluster_has_no_axis():
    scan = scan_of((3.0, 0.0), (0.12, 0.2))
    nothing = np.zeros(scan.ranges_m.size, np.bool_)
    axis, variance = shipped().axes(scan, nothing, find_clusters(scan, nothing, WaistOptions().cluster))
    assert axis.shape == (0, 2)
    assert variance.shape == (0,)


def test_the_file_is_small_and_another_is_refused(tmp_path: Path):
    assert SHIPPED.stat().st_size < 100_000
    path = tmp_path / "other.npz"
    np.savez(path, behind_feature=np.zeros((1, 1), np.uint8))
    with pytest.raises(InputError, match=r"behind_threshold is missing.*learn-trunks"):
        read_forest(path, "behind", N_FEATURE, "learn-trunks")
