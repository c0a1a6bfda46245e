"""Resolve `room`, `people` and `sensors` of `kind: drawn` in a scenario into plain entries and a room's file.

Rigs of drawn rooms have sensors mounted as by installers.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trackers.arrays import Array
from trackers.configuration import validate
from trackers.errors import InputError
from twin.drawn.distributions import DrawnPeople, DrawnRoom, DrawnSensors, draw_count, draw_from, drawn_fields
from twin.drawn.draw_building import DrawnBuilding, draw_building
from twin.drawn.draw_people import draw_people
from twin.drawn.floor_plan import DOOR_M
from twin.streams import stream

_OFF_WALL_M = 0.06
_CLEAR_M = 0.6
"""Floor before a scanner without furniture [m]."""
_TRIES = 60
_APART_M = 0.6
"""Distance from a person's start to the body of a robot [m]."""
CLEARANCE_M = 0.38
"""Least distance of drawn people's middles from furniture and walls [m], as some wear skirts and some are broad."""


def draw_sensors(
    options: DrawnSensors, building: DrawnBuilding, duration_s: float, seed: int, starts: Array
) -> dict[str, Any]:
    """Draw the entries `sensors`, `housings` and `faults` of a scenario; starts (n, 2): of people, in the room frame [m]."""
    seed = options.seed if options.seed is not None else seed
    rng = stream(seed, "drawn sensors", "")
    draws = _RigDraws(options, building, rng)
    sensors: dict[str, dict[str, Any]] = {}
    for kind, bounds, draw in (
        ("scanner", options.scanners, draws.scanner),
        ("fisheye", options.fisheyes, draws.fisheye),
        ("camera", options.cameras, draws.camera),
        ("stereo", options.stereos, draws.stereo),
    ):
        for number in range(1, draw_count(bounds, rng) + 1):
            sensors[f"{kind}_{number}"] = draw()
    if rng.random() < options.floor:
        sensors["floor"] = draws.floor()
    housings = {}
    own = stream(seed, "drawn robots", "")
    for number in range(1, draw_count(options.robots, own) + 1):
        housing = _robot(building, own, starts)
        if housing is None:
            break  # no floor is free
        housings[f"robot_{number}"] = housing
        starts = np.vstack([starts, housing["mount"]["xyz"][:2]])
        sensors[f"robot_{number}_scanner"] = _robot_scanner(options, own) | {"housing": f"robot_{number}"}
    if options.range_10_percent_m is not None:
        own, (nearest, farthest) = stream(seed, "drawn echoes", ""), np.log(options.range_10_percent_m)
        for description in sensors.values():
            if description["kind"] == "laser":
                description["range_10_percent_m"] = round(float(np.exp(own.uniform(nearest, farthest))), 1)
    faults = {}
    for name in sensors:
        if rng.random() < options.faults:
            start = rng.uniform(0, 0.6) * duration_s
            faults[f"{name}_drops"] = {
                "sensor": name,
                "kind": "dropout",
                "probability": draw_from((0.1, 1.0), rng, 2),
                "from_s": round(float(start), 1),
                "to_s": round(float(start + rng.uniform(0.1, 0.3) * duration_s), 1),
            }
    others = {"housings": housings, "faults": faults}
    return {"sensors": sensors} | {name: entries for name, entries in others.items() if entries}


def _robot(building: DrawnBuilding, rng: np.random.Generator, starts: Array) -> dict[str, Any] | None:
    """Draw a round robot that wanders, on free floor away from all starts (n, 2) [m]; None where there is none."""
    radius = float(rng.uniform(0.15, 0.25))
    for place in building.to_room(building.space.draw(_TRIES, rng)):
        if np.hypot(*(np.reshape(starts, (-1, 2)) - place).T).min(initial=np.inf) > _APART_M + radius:
            break
    else:
        return None
    return {
        "mount": {"xyz": [*place, 0.0], "yaw_deg": draw_from((-180, 180), rng, 1)},
        "drive": {
            "kind": "wander",
            "speed_m_s": draw_from((0.3, 1.0), rng, 2),
            "turn_rate": draw_from((0.6, 1.5), rng, 2),
        },
        "body": {"radius_m": round(radius, 2), "height_m": draw_from((0.12, 0.3), rng, 2)},
        "odometry": {
            "drift": draw_from((0.0, 0.03), rng, 3),
            "noise": draw_from((0.0, 0.02), rng, 3),
            "slip": round(float(rng.choice([0.0, 0.02])), 2),
        },
    }


def _robot_scanner(options: DrawnSensors, rng: np.random.Generator) -> dict[str, Any]:
    """Draw the scanner of a robot, at knee height or below, that sweeps for most of its period."""
    rate = draw_from(options.scanner_hz, rng, 1)
    return {
        "kind": "laser",
        "role": "knee",
        "rate_hz": rate,
        "field_of_view_deg": float(rng.choice(options.field_of_view_deg)),
        "resolution_deg": float(rng.choice(options.resolution_deg)),
        "range_max_m": draw_from(options.range_m, rng, 1),
        "sweep_time_s": round(float(rng.uniform(0.5, 0.9)) / rate, 4),
        "mount": {
            "xyz": [draw_from((0.0, 0.1), rng, 2), 0.0, draw_from((0.2, 0.45), rng, 2)],
            "yaw_deg": draw_from((-10, 10), rng, 1),
        },
        "noise": str(rng.choice(list(options.noise))),
    }


