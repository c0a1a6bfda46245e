"""A roster around any batch of states, and the rules of a track's life."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st

from trackers.filters.imm import Imm
from trackers.filters.particle import Cloud, LogWeights
from trackers.tracking import track_manager
from trackers.tracking.roster import Roster

NS = 1_000_000_000


def imm_states(places: np.ndarray):
    return Imm().start(np.stack([places, places], axis=1))


def clouds(places: np.ndarray):
    return Cloud.of(np.repeat(places[None, :, None], 4, axis=2))


def weights(places: np.ndarray):
    return LogWeights.of(np.log([[1.0, 2.0 + place] for place in places]).reshape(-1, 2))


def rows(batch) -> np.ndarray:
    """What stands in a batch, a row a target."""
    if isinstance(batch, Cloud):
        return batch.state[0]
    return batch.log if isinstance(batch, LogWeights) else batch.mean[0].T


@pytest.mark.parametrize("make", [imm_states, clouds, weights])
@given(kept=st.lists(st.booleans(), min_size=5, max_size=5))
def test_any_batch_of_states_is_chosen_from_joined_and_overwritten_with_its_roster(make, kept):
    roster = Roster.started(make(np.arange(5.0)), 7)
    mask = np.array(kept)
    chosen, others = roster.select(mask), roster.select(~mask)
    assert len(chosen) == len(chosen.state) == sum(kept)
    both = chosen.joined(others)
    order = np.concatenate([mask.nonzero()[0], (~mask).nonzero()[0]])
    assert (rows(both.state) == rows(roster.state)[order]).all()
    swapped = roster.state.replaced(np.array([0, 1]), roster.state.select(np.array([1, 0])))
    assert (rows(swapped) == rows(roster.state)[[1, 0, 2, 3, 4]]).all()


def test_ids_are_given_at_confirmation_and_never_twice():
    roster = Roster.started(imm_states(np.arange(3.0)), 0)
    first = roster.confirm(np.array([0, 2]), 5)
    assert first.id.tolist() == [5, 0, 6]
    assert first.confirmed.tolist() == [True, False, True]
    assert roster.id.tolist() == [0, 0, 0]


@given(st.integers(1, 400))
def test_a_decimal_period_is_as_long_as_it_says(k):
    """In floating point 0.1 k - 0.1 (k - 3) is not 0.3 for most k, which used to need a tolerance."""
    roster = Roster.started(imm_states(np.arange(1.0)), k * NS // 10).confirm(np.array([0]), 1)
    assert track_manager.coasting_within(roster, (k + 3) * NS // 10, 0.3, 0.0).all()
    assert not track_manager.coasting_within(roster, (k + 3) * NS // 10 + 1, 0.3, 0.0).any()


def test_tentative_tracks_coast_less():
    roster = Roster.started(imm_states(np.arange(2.0)), 0).confirm(np.array([0]), 1)
    assert track_manager.coasting_within(roster, NS, 1.5, 0.15).tolist() == [True, False]


def test_nobody_starts_on_somebody():
    places, bodies = np.array([[0.0, 0.0], [1.0, 0.0]]), np.array([[9.0, 0.0], [0.3, 0.0]])
    assert track_manager.clear_of(places, bodies, 0.45).tolist() == [False, True]
    assert track_manager.clear_of(places, bodies, np.array([0.2, 0.8])).tolist() == [True, False]
    assert track_manager.clear_of(places, np.empty((0, 2)), 0.45).tolist() == [True, True]
