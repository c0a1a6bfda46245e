"""Identities in `fusion`: who comes out of hiding, who comes back, and two tracks that have changed people."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from trackers.filters.imm import Imm
from trackers.fusion.identity import IdentityMemory
from trackers.fusion.options import ColourIdentityOptions
from trackers.fusion.person_state import PersonMotion
from trackers.fusion.person_tracks import People
from trackers.observations import NS_PER_S

COLOURS = np.eye(3)
"""Histograms that share no bin."""
LOOK_NS = NS_PER_S // 10


def people_at(*places: tuple[float, float], ids: tuple[int, ...], ns: int = 0) -> People:
    """Make tracks that begin at stamp ns at places [m]; those of id 0 are tentative."""
    at = np.array(places)
    people = People.started(Imm(PersonMotion()).start(at, None, 0.1**2), at, ns, len(COLOURS), 1)
    roster = people.roster.changed(id=np.array(ids), confirmed=np.array(ids) > 0)
    return people.changed(existence=np.full(len(at), 0.99), roster=roster)


def looked(identities: IdentityMemory, people: People, colours: list[int], looks: int, ns: int) -> tuple[People, int]:
    """Look at everybody several times, whose clothes have these colours; return people and the stamp after."""
    for _ in range(looks):
        people = people.changed(roster=people.roster.changed(measured_ns=np.full(len(people), ns)))
        people = identities.looked(people, np.arange(len(people)), COLOURS[colours], ns)
        ns += LOOK_NS
    return people, ns


@pytest.mark.parametrize(
    ("sigma_m", "clothes", "goes_on"),
    [
        (0.1, None, False),
        (0.3, None, True),
        (0.1, [0, 0], True),
        (0.3, [0, 1], False),
    ],
)
def test_a_new_track_is_a_hidden_person_who_may_have_come_there_and_looks_so(
    sigma_m: float, clothes: list[int] | None, goes_on: bool
) -> None:
    """0.6 m from where a person is hidden, known to 0.1 m or 0.3 m: the clothes tell whom another person comes up as."""
    identities, now = IdentityMemory(ColourIdentityOptions()), NS_PER_S
    people = people_at((0.0, 0.0), (0.6, 0.0), ids=(7, 0))
    if clothes is not None:
        people, _ = looked(identities, people, clothes, 1, 0)
    state = people.state
    known = replace(state, covariance=state.covariance * np.array([(sigma_m / 0.1) ** 2, 1.0]))
    people = people.changed(roster=people.roster.changed(state=known, measured_ns=np.array([0, now])))
    after, to_confirm = identities.recognized(people, np.array([False, True]), now)
    assert after.roster.id.tolist() == ([7] if goes_on else [7, 0])
    assert to_confirm.any() != goes_on


@pytest.mark.parametrize(
    ("away_s", "moved_m", "colour", "options", "comes_back"),
    [
        (5.0, 2.0, 0, {}, True),
        (5.0, 2.0, 1, {}, False),
        (5.0, 2.0, None, {}, False),
        (1.0, 9.0, 0, {}, False),
        (20.0, 9.0, 0, {}, True),
        (20.0, 9.0, 0, {"recall_s": 15.0}, False),
        (5.0, 2.0, 0, {"recall_s": 0.0}, False),
        (5.0, 2.0, 0, {"gate": 0.0}, False),
    ],
)
def test_who_has_left_is_known_again_by_clothes_where_one_can_have_walked_to(
    away_s: float, moved_m: float, colour: int | None, options: dict[str, float], comes_back: bool
) -> None:
    identities = IdentityMemory(ColourIdentityOptions(**options))
    people, ns = looked(identities, people_at((0.0, 0.0), ids=(7,)), [0], 5, 0)
    identities.remember(people, ns)
    now = ns + round(away_s * NS_PER_S)
    people = people_at((moved_m, 0.0), ids=(0,), ns=now)
    if colour is not None:
        people, _ = looked(identities, people, [colour], 1, now)
    after, to_confirm = identities.recognized(people, np.array([True]), now)
    assert after.roster.id.tolist() == ([7] if comes_back else [0])
    assert to_confirm.all() != comes_back
    again, _ = identities.recognized(people, np.array([True]), now)
    assert again.roster.id.tolist() == [0], "nobody comes back twice"


@pytest.mark.parametrize(
    ("existence", "looked_on_s", "moved_m", "colour", "comes_back"),
    [
        (0.1, 0.0, 1.0, 0, True),
        (0.1, 0.5, 1.0, 0, True),
        (0.1, 3.0, 1.0, 0, False),
        (0.1, 0.0, 30.0, 0, False),
        (0.1, 0.0, 1.0, 1, False),
        (0.9, 0.0, 1.0, 0, False),
    ],
)
def test_who_was_lost_and_confirmed_anew_unseen_is_known_again_once_looked_at(
    existence: float, looked_on_s: float, moved_m: float, colour: int, comes_back: bool
) -> None:
    """Unless the first track was looked at long after the second began, for then they are two, or was followed out."""
    identities = IdentityMemory(ColourIdentityOptions())
    people, born_ns = looked(identities, people_at((0.0, 0.0), ids=(7,)), [0], 10, 0)
    people, ns = looked(identities, people, [0], round(looked_on_s * NS_PER_S / LOOK_NS), born_ns)
    identities.remember(people.changed(existence=np.array([existence])), ns)
    new, none = people_at((moved_m, 0.0), (2 * moved_m, 0.0), ids=(8, 9), ns=born_ns), np.zeros(2, np.bool_)
    for _ in range(5):
        new, ns = looked(identities, new, [colour, 2], 1, ns)
        new, _ = identities.recognized(new, none, ns - LOOK_NS)
        assert new.roster.id.tolist() == [7 if comes_back else 8, 9]


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 0, 1)])
def test_identities_change_places_once_clothes_say_so_and_not_by_one_look(order: tuple[int, ...]) -> None:
    """Two of three people exchange their tracks behind each other: whoever wears a colour has its number, in any order."""
    identities, where = IdentityMemory(ColourIdentityOptions()), np.array([(0.0, 0.0), (1.0, 0.0), (5.0, 0.0)])
    people = people_at(*where[list(order)].tolist(), ids=tuple(k + 1 for k in order))
    people, ns = looked(identities, people, list(order), 20, 0)
    changed = [{0: 1, 1: 0, 2: 2}[k] for k in order]
    people, ns = looked(identities, people, changed, 1, ns)
    assert people.roster.id.tolist() == [k + 1 for k in order]
    people, ns = looked(identities, people, changed, 9, ns)
    assert people.roster.id.tolist() == [k + 1 for k in changed]
    stays, _ = looked(identities, people, changed, 20, ns)
    assert stays.roster.id.tolist() == [k + 1 for k in changed]


def test_a_track_that_has_gone_over_to_somebody_who_had_left_takes_that_number() -> None:
    """And who was followed before has left, and is known again."""
    identities = IdentityMemory(ColourIdentityOptions())
    people, ns = looked(identities, people_at((0.0, 0.0), (1.0, 0.0), ids=(1, 2)), [0, 1], 20, 0)
    identities.remember(people.select(np.array([1])), ns)
    people, ns = looked(identities, people.select(np.array([0])), [1], 10, ns)
    assert people.roster.id.tolist() == [2]
    new, _ = looked(identities, people_at((0.5, 0.0), ids=(0,), ns=ns), [0], 1, ns)
    after, _ = identities.recognized(new, np.array([True]), ns)
    assert after.roster.id.tolist() == [1]


def test_a_person_of_unknown_weight_or_stature_does_not_keep_those_of_another() -> None:
    """Two exchange their tracks by their clothes: the floor had felt one alone."""
    identities = IdentityMemory(ColourIdentityOptions())
    people, ns = looked(identities, people_at((0.0, 0.0), (1.0, 0.0), ids=(1, 2)), [0, 1], 20, 0)
    weights, row, place = people.weights, np.array([0]), np.zeros((1, 2))
    for felt_ns in range(0, ns, LOOK_NS):
        weights = weights.felt(row, np.array([900.0]), place, np.zeros(1, np.bool_), felt_ns, 8.0)
    people = people.changed(weights=weights, stature_m=np.array([1.9, np.nan]))
    people, _ = looked(identities, people, [1, 0], 10, ns)
    assert people.roster.id.tolist() == [2, 1]
    assert people.weights.newtons[1] == pytest.approx(900.0) and people.stature_m[1] == 1.9
    assert np.isnan(people.weights.newtons[0]) and np.isnan(people.stature_m[0])


@pytest.mark.parametrize(("learns_s", "is_kept"), [(8.0, True), (0.1, False)])
def test_clothes_that_nobody_else_wears_are_learned_as_the_light_changes(learns_s: float, is_kept: bool) -> None:
    """After a second in another colour a slow reference is still rather the old one, a fast one is not."""
    identities = IdentityMemory(ColourIdentityOptions(learns_s=learns_s))
    people, ns = looked(identities, people_at((0.0, 0.0), ids=(1,)), [0], 20, 0)
    people, _ = looked(identities, people, [2], 10, ns)
    assert people.roster.id.tolist() == [1]
    assert (people.clothes.reference[0] @ COLOURS[0] > 0.5) == is_kept


def test_a_track_that_looks_like_another_one_which_still_looks_so_keeps_its_person() -> None:
    """Its clothes are then others than those learned, as in another light: the other one has not changed its person."""
    identities = IdentityMemory(ColourIdentityOptions())
    people, ns = looked(identities, people_at((0.0, 0.0), (1.0, 0.0), ids=(1, 2)), [0, 1], 20, 0)
    people, _ = looked(identities, people, [1, 1], 20, ns)
    assert people.roster.id.tolist() == [1, 2]


@pytest.mark.parametrize(("apart_m", "change"), [(1.0, True), (9.0, False)])
def test_tracks_change_people_only_as_far_as_these_can_have_walked(apart_m: float, change: bool) -> None:
    identities = IdentityMemory(ColourIdentityOptions())
    people, ns = looked(identities, people_at((0.0, 0.0), (apart_m, 0.0), ids=(1, 2)), [0, 1], 20, 0)
    people, _ = looked(identities, people, [1, 0], 10, ns)
    assert (people.roster.id.tolist() == [2, 1]) == change


def test_the_same_clothes_change_nothing() -> None:
    identities = IdentityMemory(ColourIdentityOptions())
    people, _ = looked(identities, people_at((0.0, 0.0), (0.3, 0.0), ids=(1, 2)), [0, 0], 60, 0)
    assert people.roster.id.tolist() == [1, 2]


@pytest.mark.parametrize("side_by_side", [True, False])
def test_two_who_were_measured_side_by_side_are_two(side_by_side: bool) -> None:
    """In the same clothes: the first, at whom no camera looked since then, is hidden beside the second."""
    identities = IdentityMemory(ColourIdentityOptions())
    people, ns = looked(identities, people_at((0.0, 0.0), (0.3, 0.0), ids=(1, 2)), [0, 0], 1, 0)
    born = people.roster.changed(born_ns=np.array([0, NS_PER_S]))
    now, last_ns = 10 * NS_PER_S, 9 * NS_PER_S if side_by_side else ns
    clothes = people.clothes.changed(looked_ns=np.array([0, now]))
    people = people.changed(clothes=clothes, roster=born.changed(measured_ns=np.array([last_ns, now])))
    after, _ = identities.recognized(people, np.zeros(2, np.bool_), now)
    assert after.roster.id.tolist() == ([1, 2] if side_by_side else [1])


@pytest.mark.parametrize("by", ["place", "weight"])
@pytest.mark.parametrize("side_by_side", [True, False])
def test_two_whom_no_camera_sees_are_two_if_they_were_measured_side_by_side(side_by_side: bool, by: str) -> None:
    """The second is about to be confirmed, as heavy as the first, three seconds after it began."""
    identities, now = IdentityMemory(ColourIdentityOptions()), 5 * NS_PER_S
    last_ns = round(4.7 * NS_PER_S) if side_by_side else NS_PER_S
    people = people_at((0.0, 0.0), (0.3, 0.0), ids=(1, 0))
    roster = people.roster.changed(born_ns=np.array([0, 2 * NS_PER_S]), measured_ns=np.array([last_ns, now]))
    people, weights, no = people.changed(roster=roster), people.weights, np.zeros(1, np.bool_)
    for row, from_ns, to_ns in ((0, 0, last_ns), (1, 2 * NS_PER_S, now)):
        for ns in range(from_ns, to_ns + 1, LOOK_NS) if by == "weight" else ():
            weights = weights.felt(np.array([row]), np.array([800.0]), people.positions[[row]], no, ns, 8.0)
    after, _ = identities.recognized(people.changed(weights=weights), np.array([False, True]), now)
    assert after.roster.id.tolist() == ([1, 0] if side_by_side else [1])