class _RigDraws:
    def __init__(self, options: DrawnSensors, building: DrawnBuilding, rng: np.random.Generator) -> None:
        self._options, self._building, self._rng = options, building, rng
        self._hung: list[Array] = []  # occupied places on walls
        self._corners = [*range(len(building.plan.outline))]
        rng.shuffle(self._corners)

    def scanner(self) -> dict[str, Any]:
        """Draw a scanner on a wall, level, looking into the room."""
        rng, options = self._rng, self._options
        is_waist = rng.random() < options.waist
        height = float(rng.uniform(0.85, 1.1) if is_waist else rng.uniform(0.25, 0.45))
        place, yaw = self._on_a_wall()
        fov = float(rng.choice(options.field_of_view_deg))
        return {
            "kind": "laser",
            "role": "waist" if is_waist else "knee",
            "rate_hz": draw_from(options.scanner_hz, rng, 1),
            "phase_s": draw_from((0, 0.03), rng, 3),
            "field_of_view_deg": fov,
            "resolution_deg": float(rng.choice(options.resolution_deg)),
            "range_max_m": draw_from(options.range_m, rng, 1),
            "mount": self._mount(place, height, yaw + rng.uniform(-10, 10)),
            "noise": self._noise(),
        }

    def fisheye(self) -> dict[str, Any]:
        """Draw a fisheye camera at head height on a wall, looking into the room."""
        place, yaw = self._on_a_wall()
        return {
            "kind": "fisheye",
            "rate_hz": self._rate(),
            "size": list(self._options.fisheye_px),
            "mount": self._mount(
                place, float(self._rng.uniform(1.05, 2.2)), yaw, pitch_deg=float(self._rng.uniform(0, 20))
            ),
            "noise": self._noise(),
        }

    def camera(self) -> dict[str, Any]:
        """Draw a pinhole camera in a corner under the ceiling, looking down into the room."""
        return {"kind": "camera", "rate_hz": self._rate(), "size": list(self._options.camera_px),
                "vertical_field_of_view_deg": 62, "mount": self._in_a_corner(), "noise": self._noise()}  # fmt: skip

    def stereo(self) -> dict[str, Any]:
        """Draw a stereo camera in a corner under the ceiling."""
        return {"kind": "stereo", "rate_hz": min(self._rate(), 8.0), "size": list(self._options.stereo_px),
                "vertical_field_of_view_deg": 59, "baseline_m": 0.12, "mode": "matched",
                "mount": self._in_a_corner(), "noise": self._noise()}  # fmt: skip

    def floor(self) -> dict[str, Any]:
        """Draw a pressure floor of 200 mm elements under the largest room."""
        room = max(self._building.plan.rooms, key=lambda each: each.area_m2)
        columns, rows = int((room.x1 - room.x0 - 0.1) / 0.2), int((room.y1 - room.y0 - 0.1) / 0.2)
        corner = self._building.to_room(np.array([room.x0 + 0.05, room.y0 + 0.05]))[0]
        yaw = round(float(np.degrees(self._building.placement.turn)), 3)
        return {"kind": "floor", "rate_hz": 10, "rows": rows, "columns": columns, "pitch_m": 0.2,
                "mount": {"xyz": [*corner, 0], "yaw_deg": yaw}}  # fmt: skip

    def _noise(self) -> str:
        return str(self._rng.choice(list(self._options.noise)))

    def _rate(self) -> float:
        return draw_from(self._options.camera_hz, self._rng, 1)

    def _mount(self, place: Array, height_m: float, yaw_deg: float, pitch_deg: float = 0.0) -> dict[str, Any]:
        """Return a mount at a place and yaw of the plan."""
        yaw = (yaw_deg + np.degrees(self._building.placement.turn) + 180) % 360 - 180
        mount: dict[str, Any] = {
            "xyz": [*self._building.to_room(place)[0], round(height_m, 3)],
            "yaw_deg": round(float(yaw), 1),
        }
        return mount | ({"pitch_deg": round(pitch_deg, 1)} if pitch_deg else {})

    def _on_a_wall(self) -> tuple[Array, float]:
        """Draw a free place on an outer wall and its direction [deg], not behind furniture, in a door or beside another
        sensor.
        """
        plan, rng = self._building.plan, self._rng
        lengths = np.array([wall.length_m for wall in plan.walls])
        best: tuple[float, Array, float] | None = None
        for _ in range(_TRIES):
            wall = plan.walls[int(rng.choice(len(lengths), p=lengths / lengths.sum()))]
            along = rng.uniform(0.15, wall.length_m - 0.15)
            place = wall.at(along, _OFF_WALL_M)
            in_door = any(door.wall == wall and abs(door.along_m - along) < DOOR_M / 2 + 0.1 for door in plan.doors)
            if in_door or not self._is_clear(place, wall.inwards):
                continue
            apart = min((float(np.hypot(*(place - other))) for other in self._hung), default=np.inf)
            found = (apart, place, float(np.degrees(wall.faces)))
            if best is None or apart > best[0]:
                best = found
            if apart > 2.5:
                break
        if best is None:  # furniture along every wall: a corner is free
            corner = plan.outline[0] + _OFF_WALL_M
            best = (0.0, corner, 45.0)
        self._hung.append(best[1])
        return best[1], best[2]

    def _is_clear(self, place: Array, inwards: Array) -> bool:
        """Return whether no furniture stands right before a place on a wall, and no partition meets it there."""
        ahead = place + np.linspace(0, _CLEAR_M, 7)[:, None] * inwards
        lateral = np.array([-inwards[1], inwards[0]])
        points = np.concatenate([ahead, ahead + 0.15 * lateral, ahead - 0.15 * lateral])
        for piece in self._building.pieces:
            local = (points - piece.place) @ np.array(
                [[np.cos(piece.yaw), -np.sin(piece.yaw)], [np.sin(piece.yaw), np.cos(piece.yaw)]]
            )
            if (
                (np.abs(local[:, 0]) < piece.width_m / 2 + 0.05)
                & (local[:, 1] > -0.1)
                & (local[:, 1] < piece.depth_m + 0.05)
            ).any():
                return False
        ends = [np.array(end) for each in self._building.plan.partitions for end in (each.start, each.end)]
        return all(np.hypot(*(place - end)) > 0.4 for end in ends)

    def _in_a_corner(self) -> dict[str, Any]:
        """Draw a place in a corner under the ceiling, directed at the middle of the nearest room."""
        plan, rng = self._building.plan, self._rng
        corner = self._corners.pop() if self._corners else int(rng.integers(len(plan.outline)))
        before, after = plan.walls[corner - 1], plan.walls[corner]
        place = plan.outline[corner] + 0.15 * (before.inwards + after.inwards)
        room = min(plan.rooms, key=lambda each: float(np.hypot(*(each.middle - place))))
        off = room.middle - place
        height = min(plan.height_m - 0.15, 3.0)
        pitch = float(np.degrees(np.arctan2(height - 1.0, np.hypot(*off))))
        return self._mount(place, height, float(np.degrees(np.arctan2(off[1], off[0]))), pitch_deg=min(pitch, 50.0))


