"""Candidate set of a study: the poses that the constraints leave, their prices, and their compatibility."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np

from trackers.arrays import Array
from trackers.errors import InputError, raise_faults, text_near_bound
from twin.room.building import Building
from twin.room.floor_surface import floor_of
from twin.room.mjcf import compiled
from twin.room.obstacles import Footprints, obstacles_of
from twin.scenario import Scenario
from twin.scenario.housings import in_the_room
from twin.scenario.mount import Mount
from twin.scenario.sensor_descriptions import AnyDescription
from twin.studies.candidate_poses import (
    cable_lengths_m,
    candidate_mounts,
    keep_free_zones,
    most_poses,
    rejection_reasons,
    sensor_positions,
)
from twin.studies.devices import Device, KeepFreeZone, format_price
from twin.studies.spec import Study
from twin.world.scene import Scene

_MOST_POSES = 200_000
_SPARE = 4
"""Poses that are made before those outside of the building are left out, in multiples of these."""

Placement = tuple[int, ...]
"""Indices of the candidate poses, ascending; empty for the baseline, the scenario's own placement."""
BASELINE: Placement = ()


@dataclass(frozen=True)
class CandidatePose:
    """A device (or a mirrored pair) of one kind at one pose: the mounts of its first sensor, or housing, in the room.

    price, cable_m: of both devices of a pair together.
    """

    device: str
    kind: int
    mounts: tuple[Mount, ...]
    price: float
    cable_m: float


def _no_pose(device: Device) -> str:
    """State the reason that a device has no pose, and the remedy."""
    if device.ceiling is not None and not (device.walls or device.places or device.box):
        return (
            "no place on the grid is under a ceiling; a geom of the room above 2 m, a finer every_m, or heights in a box "
            "(x_m, y_m, z_m) are expected"
        )
    off = "; a smaller off_m, or" if device.walls is not None else ";"
    return f"there is no pose in the room{off} larger ranges are expected"


