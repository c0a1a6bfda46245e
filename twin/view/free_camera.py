"""Free cameras: good viewpoints on one person or all, a camera that follows a person, names over heads."""

from __future__ import annotations

from math import exp

import numpy as np
from numpy.typing import NDArray

from trackers.area import Area
from trackers.arrays import Array
from trackers.errors import InputError
from twin.instant.snapshot import Snapshot
from twin.report.palette import RGB, Tag
from twin.report.scene_pictures import Standpoint, axes_towards
from twin.room.building import check_mount
from twin.sensors.rays import trace_rays
from twin.world.world import World

_AZIMUTHS_DEG = (30, -30, 60, -60, 80, -80, 0, 100, -100, 130, -130, 160, -160, 180)
_AWAY_M = (3.2, 2.6, 2.1, 1.7, 1.35)
_ABOVE_M = (0.25, 0.7, 1.2, 1.6)
_LIKED_M = 2.6
_FROM_WALLS_M = 0.12
_CLOSE_M = 0.45
_MARGIN = 1.15
_WIDE_M = 8.0
_WIDEST = 1.15
"""Tangent of half the widest horizontal field: beyond it people at the edges look stretched."""
_BODY_M = 0.06
"""Least radius of a body part [m], so that small parts count as much as large ones."""


class CameraSpace:
    """Free space for a camera: over the floor's plan, clear of walls and furniture.

    `snapshot`: any of the scene; `floor` (k, 2): the polygon to stay over [m].
    """

    def __init__(self, snapshot: Snapshot, floor: Array) -> None:
        self._floor = Area(floor)
        self._middle = floor.mean(axis=0)

    def is_free(self, snapshot: Snapshot, eye: Array) -> bool:
        """Return True where a camera can be at `eye` (3,) [m]."""
        inward = self._middle - eye[:2]
        outward = eye[:2] - _FROM_WALLS_M * inward / max(float(np.linalg.norm(inward)), 1e-9)
        if not self._floor.contains(np.stack([eye[:2], outward])).all():
            return False
        try:
            check_mount(snapshot.model, snapshot.data, "eye", eye)
        except InputError:
            return False
        around = np.deg2rad(np.arange(0, 360, 45))
        rays = np.stack([np.cos(around), np.sin(around), np.zeros(8)], axis=-1)
        rays = np.concatenate([rays, [[0, 0, 1.0], [0, 0, -1.0]]])
        _, distance = _met(snapshot, eye, rays)
        return bool(distance.min() > _FROM_WALLS_M)


def standpoint_for(
    snapshot: Snapshot,
    room: CameraSpace,
    person: int,
    facing_rad: float,
    aspect: float,
    azimuth_deg: float,
    also: int | None = None,
) -> Standpoint:
    """Choose a viewpoint on a person (id), ideally `azimuth_deg` left or right of their heading; `also`: a second person in
    view.

    `aspect`: width over height of the image. The visible share of the person, by rays to every part of the body, has the
    largest weight.
    """
    parts, radius = body_parts(snapshot, person)
    shown, shown_radius, others = parts, radius, None
    if also is not None:
        others, other_radius = body_parts(snapshot, also)
        shown, shown_radius = np.concatenate([parts, others]), np.concatenate([radius, other_radius])
    target = 0.5 * (shown.min(axis=0) + shown.max(axis=0))
    spread = np.ptp(parts, axis=0)
    best_above = 1.2 if spread[2] < 0.8 * max(spread[:2]) else 0.25  # a lying person is seen from higher up
    best: tuple[float, Standpoint] | None = None
    for azimuth in _AZIMUTHS_DEG:
        angle = facing_rad + np.deg2rad(azimuth)
        for away in _AWAY_M:
            for above in _ABOVE_M:
                eye = target + np.array([away * np.cos(angle), away * np.sin(angle), above])
                if not room.is_free(snapshot, eye):
                    continue
                liked = 0.25 * np.cos(np.deg2rad(abs(azimuth) - azimuth_deg)) - 0.08 * abs(away - _LIKED_M)
                liked -= 0.08 * abs(above - best_above)
                if best is not None and 1.0 + liked <= best[0]:
                    continue
                score = liked + _seen(snapshot, eye, parts, person)
                if also is not None and others is not None:
                    score += 0.5 * _seen(snapshot, eye, others, also) - 0.5
                half_height = fitting(eye, target, shown, shown_radius, aspect)
                score -= 0.6 * _in_the_way(snapshot, eye, target, half_height, aspect)
                if best is None or score > best[0]:
                    best = score, Standpoint(eye, target, half_height)
    if best is None:  # no free place around: from above the head
        eye = target + np.array([0.3 * np.cos(facing_rad), 0.3 * np.sin(facing_rad), 1.2])
        return Standpoint(eye, target, fitting(eye, target, shown, shown_radius, aspect))
    return best[1]


