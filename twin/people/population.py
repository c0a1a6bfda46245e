"""Everybody in the room, stepped on a fixed clock, with a short memory for sensors that look back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trackers.area import Area
from trackers.errors import InputError
from twin.people.appearance import Appearance
from twin.people.crowd import KEEP_FROM_EDGE_M, Crowd, planar
from twin.people.gait import Gait
from twin.people.pose import FLOOR_ROWS, ROWS, Moment, heel_and_pelvis, joint_coordinates
from twin.people.scripts import first_heading, known_start, random_places, script_of
from twin.people.skeleton import Skeleton
from twin.scenario.people import Person, Stand, Wander

Array = NDArray[np.float64]

TICK_S = 0.025
"""The people's clock [s]; between ticks poses are interpolated."""

HISTORY_S = 3.0
"""How far back poses can be asked for [s]."""

_START_APART_M = 0.7
_BLOCKED_FOR_S = 0.8


@dataclass(frozen=True, eq=False)
class PopulationTruth:
    """Where everybody is at one time, room frame, people in the order of their names.

    x, y, z: the pelvis (middle between the hip joints) [m]; yaw: where the person faces [rad]; vx, vy: velocity of the
    ground point under the pelvis [m/s]; feet: (n, 2, 3) x, y, height of the sole under the left and right ankle, as if
    the foot were flat [m].
    """

    x: Array
    y: Array
    z: Array
    yaw: Array
    vx: Array
    vy: Array
    feet: Array


class Population:
    """The people of a scenario, in the order of their names: so the order of listing changes nothing.

    `advance(t)` steps them; `qpos(t)` and `truth(t)` may be asked for any t from `HISTORY_S` before the last step up to
    it. Memory does not grow with time.
    """

    def __init__(
        self,
        people: Mapping[str, Person],
        area: Array,
        rngs: Mapping[str, np.random.Generator],
        appearances: Mapping[str, Appearance],
        source: str,
    ) -> None:
        """`area` (k, 2) [m]: the polygon in which wanderers stay and starts are drawn; walkers go where they are sent.

        `rngs`: a generator of each person's own; `appearances`: their looks, for the lengths of their legs; `source`:
        what describes them, as errors name it. Known starts must be apart, and a wanderer's inside the area (see
        `twin.placement`). Raises InputError when the area has no room for those who wander.
        """
        self.names = tuple(sorted(people))
        area = np.asarray(area, dtype=float)
        described = [people[name] for name in self.names]
        random = [rngs[name] for name in self.names]
        roams = any(isinstance(person.script, Wander) or person.start is None for person in described)
        inner = _inset(area, source) if roams else area
        position = _starts(self.names, described, inner, random, source)
        heading = np.array(
            [first_heading(*each) for each in zip(described, position, random, strict=True)], dtype=float
        )
        areas = [area if isinstance(person.script, Wander) else None for person in described]
        fixed = np.array([isinstance(person.script, Stand) for person in described], dtype=bool)
        self._scripts = [script_of(person, inner, rng) for person, rng in zip(described, random, strict=True)]
        self._crowd = Crowd(planar(position), heading, areas, fixed)
        self._skeleton = Skeleton([appearances[name].proportions for name in self.names])
        self._gait = Gait(self._skeleton, self._crowd)
        count = len(self.names)
        self._until = np.zeros(count)
        self._blocked_s = np.zeros(count)
        self._may_replan = np.array([isinstance(person.script, Wander) for person in described], dtype=bool)
        self._random = random
        self._gaze = np.zeros(count)
        self._gaze_until = np.zeros(count)
        self._tick = 0
        size = round(HISTORY_S / TICK_S) + 1
        self._floor = np.zeros((size, FLOOR_ROWS, count), dtype=complex)
        self._rows = np.zeros((size, ROWS, count))
        self._remember()

    def __len__(self) -> int:
        return len(self.names)

    def advance(self, t: float) -> None:
        """Step until the clock has reached time t [s] since the start; does nothing where it has already."""
        while self._tick * TICK_S < t:
            self._step()

    def qpos(self, t: float) -> Array:
        """Joint coordinates (n, NQ_PERSON) at time t [s], laid out as `twin.people.body.JOINTS` says."""
        return joint_coordinates(self._moment(t), self._skeleton)

    def truth(self, t: float) -> PopulationTruth:
        """Where everybody is at time t [s]."""
        moment = self._moment(t)
        pelvis, velocity = moment.pelvis, moment.pelvis_velocity
        _, _, height = heel_and_pelvis(moment, self._skeleton)
        feet = np.stack([moment.floor[2:4].real, moment.floor[2:4].imag, moment.rows[9:11]], axis=-1)
        yaw = (moment.rows[0] + np.pi) % (2 * np.pi) - np.pi
        return PopulationTruth(
            pelvis.real, pelvis.imag, height, yaw, velocity.real, velocity.imag, feet.transpose(1, 0, 2)
        )

    def _moment(self, t: float) -> Moment:
        """The moment at time t [s], between the two ticks around it."""
        size = len(self._rows)
        oldest = max(0, self._tick - size + 1)
        place = t / TICK_S
        if not oldest <= place <= self._tick + 1e-6:
            raise ValueError(
                f"t = {t} s is not between {oldest * TICK_S:.2f} and {self._tick * TICK_S:.2f} s: advance(t) first, and "
                f"look back by at most {HISTORY_S} s"
            )
        before = min(int(place), max(self._tick - 1, 0))
        share = place - before
        early, late = before % size, min(before + 1, self._tick) % size
        return Moment(
            self._floor[early] + share * (self._floor[late] - self._floor[early]),
            self._rows[early] + share * (self._rows[late] - self._rows[early]),
        )

    def _remember(self) -> None:
        slot = self._tick % len(self._rows)
        self._floor[slot] = self._gait.moment.floor
        self._rows[slot] = self._gait.moment.rows

    def _step(self) -> None:
        crowd = self._crowd
        t = self._tick * TICK_S
        self._blocked_s = np.where(crowd.blocked(), self._blocked_s + TICK_S, 0.0)
        ended = (t >= self._until) | crowd.arrived() | (self._may_replan & (self._blocked_s > _BLOCKED_FOR_S))
        if ended.any():
            here = np.stack([crowd.place.real, crowd.place.imag], axis=-1)
            for person in np.nonzero(ended)[0]:
                order = self._scripts[person].next_order(t, here[person], np.delete(here, person, axis=0))
                crowd.order(int(person), order)
                self._until[person] = order.until
                self._blocked_s[person] = 0.0
        looks = t >= self._gaze_until
        if looks.any():
            for place in np.nonzero(looks)[0]:
                self._gaze[place] = np.clip(self._random[place].normal(0.0, 0.3), -0.8, 0.8)
                self._gaze_until[place] = t + self._random[place].uniform(0.8, 3.0)
        crowd.step(TICK_S)
        self._gait.step(crowd, self._gaze + 0.25 * crowd.turn_rate, TICK_S)
        self._tick += 1
        self._remember()


