"""People in the room, stepped on a fixed clock, with a short history for sensors that look back.

Their starts, times and speeds are randomized by the scenario's seed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from math import dist
from typing import Any

import numpy as np

from trackers.arrays import Array, Mask
from twin.people.body.appearance import BodyAppearance
from twin.people.crowd.bases import MovingBases
from twin.people.crowd.crowd import Crowd, planar
from twin.people.crowd.ground import Ground, entry_place
from twin.people.crowd.motion_command import End
from twin.people.gait.gait import Gait
from twin.people.poses import PopulationMotion, Poses, Rehearsal, standing
from twin.people.posture.body_measures import BodyMeasures
from twin.people.posture.gaze import FreeGaze
from twin.people.posture.posture_rows import HANDS, LOOK, OFF_FEET, PELVIS_PITCH, TICK_S
from twin.people.posture.postures import Part, Postures
from twin.people.posture.resting import seated_pose
from twin.people.script.actions import perform
from twin.people.script.actor import Actor, Approach, ScriptContext, approaches, first_that
from twin.people.script.recorded import RecordedPaths, first_heading, start_places
from twin.room.furniture import Seat
from twin.scenario import Scenario
from twin.scenario.action import TOP_RUN_M_S, TOP_WALK_M_S, RecordedPath
from twin.scenario.behaviour import Join, Lead, Sit, Walk, Wander
from twin.scenario.person import STEADY, Person, Randomize
from twin.streams import stream

_ENTER_APART_M, _THROUGH_S = 0.7, 1.0
_HELD_UP_S = 2.0
"""Wait for a free doorway beyond which a person is said not to come [s]."""
_BLOCKED_FOR_S = 0.8
_NEAR_ENOUGH_M, _HALTS_FOR_S = 0.2, 1.5
_STANDS_AT_LEAST_S = 0.1
"""Duration to which the first stretch of a recorded path may shrink where its person stands [s]."""


class Population(Poses):
    """People of a scenario, ordered by name, so that the order of listing has no effect.

    `advance(t)` and `prepare(times)` step them; `qpos(t)`, `feet(t)` and `truth(t)` accept any t from
    `posture_rows.HISTORY_S` before the last step up to it. Memory does not grow with time.
    """

    def __init__(
        self,
        people: Mapping[str, Person],
        ground: Ground,
        rngs: Mapping[str, np.random.Generator],
        appearances: Mapping[str, BodyAppearance],
        measures: BodyMeasures,
        source: str,
        bases: MovingBases | None = None,
        rehearsal: Rehearsal | None = None,
    ) -> None:
        """`ground`: walkable floor and its obstacles; `rngs`: one generator per person; `appearances`: source of proportions
        and mass; `measures`: of the bodies, in the order of names; `source`: description file named in errors;
        `bases`: housings that drive among them; `rehearsal`: of their bodies in the room, None: they touch nothing.

        Known starts must be apart, and a wanderer's inside the area (see `twin.world.placement`). Raises InputError when the
        area has no room for those who wander.
        """
        self.names = tuple(sorted(people))
        described = [put_in_place(people[name], ground, measures, number) for number, name in enumerate(self.names)]
        random = [rngs[name] for name in self.names]
        count = len(self.names)
        position = start_places(self.names, described, ground, random, source)
        heading = np.array([first_heading(*each) for each in zip(described, position, random, strict=True)], float)
        areas = [_kept_in(person, ground) for person in described]
        self._crowd = Crowd(planar(position), heading, areas, ground.obstacles, ground.clearance_m)
        self.bases = self._crowd.bases = bases
        super().__init__(self.names, appearances, measures)
        self._gait = Gait(self._skeleton, self._crowd)
        self._postures = Postures(self._measures, self._crowd.place, self._crowd.heading)
        self._context = ScriptContext(self.names, self._crowd, self._postures, ground, doing=["stand"] * count)
        if rehearsal is not None:
            stands = partial(standing, self._gait, self._skeleton, self._crowd)  # no method, which would refer back
            self._context.overlap = partial(rehearsal.deepest, self._postures, stands)
        for number, person in enumerate(described):
            if (seat := _seat_from_start(person, ground)) is not None:
                self._postures.begin_seated(number, seat, _approach(seat, ground, measures, number).side)
                self._context.taken[seat.name] = number
        self._acting = [
            perform(Actor(self._context, number, random[number]), person.script)
            for number, person in enumerate(described)
        ]
        starts = {number: person.script[0] for number, person in enumerate(described) if person.script}
        self._recorded = RecordedPaths(
            {k: each for k, each in starts.items() if isinstance(each, RecordedPath)}, TICK_S
        )
        self._arrive_s = np.array([person.arrive_s for person in described], dtype=float)
        self._arrive_s[self._recorded.numbers] = np.inf  # they enter with their paths
        self._out_s = np.full(count, -np.inf)  # time at which each has left
        self._gaze = FreeGaze(random)
        self._entered = np.zeros(count, dtype=bool)
        self._all_came = count == 0
        self._started = np.zeros(count, dtype=bool)
        self._until = np.zeros(count)
        self._done: dict[int, Callable[[], bool]] = {}
        self._blocked_s, self._halts_s = np.zeros(count), np.zeros(count)
        self._crowd.present[:] = False
        self._crowd.driven[self._recorded.numbers] = True
        self._turning = np.zeros(0, dtype=np.intp)
        self._tick = 0
        self._enter_and_leave()
        self._record()

    @property
    def doing(self) -> tuple[str, ...]:
        """Kind of action of each person as of the last step, in the order of names."""
        return tuple(self._context.doing)

    @property
    def under_way(self) -> Mask:
        """Mask (n,) of people still on the way to their action, as of the last step."""
        going = np.zeros(len(self), dtype=bool)
        going[list(self._context.going)] = True
        return going

    def late(self) -> list[str]:
        """Describe people who do not come or have not arrived in twice the time that their way takes, as of the last step."""
        crowd, held_up = self._crowd, []
        waits_s = self._tick * TICK_S - self._arrive_s
        for person in map(int, np.flatnonzero(~self._entered & (waits_s > _HELD_UP_S) & crowd.present.any())):
            nearest = int(np.where(crowd.present, np.abs(crowd.place - crowd.place[person]), np.inf).argmin())
            names = self._context.names
            held_up.append(
                f"{names[person]} has not come for {waits_s[person]:.0f} s: {names[nearest]} stands where they come in"
            )
        return [*held_up, *self._context.late()]

    def holds_posture(self) -> Mask:
        """Return a mask (n,) of people who have reached their sitting, lying, bent or reaching posture, as of the last step."""
        parts: tuple[Part, ...] = ("body", "bend", "reach")
        held = self._postures.rows[[OFF_FEET, PELVIS_PITCH, HANDS, HANDS + 4]].any(axis=0)
        done = [all(self._postures.done(number, part) for part in parts) for number in range(len(self))]
        return np.asarray(held, dtype=bool) & np.array(done, dtype=bool)

    def looks(self) -> Mask:
        """Return a mask (n,) of people whose head is held at a person, place or angle, as of the last step."""
        return self._postures.rows[LOOK] == 1.0

    def motion(self, until_s: float) -> PopulationMotion:
        """Return the motion of all people, tick by tick, from the start to `until_s` [s]; the population must not have been
        stepped.
        """
        ticks = [self._history.last()]
        while self._history.tick * TICK_S < until_s:
            self._step()
            ticks.append(self._history.last())
        return PopulationMotion(*(np.stack(each) for each in zip(*ticks, strict=True)))

    def _record(self) -> None:
        self._history.append(self._gait.state, self._postures.rows, self._crowd.present)

    def _step(self) -> None:
        crowd, context, postures = self._crowd, self._context, self._postures
        context.t = t = self._tick * TICK_S
        context.end_looks()
        self._command(t)
        self._drive()
        if self.bases is not None:
            self.bases.step(t, crowd.place, crowd.velocity, crowd.present)
        gaze = self._gaze.at(t) + 0.25 * crowd.turn_rate
        crowd.step(TICK_S)
        postures.step(crowd.place, crowd.heading, TICK_S)
        self._gait.step(crowd, gaze, TICK_S, still=~(postures.may_walk() | postures.turning()), arms_in=crowd.arms_in())
        self._tick += 1
        self._enter_and_leave()
        self._record()

    def _drive(self) -> None:
        """Drive people along recorded paths, and the feet of those who turn on their seats."""
        crowd, recorded = self._crowd, self._recorded.numbers
        turning = self._postures.turning().nonzero()[0]
        if len(turning) or len(self._turning):
            crowd.driven[self._turning], crowd.driven[turning] = False, True
            self._turning = turning
        if not (len(recorded) or len(turning)):
            return
        place, velocity = crowd.place.copy(), crowd.velocity.copy()
        place[recorded], velocity[recorded] = self._recorded.at(self._tick + 1)
        place[turning], heading = self._postures.footing(turning)
        velocity[turning] = (place[turning] - crowd.place[turning]) / TICK_S
        crowd.face(turning, heading)
        crowd.drive(place, velocity)

    def _command(self, t: float) -> None:
        """Give the next command of the script to all people whose command has ended."""
        crowd = self._crowd
        # a person held up in the last few centimetres by another who stands there has arrived
        self._halts_s = (self._halts_s + TICK_S) * crowd.halting(_NEAR_ENOUGH_M)
        arrived = crowd.arrived() | (self._halts_s > _HALTS_FOR_S)
        self._blocked_s = (self._blocked_s + TICK_S) * crowd.blocked()
        blocked = self._blocked_s > _BLOCKED_FOR_S
        taken = crowd.taken()
        ended = (arrived | blocked | taken | (t >= self._until)) & crowd.present
        for person, done in self._done.items():
            ended[person] |= bool(crowd.present[person]) and done()
        if not np.count_nonzero(ended):
            return
        for person in map(int, np.flatnonzero(ended)):
            end: End = "arrived" if arrived[person] else "taken" if taken[person] else "time"
            if end == "time" and blocked[person]:
                end = "blocked"
            done = self._done.pop(person, None)
            if done is not None and done():
                end = "done"
            acting = self._acting[person]
            command = acting.send(end) if self._started[person] else next(acting)
            self._started[person] = True
            crowd.command(person, command)
            self._until[person] = command.until
            self._blocked_s[person] = self._halts_s[person] = 0.0
            if command.done is not None:
                self._done[person] = command.done

    def _enter_and_leave(self) -> None:
        """Let in people whose time has come, and take out those who leave."""
        crowd, tick = self._crowd, self._tick
        leaving = self._context.leaving
        if leaving:
            crowd.present[list(leaving)] = False
            self._out_s[list(leaving)] = tick * TICK_S
            self._context.departed |= leaving
            leaving.clear()
        if not len(self._recorded.numbers) and self._all_came:
            return
        entering = []
        for person in map(int, np.flatnonzero(~self._entered & (self._arrive_s <= tick * TICK_S))):
            # wait for a person in the doorway, or just through it
            there = crowd.present | (tick * TICK_S - self._out_s < _THROUGH_S)
            apart = np.abs(crowd.place - crowd.place[person])[there]
            if tick == 0 or not (apart < _ENTER_APART_M).any():
                crowd.enter(person, complex(crowd.place[person]), float(crowd.heading[person]))
                entering.append(person)
        recorded = self._recorded
        there = recorded.there(tick)
        crowd.present[recorded.numbers[~there]] = False
        self._context.departed.update(recorded.numbers[tick > recorded.last].tolist())
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
            self._all_came = bool(self._entered.all())
            who = np.zeros(len(self), dtype=bool)
            who[entering] = True
            self._gait.place_anew(who, crowd, crowd.arms_in())


def _seat_from_start(person: Person, ground: Ground) -> Seat | None:
    """Return the seat on which a person starts; None: the person starts standing."""
    action = person.script[0] if person.script else None
    found = ground.furniture[action.seat] if isinstance(action, Sit) and action.seated else None
    return found if isinstance(found, Seat) else None


def _approach(seat: Seat, ground: Ground, measures: BodyMeasures, number: int) -> Approach:
    return first_that(ground.routes.reachable, approaches(seat, measures, number))


def put_in_place(person: Person, ground: Ground, measures: BodyMeasures, number: int) -> Person:
    """Return a person who starts seated with start and heading before the seat, one who comes by a door with a start in from
    it, and others unchanged.
    """
    seat = _seat_from_start(person, ground)
    if seat is None and person.start is not None:
        x, y = entry_place(np.array(person.start), ground.walkable)
        return person.model_copy(update={"start": (float(x), float(y))})
    if seat is None:
        return person
    seated = seated_pose(seat, measures, number)
    start = seated.standing_place.real, seated.standing_place.imag
    return person.model_copy(update={"start": start, "heading_deg": float(np.degrees(seated.yaw))})


def _kept_in(person: Person, ground: Ground) -> Array | None:
    """Return the polygon (k, 2) [m] that confines a person: wanderers the tracked area, others the walkable one."""
    if person.script and isinstance(person.script[0], RecordedPath):
        return None
    only_wanders = all(isinstance(action, Wander | Lead | Join) for action in person.script)
    return ground.area if only_wanders and person.script else ground.walkable


def randomized(scenario: Scenario) -> Scenario:
    """Return the scenario with starts, times and speeds of its people randomized by its seed, or unchanged without such a
    wish.
    """
    if scenario.randomize == STEADY:
        return scenario
    people = {name: _drawn(person, scenario.randomize, scenario.seed, name) for name, person in scenario.people.items()}
    return scenario.model_copy(update={"people": people, "randomize": STEADY})


def _drawn(person: Person, randomize: Randomize, seed: int, name: str) -> Person:
    # the stream keeps its first name: another would draw other numbers
    x, y, onset, pace = stream(seed, "vary", name).uniform(-1, 1, 4).tolist()
    moved, later_s, factor = (
        (randomize.start_m * x, randomize.start_m * y),
        randomize.onset_s * onset,
        1 + randomize.speed * pace,
    )
    changes: dict[str, Any] = {"script": tuple(_action(each, moved, later_s, factor) for each in person.script)}
    if person.start is not None:
        changes["start"] = (person.start[0] + moved[0], person.start[1] + moved[1])
    return person.model_copy(update=changes)


def _action(action: Any, moved: tuple[float, float], later_s: float, factor: float) -> Any:
    """Return an action delayed by `later_s` [s], at `factor` times the speed; a path is moved whole [m].

    It begins no earlier than the start of the run. A path's first stretch, of which a delay changes the duration, is passed no
    faster than people run, or than it is without the delay.
    """
    changes: dict[str, Any] = {}
    if action.at_s is not None:
        changes["at_s"] = max(0.0, action.at_s + later_s)
    if isinstance(action, RecordedPath):
        (started, *here), (then, *there) = action.points[:2]
        first_s = (then - started) / factor
        later_s = max(later_s, min(first_s, max(dist(here, there) / TOP_RUN_M_S, _STANDS_AT_LEAST_S)) - first_s)
        changes["points"] = tuple(  # changes only how long the person stands at first
            (started + (t - started) / factor + (later_s if t > started else 0.0), x + moved[0], y + moved[1])
            for t, x, y in action.points
        )
    if isinstance(action, Walk):
        changes["speed_m_s"] = min(TOP_WALK_M_S, action.speed_m_s * factor)
    return action.model_copy(update=changes)
