"""Rules by time hold at any rate."""

import itertools

import pytest

from trackers.tracking.lifecycle import lasted_s


@pytest.mark.parametrize(("rate_hz", "frames"), [(4, 2), (5, 2), (7.5, 3), (10, 3), (20, 6), (40, 12)])
def test_what_is_seen_for_a_time_is_seen_at_as_many_frames_as_the_rate_makes_of_it(rate_hz, frames):
    stamps = [round(k * 1e9 / rate_hz) + jitter for k, jitter in zip(range(20), [0, 2_000_000] * 10, strict=True)]
    lasted = [lasted_s(stamps[0], ns, before) for before, ns in itertools.pairwise(stamps)]
    assert lasted_s(stamps[0], stamps[0], stamps[0] - 10**9) == 0
    assert next(k for k, each in enumerate(lasted, 2) if each > 0.28) == frames