def overview(snapshot: Snapshot, room: CameraSpace, points: Array, aspect: float) -> Standpoint:
    """Choose a viewpoint on points (k, 3) [m], people's positions over time: high up, as near as shows most."""
    low, high = np.quantile(points, 0.05, axis=0), np.quantile(points, 0.95, axis=0)
    target = 0.5 * (low + high)
    size = max(float(np.linalg.norm(high - low)), _LIKED_M)
    heights = (2.35, 2.0) if size < _WIDE_M else (2.35, 0.25 * size)
    best: tuple[float, Standpoint] | None = None
    for turn in np.deg2rad(np.arange(7.5, 360, 15.0)):
        for away in np.arange(0.35, 1.05, 0.05) * size:
            for up in heights:
                eye = np.array([target[0] + away * np.cos(turn), target[1] + away * np.sin(turn), up])
                if not room.is_free(snapshot, eye):
                    continue
                half_height = min(fitting(eye, target, points, np.zeros(len(points)), aspect), _WIDEST / aspect)
                shown = _reached(snapshot, eye, points) & _in_picture(eye, target, points, half_height, aspect)
                score = float(shown.mean()) - 0.25 * half_height * aspect - 0.02 * away
                score -= 1.5 * _in_the_way(snapshot, eye, target, half_height, aspect)
                if best is None or score > best[0]:
                    best = score, Standpoint(eye, target, half_height)
    if best is None:  # no free place around: from above the middle
        return Standpoint(target + np.array([0.3, 0.0, 1.5]), target, _WIDEST / aspect)
    return best[1]


def body_parts(snapshot: Snapshot, person: int) -> tuple[Array, Array]:
    """Return the middles (k, 3) [m] of the geoms of a person (id), and their radii (k,) [m]."""
    mine = np.flatnonzero(snapshot.person_of_geom == person)
    return snapshot.data.geom_xpos[mine].copy(), np.maximum(snapshot.model.geom_rbound[mine], _BODY_M)


def fitting(eye: Array, target: Array, points: Array, radius: Array, aspect: float) -> float:
    """Return the tangent of half the vertical field that contains points (k, 3) with radii (k,) [m], with a margin."""
    right, up, forward = axes_towards(eye, target)
    local = points - eye
    depth = np.maximum(local @ forward, 0.2)
    high = ((np.abs(local @ up) + 0.6 * radius) / depth).max()
    wide = ((np.abs(local @ right) + 0.6 * radius) / depth).max()
    return float(_MARGIN * max(high, wide / aspect))


def seen_share(snapshot: Snapshot, eye: Array, person: int) -> float:
    """Return the visible share of the parts of a person (id) from `eye` (3,) [m], 0 to 1."""
    return _seen(snapshot, eye, body_parts(snapshot, person)[0], person)


def _seen(snapshot: Snapshot, eye: Array, parts: Array, person: int) -> float:
    ways = parts - eye
    distance = np.linalg.norm(ways, axis=1)
    geom, _ = _met(snapshot, eye, ways / distance[:, None])
    return float(((geom >= 0) & (snapshot.person_of_geom[geom] == person)).mean())


def _reached(snapshot: Snapshot, eye: Array, points: Array) -> NDArray[np.bool_]:
    ways = points - eye
    distance = np.linalg.norm(ways, axis=1)
    _, met = _met(snapshot, eye, ways / distance[:, None])
    return met >= distance - 1e-6


def _in_picture(eye: Array, target: Array, points: Array, half_height: float, aspect: float) -> NDArray[np.bool_]:
    """Return which points (k, 3) [m] are in the image."""
    right, up, forward = axes_towards(eye, target)
    local = points - eye
    depth = local @ forward
    high = np.abs(local @ up) <= half_height * depth
    return (depth > 0) & high & (np.abs(local @ right) <= half_height * aspect * depth)


