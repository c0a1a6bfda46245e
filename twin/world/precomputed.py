"""Precomputed motion of a scenario's people, with their bodies in the room, for any sensors."""

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
"""Time by which a motion exceeds the scenario's end, for sweeps and exposures begun before [s]."""


class PoseCache:
    """Poses of people's geoms at the times of scans, for scanners with the same times.

    Rays need nothing else: joints, soles, cameras and lights are not kept.
    """

    def __init__(self, person_of_geom: NDArray[np.int16]) -> None:
        self._geoms = np.flatnonzero(person_of_geom > 0)
        self.places: dict[float, tuple[Array, Array]] = {}

    def store(self, t: float, data: mujoco.MjData) -> None:
        """Store the present poses as those of time t [s]."""
        self.places[t] = data.geom_xpos[self._geoms].copy(), data.geom_xmat[self._geoms].copy()

    def restore(self, t: float, data: mujoco.MjData) -> None:
        """Restore the poses of time t [s]."""
        data.geom_xpos[self._geoms], data.geom_xmat[self._geoms] = self.places[t]


@dataclass(frozen=True, eq=False)
class PrecomputedScene:
    """Compiled initial scene of a scenario, and its people's motion; for scenarios with the same people."""

    scene: Scene
    motion: PopulationMotion

    @classmethod
    def of(cls, scenario: Scenario, motion: PopulationMotion) -> PrecomputedScene:
        """Build the scene of the scenario's people. Raises InputError as `build_scene` does."""
        return cls(build_scene(randomized(scenario)), motion)

    def scene_for(self, scenario: Scenario) -> Scene:
        """Return the scene for one world, with its own model if the world changes its light."""
        if not scenario.lights:
            return self.scene
        return replace(self.scene, bodies=replace(self.scene.bodies, model=copy.copy(self.scene.model)))


def precompute_motion(scenario: Scenario) -> PopulationMotion:
    """Step a scenario's people to its end and return their motion. Raises InputError as `build_scene` does."""
    scenario = randomized(scenario)
    return populate(scenario, build_scene(scenario)).motion(scenario.duration_s + LONGEST_LOOK_S)
