"""Everybody's poses at any moment of the last seconds, whoever moves them: stepped anew, or as they moved before."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trackers.arrays import Array, Mask
from twin.instant.feet import Feet, on_the_floor
from twin.people.body.appearance import Appearance
from twin.people.body.skeleton import Skeleton
from twin.people.gait.gait import GRAVITY_M_S2
from twin.people.gait.pose import HEADING, Moment, foot_loads, joint_coordinates
from twin.people.posture.lay import apply
from twin.people.posture.measures import BodyMeasures
from twin.people.posture.memory import TICK_S, Memory
from twin.people.posture.rows import active, faced
from twin.people.posture.weight import pressure_shift_m, support


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


class Poses(ABC):
    """What sensors and truth ask of people, in the order of their names, from the memory of their last ticks."""

    def __init__(self, names: Sequence[str], appearances: Mapping[str, Appearance], measures: BodyMeasures) -> None:
        """`appearances`: their looks, for proportions and mass; `measures`: those of their bodies, in the order of `names`."""
        self.names = tuple(names)
        self._skeleton = Skeleton([appearances[name].proportions for name in self.names])
        self._weight_n = GRAVITY_M_S2 * np.array([appearances[name].mass_kg for name in self.names], dtype=float)
        self._measures = measures
        self._memory = Memory(len(self.names))
        self._asked: tuple[float, int, Array] | None = None  # time, tick and coordinates last asked for

    def __len__(self) -> int:
        return len(self.names)

    def advance(self, t: float) -> None:
        """Step until the clock has reached time t [s] since the start; does nothing where it has already."""
        while self._memory.tick * TICK_S < t:
            self._step()

    @abstractmethod
    def _step(self) -> None:
        """Take the people on by one tick."""

    def present(self, t: float) -> Mask:
        """Who is in the room at time t [s], (n,)."""
        return self._memory.present(t)

    def qpos(self, t: float) -> Array:
        """Joint coordinates (n, NQ_PERSON) at time t [s], laid out as `twin.people.body.body.JOINTS` says.

        Those who are not present have the coordinates of when they were, or will be.
        """
        if self._asked is None or self._asked[:2] != (t, self._memory.tick):
            self._asked = t, self._memory.tick, self._coordinates(*self._memory.at(t))
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
