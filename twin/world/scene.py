"""Compiled scene: a room with its people attached, and the person of each geom, joint and site."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from trackers.errors import InputError, valid_names
from twin.instant.snapshot import FootShapes, Snapshot, base_body
from twin.people.body.appearance import BodyAppearance, appearance_of
from twin.people.body.proportions import REFERENCE_STATURE_M
from twin.people.crowd.bases import MovingBases
from twin.people.crowd.ground import Ground
from twin.people.crowd.routes import Routes
from twin.people.population import Population, put_in_place, randomized
from twin.people.poses import PopulationMotion, PrecomputedPoses, Rehearsal
from twin.people.posture.body_measures import BodyMeasures
from twin.people.posture.posture_rows import HISTORY_S, TICK_S
from twin.people.posture.side_seating import side_poses
from twin.people.script.actor import approaches
from twin.people.script.recorded import known_start, start_places
from twin.room.building import check_mounts
from twin.room.furniture import Bed, Seat, nearly_furniture
from twin.room.mjcf import set_planes
from twin.scenario import Scenario
from twin.scenario.behaviour import Lie, Sit
from twin.scenario.housings import driven, in_the_room
from twin.scenario.person import Person
from twin.scenario.sensor_descriptions import FloorDescription
from twin.streams import stream
from twin.world.body_pool import Bodies, body_pools
from twin.world.empty_room import EmptyRoom, empty_room
from twin.world.placement import CLEARANCE_M, check_approach, check_free, check_placement


@dataclass(frozen=True, eq=False)
class Scene:
    """A room, its people, and the bodies of those of them who have one.

    `ids` gives each person's id (1, 2, ... in the order listed); arrays over people are in the order of `names`
    (sorted), so that listing people in another order changes ids and nothing else.
    """

    room: mujoco.MjSpec
    """The room without people."""
    room_file: Path
    area: NDArray[np.float64]  # (k, 2) tracked area, polygon in the room frame [m]
    walkable: NDArray[np.float64]  # (k, 2) limit of bodies' middles, given by the room or from its geometry
    floor: NDArray[np.float64]  # (k, 2) hull of the room's floor, polygon in the room frame [m]
    ground: Ground
    names: tuple[str, ...]
    appearances: dict[str, BodyAppearance]
    ids: dict[str, int]
    bodies: Bodies
    pictures: bool = True
    """True where bodies have faces and prints; without them the model must not be drawn."""

    @property
    def model(self) -> mujoco.MjModel:
        """The room and the bodies, compiled."""
        return self.bodies.model

    @property
    def person_of_geom(self) -> NDArray[np.int16]:
        """Id of each geom's person, 0 for the room, (n_geom,)."""
        return self.bodies.person_of_geom

    def with_bodies(self, names: Collection[str]) -> Scene:
        """Return the same room and people, with bodies of these."""
        looks = {name: self.appearances[name] for name in names}
        bodies = Bodies.in_room(self.room, self.room_file, self.names, self.ids, looks, pictures=self.pictures)
        return replace(self, bodies=bodies)


def build_scene(scenario: Scenario, *, pictures: bool = True) -> Scene:
    """Compile the scenario's room with the people who have bodies at first (`twin.world.body_pool`).

    `pictures`: False leaves people's faces and prints out, for a scene that is never drawn. Raises InputError for a room that
    reads files outside its folder, does not compile, has no floor or nowhere to walk, and for an area or a person that does
    not fit into it.
    """
    room = empty_room(scenario)
    ground, appearances = _checked(scenario, room)
    spec, names = room.spec.copy(), tuple(appearances)
    set_planes(spec, room.model, room.data, room.walkable, _places_of_sensors(scenario))
    ids = {name: number for number, name in enumerate(scenario.people, start=1)}
    looks = {name: appearances[name] for name in body_pools(scenario.people)[0].names}
    _add_bases(spec, scenario, ground.routes)
    return Scene(
        room=spec,
        room_file=room.path,
        area=ground.area,
        walkable=room.walkable,
        floor=room.floor,
        ground=ground,
        names=names,
        appearances=appearances,
        ids=ids,
        bodies=Bodies.in_room(spec, room.path, names, ids, looks, pictures=pictures),
        pictures=pictures,
    )


def check_scene(scenario: Scenario, moved: Collection[str] = ()) -> None:
    """Raise InputError where a simulation of the scenario could not begin: for its area, people, seats or mounts.

    moved: sensors whose mounts are not those of the scenario. No body is made but of people who sit or lie, so that a suite
    can check all its scenarios before the first runs.
    """
    room = empty_room(scenario)
    ground, appearances = _checked(scenario, room)
    _add_bases(room.spec.copy(), scenario, ground.routes)
    names = tuple(appearances)
    _check_seats(scenario, ground, names, lambda number: (BodyMeasures.of([appearances[names[number]]]), 0))
    empty = Snapshot(0.0, room.model, room.data, np.zeros(room.model.ngeom, dtype=np.int16))
    check_mounts(scenario, [name for name in scenario.sensors if name not in moved], empty, room.floor)


