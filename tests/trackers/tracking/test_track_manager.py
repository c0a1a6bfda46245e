"""Confirmation, deletion and re-identification, by the same options for every tracker, at any rate."""

import numpy as np
from hypothesis import given, strategies as st

from trackers.filters.imm import ImmState
from trackers.observations import NS_PER_S
from trackers.tracking.roster import Roster
from trackers.tracking.track_manager import (
    ReidentificationOptions,
    TrackManagementOptions,
    TrackManager,
    reachable,
)

CORNERS = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]
TENTH = NS_PER_S // 10


def states(n: int) -> ImmState:
    return ImmState(np.zeros((4, 1, n)), np.zeros((4, 4, 1, n)), np.ones((1, n)))


def measured_at(*frames: set[int], n: int = 2) -> Roster[ImmState]:
    """n tracks started at 0, those named measured at each tenth of a second that follows."""
    roster = Roster.started(states(n), 0)
    for k, seen in enumerate(frames, start=1):
        roster = roster.measured(np.array(sorted(seen), np.intp), k * TENTH, states(n))
    return roster


def test_a_track_is_confirmed_by_time_and_count_only_while_it_is_measured():
    roster = measured_at({0}, {0}, {0})
    ns = 3 * TENTH
    for confirm_s, hits, expected in ((0.3, 1, True), (0.4, 1, False), (0.3, 4, True), (0.3, 5, False)):
        manager = TrackManager(TrackManagementOptions(confirm_s=confirm_s, confirm_hits=hits), None)
        assert manager.to_confirm(roster, ns, TENTH).tolist() == [expected, False]
        assert not manager.to_confirm(roster, ns + TENTH, TENTH).any()  # not measured then
    assert not TrackManager(TrackManagementOptions(), None).to_confirm(roster, ns, TENTH, confirm_s=0.4).any()


def test_ids_are_given_in_the_order_of_tracks_and_never_twice():
    manager, roster = TrackManager(TrackManagementOptions(), None), Roster.started(states(3), 0)
    roster = manager.confirm(roster, np.array([False, True, False]))
    roster = manager.confirm(roster, np.array([True, False, True]))
    assert roster.id.tolist() == [2, 1, 3] and roster.confirmed.all()


@given(st.integers(0, 40), st.integers(0, 40), st.integers(0, 60))
def test_a_track_is_kept_and_reported_for_as_long_as_the_options_say(coast, report, gap):
    options = TrackManagementOptions(coast_s=coast / 10, tentative_coast_s=0.1, report_s=report / 10)
    manager = TrackManager(options, None)
    roster = manager.confirm(Roster.started(states(2), 0), np.array([True, False]))
    assert manager.lasting(roster, gap * TENTH).tolist() == [gap <= coast, gap <= 1]
    assert manager.reported(roster, gap * TENTH).tolist() == [gap <= report, False]
    always = TrackManager(options.model_copy(update={"report_s": None}), None)
    assert always.reported(roster, gap * TENTH).tolist() == [True, False]


def test_tracks_start_in_the_area_and_clear_of_others():
    manager = TrackManager(TrackManagementOptions(start_apart_m=0.5, area_margin_m=0.2), CORNERS)
    places = np.array([[0.0, 0.0], [0.6, 0.0], [1.1, 0.0], [1.3, 0.0]])
    assert manager.may_start(places, np.array([[0.2, 0.0]])).tolist() == [False, False, True, False]
    assert manager.inside(places).tolist() == [True, True, True, False]
    assert TrackManager(TrackManagementOptions(), None).may_start(places, np.empty((0, 2))).all()


def test_re_identification_reaches_as_far_as_a_person_walks_meanwhile():
    options = ReidentificationOptions(reid_m=0.5, reid_speed_m_s=1.0)
    last, unseen_ns = np.zeros((2, 2)), np.array([0, NS_PER_S])
    places = np.array([[0.4, 0.0], [1.4, 0.0], [1.6, 0.0]])
    assert reachable(last, unseen_ns, places, options).tolist() == [[True, False, False], [True, True, False]]
    assert not reachable(last, unseen_ns, places, ReidentificationOptions(reid_speed_m_s=None)).any()