def _in_the_way(snapshot: Snapshot, eye: Array, target: Array, half_height: float, aspect: float) -> float:
    """Return the share of the image filled by objects close to the eye."""
    right, up, forward = axes_towards(eye, target)
    across, along = np.meshgrid(np.linspace(-1, 1, 7), np.linspace(-1, 1, 7))
    rays = forward + half_height * (aspect * across.ravel()[:, None] * right + along.ravel()[:, None] * up)
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    _, met = _met(snapshot, eye, rays)
    return float((met < max(_CLOSE_M, 0.45 * float(np.linalg.norm(target - eye)))).mean())


def _met(snapshot: Snapshot, eye: Array, rays: Array) -> tuple[NDArray[np.int32], Array]:
    """Return the geoms that unit rays (n, 3) from `eye` meet first, -1: none, and the distances, infinite: none [m]."""
    geom, distance = np.empty(len(rays), dtype=np.int32), np.empty(len(rays))
    trace_rays(snapshot, np.ascontiguousarray(eye), np.ascontiguousarray(rays), geom, distance)
    return geom, np.where(distance < 0, np.inf, distance)


_FOLLOW_AZIMUTH_DEG = 35.0
_SEEN_AT_LEAST = 0.4
_NEAREST_M, _FARTHEST_M = 1.2, 4.5
_CUTS_APART_S = 2.0
_TURNS_WITHIN_S = 0.25
_ZOOMS_WITHIN_S = 0.6
_WIDER = 1.25
"""Width of the picture relative to the body's, to leave room to walk into."""


class FollowCamera:
    """Camera that follows a person (id); `aspect`: width over height of the picture."""

    def __init__(self, room: CameraSpace, person: int, aspect: float) -> None:
        self._room, self._person, self._aspect = room, person, aspect
        self._stand: Standpoint | None = None
        self._cut_at_s = -np.inf

    def at(self, snapshot: Snapshot, facing_rad: float) -> Standpoint:
        """Return the camera at the snapshot's time; times must rise."""
        parts, radius = body_parts(snapshot, self._person)
        middle = 0.5 * (parts.min(axis=0) + parts.max(axis=0))
        stand = self._stand
        if stand is None or (
            snapshot.t - self._cut_at_s > _CUTS_APART_S and self._is_badly_seen(snapshot, stand, middle)
        ):
            found = standpoint_for(snapshot, self._room, self._person, facing_rad, self._aspect, _FOLLOW_AZIMUTH_DEG)
            stand = Standpoint(found.eye, found.target, _WIDER * found.half_height)
            self._cut_at_s = snapshot.t
        else:
            dt = snapshot.t - self._seen_at_s
            target = stand.target + (1 - exp(-dt / _TURNS_WITHIN_S)) * (middle - stand.target)
            fits = _WIDER * fitting(stand.eye, target, parts, radius, self._aspect)
            half_height = stand.half_height + (1 - exp(-dt / _ZOOMS_WITHIN_S)) * (fits - stand.half_height)
            stand = Standpoint(stand.eye, target, half_height)
        self._stand, self._seen_at_s = stand, snapshot.t
        return stand

    def _is_badly_seen(self, snapshot: Snapshot, stand: Standpoint, middle: Array) -> bool:
        away = float(np.linalg.norm(middle - stand.eye))
        return not _NEAREST_M < away < _FARTHEST_M or seen_share(snapshot, stand.eye, self._person) < _SEEN_AT_LEAST


_ABOVE_HEAD_M = 0.22
_NEAREST_NAMED_M = 0.3
_INK: RGB = (232, 236, 242)
_FILL: RGB = (45, 52, 64)


def name_tags(world: World, snapshot: Snapshot, stand: Standpoint, size_px: tuple[int, int]) -> list[Tag]:
    """Return a name tag over each person within the image of this size, hidden or not."""
    width, height = size_px
    right, up, forward = axes_towards(stand.eye, stand.target)
    present = world.population.present(snapshot.t)
    heads = snapshot.data.site_xpos[world.scene.bodies.head_site] + [0.0, 0.0, _ABOVE_HEAD_M] - stand.eye
    scale = 0.5 * height / stand.half_height
    tags = []
    for place, name in enumerate(world.population.names):
        depth = float(heads[place] @ forward)
        if not present[place] or depth < _NEAREST_NAMED_M:
            continue
        x = 0.5 * width + scale * float(heads[place] @ right) / depth
        y = 0.5 * height - scale * float(heads[place] @ up) / depth
        if 0 <= x < width and 0 <= y < height:
            tags.append(Tag(name, x, y, _FILL, _INK))
    return tags
