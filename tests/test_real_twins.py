"""Twins of labelled recordings: people's walks, the labelled sector, labels at other stamps."""

import numpy as np
import pytest
from benchmarks.recorded_twin import Labelled, Sector, smoothed

from trackers.observations import LaserScan


def test_a_walk_at_a_steady_pace_keeps_it_to_its_ends() -> None:
    t = np.cumsum(np.random.default_rng(3).uniform(0.1, 0.6, 20))
    walk = np.column_stack([t, 1.3 * t - 2, 0.4 - 0.7 * t])
    np.testing.assert_allclose(smoothed(walk), walk, atol=1e-9)


@pytest.mark.parametrize("edge_m", [0.0, 0.2])
def test_a_sector_holds_what_is_far_enough_from_its_sides_and_its_end(edge_m: float) -> None:
    sector = Sector.around(np.array([[3.0, 1.0], [3.9, 0.0], [1.0, -0.1]]))
    places = np.random.default_rng(4).uniform(-1, 5, (400, 2))
    side = np.array([np.sin(sector.high_rad), np.cos(sector.high_rad)])
    off = np.minimum.reduce([places @ (side * (1, -1)), places @ side, 3.9 - np.hypot(*places.T)])
    np.testing.assert_array_equal(sector.holds(places, edge_m), (off >= edge_m) & (places[:, 0] > 0))


def test_labels_go_with_their_scan_to_its_new_stamp() -> None:
    scans = [LaserScan("scan", stamp_ns, np.ones(3, np.float32), -0.1, 0.1, 0.0, 10.0) for stamp_ns in (0, 10, 20, 30)]
    legs = np.array([[0, 1.0, 0.0], [1, 1.1, 0.0], [2, 1.2, 0.0], [2, 3.0, 0.0], [3, 1.3, 0.0]])
    labels = Labelled(scans, legs, Sector(-1.0, 1.0, 4.0)).restamped({0: 5, 2: 27, 3: 26})
    assert [scan.stamp_ns for scan in labels.scans] == [5, 26, 27]
    people = {stamp_ns: sorted(places[:, 0].tolist()) for stamp_ns, places in labels.people.items()}
    assert people == {5: [1.0], 26: [1.3], 27: [1.2, 3.0]}
