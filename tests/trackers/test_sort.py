"""The plain baseline, by itself: how it expects people to go on."""

from __future__ import annotations

import numpy as np
import pytest
from synthetic_room import empty_room, observe, rig, straight_walk

from trackers.sort import Sort
from trackers.tracks import track_frames

SPEED_M_S = 0.9


def told():
    """Somebody walks for two seconds, then nothing shows them; nobody else is there."""
    on = rig(camera=False)
    seen = observe(straight_walk([(-1.5, 1.5)], [(SPEED_M_S, 0.0)], 20), 5, images=False)
    unseen = observe(straight_walk([(9.0, 9.0)], [(0.0, 0.0)], 25), 5, images=False)[len(seen) :]
    return list(track_frames(Sort(on, empty_room(np.random.default_rng(1))), on, [*seen, *unseen]))


def test_who_is_in_sight_goes_on_and_who_is_missed_is_likelier_to_stop():
    frames = [frame.tracks for frame in told()]
    in_sight = [each.vx for tracks in frames[8:20] for each in tracks]
    assert np.mean(in_sight) == pytest.approx(SPEED_M_S, rel=0.12)
    coasting = [each.vx for tracks in frames[20:] for each in tracks]
    assert 0 < coasting[-1] < 0.7 * in_sight[-1]
    assert all(each.status == "coasting" for tracks in frames[20:] for each in tracks)
