"""People of drawn rooms, alone or in groups, with their activities; scripts as in scenarios."""

from __future__ import annotations

from typing import Any

import numpy as np

from trackers.arrays import Array
from twin.drawn.distributions import DrawnPeople, draw_count, draw_from
from twin.drawn.draw_building import DrawnBuilding
from twin.streams import stream

_NAMES = (
    "ada", "ben", "cleo", "dan", "eva", "finn", "gina", "hugo", "ines", "jan", "kira", "leo", "mia", "nils", "olga",
    "paul", "quin", "rosa", "sam", "tara", "udo", "vera", "wim", "xenia", "yara", "zoe",
)  # fmt: skip
_WAYS = 0.4 * np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
"""Ways of the plan in which a hand reaches, to its point [m]."""
_APART_M = 0.8
"""Least distance of two people's starts [m]."""
_GROUP_SIZES = (2, 3, 4)
_GROUP_SHARES = (0.65, 0.25, 0.1)
"""Shares of group sizes: most are pairs (Moussaïd et al. 2010, figure 1, sizes of two to four)."""
_ABREAST_M, _SHOULDERS_M, _BEHIND_M, _FAR_M = (0.65, 0.8), (0.5, 0.6), (0.8, 1.1), (0.8, 1.1)

Script = list[dict[str, Any]]


def draw_people(
    options: DrawnPeople, building: DrawnBuilding, duration_s: float, seed: int
) -> dict[str, dict[str, Any]]:
    """Draw people by name, each as a scenario's entry; fewer if the floor is short of space."""
    seed = options.seed if options.seed is not None else seed
    rng = stream(seed, "drawn people", "")
    count = draw_count(options.count, rng)
    count = max(1, min(count, int(building.space.area_m2 / options.least_floor_m2)))
    groups = _groups(count, options, rng)
    draws = _PeopleDraws(options, building, duration_s, rng)
    people: dict[str, dict[str, Any]] = {}
    for size in groups:
        names = [_name(len(people) + place) for place in range(size)]
        members = draws.group(names, list(people))
        people |= {name: member for name, member in zip(names, members, strict=True) if member is not None}
    return people


def _name(number: int) -> str:
    again = number // len(_NAMES)
    return _NAMES[number % len(_NAMES)] + (f"_{again + 1}" if again else "")


def _groups(count: int, options: DrawnPeople, rng: np.random.Generator) -> list[int]:
    """Draw the sizes of the groups that `count` people come in; 1: alone."""
    groups: list[int] = []
    grouped, left = 0, count
    while left:
        size = 1
        if left >= 2 and grouped < round(options.in_groups * count):
            size = min(int(rng.choice(_GROUP_SIZES, p=_GROUP_SHARES)), left)
            grouped += size
        groups.append(size)
        left -= size
    return groups


