"""Pressure floor: a grid of force-sensing resistors under people's feet, loaded by MuJoCo's contacts."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cached_property

import mujoco
import numpy as np
from numpy.typing import NDArray

from trackers.arrays import Array
from trackers.rig import FloorSensor
from twin.instant.snapshot import Feet, FootShapes, Snapshot
from twin.sensors.floor_electronics import LoadFrame
from twin.sensors.floor_soles import first_sink_m, sheet_cells, sheet_start, sole_points, soles_model
from twin.sensors.sensor import Reading, State

_STEPS = 8
"""Steps of a burst: forces then have errors of 1e-4, at the ends of the sole 2e-3; the centre of pressure 0.3 mm."""

_GROUP = 5
"""People per MuJoCo model: each touch sensor checks all contacts of its model, a quadratic cost."""

_LIFTED_M = 0.05
_NUDGE_M = 1e-5
_NUDGES = 8
_SEAM_SHARE = 1e-9
_BEYOND_SOLE_M = 1e-6


@dataclass(frozen=True, eq=False)
class FloorLoad:
    """Loads of the floor at one stamp.

    load_n (rows, columns): load of each element [N]. Its parts, for each foot and cell that it loads, (k,) each, by person,
    then foot, then cell: `person` (index in the people's order), `foot` (0 left, 1 right), `cell` (row · columns + column),
    `newton`; they add up to load_n.

    foot_n (n, 2): force of each foot on the whole floor as the contacts carry it, in the grid or outside it [N]; 0 for a foot
    that is lifted or nowhere over the grid. centre_m (n, 2, 2): its centre of pressure, x, y in the plate's frame [m]; NaN
    without a force.
    """

    load_n: Array
    person: NDArray[np.int32]
    foot: NDArray[np.int32]
    cell: NDArray[np.int32]
    newton: Array
    foot_n: Array
    centre_m: Array

    @classmethod
    def nothing(cls, rows: int, columns: int, people: int) -> FloorLoad:
        """Return zero loads."""
        none = np.zeros(0, dtype=np.int32)
        centre_m = np.full((people, 2, 2), np.nan)
        return cls(np.zeros((rows, columns)), none, none, none, np.zeros(0), np.zeros((people, 2)), centre_m)


class FloorPlate:
    """A floor of `rows` x `columns` square sensing elements of side `pitch_m`, and the feet of n people.

    Its frame: origin at the corner of the first element, x along a row, y from row to row, z up. Each foot is pressed down by
    its load at its pressure point and settles, free to sink, to tip over heel and toe and to the side; how the load spreads
    over its points follows from the contacts, like that of a stiff sole on an even bed of springs.

    Every burst starts from the same state: a plate's load depends on the feet at that stamp alone. Simplified: the floor is
    rigid and frictionless; the sole does not bend and touches at POINTS points, which cells of less than about 50 mm show one
    by one; nothing but soles presses on the floor (furniture is tared, a person who lies or kneels is felt where the feet
    carry).
    """

    def __init__(self, rows: int, columns: int, pitch_m: float, shapes: FootShapes) -> None:
        """Prepare the model; `shapes` are the soles of all people who may come. Raises ValueError for impossible soles."""
        _check_shapes(shapes)
        self._rows, self._columns = rows, columns
        self._people = len(shapes.length)
        self._toes = shapes.length - shapes.heel
        self._heel = shapes.heel
        points = sole_points(shapes)
        starts = range(0, self._people, _GROUP)
        self._groups = [_FootGroup(rows, columns, pitch_m, points[start : start + _GROUP]) for start in starts]

    def press(self, feet: Feet) -> FloorLoad:
        """Return the loads of these feet (of the people of `shapes`, in the plate's frame) on the elements.

        Raises ValueError for feet of other people, loads that are negative or no numbers, and a pressure point of a loaded
        foot ahead of the toes or behind the heel.
        """
        carrying = self._check_feet(feet)
        foot_n = np.zeros((self._people, 2))
        centre_m = np.full((self._people, 2, 2), np.nan)
        parts: list[tuple[NDArray[np.intp], NDArray[np.int64], Array]] = []
        for number, group in enumerate(self._groups):
            members = slice(number * _GROUP, (number + 1) * _GROUP)
            if not carrying[members].any():
                continue
            felt = group.press(
                feet.place[members].reshape(-1, 2),
                feet.yaw[members].ravel(),
                np.where(carrying[members], feet.load_n[members], 0.0).ravel(),
                feet.pressure_ahead_m[members].ravel(),
            )
            foot_n[members] = felt.force_n.reshape(-1, 2)
            centre_m[members] = felt.centre_m.reshape(-1, 2, 2)
            parts.append((felt.foot + 2 * _GROUP * number, felt.cell, felt.newton))
        return self._add_up(parts, foot_n, centre_m)

    def _add_up(
        self, parts: list[tuple[NDArray[np.intp], NDArray[np.int64], Array]], foot_n: Array, centre_m: Array
    ) -> FloorLoad:
        foot = np.concatenate([np.zeros(0, dtype=np.intp), *(part[0] for part in parts)])
        cell = np.concatenate([np.zeros(0, dtype=np.int64), *(part[1] for part in parts)])
        newton = np.concatenate([np.zeros(0), *(part[2] for part in parts)])
        load_n: Array = np.bincount(cell, weights=newton, minlength=self._rows * self._columns).astype(float)
        return FloorLoad(
            load_n.reshape(self._rows, self._columns),
            (foot // 2).astype(np.int32),
            (foot % 2).astype(np.int32),
            cell.astype(np.int32),
            newton,
            foot_n,
            centre_m,
        )

    def _check_feet(self, feet: Feet) -> NDArray[np.bool_]:
        """Return which feet (n, 2) carry a load."""
        if feet.load_n.shape != (self._people, 2):
            raise ValueError(
                f"the loads have shape {feet.load_n.shape}; ({self._people}, 2) is needed, as are the soles"
            )
        load_n = np.where(feet.present[:, None], feet.load_n, 0.0)
        if not (np.isfinite(load_n).all() and (load_n >= 0).all()):
            raise ValueError(f"loads of feet are {load_n.tolist()} N; finite ones from 0 on are needed")
        carrying = load_n > 0
        ahead = feet.pressure_ahead_m
        held = (ahead >= -self._heel[:, None] - _BEYOND_SOLE_M) & (ahead <= self._toes[:, None] + _BEYOND_SOLE_M)
        placed = np.isfinite(feet.place).all(axis=-1) & np.isfinite(feet.yaw)
        bad = carrying & ~(held & placed)
        if bad.any():
            person, foot = np.argwhere(bad)[0]
            raise ValueError(
                f"foot {foot} of person {person} is loaded at {ahead[person, foot]:g} m ahead of the ankle, at "
                f"{feet.place[person, foot].tolist()}; {-self._heel[person]:g} to {self._toes[person]:g} m, "
                f"and a finite place and yaw, are needed"
            )
        return carrying


@dataclass(frozen=True, eq=False)
class _GroupLoad:
    """Loads of a group's feet: force_n (f,), centre_m (f, 2); and by foot and cell, (k,): foot, cell, newton."""

    force_n: Array
    centre_m: Array
    foot: NDArray[np.intp]
    cell: NDArray[np.int64]
    newton: Array


class _FootGroup:
    """Feet of a few people in one MuJoCo model, (f,) feet in total."""

    def __init__(self, rows: int, columns: int, pitch_m: float, points: Array) -> None:
        self._grid = np.array([columns, rows])
        self._pitch_m = pitch_m
        self._points = points.reshape(-1, *points.shape[2:])  # (f, POINTS, 2)
        self._cells = sheet_cells(points, pitch_m)
        step = np.arange(self._cells)
        self._column, self._row = np.tile(step, self._cells), np.repeat(step, self._cells)  # of a sheet's cells

    @cached_property
    def _model(self) -> mujoco.MjModel:
        return soles_model(self._points, self._pitch_m, self._cells)

    @cached_property
    def _data(self) -> mujoco.MjData:
        return mujoco.MjData(self._model)

    @cached_property
    def _sink_m(self) -> Array:
        return first_sink_m(self._model)

    def press(self, place: Array, yaw: Array, load_n: Array, ahead_m: Array) -> _GroupLoad:
        """Return the loads of feet at place (f, 2) with yaw, load_n, ahead_m (f,); a load of 0 lifts the foot."""
        count = len(load_n)
        carrying = load_n > 0
        place = np.where(carrying[:, None], place, 0.0)
        yaw = np.where(carrying, yaw, 0.0)
        cos, sin = np.cos(yaw), np.sin(yaw)
        turn = np.array([[cos, -sin], [sin, cos]]).transpose(2, 0, 1)  # (f, 2, 2)
        points = place[:, None] + self._points @ turn.swapaxes(1, 2)  # (f, POINTS, 2)
        extent = self._grid * self._pitch_m
        over = (points.max(axis=1) > 0).all(axis=1) & (points.min(axis=1) < extent).all(axis=1)
        load_n = np.where(over, load_n, 0.0)
        if not load_n.any():
            nothing = np.zeros(0)
            return _GroupLoad(
                np.zeros(count), np.full((count, 2), np.nan), nothing.astype(int), nothing.astype(int), nothing
            )
        start = sheet_start(points, self._pitch_m)
        touch_n, force_n, tilt = self._settle(start, place, yaw, load_n, np.where(load_n > 0, ahead_m, 0.0))
        with np.errstate(invalid="ignore"):
            centre = np.stack([-tilt[:, 0], tilt[:, 1]], axis=-1) / force_n[:, None]  # (f, 2) in the foot's frame
        centre_m = place + (turn @ centre[..., None])[..., 0]
        column, row = start[:, :1] + self._column, start[:, 1:] + self._row  # (f, cells²)
        felt = (touch_n > 0) & (column >= 0) & (column < self._grid[0]) & (row >= 0) & (row < self._grid[1])
        foot, _ = np.nonzero(felt)
        cell = (row * self._grid[0] + column)[felt]
        return _GroupLoad(force_n, centre_m, foot, cell, touch_n[felt])

    def _settle(
        self, start: NDArray[np.int64], place: Array, yaw: Array, load_n: Array, ahead_m: Array
    ) -> tuple[Array, Array, Array]:
        """Return touch forces (f, cells²) [N], each foot's force (f,) [N] and its moments (f, 2) about y and x [Nm].

        A point exactly on a seam is felt by both elements or by neither: a foot of which the elements do not feel all is moved
        by hundredths of a millimetre until they do.
        """
        nudge = np.zeros(len(load_n))
        lost = load_n > 0
        for _ in range(_NUDGES):
            self._lay(start, place + nudge[:, None], yaw)
            touch_n, forces = self._burst(load_n, ahead_m)
            lost = np.abs(touch_n.sum(axis=1) - forces[:, 0]) > _SEAM_SHARE * load_n
            if not lost.any():
                return touch_n, forces[:, 0], forces[:, 1:]
            nudge[lost] += _NUDGE_M
        raise RuntimeError(f"feet at {place[lost].tolist()} m are not felt whole by the elements under them")

    def _lay(self, start: NDArray[np.int64], place: Array, yaw: Array) -> None:
        """Place the sheets and the feet."""
        count, data = len(yaw), self._data
        data.mocap_pos[:count, :2] = start * self._pitch_m
        data.mocap_pos[count:, :2] = place
        data.mocap_quat[count:, 0] = np.cos(yaw / 2)
        data.mocap_quat[count:, 3] = np.sin(yaw / 2)

    def _burst(self, load_n: Array, ahead_m: Array) -> tuple[Array, Array]:
        """Press the feet from a constant start; return touch (f, cells²) and the contacts' forces on the joints (f, 3)."""
        model, data, count = self._model, self._data, len(load_n)
        data.time = 0.0
        data.qvel[:] = 0.0
        data.qpos[:] = 0.0
        data.qpos[::3] = np.where(load_n > 0, -self._sink_m * load_n, _LIFTED_M)
        data.qfrc_applied[::3] = -load_n
        data.qfrc_applied[1::3] = load_n * ahead_m
        flags = model.opt.disableflags
        model.opt.disableflags = flags | int(mujoco.mjtDisableBit.mjDSBL_SENSOR)
        mujoco.mj_step(model, data, nstep=_STEPS)
        model.opt.disableflags = flags
        # Contacts, their forces and the sites are those at the start of the last step, and so consistent.
        mujoco.mj_sensorAcc(model, data)
        touch_n = data.sensordata.reshape(count, -1).copy()
        return touch_n, data.qfrc_constraint.reshape(count, 3).copy()


def _check_shapes(shapes: FootShapes) -> None:
    measures = np.stack([shapes.heel, shapes.ball, shapes.length - shapes.heel - shapes.ball, shapes.breadth])
    if not (np.isfinite(measures).all() and (measures > 0).all()):
        raise ValueError(
            "a sole's heel, ball, length and breadth must be above 0, with the toes' tips ahead of the ball; "
            f"they are {np.stack([shapes.heel, shapes.ball, shapes.length, shapes.breadth], axis=1).tolist()} m"
        )


class Floor:
    """An ideal floor: each element reports its load by the force curve, rounded to 8 bits, all at the same instant.

    The load comes from MuJoCo's contacts between soles and floor (`FloorPlate`), computed only when a frame is due. A snapshot
    without feet, or without a person present, is the empty room: no element is loaded.

    `shapes` gives the soles of the snapshots' people; it is called when a person first steps on the floor, not before.

    The observation is a LoadFrame: a FloorFrame that still has the loads, for the electronics around it. The truth holds
    `load_n` (rows, columns) [N], and which foot loads which element, (k,) each: `person` (index in the people's order), `foot`
    (0 left, 1 right), `cell` (row · columns + column), `newton`; those of a cell add up to its load. And of each foot, by the
    contacts: `foot_n` (n, 2), its force on the floor in the grid or outside it [N], and `centre_m` (n, 2, 2), its centre of
    pressure in the room, x, y [m], NaN without a force.
    """

    instants_s = (0.0,)

    def __init__(self, name: str, rig: FloorSensor, shapes: Callable[[], FootShapes]) -> None:
        self.name = name
        self._rig = rig
        self._shapes = shapes
        pose = rig.room_from_sensor
        self._origin = pose.translation[:2]
        self._yaw = pose.rpy[2]
        self._rotation = pose.rotation[:2, :2]
        self._last: tuple[Feet, FloorLoad] | None = None

    @cached_property
    def _plate(self) -> FloorPlate:
        return FloorPlate(self._rig.rows, self._rig.columns, self._rig.pitch_m, self._shapes())

    def observe(
        self, stamp_ns: int, snapshots: Iterable[Snapshot], state: State, rng: np.random.Generator
    ) -> tuple[Reading, State]:
        """Return the ideal frame; `rng` and `state` are not used."""
        (snapshot,) = snapshots
        pressed = self._press(snapshot.feet)
        curve = self._rig.curve
        frame = LoadFrame(self.name, stamp_ns, curve.values(pressed.load_n), pressed.load_n, curve)
        truth = {
            "load_n": pressed.load_n,
            "person": pressed.person,
            "foot": pressed.foot,
            "cell": pressed.cell,
            "newton": pressed.newton,
            "foot_n": pressed.foot_n,
            "centre_m": pressed.centre_m @ self._rotation.T + self._origin,
        }
        return Reading(frame, truth), state

    def cells_of_feet(self, feet: Feet) -> list[tuple[tuple[int, ...], tuple[int, ...]]]:
        """Return the indices of the elements loaded by the left and right foot of each person."""
        pressed = self._press(feet)
        cells: list[tuple[list[int], list[int]]] = [([], []) for _ in range(len(feet.present))]
        for person, foot, cell in zip(
            pressed.person.tolist(), pressed.foot.tolist(), pressed.cell.tolist(), strict=True
        ):
            cells[person][foot].append(cell)
        return [(tuple(left), tuple(right)) for left, right in cells]

    def _press(self, feet: Feet | None) -> FloorLoad:
        if feet is None or not (feet.present[:, None] & (feet.load_n != 0)).any():
            return FloorLoad.nothing(self._rig.rows, self._rig.columns, 0 if feet is None else len(feet.present))
        # truth and sensor use the same feet, one after the other
        if self._last is None or self._last[0] is not feet:
            self._last = feet, self._plate.press(self._in_plate_frame(feet))
        return self._last[1]

    def _in_plate_frame(self, feet: Feet) -> Feet:
        return replace(feet, place=(feet.place - self._origin) @ self._rotation, yaw=feet.yaw - self._yaw)

    def rig_sensor(self) -> FloorSensor:
        """Return the tracker's view of the sensor: pose, grid, force curve and topic."""
        return self._rig
