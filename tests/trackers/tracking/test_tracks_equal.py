"""Tracks and truths that know the same are equal, whatever they do not know."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from trackers.tracks import Track, TrackFrame
from twin.truth.truth_types import PersonTruth


@pytest.mark.parametrize("kind", [Track, PersonTruth])
def test_what_nobody_estimated_is_equal_and_what_differs_is_not(kind: type[Track] | type[PersonTruth]) -> None:
    one = kind(1, 0.5, float("nan"))
    assert one == kind(1, 0.5, float(np.float64(np.nan)))
    assert TrackFrame(0, (Track(1, 0.0, 0.0),)) == TrackFrame(0, (Track(1, 0.0, 0.0, float("nan")),))
    for field in fields(kind):
        if field.name in ("status", "situation", "visible", "feet", "in_area"):
            continue
        assert replace(one, **{field.name: 7.5}) != one
    assert one != (1, 0.5, float("nan"))


def test_equal_tracks_hash_alike() -> None:
    assert len({Track(1, 0.0, 0.0), Track(1, 0.0, 0.0, float("nan")), Track(2, 0.0, 0.0)}) == 2
