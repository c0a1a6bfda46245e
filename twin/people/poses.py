"""Poses of all people during the last seconds, stepped now or precomputed; and poses tried out before an action."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from trackers.area import wrap_angle
from trackers.arrays import Array, Mask, Planar
from twin.instant.snapshot import Feet, Snapshot, on_the_floor
from twin.people.body.appearance import BodyAppearance
from twin.people.body.person_spec import NQ_PERSON
from twin.people.body.proportions import Skeleton
from twin.people.gait.footsteps import MovingBodies
from twin.people.gait.gait import GRAVITY_M_S2, Gait
from twin.people.gait.gait_state import HEADING, GaitState, foot_loads, joint_coordinates, pelvis_yaw
from twin.people.posture.body_measures import TOLERANCE_M, BodyMeasures, Penetration, PenetrationCheck
from twin.people.posture.overlay import overlay_postures, pelvis_over_floor
from twin.people.posture.posture_rows import TICK_S, PoseHistory, active, faced, pressure_shift_m, support
from twin.people.posture.postures import Part, Postures


@dataclass(frozen=True, eq=False)
class PopulationTruth:
    """Truth about all people at one time, in the room frame, ordered by name.

    present: in the room, (n,); x, y, z: the pelvis (middle between the hip joints) [m]; yaw: facing direction, for a person
    on the back that of the feet [rad]; vx, vy: velocity of the ground point under the pelvis [m/s].
    """

    present: Mask
    x: Array
    y: Array
    z: Array
    yaw: Array
    vx: Array
    vy: Array


@dataclass(eq=False)
class _PoseAtTime:
    """Gait state and posture at one time and at the ticks around it, read-only; joint coordinates and feet once asked for."""

    state: GaitState
    posture: Array
    around: list[tuple[GaitState, Array]]
    coordinates: Array | None = None
    feet: Feet | None = None


class Poses(ABC):
    """Poses, soles and truth of people ordered by name, from the history of their last ticks."""

    def __init__(self, names: Sequence[str], appearances: Mapping[str, BodyAppearance], measures: BodyMeasures) -> None:
        """`appearances`: source of proportions and mass; `measures`: of the bodies, in the order of `names`."""
        self.names = tuple(names)
        looks = [appearances[name] for name in self.names]
        self._skeletons = {1: Skeleton([each.proportions for each in looks], [each.carries for each in looks])}
        self._skeleton, self._looks = self._skeletons[1], looks
        self._weight_n = GRAVITY_M_S2 * np.array([appearances[name].mass_kg for name in self.names], dtype=float)
        self._measures = measures
        self._history = PoseHistory(len(self.names))
        self._prepared: dict[float, _PoseAtTime] = {}
        self._asked: tuple[float, int] | None = None  # time and tick of the last query about another time
        self._pose_then: _PoseAtTime

    def __len__(self) -> int:
        return len(self.names)

    def advance(self, t: float) -> None:
        """Step until the clock has reached time t [s] since the start; do nothing if it has already."""
        while self._history.tick * TICK_S < t:
            self._step()

    @abstractmethod
    def _step(self) -> None:
        """Step the people by one tick."""

    def prepare(self, times: Sequence[float]) -> None:
        """Step to the last of these times [s], and work out the joint coordinates at all of them in one call.

        times: ascending, within `AHEAD_S`. Answers about them are as if they were asked for one by one, to the bit.
        """
        self._prepared = {}
        for t in times:
            self.advance(t)
            self._prepared[t] = self._read(t)
        states, count = [pose.state for pose in self._prepared.values()], len(self._prepared)
        whole = GaitState(
            np.concatenate([each.floor for each in states], axis=1),
            np.concatenate([each.rows for each in states], axis=1),
        )
        if count not in self._skeletons:
            looks = self._looks * count
            self._skeletons[count] = Skeleton([each.proportions for each in looks], [each.carries for each in looks])
        upright = joint_coordinates(whole, self._skeletons[count]).reshape(count, len(self), NQ_PERSON)
        for pose, coordinates in zip(self._prepared.values(), upright, strict=True):
            pose.coordinates = overlay_postures(coordinates, pose.posture, self._measures)

    def present(self, t: float) -> Mask:
        """Return a mask (n,) of the people in the room at time t [s]."""
        return self._history.present(t)

    def qpos(self, t: float) -> Array:
        """Return joint coordinates (n, NQ_PERSON) at time t [s], laid out as `twin.people.body.person_spec.JOINTS`.

        Absent people have those of their last, or else first, presence.
        """
        pose = self._at(t)
        if pose.coordinates is None:
            upright = joint_coordinates(pose.state, self._skeleton)
            pose.coordinates = overlay_postures(upright, pose.posture, self._measures)
        return pose.coordinates.copy()

    def feet(self, t: float) -> Feet:
        """Return all soles and the weight on them at time t [s]."""
        pose = self._at(t)
        if pose.feet is None:
            pose.feet = self._feet(pose, self.present(t))
        return pose.feet

    def _feet(self, pose: _PoseAtTime, present: Mask) -> Feet:
        feet, posture = foot_loads(pose.state, self._skeleton), pose.posture
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
        """Return the truth about all people at time t [s]."""
        pose, qpos = self._at(t), self.qpos(t)
        velocity = pose.state.pelvis_velocity + self._posture_velocity(pose.around)
        yaw = wrap_angle(faced(pose.state.rows[HEADING], pose.posture))
        x, y, z = qpos[:, :3].T.copy()
        return PopulationTruth(self.present(t), x, y, z, yaw, velocity.real, velocity.imag)

    def _at(self, t: float) -> _PoseAtTime:
        """Return the pose at time t [s]."""
        if (prepared := self._prepared.get(t)) is not None:
            return prepared
        if self._asked != (t, self._history.tick):
            self._asked, self._pose_then = (t, self._history.tick), self._read(t)
        return self._pose_then

    def _read(self, t: float) -> _PoseAtTime:
        return _PoseAtTime(*self._history.at(t), self._history.ticks_around(t))

    def _posture_velocity(self, around: list[tuple[GaitState, Array]]) -> Planar:
        """Return the velocity of the ground point under the pelvis due to sitting down, bending and the like, (n,) [m/s]."""
        if not any(len(active(posture)) for _, posture in around):
            return np.zeros(len(self), dtype=complex)
        ends = []
        for state, posture in around:
            place = state.pelvis
            ends.append(pelvis_over_floor(place, pelvis_yaw(state, self._skeleton), posture) - place)
        return (ends[1] - ends[0]) / TICK_S


@dataclass(frozen=True, eq=False)
class PopulationMotion:
    """Motion of n people: the rows of a `PoseHistory` at every tick t from the start on."""

    floor: Planar  # (t, FLOOR_ROWS, n)
    rows: NDArray[np.float64]  # (t, ROWS, n)
    posture: NDArray[np.float64]  # (t, POSTURE_ROWS, n), most of it 0
    present: NDArray[np.bool_]  # (t, n)

    def save(self, path: Path) -> None:
        """Write the motion to a file (.npz), of the postures only non-zero values; exact to the bit."""
        bits = self.posture.view(np.int64) != 0
        np.savez(
            path, floor=self.floor, rows=self.rows, present=self.present, shape=self.posture.shape,
            which=np.packbits(bits), posture=self.posture[bits],
        )  # fmt: skip

    @classmethod
    def load(cls, path: Path) -> PopulationMotion:
        """Read a file written by `save`, exact to the bit."""
        with np.load(path) as held:
            posture = np.zeros(held["shape"])
            posture[np.unpackbits(held["which"], count=posture.size).reshape(posture.shape).astype(bool)] = held[
                "posture"
            ]
            return cls(held["floor"], held["rows"], posture, held["present"])


class PrecomputedPoses(Poses):
    """Poses of people whose motion was precomputed.

    Ticks enter the history one by one, as in stepping, so that values between the last two ticks do not depend on the order
    of queries.
    """

    def __init__(
        self,
        names: Sequence[str],
        appearances: Mapping[str, BodyAppearance],
        measures: BodyMeasures,
        motion: PopulationMotion,
    ) -> None:
        super().__init__(names, appearances, measures)
        self._motion = motion
        self._step()

    def _step(self) -> None:
        tick = self._history.tick + 1
        if tick >= len(self._motion.present):
            raise ValueError(f"the motion ends after {len(self._motion.present)} ticks; no later time can be asked for")
        motion = self._motion
        self._history.append(
            GaitState(motion.floor[tick], motion.rows[tick]), motion.posture[tick], motion.present[tick]
        )


_TRIED_EVERY_S, _MOST_TRIED = 0.1, 100
_TRIED: tuple[Part, ...] = ("body", "bend", "reach")


class Rehearsal:
    """Bodies in their room, posed aside from the run: which parts of the room would an action touch?"""

    def __init__(
        self,
        model: mujoco.MjModel,
        person_of_geom: NDArray[np.int16],
        qpos_address: NDArray[np.intp],
        ids: Sequence[int],
    ) -> None:
        """`qpos_address` (n, NQ_PERSON) and `ids` (n,) of the people by number; -1 for people without a body."""
        self._model, self._owner, self._address, self._ids = model, person_of_geom, qpos_address, tuple(ids)
        self._made: tuple[PenetrationCheck, mujoco.MjData] | None = None

    def deepest(
        self,
        postures: Postures,
        stands: Callable[[], tuple[Array, Planar, Array]],
        number: int,
        act: Callable[[Postures], object] | None,
        allowed: Collection[int],
    ) -> Penetration | None:
        """Return the deepest overlap of one person with the room in an action, from now until its posture is held.

        stands: returns joint coordinates without postures (n, NQ_PERSON), places x + iy [m] and headings [rad] of all people;
        act: gives the postures its command, None: the present pose; allowed: geoms that the person presses into. What the
        present pose overlaps already counts for an action where it comes deeper.
        """
        if self._address[number, 0] < 0:
            return None
        if self._made is None:  # until somebody acts near something
            self._made = PenetrationCheck(self._model, self._owner), mujoco.MjData(self._model)
        check, data = self._made
        coordinates, place, heading = stands()

        def pose_of(rows: Array) -> Array:
            whose = np.full(rows.shape[1], number)
            return overlay_postures(coordinates[whose], rows, postures.measures.of_people(whose))

        now = pose_of(postures.rows[:, [number]])
        poses = now if act is None else pose_of(self._rows(postures, number, act, place, heading))
        touched = {} if act is None else self._touched(check, data, number, now[0], allowed)
        deepest: Penetration | None = None
        for qpos in poses:
            for each in self._touched(check, data, number, qpos, allowed).values():
                there = touched.get(each.other_geom)
                is_new = there is None or each.depth_m > there.depth_m + TOLERANCE_M
                if is_new and (deepest is None or each.depth_m > deepest.depth_m):
                    deepest = each
        return deepest

    @staticmethod
    def _rows(
        postures: Postures, number: int, act: Callable[[Postures], object], place: Planar, heading: Array
    ) -> Array:
        """Return the postures of one person in an action (POSTURE_ROWS, k)."""
        trial = deepcopy(postures, {id(postures.measures): postures.measures})
        act(trial)
        rows = []
        while not (rows and all(trial.done(number, part) for part in _TRIED)) and len(rows) < _MOST_TRIED:
            trial.step(place, heading, _TRIED_EVERY_S)
            rows.append(trial.rows[:, number].copy())
        return np.stack(rows, axis=1)

    def _touched(
        self, check: PenetrationCheck, data: mujoco.MjData, number: int, qpos: Array, allowed: Collection[int]
    ) -> dict[str, Penetration]:
        """Return the overlaps of one person in a pose with the room, by its geoms."""
        data.qpos[self._address[number]] = qpos
        mujoco.mj_kinematics(self._model, data)
        person = self._ids[number]
        snapshot = Snapshot(0.0, self._model, data, self._owner)
        return {each.other_geom: each for each in check.at(snapshot, {person: allowed}, only=person)}


def standing(gait: Gait, skeleton: Skeleton, crowd: MovingBodies) -> tuple[Array, Planar, Array]:
    """Return joint coordinates without postures, places and headings of all people."""
    return joint_coordinates(gait.state, skeleton), crowd.place, crowd.heading
