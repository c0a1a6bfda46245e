"""Precomputed motion of a scenario's people, with their bodies in the room, for any sensors to look at."""

from __future__ import annotations

import copy
from dataclasses import dataclass, replace

import mujoco
import numpy as np
from numpy.typing import NDArray

from trackers.arrays import Array
from twin.people.poses import PopulationMotion
from twin.people.randomize import randomized
from twin.scenario import Scenario
from twin.world.scene import Scene, build_scene, populate

LONGEST_LOOK_S = 1.0
"""A motion goes on for so long after the scenario's end: a sweep or an exposure begun before takes less [s]."""


class PoseCache:
    """Poses of people's geoms at the times at which scanners have looked, for scanners that look at the same times.

    A ray asks for nothing else: neither joints nor soles, cameras or lights are kept.
    """

    def __init__(self, person_of_geom: NDArray[np.int16]) -> None:
        self._geoms = np.flatnonzero(person_of_geom > 0)
        self.places: dict[float, tuple[Array, Array]] = {}

    def store(self, t: float, data: mujoco.MjData) -> None:
        """Keep the poses that are those of time t [s]."""
        self.places[t] = data.geom_xpos[self._geoms].copy(), data.geom_xmat[self._geoms].copy()

    def restore(self, t: float, data: mujoco.MjData) -> None:
        """Put the geoms where they are at time t [s]."""
        data.geom_xpos[self._geoms], data.geom_xmat[self._geoms] = self.places[t]


@dataclass(frozen=True, eq=False)
class PrecomputedScene:
    """The compiled scene of a scenario as it begins, and its people's motion; for scenarios with the same people."""

    scene: Scene
    motion: PopulationMotion

    @classmethod
    def of(cls, scenario: Scenario, motion: PopulationMotion) -> PrecomputedScene:
        """Build the scene of the scenario's people. Raises InputError as `build_scene` does."""
        return cls(build_scene(randomized(scenario)), motion)

    def scene_for(self, scenario: Scenario) -> Scene:
        """Return the scene for one world: with a model of its own where the world changes its light."""
        if not scenario.lights:
            return self.scene
        return replace(self.scene, bodies=replace(self.scene.bodies, model=copy.copy(self.scene.model)))


def precompute_motion(scenario: Scenario) -> PopulationMotion:
    """Step a scenario's people to its end and return their motion. Raises InputError as `build_scene` does."""
    scenario = randomized(scenario)
    return populate(scenario, build_scene(scenario)).motion(scenario.duration_s + LONGEST_LOOK_S)
