"""Who is in what situation with whom, by points and tracks."""

import numpy as np

from trackers.filters.gating import linked
from trackers.laser.group import Points
from trackers.laser_vision_learning.situations import SituationOptions, Situations, assessed, situation_names
from trackers.observations import NS_PER_S

OPTIONS = SituationOptions()


def legs(*places) -> np.ndarray:
    """Two legs 0.2 m apart for each of those at `places`, three points a leg."""
    return np.array([(x + 0.1 * side + 0.02 * k, y) for x, y in places for side in (-1, 1) for k in range(3)])


class Sequence:
    """Situations frame by frame at 25 Hz; `unseen` are the indices of who shows no point."""

    def __init__(self):
        self.situations, self.ns, self.unseen_s = Situations.none(np.zeros(0, np.int64)), 0, {}

    def frame(self, *places, unseen=(), frames=1, serial=None, sure=None):
        places = np.array(places, float)
        serial = np.arange(len(places)) if serial is None else np.array(serial)
        for _ in range(frames):
            self.ns += NS_PER_S // 25
            self.unseen_s = {one: self.unseen_s.get(one, 0.0) + 0.04 for one in unseen}
            shown = [k for k in range(len(places)) if k not in unseen]
            points = legs(*places[shown])
            self.situations = assessed(
                self.situations,
                serial,
                places,
                np.ones(len(places), bool) if sure is None else np.array(sure),
                np.array([self.unseen_s.get(k, 0.0) for k in range(len(places))]),
                Points(points, np.full(len(points), 0.03), np.zeros(len(points), np.bool_)),
                np.repeat(shown, 6),
                self.ns,
                OPTIONS,
            )
        return situation_names(self.situations, np.zeros(len(places), bool))


def test_from_apart_to_merged_and_back_with_hysteresis():
    two = Sequence()
    assert two.frame((0, 0), (3, 0)) == ["apart"] * 2
    assert two.frame((0, 0), (1.6, 0)) == ["apart"] * 2
    assert two.frame((0, 0), (1.4, 0)) == ["interacting"] * 2
    assert two.frame((0, 0), (1.6, 0)) == ["interacting"] * 2  # it goes on a little farther than it began
    assert two.frame((0, 0), (0.65, 0)) == ["correlated"] * 2
    assert two.frame((0, 0), (0.5, 0)) == ["merged"] * 2
    assert two.frame((0, 0), (0.9, 0), frames=4) == ["merged"] * 2  # and a merge a little longer
    assert two.frame((0, 0), (0.9, 0), frames=3) == ["interacting"] * 2
    assert two.frame((0, 0), (2.0, 0)) == ["apart"] * 2


def test_who_shows_no_point_beside_somebody_is_merged_with_them_and_who_is_alone_is_not():
    two = Sequence()
    two.frame((0, 0), (0.9, 0), (5, 5))
    assert two.frame((0, 0), (0.9, 0), (5, 5), unseen=(1, 2), frames=2) == ["interacting", "interacting", "apart"]
    assert two.frame((0, 0), (0.9, 0), (5, 5), unseen=(1, 2), frames=3) == ["merged", "merged", "apart"]
    assert two.situations.confused[0, 1]


def test_three_are_one_group_of_which_two_may_go_on():
    three = Sequence()
    three.frame((0, 0), (0.35, 0), (0.7, 0), frames=2)
    assert np.unique(linked(three.situations.confused)).size == 1
    three.frame((0, 0), (0.35, 0), (2.2, 0), frames=8)
    group = linked(three.situations.confused)
    assert group[0] == group[1] != group[2]


def test_merging_at_arms_length_confuses_nobody():
    two = Sequence()
    assert two.frame((0, 0), (0.55, 0)) == ["merged"] * 2
    assert not two.situations.confused.any()
    two.frame((0, 0), (0.35, 0))
    two.frame((0, 0), (0.55, 0))
    assert two.situations.confused.any()  # it lasts as long as the merge


def test_situations_follow_the_tracks():
    """One leaves, one joins: what holds between the others holds on."""
    three = Sequence()
    three.frame((0, 0), (0.35, 0), (5, 0), serial=[3, 7, 8])
    three.frame((5, 0), (0.5, 0), (0, 0), serial=[8, 9, 3])
    kept = three.situations.of(np.array([3, 7, 9]))
    assert kept.merged[0, 2] and not kept.merged[1].any()
    assert not three.situations.of(np.array([3, 8])).confused.any()


def test_tentative_tracks_and_nobody_take_no_part():
    two = Sequence()
    assert two.frame((0, 0), (0.4, 0), sure=[True, False]) == ["apart"] * 2
    empty = Situations.none(np.zeros(0, np.int64))
    nothing = Points(np.zeros((0, 2)), np.zeros(0), np.zeros(0, np.bool_))
    none = np.zeros(0)
    found = assessed(empty, empty.serial, np.zeros((0, 2)), none > 0, none, nothing, none.astype(int), 5, OPTIONS)
    assert situation_names(found, none > 0) == []