def scene_faults(
    place: Callable[[str], str], scenarios: Sequence[Scenario], moved: Collection[str] = ()
) -> Iterator[str]:
    """Yield what keeps simulations of a scenario, one for each seed, from beginning: its area, people, seats, mounts.

    place: returns where a field is written, "" for the scenario itself; moved: sensors that are placed later. A field is
    named once, with the seeds where it is at fault; nothing is simulated.
    """
    found: dict[str, list[tuple[int, str]]] = {}
    for scenario in scenarios:
        try:
            check_scene(randomized(scenario), moved)
        except InputError as error:
            field, colon, rest = str(error).removeprefix(f"{scenario.source}: ").partition(": ")
            is_field = colon and " " not in field and field.split(".")[0] in Scenario.model_fields
            fault = (field, rest) if is_field else ("", str(error))
            found.setdefault(fault[0], []).append((scenario.seed, fault[1]))
    for field, faults in found.items():
        (seed, fault), *more = faults
        others = f", and {len(more)} more of {len(scenarios)} seeds," * bool(more)
        drawn = "" if len(faults) == len(scenarios) else f"with seed {seed}{others} "
        yield f"{place(field)}: {drawn}{fault}"


def _checked(scenario: Scenario, room: EmptyRoom) -> tuple[Ground, dict[str, BodyAppearance]]:
    """Return the ground and the people's looks, by sorted name; raise InputError for what does not fit into the room."""
    area = np.array(scenario.area, dtype=float) if scenario.area is not None else room.walkable
    _check_furniture(scenario, room.furniture)
    source = scenario.source
    routes = _routes(room, source)
    check_placement(scenario, area, room.walkable, routes, room.fitting_people())
    ground = Ground(area, room.walkable, room.obstacles, routes, room.furniture, source, scenario.clearance_m)
    names = sorted(scenario.people)
    appearances = {name: appearance_of(scenario.people[name], stream(scenario.seed, "looks", name)) for name in names}
    _check_starts(scenario, ground, appearances)  # before bodies are made, of which hundreds take long
    return ground, appearances


def _check_starts(scenario: Scenario, ground: Ground, appearances: Mapping[str, BodyAppearance]) -> None:
    """Raise InputError where the area has no room for all whose start is drawn, by the draws of `Population`."""
    if all(known_start(person) is not None for person in scenario.people.values()):
        return
    names = tuple(appearances)
    described = []
    for name in names:
        person = scenario.people[name]
        seated = person.script and isinstance(person.script[0], Sit)
        measures = BodyMeasures.of([appearances[name]] if seated else [])
        described.append(put_in_place(person, ground, measures, 0))
    streams = [stream(scenario.seed, "person", name) for name in names]
    start_places(names, described, ground, streams, ground.source)


def _add_bases(spec: mujoco.MjSpec, scenario: Scenario, routes: Routes) -> None:
    """Add the bodies of housings that drive to a room; raises InputError for one that starts in furniture or a person."""
    for name, housing in driven(scenario).items():
        field = f"{scenario.source}: housings.{name}.mount.xyz"
        start = np.array(housing.mount.xyz[:2])
        reach_m = housing.body.reach_m if housing.body is not None else 0.0
        check_free(start, routes, field, reach_m)
        for other, person in scenario.people.items():
            if person.start is not None and np.hypot(*(start - person.start)) < reach_m + CLEARANCE_M / 2:
                raise InputError(
                    f"{field}: {list(start)} is where {other!r} starts; a place clear of people is expected"
                )
        if housing.body is None:
            continue
        x, y, z = housing.mount.xyz
        body = spec.worldbody.add_body(name=base_body(name), mocap=True, pos=[x, y, z])
        half_m, (length_m, width_m) = housing.body.height_m / 2, housing.body.size_m or (0.0, 0.0)
        is_round = housing.body.radius_m is not None
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_CYLINDER if is_round else mujoco.mjtGeom.mjGEOM_BOX,
            size=[housing.body.radius_m, half_m, 0.0] if is_round else [length_m / 2, width_m / 2, half_m],
            pos=[0.0, 0.0, half_m - z],
            rgba=[*housing.body.colour, 1.0],
            contype=0,
            conaffinity=0,
        )


def precomputed_poses(scene: Scene, motion: PopulationMotion) -> PrecomputedPoses:
    """Return the poses of the scene's people from a precomputed motion."""
    measures = BodyMeasures.in_room(scene.model, scene.appearances, scene.bodies.names)
    return PrecomputedPoses(scene.names, scene.appearances, measures, motion)