class _PeopleDraws:
    """Draws for people's scripts; seats, beds and starts are used once."""

    def __init__(
        self, options: DrawnPeople, building: DrawnBuilding, duration_s: float, rng: np.random.Generator
    ) -> None:
        self._options, self._building, self._duration_s, self._rng = options, building, duration_s, rng
        self._free = {kind: building.spots(kind) for kind in ("seat", "bed")}
        self._starts: list[Array] = []

    def group(self, names: list[str], others: list[str]) -> list[dict[str, Any] | None]:
        """Draw one person, or a group, whose first member walks about and the others follow."""
        options, rng = self._options, self._rng
        arrives = bool(self._building.plan.doors) and rng.random() < options.arriving
        leaves = bool(self._building.plan.doors) and rng.random() < options.leaving
        arrive_s = draw_from((0.5, 0.6 * self._duration_s), rng, 1) if arrives else 0.0
        first = self._person(arrive_s, None, arrives)
        if first is None:
            return [None] * len(names)
        led = len(names) > 1 and options.led > 0 and rng.random() < options.led
        alone = len(names) == 1
        script = self._leading(len(names)) if led else self._script(others) if alone else self._walking(len(names))
        members: list[dict[str, Any] | None] = [first]
        near = None if arrives else self._starts[-1]
        for place, _ in enumerate(names[1:], start=1):
            member = self._person(round(arrive_s + 1.3 * place, 1) if arrives else 0.0, near, arrives)
            members.append(member)
            if member is not None:
                goes = {"kind": "join", "person": names[0]} if led else self._following(names[0], place, leaves)
                after = [self._wandering(None)] if led and not leaves else self._parting(leaves)
                member["script"] = [goes, *after]
        first["script"] = [*script[:-1], *self._parting(leaves)] if leaves else script
        return members

    def _person(self, arrive_s: float, near: Array | None, by_door: bool) -> dict[str, Any] | None:
        """Draw a person's stature and start; None without a place to start."""
        rng, building = self._rng, self._building
        is_child = rng.random() < self._options.children
        height_m = rng.uniform(1.05, 1.38) if is_child else np.clip(rng.normal(1.71, 0.08), 1.5, 1.98)
        person: dict[str, Any] = {"height_m": round(float(height_m), 2)}
        if by_door:
            door = building.plan.doors[int(rng.integers(len(building.plan.doors)))]
            place = door.before(0.6)
            inwards = np.degrees(door.wall.faces + building.placement.turn)
            person |= {"arrive_s": arrive_s, "heading_deg": round(float(inwards), 1)}
        else:
            place = self._start(near)
            if place is None:
                return None
            self._starts.append(place)
        person["start"] = list(building.to_room(place)[0])
        return person

    def _start(self, near: Array | None) -> Array | None:
        """Draw a free place away from all other starts; close to `near` if given."""
        for place in self._building.space.draw(60, self._rng):
            if all(np.hypot(*(place - other)) >= _APART_M for other in self._starts) and (
                near is None or np.hypot(*(place - near)) < 2.0
            ):
                return place
        return None if near is None else self._start(None)

    def _script(self, others: list[str]) -> Script:
        """Draw one to four activities; the last lasts to the end."""
        rng, options = self._rng, self._options
        kinds = [kind for kind, weight in options.activities.items() if weight > 0]
        weights = np.array([options.activities[kind] for kind in kinds])
        script: Script = []
        for _ in range(int(rng.integers(1, 5))):
            kind = kinds[int(rng.choice(len(kinds), p=weights / weights.sum()))]
            script += self._activity(kind, others)
        return [*script, self._wandering(None)]

    def _activity(self, kind: str, others: list[str]) -> Script:
        """Draw the actions of one activity; none if its object is missing."""
        rng = self._rng
        lasts_s = draw_from((2, max(0.4 * self._duration_s, 3)), rng, 1)
        match kind:
            case "wander":
                return [self._wandering(lasts_s)]
            case "walk":
                return self._walking()[:1]
            case "run":
                return [{"kind": "run", "waypoints": self._places(2), "speed_m_s": draw_from((2.2, 3.2), rng, 1)}]
            case "stand":
                return [{"kind": "stand", "for_s": lasts_s}]
            case "look":
                return [{"kind": "look", "yaw_deg": draw_from((-70, 70), rng, 0), "for_s": lasts_s}]
            case "bend":
                return [{"kind": "bend", "angle_deg": draw_from((40, 90), rng, 0), "for_s": round(lasts_s / 3, 1)}]
            case "reach":
                building = self._building
                place, height_m = building.space.draw(1, rng)[0], draw_from((0.8, 1.5), rng, 2)
                beyond = [way for way in _WAYS if building.space.is_reached((place + 1.5 * way)[None])[0]]
                if not beyond:
                    return []
                at, point = (list(each) for each in building.to_room(np.array([place, place + beyond[0]])))
                return [
                    {"kind": "walk", "waypoints": [at]},
                    {"kind": "turn", "towards": point},
                    {"kind": "reach", "point": [*point, height_m], "for_s": 1.5},
                ]
            case "meet":
                return [{"kind": "meet", "person": str(rng.choice(others)), "for_s": lasts_s}] if others else []
            case _:
                spots = self._free["seat" if kind == "sit" else "bed"]
                if not spots:
                    return []
                spot = spots.pop(int(rng.integers(len(spots))))
                return [{"kind": kind, "seat" if kind == "sit" else "bed": spot, "for_s": lasts_s}]

    def _wandering(self, for_s: float | None) -> dict[str, Any]:
        low, high = sorted(self._rng.uniform(*self._options.speed_m_s, 2))
        action: dict[str, Any] = {"kind": "wander", "speed_m_s": [round(float(low), 2), round(float(high), 2)]}
        return action if for_s is None else action | {"for_s": for_s}

    def _walking(self, size: int = 1) -> Script:
        """Walk through a few places, then stand a while, then wander; slower for larger groups."""
        low, high = self._options.speed_m_s
        slower = self._options.group_slowdown_m_s * (size - 1)
        speed = round(max(low, float(self._rng.uniform(low, high)) - slower), 2)
        walk = {"kind": "walk", "waypoints": self._places(int(self._rng.integers(2, 6))), "speed_m_s": speed}
        return [walk, {"kind": "stand", "for_s": draw_from((1, 6), self._rng, 1)}, self._wandering(None)]

    def _leading(self, size: int) -> Script:
        """Lead a group for most of the run, then wander."""
        rng, near_m = self._rng, _SHOULDERS_M if self._rng.random() < self._options.shoulder_to_shoulder else _ABREAST_M
        low, high = sorted(rng.uniform(*self._options.speed_m_s, 2))
        lead = {
            "kind": "lead",
            "formation": "v" if size == 3 else "file" if rng.random() > self._options.abreast else "abreast",
            "spacing_m": [draw_from(near_m, rng, 2), draw_from(_FAR_M, rng, 2)],
            "speed_m_s": [round(float(low), 2), round(float(high), 2)],
            "for_s": round(float(rng.uniform(0.5, 0.9)) * self._duration_s, 1),
        }
        return [lead, self._wandering(None)]

    def _places(self, count: int) -> list[list[float]]:
        return [list(place) for place in self._building.to_room(self._building.space.draw(count, self._rng))]

    def _following(self, person: str, place: int, leaves: bool) -> dict[str, Any]:
        """Follow the first of the group: abreast on alternate sides, or behind."""
        rng = self._rng
        action: dict[str, Any] = {"kind": "follow", "person": person}
        if rng.random() < self._options.abreast and place <= 2:
            share = self._options.shoulder_to_shoulder
            distance_m = _SHOULDERS_M if share > 0 and rng.random() < share else _ABREAST_M
            action |= {
                "beside": "left" if place == 1 else "right",
                "distance_m": draw_from(distance_m, rng, 2),
            }
        else:
            action |= {"distance_m": draw_from(_BEHIND_M, rng, 2)}
        if leaves:
            action["for_s"] = round(float(rng.uniform(0.4, 0.8)) * self._duration_s, 1)
        return action

    def _parting(self, leaves: bool) -> Script:
        """Draw the action of leaving by a door; none for people who stay."""
        if not leaves:
            return []
        doors = self._building.plan.doors
        door = doors[int(self._rng.integers(len(doors)))]
        return [{"kind": "leave", "to": list(self._building.to_room(door.before(0.6))[0])}]