def draw_scene(content: dict[str, Any], source: str, keep_room: Callable[[str, str], str]) -> dict[str, Any]:
    """Return a scenario's content with its drawn parts filled in.

    content: plain data with `seed` and `duration_s`. keep_room: given a name and the MJCF, writes the room's file and
    returns the path for the entry `room`. People and sensors are drawn only into drawn rooms. Raises InputError, naming
    `source`.
    """
    room = content.get("room")
    fields = drawn_fields(content)
    if "room" not in fields:
        field = fields[0]
        raise InputError(f"{source}: {field}: can be drawn into a drawn room only; room: {{kind: drawn}} is expected")
    seed, duration_s = content.get("seed", 0), content.get("duration_s")
    if not isinstance(seed, int) or isinstance(seed, bool) or not 0 <= seed < 2**63:
        return content | {"room": "drawn"}  # the scenario's own check reports it
    if isinstance(duration_s, bool) or not isinstance(duration_s, int | float) or not duration_s > 0:
        duration_s = 20.0
    options = validate(DrawnRoom, room, f"{source}: room")
    building = _building(options, seed, source)
    digest = hashlib.sha256(building.mjcf.encode()).hexdigest()[:16]
    drawn = content | {"room": keep_room(f"drawn_{digest}", building.mjcf)}
    if "people" in fields:
        people = validate(DrawnPeople, content["people"], f"{source}: people")
        drawn["people"] = draw_people(people, building, float(duration_s), seed)
        drawn.setdefault("clearance_m", CLEARANCE_M)
    if "sensors" in fields:
        sensors = validate(DrawnSensors, content["sensors"], f"{source}: sensors")
        rig = draw_sensors(sensors, building, float(duration_s), seed, _starts(drawn.get("people")))
        drawn["sensors"] = rig.pop("sensors")
        for field, entries in rig.items():
            own = content.get(field)
            drawn[field] = entries | (own if isinstance(own, dict) else {})
    return drawn


def _building(options: DrawnRoom, seed: int, source: str) -> DrawnBuilding:
    try:
        return draw_building(options, seed, "drawn")
    except ValueError as error:
        raise InputError(f"{source}: room: {error}") from error


def _starts(people: Any) -> NDArray[np.float64]:
    """Return where people start (n, 2) [m], those whose start is given."""
    each = people.values() if isinstance(people, dict) else ()
    found = [person["start"] for person in each if isinstance(person, dict) and "start" in person]
    try:
        return np.array(found, float).reshape(-1, 2)
    except (TypeError, ValueError):
        return np.empty((0, 2))  # the scenario's own check reports it
