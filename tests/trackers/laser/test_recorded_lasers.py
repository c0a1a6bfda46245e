"""Real scanners: labelled legs, and people walking past a robot."""

import numpy as np
import pytest
from recorded_scans import labelled, needs_data, on_furniture, walkers_in_the_robots_bag

from trackers.feeding import track_frames
from trackers.laser.background import LearnedBackground
from trackers.laser.bearings import returns
from trackers.laser.clusters import find_clusters
from trackers.laser.layer import KneeOptions
from trackers.presets import make_tracker
from trackers.rig import LaserSensor, Rig


def recall(found: list[np.ndarray], legs: np.ndarray) -> float:
    """Share of labelled legs (scan, x, y) with a cluster's middle within 0.15 m."""
    gaps = [np.hypot(*(found[int(k)] - (x, y)).T).min(initial=np.inf) for k, x, y in legs]
    return float(np.mean(np.array(gaps) < 0.15))


@needs_data
@pytest.mark.parametrize("number", [1, 2, 3])
def test_clusters_find_the_labelled_legs(number):
    scans, legs = labelled(number)
    found = [find_clusters(scan, returns(scan)[1], KneeOptions().cluster).middle for scan in scans]
    assert recall(found, legs) >= 0.99


@needs_data
@pytest.mark.parametrize("number", [1, 2, 3])
def test_the_learned_background_leaves_the_people_and_little_else(number):
    scans, legs = labelled(number)
    background = LearnedBackground()
    found = [find_clusters(scan, background.foreground(scan), KneeOptions().cluster).middle for scan in scans]
    t = np.array([scan.t - scans[0].t for scan in scans])
    learned = legs[t[legs[:, 0].astype(int)] >= 5]  # the first seconds show people and room alike
    assert recall(found, learned[~on_furniture(scans, learned)]) >= 0.99
    assert np.mean([len(middle) for middle in found]) < 5  # of about 29 before


@needs_data
@pytest.mark.parametrize(("number", "n"), [(1, 6), (2, 3), (3, 6)])
def test_few_labels_lie_on_what_stands_there_all_the_time(number, n):
    assert on_furniture(*labelled(number)).sum() == n


@needs_data
@pytest.mark.parametrize(("name", "last"), [("laser-imm", 1264), ("fusion", 1190)])
def test_people_walking_past_a_robot_are_few_long_tracks(name, last):
    """Three people walk about for 110 s; the eye finds no more in the plotted scans. last: scan up to which all are followed."""
    rig = Rig(sensors={"scan": LaserSensor(topic="/scan")})
    tracker = make_tracker(name, rig)
    frames = list(track_frames(tracker, rig, walkers_in_the_robots_bag()))
    assert len(frames) == 1265
    assert tracker.background_learned_causally
    paths: dict[int, list] = {}
    for k, frame in enumerate(frames):
        for track in frame.tracks:
            paths.setdefault(track.id, []).append((k, track.x, track.y))
    walkers = {i: np.array(path) for i, path in paths.items() if np.ptp(np.array(path)[:, 1:], axis=0).max() > 1.5}
    assert len(walkers) == 3
    for path in walkers.values():
        assert path[0, 0] < 80
        assert path[-1, 0] >= last  # to the last scans, where they stand still again
    # what flickers at the far edge of the room is taken for somebody for two seconds, once
    others = [path for number, path in paths.items() if number not in walkers]
    assert len(others) <= 1
    assert all(len(path) <= 20 for path in others)
