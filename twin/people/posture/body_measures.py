"""Body measures for postures, taken from the compiled bodies, and the overlaps of posed bodies with their room.

Overlaps are measured between MuJoCo's own geoms (`mj_geomDistance`: exact for convex shapes), after a broad phase on
bounding spheres for all pairs at once. Of a person the geoms of group 1 count (the body and its clothes; not eyes, ears and
mouth), of the room all static ones that rise above the floor. Feet on the floor are no overlap, nor is what the caller
allows, such as the chair of a sitting person.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property

import mujoco
import numpy as np
from numpy.typing import NDArray

from trackers.arrays import Array
from twin.geometry.geom_hull import hull_points
from twin.instant.snapshot import Snapshot
from twin.people.body.appearance import BodyAppearance
from twin.people.body.person_spec import GEOM_GROUP, person_spec
from twin.people.body.proportions import REFERENCE_STATURE_M, proportions_of

SEATED_PELVIS_RAD, SEATED_SPINE_RAD = -0.16, 0.10
"""Pitch of the pelvis of a seated person, which rolls back, and of the trunk on it, which comes forward again [rad]."""

_MEASURED = frozenset({"hips", "chest", "left_hand", "left_thigh", "left_shank", "bag"})
"""Measured geoms of a body."""


_HEAD_RADIUS_M = 0.14
"""Of the head with hair and a hat, from its centre [m]."""


@dataclass(frozen=True, eq=False)
class BodyMeasures:
    """Measures of n people, (n,) each [m]; frames as in `twin.people.body.person_spec`.

    stature; thigh, shank, ankle_height, ball (before the ankle); hip_lateral: hip joint left of the middle; waist: bend of
    the trunk, above the hips; shoulder_ahead, shoulder_lateral, shoulder_up: left shoulder joint from the waist; upper_arm;
    grip: from the elbow to the middle of the hand; neck: pivot of the head, above the waist; head_ahead, head_up: centre of
    the head from there; under, behind: the buttocks below (when seated) and behind the hip joints; burden_behind: a bag on
    the back behind them, 0 without; back: the chest behind the line of the spine; thigh_under, thigh_over: from the thigh's
    axis to its back and front; shank_radius: to the calf's back; left_carries, right_carries: 1 where the hand carries a bag.
    """

    stature: Array
    thigh: Array
    shank: Array
    ankle_height: Array
    ball: Array
    hip_lateral: Array
    waist: Array
    shoulder_ahead: Array
    shoulder_lateral: Array
    shoulder_up: Array
    upper_arm: Array
    grip: Array
    neck: Array
    head_ahead: Array
    head_up: Array
    under: Array
    behind: Array
    burden_behind: Array
    back: Array
    thigh_under: Array
    thigh_over: Array
    shank_radius: Array
    left_carries: Array
    right_carries: Array

    @classmethod
    def of(cls, appearances: Sequence[BodyAppearance]) -> BodyMeasures:
        """Compile and measure one body per appearance, in their order."""
        return cls._of_rows([_measured_alone(looks) for looks in appearances])

    @classmethod
    def in_room(
        cls, model: mujoco.MjModel, appearances: Mapping[str, BodyAppearance], bodies: Collection[str]
    ) -> BodyMeasures:
        """Measure people; those in `bodies` are already in a compiled room, NAME/ before their elements' names.

        The other bodies are compiled here.
        """
        data = _standing(model, [f"{name}/" for name in appearances if name in bodies])
        return cls._of_rows(
            [
                _measured(model, data, f"{name}/", looks) if name in bodies else _measured_alone(looks)
                for name, looks in appearances.items()
            ]
        )

    @classmethod
    def _of_rows(cls, rows: Sequence[Mapping[str, float]]) -> BodyMeasures:
        return cls(**{field.name: np.array([row[field.name] for row in rows], dtype=float) for field in fields(cls)})

    def __len__(self) -> int:
        return len(self.stature)

    def of_people(self, people: Array | NDArray[np.intp]) -> BodyMeasures:
        """Return the measures of some of the people, by index or mask."""
        return BodyMeasures(**{field.name: getattr(self, field.name)[people] for field in fields(self)})

    @cached_property
    def leg(self) -> Array:
        """Hip to ankle, (n,) [m]."""
        return self.thigh + self.shank

    @cached_property
    def arm(self) -> Array:
        """Shoulder to the middle of the hand, (n,) [m]."""
        return self.upper_arm + self.grip

    def head_ahead_m(self, person: int, angle_rad: float) -> float:
        """Return how far before the hips the head of one person reaches, hair and all, in a bend by an angle [m]."""
        up = self.waist + self.neck + self.head_up + self.head_ahead
        return float(up[person] * np.sin(min(angle_rad, 0.5 * np.pi)) + _HEAD_RADIUS_M)

    @cached_property
    def scale(self) -> Array:
        """Leg length relative to the reference person's, (n,)."""
        reference = proportions_of(REFERENCE_STATURE_M)
        return self.leg / (reference.thigh + reference.shank)


