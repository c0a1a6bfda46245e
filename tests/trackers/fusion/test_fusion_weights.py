"""Weights on pressure floors in `fusion`: how they are learned, whom they tell, and that no foot is one more person."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from trackers.area import Pose
from trackers.arrays import Array
from trackers.filters.imm import Imm
from trackers.fusion.floor_source import FusedFloor
from trackers.fusion.identity import IdentityMemory
from trackers.fusion.look import Expected, Look
from trackers.fusion.options import ColourIdentityOptions, FusionOptions
from trackers.fusion.person_state import PersonMotion
from trackers.fusion.person_tracks import People
from trackers.fusion.weights import Weights
from trackers.observations import NS_PER_S, FloorFrame
from trackers.rig import FloorSensor

FLOOR = FloorSensor(topic="/floor", room_from_sensor=Pose(xyz=(-2.0, -2.0, 0.0)), rows=20, columns=20, pitch_m=0.2)
COLOURS, NO = np.eye(2), np.zeros(2, np.bool_)
SEATED = 0.2
"""Share of the weight that stays on the feet of who sits on a chair."""


def borne(
    loads_n: list[float],
    rate_hz: float = 10.0,
    start: Weights | None = None,
    from_s: float = 0.0,
    walks: bool = False,
    learns_s: float = 8.0,
) -> Weights:
    """Return the weight of one person after these loads [N]."""
    weights = Weights.unknown(1) if start is None else start
    for number, load_n in enumerate(loads_n):
        ns = round((from_s + number / rate_hz) * NS_PER_S)
        row, place = np.zeros(1, np.intp), np.zeros((1, 2))
        weights = weights.felt(row, np.array([load_n]), place, np.array([walks]), ns, learns_s)
    return weights


def walking(weight_n: float, seconds: float, rate_hz: float = 10.0) -> list[float]:
    """Loads of a walker [N]: 15 % more and less at each step."""
    t = np.arange(0.0, seconds, 1 / rate_hz)
    return (weight_n * (1 + 0.15 * np.sin(2 * np.pi * 1.9 * t))).tolist()


@pytest.mark.parametrize("rate_hz", [5.0, 9.5, 25.0])
@pytest.mark.parametrize("weight_n", [180.0, 600.0, 1100.0])
def test_a_weight_is_learned_from_steps_at_any_rate(weight_n: float, rate_hz: float) -> None:
    learned = borne(walking(weight_n, 6.0, rate_hz), rate_hz)
    assert learned.newtons[0] == pytest.approx(weight_n, rel=0.05)


def test_who_sits_keeps_the_weight_and_is_known_to_sit() -> None:
    stood = borne(walking(800.0, 4.0))
    row = np.zeros(1, np.intp)
    stands, sits, _ = stood.log_postures(row, np.array([800.0]))[0]
    assert stands > sits
    stands, sits, _ = stood.log_postures(row, np.array([SEATED * 800.0]))[0]
    assert sits > stands
    sat = borne([SEATED * 800.0] * 60, start=stood, from_s=4.0)
    assert sat.newtons == stood.newtons and not sat.on_feet(10 * NS_PER_S).any()
    assert (Weights.unknown(1).log_postures(row, np.array([800.0])) == 0).all()


def test_who_was_met_sitting_gets_the_whole_weight_on_rising() -> None:
    met = borne([150.0] * 30)
    risen = borne(walking(800.0, 3.0), start=met, from_s=3.0)
    assert risen.newtons[0] == pytest.approx(800.0, rel=0.06)


def test_who_has_carried_another_one_is_as_light_as_before() -> None:
    carried = borne(walking(1300.0, 3.0), start=borne(walking(700.0, 4.0)), from_s=4.0, walks=True)
    assert carried.newtons[0] == pytest.approx(1300.0, rel=0.08)
    again = borne(walking(700.0, 3.0), start=carried, from_s=7.0, walks=True)
    assert again.newtons[0] == pytest.approx(700.0, rel=0.08)
    assert again.on_feet(10 * NS_PER_S).all()


def test_one_frame_is_no_weight_and_a_weight_that_is_known_stays_so() -> None:
    assert not borne([100.0]).known.any()
    for learns_s in (0.1, 8.0):
        loads = walking(700.0, 4.0)
        assert all(borne(loads[:k], learns_s=learns_s).known.all() for k in range(10, 40))


def test_nothing_makes_people_heavier_but_a_chair_makes_them_lighter() -> None:
    heavy, light = borne(walking(900.0, 4.0)), borne(walking(600.0, 4.0))
    sits = borne([SEATED * 900.0] * 20)
    assert heavy.log_ratio(heavy)[0, 0] > 1 and light.log_ratio(light)[0, 0] > 1
    assert light.log_ratio(heavy)[0, 0] < -4
    assert -1 < heavy.log_ratio(sits)[0, 0] < 0
    assert np.isnan(Weights.unknown(1).log_ratio(heavy)).all() and np.isnan(heavy.log_ratio(Weights.unknown(1))).all()


def people_of(weights_n: list[float], places: Array) -> People:
    """Make people who walked for some seconds at places [m], numbered from 1."""
    people = People.started(Imm(PersonMotion()).start(places, None, 0.1**2), places, 0, 2, 1)
    each = [borne(walking(weight_n, 4.0)) for weight_n in weights_n]
    weights = each[0]
    for more in each[1:]:
        weights = weights.joined(more)
    n = len(places)
    roster = people.roster.changed(id=np.arange(1, n + 1), confirmed=np.ones(n, np.bool_))
    return people.changed(weights=weights, roster=roster, existence=np.full(n, 0.99))


@pytest.mark.parametrize("stale", [True, False])
@pytest.mark.parametrize("swapped", [True, False])
def test_two_who_have_changed_weights_have_changed_places(swapped: bool, stale: bool) -> None:
    """Clothes looked at seconds ago tell nothing of now."""
    identities, people = (
        IdentityMemory(ColourIdentityOptions()),
        people_of([900.0, 500.0], np.array([[0.0, 0], [1.0, 0]])),
    )
    loads = [walking(500.0, 2.0), walking(900.0, 2.0)] if swapped else [walking(900.0, 2.0), walking(500.0, 2.0)]
    if stale:
        people = people.changed(clothes=people.clothes.looked(np.arange(2), COLOURS, people.positions, NO, 0, 8.0))
    for number, load_n in enumerate(np.transpose(loads)):
        people = identities.felt(people, np.arange(2), load_n, round((4.0 + number / 10) * NS_PER_S))
    assert people.roster.id.tolist() == ([2, 1] if swapped else [1, 2])
    assert people.weights.newtons[people.roster.id.argsort()] == pytest.approx([900.0, 500.0], rel=0.06)


@pytest.mark.parametrize(
    ("lies", "load_n", "away_m", "comes_back"),
    [
        (True, 900.0, 0.2, True),
        (True, 160.0, 0.2, True),
        (True, 1300.0, 0.2, False),
        (True, 160.0, 3.0, False),
        (False, 900.0, 3.0, True),
        (False, 160.0, 0.2, False),
    ],
)
def test_who_lay_down_is_reidentified_there_by_what_the_floor_bears(
    lies: bool, load_n: float, away_m: float, comes_back: bool
) -> None:
    """A minute after a person of 900 N lay down in a room of 20 m²: as heavy or sitting there; elsewhere who has walked off."""
    identities, people = IdentityMemory(ColourIdentityOptions(), 20.0), people_of([900.0], np.zeros((1, 2)))
    posture = people.posture.changed(probability=np.array([[0.0, 0.0, 1.0]] if lies else [[1.0, 0.0, 0.0]]))
    identities.remember(people.changed(posture=posture), 4 * NS_PER_S)
    place, now = np.array([[away_m, 0.0]]), 64 * NS_PER_S
    new = People.started(people.state, place, now, 2, 1)
    state = Imm(PersonMotion()).start(place, None, 0.1**2)
    new = new.changed(roster=new.roster.changed(state=state), weights=borne([load_n] * 6, from_s=63.4))
    after, to_confirm = identities.recognized(new, np.ones(1, np.bool_), now)
    assert (after.roster.id.tolist() == [1]) == comes_back == (not to_confirm.any())


def look(loads: dict[tuple[float, float], float], expected: Expected, **others: FloorSensor) -> Look:
    """Look at a floor with loads [N] at places [m]."""
    load_n = np.zeros((FLOOR.rows, FLOOR.columns))
    for (x, y), each in loads.items():
        load_n[np.unravel_index(np.hypot(*(FLOOR.centres - (x, y)).transpose(2, 0, 1)).argmin(), load_n.shape)] += each
    values = np.rint(FLOOR.curve.signal(load_n)).astype(np.uint8)
    source = FusedFloor("floor", {"floor": FLOOR, **others}, [], FusionOptions().floor)
    for name in others:
        source.look({name: FloorFrame(name, 0, np.zeros_like(values))}, expected, 0)
    seen = source.look({"floor": FloorFrame("floor", 0, values)}, expected, 0)
    assert seen is not None
    return seen


def standing(*places: tuple[float, float], weight_n: tuple[float, ...], on_feet: bool = True) -> Expected:
    """Expect people who stand at places [m]."""
    at, n = np.array(places), len(places)
    nothing = np.zeros((n, 2))
    no = np.zeros(n, np.bool_)
    feet = np.full(n, on_feet)
    return Expected(at, np.pad(at, ((0, 0), (0, 1))), nothing, np.zeros(n), nothing, no, np.array(weight_n), feet, ~no)


@pytest.mark.parametrize(
    ("weight_n", "on_feet", "behind_n", "ahead_n", "is_foot"),
    [
        (800.0, True, 100.0, 700.0, True),
        (800.0, True, 800.0, 700.0, False),  # all the weight is there: another person
        (800.0, True, 100.0, 1300.0, False),  # more than that lacks
        (np.nan, True, 100.0, 700.0, False),  # not known
        (800.0, False, 160.0, 640.0, False),  # sits
    ],
)
def test_a_foot_that_comes_down_ahead_is_the_walkers_who_lacks_as_much(
    weight_n: float, on_feet: bool, behind_n: float, ahead_n: float, is_foot: bool
) -> None:
    """0.7 m from where the walker is expected, beyond what a stride explains."""
    expected = standing((0.1, 0.1), weight_n=(weight_n,), on_feet=on_feet)
    seen = look({(0.1, 0.1): behind_n, (0.8, 0.1): ahead_n}, expected)
    assert (seen.starts.max() == 0) == is_foot
    assert not is_foot or (seen.position[seen.owner == 0, 0] > 0.6).all()


def test_loads_of_confirmed_people_are_no_walkers_foot_whether_their_weight_is_known_or_not() -> None:
    for weight_n, load_n in ((np.nan, 700.0), (700.0, 150.0)):
        expected = standing((0.1, 0.1), (0.9, 0.1), weight_n=(800.0, weight_n))
        expected = replace(expected, on_feet=np.array([True, False]))
        seen = look({(0.1, 0.1): 100.0, (0.9, 0.1): load_n}, expected)
        np.testing.assert_allclose(seen.position[seen.owner == 1], [[0.9, 0.1]], atol=0.1)
        tentative = replace(expected, confirmed=np.array([True, False]))
        seen = look({(0.1, 0.1): 100.0, (0.9, 0.1): 700.0}, tentative)
        assert not (seen.owner == 1).any() and seen.position[seen.owner == 0, 0] > 0.6


def test_feet_do_not_depend_on_the_order_of_tracks() -> None:
    places, loads = [(0.1, 0.1), (0.5, 1.3)], {(0.1, 0.1): 80.0, (0.5, 1.3): 90.0, (0.7, 0.5): 700.0}
    seen = look(loads, standing(*places, weight_n=(800.0, 760.0)))
    other = look(loads, standing(*places[::-1], weight_n=(760.0, 800.0)))
    found = [look.position[look.owner.argsort()] for look in (seen, other)]
    np.testing.assert_allclose(found[0], found[1][::-1])


def test_who_has_left_the_floor_lacks_nothing_of_it() -> None:
    """A person steps onto the floor beside one who has just left it: another one."""
    for x, is_new in ((-2.2, True), (-0.8, False)):
        assert (look({(-1.5, 0.1): 700.0}, standing((x, 0.1), weight_n=(800.0,))).starts.max() > 0) == is_new


@pytest.mark.parametrize("hidden", [True, False])
def test_a_load_that_another_person_lacks_is_no_evidence_of_one_more_there(hidden: bool) -> None:
    """Both are expected about one person's two feet; with the load of two, both are there."""
    expected = standing((0.1, 0.1), (0.5, 0.1), weight_n=(800.0, 700.0))
    expected = replace(expected, on_feet=np.array([True, not hidden]))
    alone = look({(0.1, 0.1): 500.0, (0.5, 0.1): 300.0}, expected)
    both = look({(0.1, 0.1): 800.0, (0.5, 0.1): 700.0}, expected)
    assert alone.evidence is not None and both.evidence is not None
    assert (alone.evidence[alone.owner == 1] < 0).all()
    assert both.evidence[both.owner == 1] == 1


def test_the_weight_is_of_who_is_alone_and_all_on_the_floor() -> None:
    def known(*places: tuple[float, float]) -> list[bool]:
        seen = look(dict.fromkeys(places, 700.0), standing(*places, weight_n=(np.nan,) * len(places)))
        assert seen.load_n is not None
        return (~np.isnan(seen.load_n)).tolist()

    assert known((0.1, 0.1)) == [True]
    assert known((0.1, 0.1), (0.5, 0.1)) == [False, False]
    assert known((0.1, 0.1), (1.5, 0.1)) == [True, True]
    assert known((-1.9, 0.1)) == [False]
    at = (-1.7, 0.1)
    assert known(at) == [True]
    beside = FLOOR.model_copy(update={"room_from_sensor": Pose(xyz=(-6.0, -2.0, 0.0))})
    seen = look({at: 700.0}, standing(at, weight_n=(np.nan,)), beside=beside)  # which may bear a foot
    assert seen.load_n is not None and np.isnan(seen.load_n).all()
