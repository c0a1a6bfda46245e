"""A sensor that hangs is silent, one that has no noise or nothing to say is believed."""

from dataclasses import replace

import numpy as np
import pytest

from trackers.observations import NS_PER_S, DepthImage, Image, LaserScan
from trackers.tracking.missing_frames import StaleFrameDetector
from trackers.tracking.synced_frames import BLANK, FrameSynchronizer, SyncPolicy

RNG = np.random.default_rng(3)


def scan(ranges_m, n=0):
    return LaserScan("knee", n * NS_PER_S // 10, np.asarray(ranges_m, np.float32), 0.0, 0.01, 0.1, 9.0)


def noisy(n_beam=200):
    return 3.0 + 0.01 * RNG.standard_normal(n_beam)


def told(readings):
    repeats = StaleFrameDetector()
    return [repeats.repeats(each) for each in readings]


def test_a_noisy_scanner_that_hangs_is_told_until_it_goes_on():
    first, last, later = noisy(), noisy(), noisy()
    assert told(map(scan, [first, last, last, last, later])) == [False, False, True, True, False]


def test_a_scanner_without_noise_is_believed_though_nobody_moves():
    still = np.full(200, 3.0)
    somebody = still.copy()
    somebody[20:30] = 1.0
    assert not any(told(map(scan, [still, still, somebody, somebody, still, still])))


def test_after_one_great_change_a_scanner_without_noise_is_believed_again():
    still, elsewhere, step = np.full(200, 3.0), np.full(200, 2.0), np.full(200, 2.0)
    step[:10] = 1.0
    assert told(map(scan, [still, elsewhere, step, step]))[-1] is False


def test_scans_with_hardly_a_return_are_believed():
    """In the open nobody there is nothing again and again."""
    nothing = np.full(200, np.inf)
    assert not any(told(map(scan, [noisy(), noisy(), nothing, nothing, nothing])))
    few = nothing.copy()
    few[:10] = noisy(10)
    assert not any(told(map(scan, [noisy(), noisy(), few, few])))


def test_invalid_beams_do_not_hide_that_a_scanner_hangs():
    first, last = noisy(), noisy()
    first[::7] = last[::7] = np.nan
    assert told(map(scan, [first, last, last])) == [False, False, True]


@pytest.mark.parametrize("kind", [Image, DepthImage])
def test_pictures_too(kind):
    pictures = RNG.integers(0, 255, (2, 32, 40, 3), np.uint8)
    depth = (np.ones((32, 40), np.float32),) if kind is DepthImage else ()
    told_of = told(kind("camera", 0, each, *depth) for each in [pictures[0], pictures[1], pictures[1], pictures[0]])
    assert told_of == [False, False, True, False]


def test_the_moment_of_a_repetition_leaves_without_it_and_nobody_waits():
    gatherer = FrameSynchronizer(SyncPolicy(("knee",)))
    ranges = [noisy(), noisy()]
    left = [moment for n in range(4) for moment in gatherer.add(scan(ranges[min(n, 1)], n))]
    assert [moment.ns for moment in left] == [n * NS_PER_S // 10 for n in range(4)]
    assert [list(moment.observations) for moment in left] == [["knee"], ["knee"], [], []]
    assert gatherer.losses.total() == 2
    again = replace(scan(ranges[1], 3), stamp_ns=left[3].ns + 1)
    assert [moment.ns for moment in gatherer.add(again)] == [again.stamp_ns]  # not too late: a moment of its own


NO_BEAMS, INVALID, NOTHING = np.empty(0), np.full(200, np.nan), np.full(200, np.inf)


@pytest.mark.parametrize("blank", [NO_BEAMS, INVALID, NOTHING], ids=["no beams", "invalid", "nothing met"])
def test_a_scan_that_loses_every_return_is_no_reading(blank):
    gatherer = FrameSynchronizer(SyncPolicy(triggers=("knee",)))
    scans = [scan(each, n) for n, each in enumerate((noisy(), blank, blank, noisy(), blank, noisy()))]
    moments = [moment for each in scans for moment in gatherer.add(each)] + gatherer.finish()
    assert [len(moment.observations) for moment in moments] == [1, 0, 0, 1, 0, 1]
    assert gatherer.losses == {("knee", BLANK): 3}


def test_nothing_met_in_open_space_is_a_look():
    repeats = StaleFrameDetector()
    post = np.where(np.arange(200) < 10, noisy(), np.inf)
    assert not any(repeats.is_blank(scan(each)) for each in (NOTHING, post, NOTHING, NOTHING))
    assert repeats.is_blank(scan(NO_BEAMS))