def populate(scenario: Scenario, scene: Scene) -> Population:
    """Make the scenario's people, each with a random stream of their own."""
    streams = {name: stream(scenario.seed, "person", name) for name in scene.names}
    measures = BodyMeasures.in_room(scene.model, scene.appearances, scene.bodies.names)
    _check_seats(scenario, scene.ground, scene.names, lambda number: (measures, number))
    source = scenario.source
    housings = driven(scenario)
    bases = None
    if housings:
        rngs = {name: stream(scenario.seed, "housing", name) for name in housings}
        bases = MovingBases(housings, scene.ground, scene.names, rngs, TICK_S, HISTORY_S)
    ids = [scene.ids[name] for name in scene.names]
    rehearsal = Rehearsal(scene.model, scene.person_of_geom, scene.bodies.qpos_address, ids)
    return Population(scenario.people, scene.ground, streams, scene.appearances, measures, source, bases, rehearsal)


def foot_shapes(scene: Scene) -> FootShapes:
    """Return the soles of the scene's people, in the order of their names."""
    lengths = [scene.appearances[name].proportions for name in scene.names]
    measures = ("heel_behind_ankle", "ball_before_ankle", "shoe_length", "foot_breadth")
    return FootShapes(*(np.array([getattr(each, measure) for each in lengths], dtype=float) for measure in measures))


def _check_seats(
    scenario: Scenario, ground: Ground, names: Sequence[str], measured: Callable[[int], tuple[BodyMeasures, int]]
) -> None:
    """Raise InputError where a seat or bed of a script is unreachable, or two people start on one seat.

    measured: returns the measures of some people, and a person's place among them, by the place in `names`.
    """
    seated: dict[str, str] = {}
    for number, name in enumerate(names):
        for place, action in enumerate(scenario.people[name].script):
            if isinstance(action, Sit) and action.seated and (other := seated.setdefault(action.seat, name)) != name:
                raise InputError(
                    f"{scenario.source}: people.{name}.script.{place}.seat: {other!r} sits on {action.seat!r} from the "
                    "start too; a seat for each is expected"
                )
            if not isinstance(action, Sit | Lie) or (isinstance(action, Sit) and action.seated):
                continue
            asked, kind = (action.seat, "seat") if isinstance(action, Sit) else (action.bed, "bed")
            field = f"{scenario.source}: people.{name}.script.{place}.{kind}"
            _check_seat(ground.furniture[asked], *measured(number), ground.routes, field)


def _check_seat(furniture: Seat | Bed, measures: BodyMeasures, person: int, routes: Routes, field: str) -> None:
    """Raise InputError naming the field where a person cannot come to a seat or bed."""
    if any(routes.reachable(each.turns_round_at) for each in approaches(furniture, measures, person)):
        return
    faults = [fault for _, fault in side_poses(furniture, measures, person)] if isinstance(furniture, Seat) else []
    places = [each.turns_round_at for each in approaches(furniture, measures, person)]
    check_approach(furniture, places, routes, field, faults)


def unusable_furniture(scene: Scene) -> list[str]:
    """Return a sentence for each seat and bed of a room to which an adult of usual size cannot come, or that is called amiss."""
    adult = Person(height_m=REFERENCE_STATURE_M, build=1.0, bag="none")
    measures = BodyMeasures.of([appearance_of(adult, np.random.default_rng(0))])
    faults = nearly_furniture(scene.model)
    for name, furniture in scene.ground.furniture.items():
        try:
            field = f"{'seat' if isinstance(furniture, Seat) else 'bed'}_{name}"
            _check_seat(furniture, measures, 0, scene.ground.routes, field)
        except InputError as error:
            faults.append(str(error))
    return faults


def _places_of_sensors(scenario: Scenario) -> list[NDArray[np.float64]]:
    """Return the places of the sensors, (3,) each in the room frame [m]."""
    described = (in_the_room(scenario, name) for name in scenario.sensors)
    return [np.array(each.mount.xyz, dtype=float) for each in described if not isinstance(each, FloorDescription)]


def _routes(room: EmptyRoom, source: str) -> Routes:
    try:
        return room.routes
    except ValueError as error:
        raise InputError(f"{source}: room: the walkable area {error}") from error


def _check_furniture(scenario: Scenario, furniture: Mapping[str, Seat | Bed]) -> None:
    """Raise InputError where a script names a seat or bed that the room does not have."""
    for name, person in scenario.people.items():
        for place, action in enumerate(person.script):
            match action:
                case Sit(seat=asked):
                    field, kind = "seat", Seat
                case Lie(bed=asked):
                    field, kind = "bed", Bed
                case _:
                    continue
            if not isinstance(furniture.get(asked), kind):
                there = sorted(each for each, thing in furniture.items() if isinstance(thing, kind))
                none = f"none, as the room names none: a site called {field}_NAME is needed"
                raise InputError(
                    f"{scenario.source}: people.{name}.script.{place}.{field}: {scenario.room} has no {field} "
                    f"{asked!r}; {valid_names(asked, there, none=none)}"
                )
