"""Everybody in the room, stepped on a fixed clock, with a short memory for sensors that look back."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trackers.arrays import Array, Mask
from twin.instant.feet import Feet, on_the_floor
from twin.people.body.appearance import Appearance
from twin.people.body.skeleton import Skeleton
from twin.people.crowd.crowd import Crowd, planar
from twin.people.crowd.ground import Ground
from twin.people.crowd.order import End
from twin.people.gait.gait import GRAVITY_M_S2, Gait
from twin.people.gait.pose import HEADING, Moment, foot_loads, joint_coordinates
from twin.people.posture.gaze import FreeGaze
from twin.people.posture.lay import apply
from twin.people.posture.measures import BodyMeasures
from twin.people.posture.memory import TICK_S, Memory
from twin.people.posture.posture import Part, Postures
from twin.people.posture.rows import HANDS, LOOK, OFF_FEET, PELVIS_PITCH, active, faced
from twin.people.posture.weight import pressure_shift_m, support
from twin.people.script.actions import perform
from twin.people.script.actor import Actor, Stage
from twin.people.script.arrivals import first_heading, start_places
from twin.people.script.recorded import RecordedPaths
from twin.scenario.behaviour import Path, Wander
from twin.scenario.people import Person

_ENTER_APART_M = 0.7
_BLOCKED_FOR_S = 0.8
_NEAR_ENOUGH_M, _HALTS_FOR_S = 0.2, 1.5


@dataclass(frozen=True, eq=False)
class PopulationTruth:
    """Where everybody is at one time, room frame, people in the order of their names.

    present: who is in the room, (n,); x, y, z: the pelvis (middle between the hip joints) [m]; yaw: where the person faces,
    for somebody who lies on the back where the feet point [rad]; vx, vy: velocity of the ground point under the pelvis
    [m/s].
    """

    present: Mask
    x: Array
    y: Array
    z: Array
    yaw: Array
    vx: Array
    vy: Array


class Population:
    """The people of a scenario, in the order of their names: so the order of listing changes nothing.

    `advance(t)` steps them; `qpos(t)`, `feet(t)` and `truth(t)` may be asked for any t from `memory.HISTORY_S` before the last
    step up to it. Memory does not grow with time.
    """

    def __init__(
        self,
        people: Mapping[str, Person],
        ground: Ground,
        rngs: Mapping[str, np.random.Generator],
        appearances: Mapping[str, Appearance],
        measures: BodyMeasures,
        source: str,
    ) -> None:
        """`ground`: where people may walk and what stands there; `rngs`: a generator of each person's own;
        `appearances`: their looks, for their proportions and mass; `measures`: those of their bodies, in the order of
        their names; `source`: what describes them, as errors name it.

        Known starts must be apart, and a wanderer's inside the area (see `twin.world.placement`). Raises InputError when the
        area has no room for those who wander.
        """
        self.names = tuple(sorted(people))
        described = [people[name] for name in self.names]
        random = [rngs[name] for name in self.names]
        count = len(self.names)
        position = start_places(self.names, described, ground, random, source)
        heading = np.array([first_heading(*each) for each in zip(described, position, random, strict=True)], float)
        areas = [_kept_in(person, ground) for person in described]
        self._crowd = Crowd(planar(position), heading, areas, np.zeros(count, dtype=bool), ground.obstacles)
        self._skeleton = Skeleton([appearances[name].proportions for name in self.names])
        self._weight_n = GRAVITY_M_S2 * np.array([appearances[name].mass_kg for name in self.names], dtype=float)
        self._gait = Gait(self._skeleton, self._crowd)
        self._measures = measures
        self._postures = Postures(self._measures, self._crowd.place, self._crowd.heading)
        self._stage = Stage(self.names, self._crowd, self._postures, ground, doing=["stand"] * count)
        self._acting = [
            perform(Actor(self._stage, number, random[number]), person.script)
            for number, person in enumerate(described)
        ]
        self._recorded = RecordedPaths(
            {
                number: person.script[0]
                for number, person in enumerate(described)
                if person.script and isinstance(person.script[0], Path)
            },
            TICK_S,
        )
        self._arrive_s = np.array([person.arrive_s for person in described], dtype=float)
        self._arrive_s[self._recorded.numbers] = np.inf  # they come with their paths
        self._gaze = FreeGaze(random)
        self._entered = np.zeros(count, dtype=bool)
        self._everybody_came = count == 0
        self._begun = np.zeros(count, dtype=bool)
        self._until = np.zeros(count)
        self._done: dict[int, Callable[[], bool]] = {}
        self._blocked_s, self._halts_s = np.zeros(count), np.zeros(count)
        self._crowd.present[:] = False
        self._crowd.driven[self._recorded.numbers] = True
        self._tick = 0
        self._memory = Memory(count)
        self._asked: tuple[float, int, Array] | None = None  # time, tick and coordinates last asked for
        self._enter_and_leave()
        self._remember()

    def __len__(self) -> int:
        return len(self.names)

    @property
    def in_use(self) -> dict[str, str]:
        """By person, the seat or bed that they sit or lie on, are about to, or have just left, as of the last step."""
        return {self.names[number]: furniture for furniture, number in self._stage.taken.items()}

    @property
    def doing(self) -> tuple[str, ...]:
        """The kind of action that each is at, as of the last step, in the order of the names."""
        return tuple(self._stage.doing)

    def holds_posture(self) -> Mask:
        """Who sits, lies, bends or reaches and has got there, as of the last step, (n,)."""
        parts: tuple[Part, ...] = ("body", "bend", "reach")
        held = self._postures.rows[[OFF_FEET, PELVIS_PITCH, HANDS, HANDS + 4]].any(axis=0)
        done = [all(self._postures.done(number, part) for part in parts) for number in range(len(self))]
        return np.asarray(held, dtype=bool) & np.array(done, dtype=bool)

    def looks(self) -> Mask:
        """Who keeps the head turned to somebody, to a place or by an angle, as of the last step, (n,)."""
        return self._postures.rows[LOOK] == 1.0

    def advance(self, t: float) -> None:
        """Step until the clock has reached time t [s] since the start; does nothing where it has already."""
        while self._tick * TICK_S < t:
            self._step()

    def present(self, t: float) -> Mask:
        """Who is in the room at time t [s], (n,)."""
        return self._memory.present(t)

    def qpos(self, t: float) -> Array:
        """Joint coordinates (n, NQ_PERSON) at time t [s], laid out as `twin.people.body.body.JOINTS` says.

        Those who are not present have the coordinates of when they were, or will be.
        """
        if self._asked is None or self._asked[:2] != (t, self._tick):
            self._asked = t, self._tick, self._coordinates(*self._memory.at(t))
        return self._asked[2].copy()

    def feet(self, t: float) -> Feet:
        """Everybody's soles and the weight on them at time t [s]."""
        moment, posture = self._memory.at(t)
        present = self.present(t)
        feet = foot_loads(moment, self._skeleton)
        on_feet, acceleration = support(posture)
        load = on_the_floor(feet.load, feet.height)
        load_n = load * (on_feet * np.maximum(1.0 + acceleration / GRAVITY_M_S2, 0.0) * self._weight_n)
        return Feet(
            place=np.stack([feet.place.real, feet.place.imag], axis=-1).transpose(1, 0, 2),
            yaw=feet.yaw.T,
            height=feet.height.T,
            load_n=np.where(present, load_n, 0.0).T,
            pressure_ahead_m=(feet.pressure_ahead + pressure_shift_m(posture)).T,
            present=present,
        )

    def truth(self, t: float) -> PopulationTruth:
        """Where everybody is at time t [s]."""
        moment, posture = self._memory.at(t)
        qpos = self.qpos(t)
        velocity = moment.pelvis_velocity + self._posture_velocity(t)
        yaw = (faced(moment.rows[HEADING], posture) + np.pi) % (2 * np.pi) - np.pi
        x, y, z = qpos[:, :3].T.copy()
        return PopulationTruth(self.present(t), x, y, z, yaw, velocity.real, velocity.imag)

    def _coordinates(self, moment: Moment, posture: Array) -> Array:
        return apply(joint_coordinates(moment, self._skeleton), posture, self._measures)

    def _posture_velocity(self, t: float) -> NDArray[np.complex128]:
        """What sitting down, bending and the like add to the velocity of the ground point under the pelvis, (n,) [m/s]."""
        around = self._memory.ticks_around(t)
        if not any(len(active(posture)) for _, posture in around):
            return np.zeros(len(self), dtype=complex)
        ends = []
        for moment, posture in around:
            qpos = self._coordinates(moment, posture)
            ends.append(qpos[:, 0] + 1j * qpos[:, 1] - moment.pelvis)
        return (ends[1] - ends[0]) / TICK_S

    def _remember(self) -> None:
        self._memory.remember(self._gait.moment, self._postures.rows, self._crowd.present)

    def _step(self) -> None:
        crowd, stage, postures = self._crowd, self._stage, self._postures
        stage.t = t = self._tick * TICK_S
        stage.end_looks()
        self._order(t)
        if len(self._recorded.numbers):
            place, velocity = crowd.place.copy(), crowd.velocity.copy()
            place[self._recorded.numbers], velocity[self._recorded.numbers] = self._recorded.at(self._tick + 1)
            crowd.drive(place, velocity)
        gaze = self._gaze.at(t) + 0.25 * crowd.turn_rate
        crowd.step(TICK_S)
        postures.step(crowd.place, crowd.heading, TICK_S)
        self._gait.step(crowd, gaze, TICK_S, still=~postures.may_walk())
        self._tick += 1
        self._enter_and_leave()
        self._remember()

    def _order(self, t: float) -> None:
        """Give everybody whose order has ended the next one of their script."""
        crowd = self._crowd
        # who is kept from the last few centimetres, by somebody who stands there, has arrived
        self._halts_s = (self._halts_s + TICK_S) * crowd.halting(_NEAR_ENOUGH_M)
        arrived = crowd.arrived() | (self._halts_s > _HALTS_FOR_S)
        self._blocked_s = (self._blocked_s + TICK_S) * crowd.blocked()
        blocked = self._blocked_s > _BLOCKED_FOR_S
        taken = crowd.taken()
        ended = (arrived | blocked | taken | (t >= self._until)) & crowd.present
        for person, done in self._done.items():
            ended[person] |= bool(crowd.present[person]) and done()
        if not ended.any():
            return
        for person in map(int, np.flatnonzero(ended)):
            end: End = "arrived" if arrived[person] else "taken" if taken[person] else "time"
            if end == "time" and blocked[person]:
                end = "blocked"
            done = self._done.pop(person, None)
            if done is not None and done():
                end = "done"
            acting = self._acting[person]
            order = acting.send(end) if self._begun[person] else next(acting)
            self._begun[person] = True
            crowd.order(person, order)
            self._until[person] = order.until
            self._blocked_s[person] = self._halts_s[person] = 0.0
            if order.done is not None:
                self._done[person] = order.done

    def _enter_and_leave(self) -> None:
        """Let those in whose time has come, and take out those who are gone."""
        crowd, tick = self._crowd, self._tick
        leaving = self._stage.leaving
        if leaving:
            crowd.present[list(leaving)] = False
            self._stage.gone |= leaving
            leaving.clear()
        if not len(self._recorded.numbers) and self._everybody_came:
            return
        entering = []
        for person in map(int, np.flatnonzero(~self._entered & (self._arrive_s <= tick * TICK_S))):
            apart = np.abs(crowd.place - crowd.place[person])[crowd.present]
            # whoever stands in the doorway is waited for
            if tick == 0 or not (apart < _ENTER_APART_M).any():
                crowd.enter(person, complex(crowd.place[person]), float(crowd.heading[person]))
                entering.append(person)
        recorded = self._recorded
        there = recorded.there(tick)
        crowd.present[recorded.numbers[~there]] = False
        self._stage.gone.update(recorded.numbers[tick > recorded.last].tolist())
        new = there & ~crowd.present[recorded.numbers]
        if new.any():
            place, velocity = recorded.at(tick)
            for row in np.flatnonzero(new):
                person = int(recorded.numbers[row])
                fast = abs(velocity[row]) > 0.05
                heading = float(np.angle(velocity[row])) if fast else float(crowd.heading[person])
                crowd.enter(person, complex(place[row]), heading, complex(velocity[row]))
                entering.append(person)
        if entering:
            self._entered[entering] = True
            self._everybody_came = bool(self._entered.all())
            who = np.zeros(len(self), dtype=bool)
            who[entering] = True
            self._gait.place_anew(who, crowd)


def _kept_in(person: Person, ground: Ground) -> Array | None:
    """The polygon (k, 2) [m] that a person does not leave: wanderers the tracked area, others the walkable one."""
    if person.script and isinstance(person.script[0], Path):
        return None
    only_wanders = all(isinstance(action, Wander) for action in person.script)
    return ground.area if only_wanders and person.script else ground.walkable