def _standing(model: mujoco.MjModel, prefixes: Sequence[str]) -> mujoco.MjData:
    """Pose people, given by their name prefixes, standing straight with the hip joints at the origin."""
    data = mujoco.MjData(model)
    for prefix in prefixes:
        start = model.jnt_qposadr[model.joint(f"{prefix}root").id]
        data.qpos[start : start + 7] = 0, 0, 0, 1, 0, 0, 0
    mujoco.mj_kinematics(model, data)
    return data


def _measured_alone(looks: BodyAppearance) -> dict[str, float]:
    """Compile and measure one body with only the measured geoms."""
    spec = person_spec(looks, only=_MEASURED, pictures=False)
    spec.compiler.boundmass = spec.compiler.boundinertia = 1.0  # a segment without geoms has no mass of its own
    model = spec.compile()
    return _measured(model, _standing(model, [""]), "", looks)


def _measured(model: mujoco.MjModel, data: mujoco.MjData, prefix: str, looks: BodyAppearance) -> dict[str, float]:
    """Measure one body that stands straight with the hip joints at the origin; by name of the measure."""

    def place(body: str) -> Array:
        return model.body(prefix + body).pos

    def surface(geom: str) -> Array:
        number = model.geom(prefix + geom).id
        points = hull_points(model, data, number)
        assert points is not None
        return points - data.xpos[model.geom_bodyid[number]]

    thigh, shank = -place("left_shank")[2], -place("left_foot")[2]
    shoulder = place("left_upper_arm")
    head = model.site(f"{prefix}head").pos
    hips, thighs, calf = surface("hips"), surface("left_thigh"), surface("left_shank")
    middle = thighs[(thighs[:, 2] < -0.45 * thigh) & (thighs[:, 2] > -0.8 * thigh)]
    if not len(middle):  # a capsule has points at its ends only
        middle = thighs
    return {
        "stature": looks.height_m,
        "thigh": thigh,
        "shank": shank,
        "ankle_height": looks.proportions.ankle_height,
        "ball": looks.proportions.ball_before_ankle,
        "hip_lateral": place("left_thigh")[1],
        "waist": place("trunk")[2],
        "shoulder_ahead": shoulder[0],
        "shoulder_lateral": shoulder[1],
        "shoulder_up": shoulder[2],
        "upper_arm": -place("left_forearm")[2],
        "grip": -model.geom(f"{prefix}left_hand").pos[2],
        "neck": place("head")[2],
        "head_ahead": head[0],
        "head_up": head[2],
        "under": -float((np.cos(SEATED_PELVIS_RAD) * hips[:, 2] - np.sin(SEATED_PELVIS_RAD) * hips[:, 0]).min()),
        "behind": -float(hips[:, 0].min()),
        "burden_behind": _bag_behind(model, prefix, surface),
        "back": -float(surface("chest")[:, 0].min()),
        "thigh_under": -float(middle[:, 0].min()),
        "thigh_over": float(middle[:, 0].max()),
        "shank_radius": -float(calf[:, 0].min()),
        "left_carries": float(looks.carries[0]),
        "right_carries": float(looks.carries[1]),
    }


def _bag_behind(model: mujoco.MjModel, prefix: str, surface: Callable[[str], Array]) -> float:
    """Return the reach of a bag worn on the trunk behind the body's middle [m]."""
    number = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, f"{prefix}bag")
    if number < 0 or model.body(model.geom_bodyid[number]).name != f"{prefix}trunk":
        return 0.0
    return max(-float(surface("bag")[:, 0].min()), 0.0)


Allowed = Mapping[int, Collection[int]]
"""For ids of people: geoms of the room that they may touch and press into."""

TOLERANCE_M = 0.01
"""Depth up to which flesh and cloth give way [m]."""
LOW_M = 0.05
"""Height below which geoms belong to the floor: rugs, marks, tiles, thresholds [m]."""

_UNDER_THE_FLOOR_M = -1.0


@dataclass(frozen=True)
class Penetration:
    """Deepest overlap of one person with another, or with one geom of the room, at one time.

    `person` and `other` are ids, `other` 0 for the room; `geom` and `other_geom`: names of the overlapping geoms.
    """

    t: float
    person: int
    other: int
    geom: str
    other_geom: str
    depth_m: float