@dataclass(frozen=True, eq=False)
class CandidateSet:
    """All candidate poses that keep the constraints.

    rejected: number of rejected poses, by device and reason; positions: those of each pose's sensors (k, 3) [m];
    n_considered: number of poses by device before rejection.
    """

    study: Study
    scenario: Scenario
    building: Building
    poses: tuple[CandidatePose, ...]
    positions: tuple[Array, ...]
    rejected: dict[str, dict[str, int]]
    n_considered: dict[str, int]
    zones: tuple[KeepFreeZone, ...] = ()
    """The zones without devices, as polygons."""

    @classmethod
    def of(cls, study: Study, scenario: Scenario, scene: Scene, source: str) -> CandidateSet:
        """Find the candidate poses in a scenario's room. Raises InputError, naming `source`, where a device has none."""
        building = building_of(scene)
        zones = keep_free_zones(study.constraints, building, source)
        poses: list[CandidatePose] = []
        positions: list[Array] = []
        rejected: dict[str, dict[str, int]] = {}
        n_considered: dict[str, int] = {}
        faults: list[str] = []
        for name, device in study.devices.items():
            n_pose = most_poses(device, building) * len(device.kinds)
            mounts: list[tuple[Mount, ...]] = []
            if n_pose <= _SPARE * _MOST_POSES:
                mounts = candidate_mounts(device, scenario, building, scene)
                n_pose = len(mounts) * len(device.kinds)
            n_considered[name] = len(mounts)
            if n_pose > _MOST_POSES:
                faults.append(
                    f"{source}: devices.{name}: has {n_pose:.7g} poses; at most {_MOST_POSES} are expected, by larger steps"
                )
                continue
            if not mounts:
                faults.append(f"{source}: devices.{name}: {_no_pose(device)}")
                continue
            held = [sensor_positions(device, scenario, each) for each in mounts]
            reasons = rejection_reasons(study, building, scene, scenario, device, mounts, held, zones)
            left = np.ones(len(mounts), dtype=bool)
            counts = {}
            for reason, violation in reasons.items():
                counts[reason] = int((left & violation).sum())
                left &= ~violation
            rejected[name] = {reason: count for reason, count in counts.items() if count}
            if not left.any():
                reasons_text = ", ".join(f"{count} {reason}" for reason, count in rejected[name].items())
                faults.append(
                    f"{source}: devices.{name}: of its {len(mounts)} poses none is left: {reasons_text}; other poses or weaker "
                    "constraints are expected"
                )
                continue
            cable_m = cable_lengths_m(study, building, held, len(mounts[0])).sum(axis=1)
            for number in np.flatnonzero(left):
                for kind_number, kind in enumerate(device.kinds):
                    per_m = study.constraints.cable.price_per_m if study.constraints.cable else 0.0
                    price = device.price_of(kind) * len(mounts[number]) + per_m * float(cable_m[number])
                    poses.append(CandidatePose(name, kind_number, mounts[number], price, float(cable_m[number])))
                    positions.append(held[number])
        raise_faults(faults)
        candidate_set = cls(study, scenario, building, tuple(poses), tuple(positions), rejected, n_considered, zones)
        candidate_set._check(source)
        return candidate_set

    @cached_property
    def by_device(self) -> dict[str, list[int]]:
        """The numbers of each device's candidate poses."""
        found: dict[str, list[int]] = {name: [] for name in self.study.devices}
        for number, pose in enumerate(self.poses):
            found[pose.device].append(number)
        return found

    @cached_property
    def prices(self) -> Array:
        """The price of each candidate pose, (n,)."""
        return np.array([pose.price for pose in self.poses])

    def apart_m(self, one: int, other: int) -> float:
        """Return the least distance between the devices of two candidate poses [m]."""
        gaps = self.positions[one][:, None] - self.positions[other]
        return float(np.sqrt((gaps**2).sum(axis=-1)).min())

    def too_near(self, one: int, other: int) -> bool:
        """Return True where two poses exclude each other: nearer than `apart_m`, or the same position."""
        return self.apart_m(one, other) < max(self.study.constraints.apart_m, 1e-6) - 1e-9

    def price(self, placement: Placement) -> float:
        """Return the price of a placement's devices and cables.

        A device of the scenario's own counts as the first kind that changes nothing of it, else as the first.
        """
        if placement != BASELINE:
            return float(self.prices[list(placement)].sum())
        return sum(
            self.device_price(device, self.scenario.sensors[name] if name else None) + self._own_cable(device, name)
            for device in self.study.devices.values()
            for name in device.sensors or ("",)
        )

    def _own_cable(self, device: Device, name: str) -> float:
        """Return the price of the cable to a device of the scenario's own: of this sensor; "": of several sensors."""
        if (cable := self.study.constraints.cable) is None:
            return 0.0
        sensors = [name] if name else device.sensors_in(self.scenario)
        held = np.array([in_the_room(self.scenario, each).mount.xyz for each in sensors])
        return cable.price_per_m * float(cable_lengths_m(self.study, self.building, [held], 1)[0, 0])

    def device_price(self, device: Device, sensor: AnyDescription | None) -> float:
        """Return the price of a device that stands for a sensor: of the first matching kind; None: of several sensors."""
        own = sensor.model_dump(mode="json", exclude_none=True) if sensor is not None else {}
        possible = [kind for kind in device.kinds if all(own.get(field) == value for field, value in kind.set.items())]
        return device.price_of((possible or device.kinds)[0])

    def violation(self, placement: Iterable[int]) -> str:
        """Return the constraint that a set of poses violates; "" for none."""
        chosen = sorted(placement)
        for name, device in self.study.devices.items():
            number = sum(self.poses[each].device == name for each in chosen)
            least, most = device.counts
            if not least <= number <= most:
                return f"devices.{name}.count: {number} of them, {least} to {most} are expected"
        return self.conflict(chosen)

    def over_budget(self, number: Mapping[str, int]) -> str:
        """Return that so many devices cost more than the budget, wherever they are; "" where they may cost less."""
        budget, least = self.study.constraints.budget, 0.0
        for name, count in number.items():
            least += float(np.sort(self.prices[self.by_device[name]])[:count].sum())
        if budget is None or least <= budget + 1e-9:
            return ""
        return f"over the budget of {budget:g}: they cost {format_price(least)} at least"

    def conflict(self, chosen: list[int]) -> str:
        """Return the conflict between poses, whatever the required count; "" for none."""
        budget = self.study.constraints.budget
        if budget is not None and self.prices[chosen].sum() > budget + 1e-9:
            costs = text_near_bound(float(self.prices[chosen].sum()), budget, ".6g")
            return f"constraints.budget: costs {costs}, at most {budget:g} is expected"
        for place, one in enumerate(chosen):
            for other in chosen[place + 1 :]:
                if self.too_near(one, other):
                    apart = text_near_bound(self.apart_m(one, other), self.study.constraints.apart_m)
                    return f"constraints.apart_m: two are {apart} m apart"
        return ""

    def _check(self, source: str) -> None:
        """Raise InputError where no set can keep the constraints: budget, or distance between devices."""
        constraints, cheapest = self.study.constraints, 0.0
        for name, numbers in self.by_device.items():
            least = self.study.devices[name].counts[0]
            cheapest += float(np.sort(self.prices[numbers])[:1].sum()) * least
            spread = np.concatenate([self.positions[each] for each in numbers])
            across_m = float(np.linalg.norm(np.ptp(spread, axis=0)))
            if least >= 2 and across_m < constraints.apart_m:
                across = text_near_bound(across_m, constraints.apart_m)
                raise InputError(
                    f"{source}: constraints.apart_m and devices.{name}.count: {least} devices {constraints.apart_m:g} m apart do "
                    f"not fit in {across} m; a smaller distance or fewer devices are expected"
                )
        if constraints.budget is not None and cheapest > constraints.budget + 1e-9:
            costs = text_near_bound(cheapest, constraints.budget, ".6g")
            raise InputError(
                f"{source}: constraints.budget: {constraints.budget:g} is below the cheapest set, which costs {costs}; at "
                "least that is expected"
            )


def building_of(scene: Scene) -> Building:
    """Return the building of a scene's room, without its people."""
    room = compiled(scene.room, scene.room_file)
    data = mujoco.MjData(room)
    mujoco.mj_kinematics(room, data)
    floor = floor_of(room, data, scene.room_file.name)
    return Building.of(room, data, floor, scene.walkable, Footprints(obstacles_of(room, scene.room_file.name)))
