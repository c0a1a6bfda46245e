"""Pressure floor: a grid of force-sensing resistors under people's feet."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import cached_property

import numpy as np

from trackers.rig import FloorSensor
from twin.instant.snapshot import Feet, FootShapes, Snapshot
from twin.sensors.floor_electronics import LoadFrame
from twin.sensors.floor_plate import FloorLoad, FloorPlate
from twin.sensors.sensor import Reading, State


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
        if feet is None:
            return self._pressed(None)
        # truth and sensor use the same stamp, one after the other
        if self._last is None or self._last[0] is not feet:
            self._last = feet, self._pressed(feet)
        return self._last[1]

    def _pressed(self, feet: Feet | None) -> FloorLoad:
        if feet is None or not (feet.present[:, None] & (feet.load_n != 0)).any():
            return FloorLoad.nothing(self._rig.rows, self._rig.columns, 0 if feet is None else len(feet.present))
        return self._plate.press(self._in_plate_frame(feet))

    def _in_plate_frame(self, feet: Feet) -> Feet:
        return replace(feet, place=(feet.place - self._origin) @ self._rotation, yaw=feet.yaw - self._yaw)

    def rig_sensor(self) -> FloorSensor:
        """Return the tracker's view of the sensor: pose, grid, force curve and topic."""
        return self._rig