class PenetrationCheck:
    """Overlaps of one model's people over time; made once, as it sorts the geoms."""

    def __init__(self, model: mujoco.MjModel, person_of_geom: NDArray[np.int16]) -> None:
        """`person_of_geom` (n_geom,): id of the person a geom belongs to, 0 for the room."""
        self.model = model
        self._owner = person_of_geom
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        self._body = np.flatnonzero((person_of_geom > 0) & (model.geom_group == GEOM_GROUP))
        kind = model.geom_type
        still = (model.body_weldid[model.geom_bodyid] == 0) & (person_of_geom == 0) & (model.geom_rgba[:, 3] > 0)
        shaped = (kind != mujoco.mjtGeom.mjGEOM_PLANE) & (kind != mujoco.mjtGeom.mjGEOM_HFIELD)
        self._things = np.array(
            [geom for geom in np.flatnonzero(still & shaped) if _top(model, data, int(geom)) > LOW_M], dtype=np.intp
        )
        upright = np.abs(data.geom_xmat[:, 8]) < 0.7
        self._walls = np.flatnonzero(still & (kind == mujoco.mjtGeom.mjGEOM_PLANE) & upright)

    def at(
        self,
        snapshot: Snapshot,
        allowed: Allowed | None = None,
        least_m: float = TOLERANCE_M,
        only: int | None = None,
    ) -> list[Penetration]:
        """Find overlaps deeper than `least_m` [m], by ids: one per pair of people, one per person and room geom.

        `only`: the person whose overlaps with the room alone are looked for. People far below the floor are not in the room.
        """
        data = snapshot.data
        body = self._body if only is None else self._body[self._owner[self._body] == only]
        body = body[data.geom_xpos[body, 2] > _UNDER_THE_FLOOR_M]
        place, reach = data.geom_xpos[body], self.model.geom_rbound[body]
        deepest: dict[tuple[int, int, int], Penetration] = {}
        for first, second in self._near(data, body, place, reach):
            person, other = int(self._owner[first]), int(self._owner[second])
            if not other and allowed is not None and second in allowed.get(person, ()):
                continue
            depth = -float(mujoco.mj_geomDistance(self.model, data, first, second, 0.0, None))
            if depth <= least_m:
                continue
            if 0 < other < person:
                person, other, first, second = other, person, second, first
            key = (person, other, 0 if other else second)
            if key not in deepest or depth > deepest[key].depth_m:
                names = self._name(first), self._name(second)
                deepest[key] = Penetration(snapshot.t, person, other, *names, depth)
        return [deepest[key] for key in sorted(deepest)]

    def _near(
        self, data: mujoco.MjData, body: NDArray[np.intp], place: Array, reach: Array
    ) -> Iterable[tuple[int, int]]:
        """Yield pairs of geoms whose bounding spheres meet: a person's, then another person's or the room's."""
        owner = self._owner[body]
        pairs = (owner[:, None] < owner) & (_apart(place, place) < reach[:, None] + reach)
        for first, second in np.argwhere(pairs):
            yield int(body[first]), int(body[second])
        things = self._things
        touches = _apart(place, data.geom_xpos[things]) < reach[:, None] + self.model.geom_rbound[things]
        for first, second in np.argwhere(touches):
            yield int(body[first]), int(things[second])
        for wall in self._walls:
            turn = data.geom_xmat[wall].reshape(3, 3)
            offset = (place - data.geom_xpos[wall]) @ turn
            size = self.model.geom_size[wall, :2]
            adjacent = (np.abs(offset[:, :2]) < np.where(size > 0, size, np.inf)).all(axis=1)
            # a geom wholly behind it is in the next room, not in the wall
            for first in np.flatnonzero(adjacent & (np.abs(offset[:, 2]) < reach)):
                yield int(body[first]), int(wall)

    def _name(self, geom: int) -> str:
        return self.model.geom(geom).name or f"geom {geom}"


def _apart(first: Array, second: Array) -> Array:
    """Return distances (n, m) [m] between points (n, 3) and (m, 3)."""
    return np.linalg.norm(first[:, None] - second, axis=-1)


def _top(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> float:
    """Return the greatest height of a geom by its bounding box [m]."""
    middle, half = model.geom_aabb[geom, :3], model.geom_aabb[geom, 3:]
    turn = data.geom_xmat[geom].reshape(3, 3)
    return float(data.geom_xpos[geom, 2] + turn[2] @ middle + np.abs(turn[2]) @ half)
