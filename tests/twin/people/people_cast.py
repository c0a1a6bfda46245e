"""People for tests: a population of wanderers, and the room with their bodies in it."""

from __future__ import annotations

import os
from dataclasses import dataclass

os.environ.setdefault("MUJOCO_GL", "egl")

import mujoco
import numpy as np

from twin.models import MODELS
from twin.people.body.appearance import appearance_of
from twin.people.body.person_spec import person_spec
from twin.people.crowd.ground import Ground
from twin.people.crowd.routes import Routes
from twin.people.population import Population
from twin.people.posture.body_measures import BodyMeasures
from twin.scenario.person import Person
from twin.streams import stream

AREA = np.array([[-2.0, 0.6], [2.0, 0.6], [2.0, 2.8], [-2.0, 2.8]])
EVERYWHERE = np.array([[-50.0, -50.0], [50.0, -50.0], [50.0, 50.0], [-50.0, 50.0]])
FIVE = ("black", "blue", "pink", "purple", "white")


@dataclass
class Cast:
    """A population and its bodies in the lab."""

    population: Population
    model: mujoco.MjModel
    data: mujoco.MjData

    def pose(self, t: float) -> np.ndarray:
        """Put everybody where they are at time t; returns their joint coordinates."""
        self.population.advance(t)
        coordinates = self.population.qpos(t)
        self.data.qpos[:] = coordinates.ravel()
        mujoco.mj_kinematics(self.model, self.data)
        return coordinates


def make_population(people: dict[str, Person], seed: int, area: np.ndarray = AREA) -> Population:
    looks = {name: appearance_of(person, stream(seed, "looks", name)) for name, person in people.items()}
    ground = Ground(area, EVERYWHERE, (), Routes(EVERYWHERE, ()), {}, "test")
    random = {name: stream(seed, "person", name) for name in people}
    return Population(people, ground, random, looks, BodyMeasures.of([looks[name] for name in sorted(people)]), "test")


def make_cast(people: dict[str, Person], seed: int = 1) -> Cast:
    spec = mujoco.MjSpec.from_file(str(MODELS / "rooms" / "lab.xml"))
    for name in sorted(people):
        looks = appearance_of(people[name], stream(seed, "looks", name))
        spec.attach(person_spec(looks), prefix=f"{name}/", frame=spec.worldbody.add_frame())
    model = spec.compile()
    return Cast(make_population(people, seed), model, mujoco.MjData(model))