def _starts(
    names: tuple[str, ...], people: list[Person], inner: Array, random: list[np.random.Generator], source: str
) -> Array:
    """Ground points (n, 2) [m]: as asked, at the first waypoint, or drawn in `inner` away from everybody placed."""
    places: dict[int, Array] = {}
    for number, person in enumerate(people):
        start = known_start(person)
        if start is not None:
            places[number] = np.array(start, dtype=float)
    for number, name in enumerate(names):
        if number in places:
            continue
        candidates = random_places(inner, 200, random[number])
        if places:
            taken = np.array(list(places.values()))
            clear = np.linalg.norm(candidates[:, None] - taken, axis=-1).min(axis=1) >= _START_APART_M
            candidates = candidates[clear]
        if not len(candidates):
            raise InputError(
                f"{source}: people.{name}: no place in the area is {_START_APART_M} m from everybody else; "
                f"fewer people than {len(people)}, or a larger area, are expected"
            )
        places[number] = candidates[0]
    return np.array([places[number] for number in range(len(people))], dtype=float).reshape(-1, 2)


def _inset(area: Array, source: str) -> Array:
    """The polygon drawn in towards its middle so that a body's middle keeps from the edge; corners (k, 2) [m]."""
    rolled = np.roll(area, -1, axis=0)
    turn = np.sign(np.sum(area[:, 0] * rolled[:, 1] - area[:, 1] * rolled[:, 0]))
    way = rolled - area
    inward = turn * np.stack([-way[:, 1], way[:, 0]], axis=-1) / np.linalg.norm(way, axis=1)[:, None]
    before = np.roll(inward, 1, axis=0)
    margin = KEEP_FROM_EDGE_M + 0.1
    corner = area + margin * (inward + before) / (1 + np.einsum("ki,ki->k", inward, before))[:, None]
    turned = np.einsum("ki,ki->k", np.roll(corner, -1, axis=0) - corner, way) <= 0
    if turned.any() or not Area(area).contains(corner).all():
        raise InputError(
            f"{source}: area: is too narrow to walk in; more than {2 * margin:g} m between its edges is expected"
        )
    return corner
