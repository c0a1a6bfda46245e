"""The compiled scene: a room, its people attached, and which geom, joint and site belongs to whom."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from trackers.errors import InputError
from twin import models
from twin.people.appearance import Appearance, appearance_of
from twin.people.body import NQ_PERSON, person_spec
from twin.people.population import Population
from twin.placement import check_placement, check_polygon
from twin.scenario import Scenario
from twin.streams import stream


@dataclass(frozen=True, eq=False)
class Scene:
    """A compiled model and the maps from its elements to people.

    `ids` gives each person's id (1, 2, ... in the order listed); arrays over people are in the order of `names`
    (sorted), so that listing people in another order changes ids and nothing else.
    """

    model: mujoco.MjModel
    area: NDArray[np.float64]  # (k, 2) tracked area, polygon in the room frame [m]
    names: tuple[str, ...]
    appearances: dict[str, Appearance]
    ids: dict[str, int]
    person_of_geom: NDArray[np.int16]  # (n_geom,) id of the person a geom belongs to, 0 for the room
    qpos_address: NDArray[np.intp]  # (n_people, nq_person)
    head_site: NDArray[np.intp]  # (n_people,)
    point_site: NDArray[np.intp]  # (n_people, n_point) the fixed points on each body


def build_scene(scenario: Scenario) -> Scene:
    """Compile the scenario's room with its people in it.

    Raises InputError where the room does not compile or has no area, or the area or a person does not fit into it.
    """
    path = models.find("rooms", scenario.room, asked_by=f"scenario {scenario.name!r}: room")
    spec = _room_spec(path)
    walkable = _walkable_area(spec, path)
    area = np.array(scenario.area, dtype=float) if scenario.area is not None else walkable
    if area is None:
        raise InputError(
            f"scenario {scenario.name!r}: area is missing and {path.name} names no walkable_area; "
            "a polygon like [[-2, 0.6], [2, 0.6], [2, 2.8], [-2, 2.8]] under area: is expected"
        )
    if scenario.area is not None:
        check_polygon(area, f"scenario {scenario.name!r}: area")
    check_placement(scenario, area, walkable)
    names = tuple(sorted(scenario.people))
    appearances = {name: appearance_of(scenario.people[name], stream(scenario.seed, "looks", name)) for name in names}
    for name, appearance in appearances.items():
        spec.attach(person_spec(appearance), prefix=f"{name}/", frame=spec.worldbody.add_frame())
    try:
        model = spec.compile()
    except ValueError as error:
        raise InputError(f"{path}: does not compile ({_first_line(error)}); a valid MJCF room is expected") from error
    ids = {name: number for number, name in enumerate(scenario.people, start=1)}
    return Scene(
        model=model,
        area=area,
        names=names,
        appearances=appearances,
        ids=ids,
        person_of_geom=_person_of_geom(model, ids),
        qpos_address=_addresses(model, names),
        head_site=np.array([_site(model, f"{name}/head") for name in names], dtype=np.intp),
        point_site=_points(model, names),
    )


def populate(scenario: Scenario, scene: Scene) -> Population:
    """The scenario's people as they move, each with a stream of their own."""
    streams = {name: stream(scenario.seed, "person", name) for name in scene.names}
    return Population(scenario.people, scene.area, streams, scene.appearances, f"scenario {scenario.name!r}")


def _first_line(error: Exception) -> str:
    return str(error).strip().splitlines()[0].rstrip(".")


def _room_spec(path: Path) -> mujoco.MjSpec:
    try:
        return mujoco.MjSpec.from_file(str(path))
    except ValueError as error:
        raise InputError(f"{path}: is not a room ({_first_line(error)}); a valid MJCF file is expected") from error


def _walkable_area(spec: mujoco.MjSpec, path: Path) -> NDArray[np.float64] | None:
    """The polygon (k, 2) [m] in the room's `<custom><numeric name="walkable_area"/>`, None where the room has none."""
    for numeric in spec.numerics:
        if numeric.name == "walkable_area":
            data = np.array(numeric.data, dtype=float)
            if len(data) < 6 or len(data) % 2:
                raise InputError(
                    f"{path}: walkable_area: {len(data)} numbers are not a polygon; "
                    "x1 y1 x2 y2 ... [m] of at least 3 corners are expected"
                )
            corners = data.reshape(-1, 2)
            check_polygon(corners, f"{path}: walkable_area")
            return corners
    return None


def _person_of_geom(model: mujoco.MjModel, ids: dict[str, int]) -> NDArray[np.int16]:
    """By the body at the root of each person: a room's own body may be called like a person."""
    owner = np.zeros(model.nbody, dtype=np.int16)
    for name, number in ids.items():
        owner[model.jnt_bodyid[model.joint(f"{name}/root").id]] = number
    return owner[model.body_rootid[model.geom_bodyid]]


def _addresses(model: mujoco.MjModel, names: tuple[str, ...]) -> NDArray[np.intp]:
    """Places of each person's coordinates in qpos: one free joint, then hinges, contiguous in the order of the body."""
    starts = [int(model.jnt_qposadr[model.joint(f"{name}/root").id]) for name in names]
    return np.array(starts, dtype=np.intp)[:, None] + np.arange(NQ_PERSON)


def _site(model: mujoco.MjModel, name: str) -> int:
    return int(model.site(name).id)


def _points(model: mujoco.MjModel, names: tuple[str, ...]) -> NDArray[np.intp]:
    rows = [
        [site for site in range(model.nsite) if model.site(site).name.startswith(f"{name}/point_")] for name in names
    ]
    return np.array(rows, dtype=np.intp).reshape(len(names), -1 if names else 0)
