"""Frames that leave late: what is known by then, and nothing else."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from trackers.observations import NS_PER_S
from trackers.tracking.fixed_lag_smoother import FixedLagSmoother, Held, by_id
from trackers.tracks import Track, TrackFrame

STEP_NS = NS_PER_S // 10


def walked(
    place: np.ndarray, measured: np.ndarray, confirmed_from: int, delay_s: float = 0.5, place_m: float = 0.1
) -> tuple[list[TrackFrame], list[int]]:
    """Frames of one person (serial 4, id 7), and how many had left after each moment."""
    back, frames, n_left = FixedLagSmoother(delay_s, 1.5), [], []
    last = place[0]
    for k, (here, seen) in enumerate(zip(place, measured, strict=True)):
        last = here if seen else last
        tracks = [Track(7, *last.tolist(), status="confirmed" if seen else "coasting")] if k >= confirmed_from else []
        held = Held(k * STEP_NS, np.array([4]), np.array([seen]), last[None], np.array([place_m**2]), by_id(tracks))
        frames += back.add(held, np.array([7 if k >= confirmed_from else 0]))
        n_left.append(len(frames))
    return frames + back.finish(), n_left


@settings(deadline=None, max_examples=20)
@given(st.lists(st.floats(-2, 2), min_size=4, max_size=4), st.integers(0, 4))
def test_a_steady_walk_is_found_from_the_first_measurement_on_and_through_a_gap(motion: list[float], gap: int) -> None:
    k = np.arange(40)
    place = np.array(motion[:2]) + 0.1 * k[:, None] * np.array(motion[2:])
    measured = (k < 15) | (k >= 15 + gap)
    frames, n_left = walked(place, measured, confirmed_from=3, place_m=1e-3)  # so sure that nothing else counts
    assert [each.stamp_ns for each in frames] == (k * STEP_NS).tolist()
    assert n_left == [max(0, each - 4) for each in k]  # half a second late
    found = [track for frame in frames for track in frame.tracks]
    assert [each.id for each in found] == [7] * 40
    np.testing.assert_allclose([(each.x, each.y) for each in found], place, atol=1e-3)
    np.testing.assert_allclose([(each.vx, each.vy) for each in found], [motion[2:]] * 40, atol=0.02)
    assert [each.status == "confirmed" for each in found] == measured.tolist()


def test_noise_is_averaged_out() -> None:
    rng, k = np.random.default_rng(3), np.arange(200)
    place = np.stack([np.sin(0.05 * k), np.cos(0.05 * k)], axis=1)
    frames, _ = walked(place + 0.1 * rng.standard_normal(place.shape), np.ones(200, bool), 2)
    found = np.array([(each.tracks[0].x, each.tracks[0].y) for each in frames])
    assert np.sqrt(((found - place)[10:-10] ** 2).mean()) < 0.055  # of 0.1


def test_a_tentative_track_that_is_never_confirmed_is_nobody() -> None:
    back, nobody = FixedLagSmoother(0.3, 1.5), np.zeros(1, np.int64)
    frames = []
    for k in range(4):
        held = Held(k * STEP_NS, np.array([0]), np.array([True]), np.zeros((1, 2)), np.full(1, 0.01), {})
        frames += back.add(held, nobody)
    assert all(not frame.tracks for frame in frames + back.finish())


@pytest.mark.parametrize("delay_s", [0.2, 0.5])
def test_who_is_gone_for_longer_than_the_delay_is_told_as_the_tracker_did(delay_s: float) -> None:
    k = np.arange(30)
    place = np.stack([0.1 * k, 0 * k], axis=1)
    frames, _ = walked(place, (k < 10) | (k > 20), 0, delay_s)
    assert [frame.tracks[0].x for frame in frames[15:16]] == [place[9, 0]]  # the tracker's own, kept where it was last


def test_nothing_ever_came() -> None:
    assert FixedLagSmoother(0.5, 1.5).finish() == []


def test_memory_does_not_grow_with_the_people_who_have_gone() -> None:
    smoother, sizes = FixedLagSmoother(0.5, 1.5), []
    for k in range(400):  # a new person every 0.2 s, who stays as long
        serial = np.array([k // 2])
        held = Held(k * STEP_NS, serial, np.array([True]), np.zeros((1, 2)), np.full(1, 0.01), {})
        smoother.add(held, serial + 1)
        sizes.append(len(pickle.dumps(smoother)))
    assert max(sizes[200:]) <= max(sizes[50:100]) + 100
