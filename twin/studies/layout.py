"""Where each device of a study may hang: every place turned every way, the reasons against it, and what it costs."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from math import atan2, degrees, hypot

import mujoco
import numpy as np

from trackers.area import Area
from trackers.arrays import Array, Mask
from trackers.errors import InputError
from twin.room.building import Building
from twin.room.floor import floor_of
from twin.room.obstacles import Footprints, obstacles_of
from twin.scenario import Scenario
from twin.scenario.floor import FloorDescription, check_floor
from twin.scenario.housings import in_the_room
from twin.scenario.mount import Mount, mount_of
from twin.scenario.sensors import CAMERA_KINDS
from twin.studies.description import Study
from twin.studies.moves import Move, steps
from twin.world.scene import Scene

_AIM_HEIGHT_M = 1.0
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
            mounts = _mounts(move, scenario, building, scene)
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
            held = [_held(move, scenario, each) for each in mounts]
            reasons = _reasons(study, building, scene, scenario, move, mounts, held)
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
            cable_m = _cable_m(study, building, held)
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
    room = scene.room.compile()
    data = mujoco.MjData(room)
    mujoco.mj_kinematics(room, data)
    floor = floor_of(room, data, scene.room_file.name)
    return Building.of(room, data, floor, scene.walkable, Footprints(obstacles_of(room, scene.room_file.name)))


def first_sensor(move: Move, scenario: Scenario) -> str:
    """The sensor by which a device is described."""
    if move.housing is not None:
        return next(name for name, each in scenario.sensors.items() if getattr(each, "housing", None) == move.housing)
    return (*move.sensors, *move.together)[0]


def inner_mounts(move: Move, scenario: Scenario) -> list[Mount]:
    """Where the sensors of a device are in its own frame: that of its first sensor, or of its housing."""
    if move.housing is not None:
        on_it = [each for each in scenario.sensors.values() if getattr(each, "housing", None) == move.housing]
        return [each.mount for each in on_it]  # pyright: ignore[reportReturnType]
    if move.sensors:
        return [Mount(xyz=(0.0, 0.0, 0.0))]
    first, *_ = hung = [in_the_room(scenario, name).mount.room_from_housing() for name in move.together]  # pyright: ignore
    back = first.rotation.T
    return [mount_of(back @ each.rotation, back @ (each.translation - first.translation)) for each in hung]


def _held(move: Move, scenario: Scenario, mounts: tuple[Mount, ...]) -> Array:
    """Where all sensors of a device (or pair) at these mounts are, (k, 3) [m]."""
    return np.array([mount.carrying(inner).xyz for mount in mounts for inner in inner_mounts(move, scenario)])


def _mounts(move: Move, scenario: Scenario, building: Building, scene: Scene) -> list[tuple[Mount, ...]]:
    """Every place, turned every way, with its mirror image where there is one; yaw and tilt in the room."""
    first = scenario.sensors[first_sensor(move, scenario)]
    is_camera = first.kind in CAMERA_KINDS
    own_pitch = (
        0.0
        if isinstance(first, FloorDescription)
        else in_the_room(scenario, first_sensor(move, scenario)).mount.pitch_deg
    )  # pyright: ignore
    bases: list[Mount] = [Mount(xyz=each.xyz, yaw_deg=each.yaw_deg, pitch_deg=each.pitch_deg) for each in move.places]
    if move.walls is not None:
        walls = move.walls
        heights = steps(walls.height_m, walls.height_every_m)
        places, facing = building.along_walls(walls.every_m, walls.off_m, heights)
        for place, yaw in zip(places.tolist(), facing.tolist(), strict=True):
            x, y, z = place
            bases.append(Mount(xyz=(x, y, z), yaw_deg=degrees(yaw), pitch_deg=own_pitch))
    if move.ceiling is not None:
        low, high = building.outline.min(axis=0), building.outline.max(axis=0)
        grid = [steps((a + move.ceiling.every_m / 2, b), move.ceiling.every_m) for a, b in zip(low, high, strict=True)]
        places = np.array(list(product(*grid)))
        places = places[building.is_indoors(places)]
        heights = building.ceiling_m(places) - move.ceiling.off_m
        for (x, y), z in zip(places.tolist(), heights.tolist(), strict=True):
            if np.isfinite(z):
                bases.append(Mount(xyz=(x, y, z), pitch_deg=own_pitch))
    if move.box is not None:
        axes = [steps(each, move.box.every_m) for each in (move.box.x_m, move.box.y_m, move.box.z_m)]
        bases += [Mount(xyz=(x, y, z), pitch_deg=own_pitch) for x, y, z in product(*axes)]
    middle = scene.area.mean(axis=0)
    turned = []
    for base in bases:
        if move.aim:
            x, y, z = base.xyz
            gap = hypot(middle[0] - x, middle[1] - y)
            yaw = degrees(atan2(middle[1] - y, middle[0] - x))
            pitch = degrees(atan2(z - _AIM_HEIGHT_M, gap)) if is_camera else base.pitch_deg
            turned.append(base.model_copy(update={"yaw_deg": yaw, "pitch_deg": pitch}))
            continue
        yaws = steps(move.yaw_deg, move.yaw_every_deg) if move.yaw_deg else [0.0]
        tilts = steps(move.tilt_deg, move.tilt_every_deg) if move.tilt_deg else [base.pitch_deg]
        turned += [
            base.model_copy(update={"yaw_deg": base.yaw_deg + yaw, "pitch_deg": tilt}) for yaw in yaws for tilt in tilts
        ]
    rounded = [_rounded(each) for each in turned]
    return [(each,) if move.mirrored is None else (each, _image(each, move)) for each in rounded]


def _rounded(mount: Mount) -> Mount:
    """To the millimetre and a hundredth of a degree: what somebody with a drill can read off a plan, and more."""
    x, y, z = (round(each, 3) + 0.0 for each in mount.xyz)
    yaw = (mount.yaw_deg + 180) % 360 - 180
    return Mount(xyz=(x, y, z), yaw_deg=round(yaw, 2) + 0.0, pitch_deg=round(mount.pitch_deg, 2) + 0.0)


def _image(mount: Mount, move: Move) -> Mount:
    mirror = move.mirrored
    assert mirror is not None
    x, y, z = mount.xyz
    if mirror.x_m is not None:
        return _rounded(mount.model_copy(update={"xyz": (2 * mirror.x_m - x, y, z), "yaw_deg": 180 - mount.yaw_deg}))
    assert mirror.y_m is not None
    return _rounded(mount.model_copy(update={"xyz": (x, 2 * mirror.y_m - y, z), "yaw_deg": -mount.yaw_deg}))


def _cable_m(study: Study, building: Building, held: list[Array]) -> Array:
    """Length of cable to each option (n,) [m], to each of a pair; 0 where cables are not counted."""
    cable = study.constraints.cable
    if cable is None:
        return np.zeros(len(held))
    start = np.array(cable.start)
    places = np.concatenate(held)
    straight = cable.along == "straight"
    each = np.linalg.norm(places - start, axis=1) if straight else building.way_along_walls_m(start, places)
    per = len(held[0])
    return each.reshape(len(held), per).max(axis=1)


def _reasons(
    study: Study,
    building: Building,
    scene: Scene,
    scenario: Scenario,
    move: Move,
    mounts: list[tuple[Mount, ...]],
    held: list[Array],
) -> dict[str, Mask]:
    """By reason, which of a device's options (n,) it is against."""
    constraints, places = study.constraints, np.concatenate(held)

    def any_of(which: Mask) -> Mask:
        return np.asarray(which.reshape(len(held), -1).any(axis=1))

    first = scenario.sensors[first_sensor(move, scenario)]
    if isinstance(first, FloorDescription):
        return {"not on the floor of the room": np.array([not _lies(first, scene, each) for each in mounts])}
    reasons = {
        "below the floor": any_of(places[:, 2] < 0),
        "outside the building": any_of(~building.is_indoors(places)),
        "inside a wall or a thing": any_of(building.is_solid(places)),
        f"where people walk below {constraints.walked_below_m:g} m": any_of(
            building.is_walked(places, constraints.walked_below_m)
        ),
    }
    for zone in constraints.keep_free:
        inside = Area(np.array(zone.polygon)).contains(places[:, :2])
        reasons[f"in the zone {zone.name!r}"] = any_of(
            inside & (places[:, 2] >= zone.from_m) & (places[:, 2] <= zone.to_m)
        )
    cable = constraints.cable
    if cable is not None and cable.most_m is not None:
        reasons[f"with more than {cable.most_m:g} m of cable"] = _cable_m(study, building, held) > cable.most_m
    return reasons


def _lies(floor: FloorDescription, scene: Scene, mounts: tuple[Mount, ...]) -> bool:
    """Whether a pressure floor can lie there."""
    for mount in mounts:
        if mount.xyz[2] != 0 or mount.pitch_deg:
            return False
        try:
            there = {"xyz": mount.xyz, "yaw_deg": mount.yaw_deg}
            check_floor(floor.model_copy(update={"mount": floor.mount.model_copy(update=there)}), scene.floor, "")
        except InputError:
            return False
    return True
