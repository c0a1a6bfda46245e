"""The options of a study: where each device may be mounted, what that costs, and which of them go together."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np

from trackers.arrays import Array
from trackers.errors import InputError
from twin.room.building import Building
from twin.room.floor import floor_of
from twin.room.model import compiled
from twin.room.obstacles import Footprints, obstacles_of
from twin.scenario import Scenario
from twin.scenario.mount import Mount
from twin.studies.description import Study
from twin.studies.mounts import every_mount, positions_at
from twin.studies.moves import Move
from twin.studies.refusals import cable_lengths_m, reasons_against
from twin.world.scene import Scene

_MOST_OPTIONS = 200_000

Candidate = tuple[int, ...]
"""The numbers of its options, ascending; of the scenario's own placement none."""
OWN: Candidate = ()


@dataclass(frozen=True)
class Option:
    """A device (or a mirrored pair) of one kind at one place: the mounts of its first sensor, or housing, in the room."""

    device: str
    kind: int
    mounts: tuple[Mount, ...]
    price: float
    cable_m: float


@dataclass(frozen=True, eq=False)
class Layout:
    """All options that keep the constraints, and how many there were before.

    refused: by device and reason, how many options it takes; positions: of each option, where all of its sensors are (k, 3) [m].
    """

    study: Study
    scenario: Scenario
    building: Building
    options: tuple[Option, ...]
    positions: tuple[Array, ...]
    refused: dict[str, dict[str, int]]
    tried: dict[str, int]

    @classmethod
    def of(cls, study: Study, scenario: Scenario, scene: Scene, source: str) -> Layout:
        """The options in the room of a scenario. Raises InputError, naming `source`, where a device has none."""
        building = building_of(scene)
        options: list[Option] = []
        positions: list[Array] = []
        refused: dict[str, dict[str, int]] = {}
        tried: dict[str, int] = {}
        faults: list[str] = []
        for name, move in study.move.items():
            mounts = every_mount(move, scenario, building, scene)
            tried[name] = len(mounts)
            if len(mounts) * len(move.kinds) > _MOST_OPTIONS:
                faults.append(
                    f"{source}: move.{name}: has {len(mounts) * len(move.kinds)} places; at most {_MOST_OPTIONS} are expected, "
                    "by larger steps"
                )
                continue
            if not mounts:
                faults.append(f"{source}: move.{name}: there is no place in the room; larger ranges are expected")
                continue
            held = [positions_at(move, scenario, each) for each in mounts]
            reasons = reasons_against(study, building, scene, scenario, move, mounts, held)
            left = np.ones(len(mounts), dtype=bool)
            counts = {}
            for reason, against in reasons.items():
                counts[reason] = int((left & against).sum())
                left &= ~against
            refused[name] = {reason: count for reason, count in counts.items() if count}
            if not left.any():
                told = ", ".join(f"{count} {reason}" for reason, count in refused[name].items())
                faults.append(
                    f"{source}: move.{name}: of its {len(mounts)} places none is left: {told}; other places or weaker "
                    "constraints are expected"
                )
                continue
            cable_m = cable_lengths_m(study, building, held)
            for number in np.flatnonzero(left):
                for kind_number, kind in enumerate(move.kinds):
                    each = kind.price if kind.price is not None else move.price
                    per_m = study.constraints.cable.price_per_m if study.constraints.cable else 0.0
                    price = each * len(mounts[number]) + per_m * float(cable_m[number])
                    options.append(Option(name, kind_number, mounts[number], price, float(cable_m[number])))
                    positions.append(held[number])
        if faults:
            raise InputError("\n".join(faults))
        layout = cls(study, scenario, building, tuple(options), tuple(positions), refused, tried)
        layout._check(source)
        return layout

    @cached_property
    def of_device(self) -> dict[str, list[int]]:
        """The options of each device."""
        found: dict[str, list[int]] = {name: [] for name in self.study.move}
        for number, option in enumerate(self.options):
            found[option.device].append(number)
        return found

    @cached_property
    def prices(self) -> Array:
        """What each option costs, (n,)."""
        return np.array([option.price for option in self.options])

    def apart_m(self, one: int, other: int) -> float:
        """The least distance between the devices of two options [m]."""
        gaps = self.positions[one][:, None] - self.positions[other]
        return float(np.sqrt((gaps**2).sum(axis=-1)).min())

    def too_near(self, one: int, other: int) -> bool:
        """Whether two options cannot be taken together: nearer than `apart_m`, or the same place."""
        return self.apart_m(one, other) < max(self.study.constraints.apart_m, 1e-6) - 1e-9

    def price(self, candidate: Candidate) -> float:
        """What the devices and cables of a candidate cost; of the scenario's own placement, what its devices do.

        A device of the scenario's own is of the first kind that changes nothing of it, or of the first.
        """
        if candidate != OWN:
            return float(self.prices[list(candidate)].sum())
        return sum(
            self._price_as_it_is(move, name) for move in self.study.move.values() for name in move.sensors or ("",)
        )

    def _price_as_it_is(self, move: Move, name: str) -> float:
        """What a device costs that the scenario has; name: its sensor, "" where it is of several."""
        sensors = self.scenario.sensors
        own = sensors[name].model_dump(mode="json", exclude_none=True) if name else {}
        alike = [kind for kind in move.kinds if all(own.get(field) == value for field, value in kind.set.items())]
        kind = (alike or move.kinds)[0]
        return kind.price if kind.price is not None else move.price

    def against(self, candidate: Iterable[int]) -> str:
        """Why a set of options may not be taken; "" where it may."""
        chosen = sorted(candidate)
        for name, move in self.study.move.items():
            number = sum(self.options[each].device == name for each in chosen)
            least, most = move.counts
            if not least <= number <= most:
                return f"move.{name}.count: {number} of them, {least} to {most} are expected"
        return self.conflict(chosen)

    def conflict(self, chosen: list[int]) -> str:
        """Why options cannot be together, however many there should be; "" where they can."""
        budget = self.study.constraints.budget
        if budget is not None and self.prices[chosen].sum() > budget + 1e-9:
            return f"constraints.budget: costs {self.prices[chosen].sum():g}, at most {budget:g} is expected"
        for place, one in enumerate(chosen):
            for other in chosen[place + 1 :]:
                if self.too_near(one, other):
                    return f"constraints.apart_m: two are {self.apart_m(one, other):.2f} m apart"
        return ""

    def _check(self, source: str) -> None:
        """Raise InputError where no set can keep the constraints: the budget, or the distance between devices."""
        constraints, cheapest = self.study.constraints, 0.0
        for name, numbers in self.of_device.items():
            least = self.study.move[name].counts[0]
            cheapest += float(np.sort(self.prices[numbers])[:1].sum()) * least
            spread = np.concatenate([self.positions[each] for each in numbers])
            across_m = float(np.linalg.norm(np.ptp(spread, axis=0)))
            if least >= 2 and across_m < constraints.apart_m:
                raise InputError(
                    f"{source}: constraints.apart_m and move.{name}.count: {least} devices {constraints.apart_m:g} m apart do "
                    f"not fit in {across_m:.2f} m; a smaller distance or fewer devices are expected"
                )
        if constraints.budget is not None and cheapest > constraints.budget + 1e-9:
            raise InputError(
                f"{source}: constraints.budget: {constraints.budget:g} is below the cheapest set, which costs {cheapest:g}; at "
                "least that is expected"
            )


def building_of(scene: Scene) -> Building:
    """The building of a scene's room, without its people."""
    room = compiled(scene.room, scene.room_file)
    data = mujoco.MjData(room)
    mujoco.mj_kinematics(room, data)
    floor = floor_of(room, data, scene.room_file.name)
    return Building.of(room, data, floor, scene.walkable, Footprints(obstacles_of(room, scene.room_file.name)))
