"""Legs that may initiate a track: a single leg does not, within a stride of somebody else."""

from __future__ import annotations

import numpy as np

from trackers.likelihood.legs import may_be_new

FREE = np.ones(3, np.bool_)


def test_a_single_leg_within_a_stride_of_somebody_known_initiates_none_and_two_legs_do() -> None:
    place = np.array([(0.0, 0.0), (0.0, 1.0), (5.0, 0.0)])
    known = np.array([(0.7, 0.0), (0.7, 1.0)])
    assert may_be_new(place, np.array([True, False, True]), FREE, known, 0.8).tolist() == [False, True, True]


def test_one_leg_shown_twice_in_a_frame_initiates_one_track() -> None:
    place, nobody = np.array([(0.0, 0.0), (0.3, 0.0), (0.6, 0.0)]), np.empty((0, 2))
    single = np.ones(3, np.bool_)
    assert may_be_new(place, single, FREE, nobody, 0.8).tolist() == [True, False, False]
    assert may_be_new(place, ~single, FREE, nobody, 0.8).all()
    beside_a_pair = may_be_new(place, np.array([True, True, False]), FREE, nobody, 0.8)
    assert beside_a_pair.tolist() == [False, False, True]


def test_what_may_not_initiate_a_track_keeps_none_from_it() -> None:
    place, nobody = np.array([(0.0, 0.0), (0.3, 0.0), (0.6, 0.0)]), np.empty((0, 2))
    found = may_be_new(place, np.ones(3, np.bool_), np.array([False, True, True]), nobody, 0.8)
    assert found.tolist() == [False, True, False]
