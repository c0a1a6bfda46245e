"""Frames that are owed where the only sensor that triggers them loses an observation."""

import numpy as np
import pytest

from trackers.observations import NS_PER_S
from trackers.tracking.missing_frames import FrameClock


def ns(seconds: float) -> int:
    return round(seconds * NS_PER_S)


def run(frames, others, longest_s: float = 1.5):
    """Feed (arrival, stamp) of frames and stamps of the other sensor, by arrival [s]; return stamps owed, and those reported."""
    clock, owed, reported = FrameClock(longest_s), [], []
    events = sorted([(arrival, 0, stamp) for arrival, stamp in frames] + [(stamp, 1, stamp) for stamp in others])
    for _, is_other, stamp in events:
        if is_other:
            owed += clock.owed(ns(stamp))
        elif clock.take(ns(stamp)):
            reported.append(ns(stamp))
    return owed, reported


@pytest.mark.parametrize("period", [0.025, 0.1, 1 / 3])
@pytest.mark.parametrize("sweep", [0.0, 0.8])
def test_lost_frames_are_owed_once_each_at_their_turn(period: float, sweep: float):
    lost = {12, 20, 21}
    frames = [(period * (k + sweep), period * k) for k in range(30) if k not in lost]
    owed, reported = run(frames, np.arange(0, 29 * period, 0.02))
    np.testing.assert_allclose(owed, [period * NS_PER_S * k for k in sorted(lost)], atol=2)
    assert len(reported) == len(frames)


def test_frames_that_come_in_time_owe_nothing_whatever_their_jitter():
    rng = np.random.default_rng(0)
    frames = [(0.1 * k + 0.08 + 0.01 * rng.random(), 0.1 * k + 0.01 * rng.normal()) for k in range(100)]
    assert run(frames, np.arange(0, 10, 0.01))[0] == []


def test_a_frame_that_comes_after_all_is_not_reported_twice():
    frames = [(0.1 * k + (0.11 if k == 12 else 0.02), 0.1 * k + 0.003 * (k == 12)) for k in range(30)]
    owed, reported = run(frames, np.arange(0, 3, 0.01))
    assert owed == [ns(1.2)]
    assert ns(1.203) not in reported
    assert len(reported) == len(frames) - 1


def test_a_silent_sensor_owes_frames_only_for_as_long_as_tracks_last():
    owed, _ = run([(0.1 * k, 0.1 * k) for k in range(20)], np.arange(0, 60, 0.05), longest_s=0.55)
    assert owed == [ns(1.9 + 0.1 * k) for k in range(1, 6)]


def test_before_the_period_is_known_nothing_is_owed():
    assert run([(0.0, 0.0), (0.1, 0.1), (0.2, 0.2)], np.arange(0, 5, 0.05))[0] == []
