"""Visibility of people: the share of each body that a sensor's rays reach, and boxes in images of person ids.

Shares depend on rays alone, not on a renderer.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import cv2
import numpy as np
from numpy.typing import NDArray

from trackers.area import Area
from trackers.cameras import Intrinsics
from trackers.rig import RigSensor
from twin.instant.snapshot import Snapshot
from twin.scenario.camera_descriptions import PinholeDescription, StereoDescription
from twin.scenario.sensor_descriptions import FisheyeDescription, FloorDescription, LaserDescription, SensorDescription
from twin.sensors.rays import crosses_plane, passes_spheres, trace_rays
from twin.truth.truth_types import Box

_PLANE_BAND_M = 0.15
"""Distance from the scan plane within which a body point counts for a scanner, moved into the plane [m]."""


@dataclass(frozen=True, eq=False)
class SensorView:
    """Pose of a sensor, and its ideal field and range."""

    room_from_sensor_xyz: NDArray[np.float64]  # (3,) [m]
    room_from_sensor_rotation: NDArray[np.float64]  # (3, 3)
    sees: float | Intrinsics  # a scanner's half field from its x axis [rad]; a camera's intrinsics
    range_max_m: float
    base: str | None = None  # the driving housing in whose frame the pose is
    own_base: str | None = None  # of a pose in the room: the driving housing whose body the sensor looks through

    def at(self, snapshot: Snapshot) -> SensorView:
        """Return the view with its pose in the room at the time of a snapshot."""
        if self.base is None:
            return self
        room_from_base = snapshot.bases[self.base]
        turn = room_from_base[:3, :3]
        place = turn @ self.room_from_sensor_xyz + room_from_base[:3, 3]
        return replace(
            self,
            room_from_sensor_xyz=place,
            room_from_sensor_rotation=turn @ self.room_from_sensor_rotation,
            base=None,
            own_base=self.base,
        )

    @property
    def is_scanner(self) -> bool:
        """True for a sensor that observes one plane only."""
        return not isinstance(self.sees, Intrinsics)

    @property
    def normal(self) -> NDArray[np.float64] | None:
        """Normal (3,) of a scanner's plane; None for a camera."""
        return self.room_from_sensor_rotation[:, 2] if self.is_scanner else None


def sensor_view(sensor: RigSensor, description: SensorDescription) -> SensorView | None:
    """Return the view of a sensor with the rig's pose and its description's field; None for a floor."""
    pose = sensor.room_from_sensor
    match description:
        case FloorDescription():
            return None
        case LaserDescription():
            half = np.deg2rad(description.field_of_view_deg) / 2
            base = getattr(sensor, "mounted_on", None)
            return SensorView(pose.translation, pose.rotation, half, description.range_max_m, base)
        case FisheyeDescription() | PinholeDescription() | StereoDescription():
            # The depth's range does not limit the image.
            return SensorView(pose.translation, pose.rotation, description.intrinsics(), np.inf)


def visible_share(
    view: SensorView, snapshot: Snapshot, points: NDArray[np.float64], ids: NDArray[np.int16]
) -> tuple[NDArray[np.float64], NDArray[np.int16]]:
    """Return the share, 0 to 1, of the points on each body (n_people, n_point, 3) [m] that a ray reaches, (n_people,).

    A ray reaches a point when it meets that person first, or nothing before the point. For a scanner only points near its
    plane count, moved into it; 0 where no part of the body crosses the plane. `ids`: as in the snapshot's `person_of_geom`.
    Also returns whom each ray meets, as `first_hits` does.
    """
    if len(points) == 0:
        return np.zeros(0), np.zeros(points.shape[:2], dtype=np.int16)
    counted, met = first_hits(view, snapshot, points, ids)
    total = counted.sum(axis=1)
    reached = (met == ids[:, None]).sum(axis=1)
    return np.divide(reached, total, out=np.zeros(len(points)), where=total > 0), met


def first_hits(
    view: SensorView, snapshot: Snapshot, points: NDArray[np.float64], ids: NDArray[np.int16]
) -> tuple[NDArray[np.bool_], NDArray[np.int16]]:
    """Return the counted points of each body (n_people, n_point, 3), and the person that a ray to each meets first.

    Both (n_people, n_point). The id is the body's own where the ray reaches the point, that of the person in front of it, 0
    for the room, and -1 without a ray: for points that do not count, or are outside the sensor's field or range.
    """
    local = (points - view.room_from_sensor_xyz) @ view.room_from_sensor_rotation  # (n, k, 3)
    if isinstance(view.sees, Intrinsics):
        counted = np.ones(local.shape[:2], dtype=bool)
        in_field = view.sees.project(local)[1]
    else:
        counted = np.abs(local[..., 2]) <= _PLANE_BAND_M
        local = local * np.array([1.0, 1.0, 0.0])
        in_field = np.abs(np.arctan2(local[..., 1], local[..., 0])) <= view.sees
    distance = np.sqrt((local * local).sum(axis=-1))
    candidate = counted & in_field & (distance <= view.range_max_m) & (distance > 0)
    met = np.where(candidate, ids[:, None], np.int16(-1))
    if np.count_nonzero(candidate):
        directions = (local[candidate] / distance[candidate, None]) @ view.room_from_sensor_rotation.T
        met[candidate] = _Rays(view, snapshot, directions, distance[candidate], met[candidate]).first_hits()
    return counted, met


@dataclass(frozen=True, eq=False)
class _Rays:
    """Rays from a sensor to points on bodies: unit directions (n, 3) in the room frame, distances of the points (n,) [m],
    and the ids (n,) of their people.
    """

    view: SensorView
    snapshot: Snapshot
    directions: NDArray[np.float64]
    distance_m: NDArray[np.float64]
    ids: NDArray[np.int16]

    def first_hits(self) -> NDArray[np.int16]:
        """Return the person each ray meets first (n,), 0 for the room; the point's own person if nothing is before."""
        snapshot, normal, origin_m = self.snapshot, self.view.normal, self.view.room_from_sensor_xyz
        none = np.zeros(snapshot.person_of_geom.shape, dtype=np.bool_)
        clear = none if normal is None else ~crosses_plane(snapshot, origin_m, normal)
        geoms = ((snapshot.person_of_geom > 0) & ~clear).nonzero()[0]
        person, centre = snapshot.person_of_geom[geoms], snapshot.data.geom_xpos[geoms] - origin_m
        radius = snapshot.model.geom_rbound[geoms]
        # The first hit on a person decides: geoms that no other person's ray can meet are left out,
        near = passes_spheres(self.directions, self.distance_m, centre, radius) & (person != self.ids[:, None])
        left_out = clear.copy()
        left_out[geoms[~near.any(axis=0)]] = True
        first, first_m = self._hits(left_out)
        # but where a ray hits another person, its own person's geoms may come before.
        other = (first != self.ids).nonzero()[0]
        from_m = np.sqrt((centre * centre).sum(axis=1)) - radius
        own_from_m = np.where(person == self.ids[other, None], from_m, np.inf).min(axis=1, initial=np.inf)
        unsure = other[first_m[other] >= own_from_m]
        if unsure.size:
            first[unsure] = self._those(unsure)._hits(clear)[0]
        return first

    def _those(self, which: NDArray[np.intp]) -> _Rays:
        return _Rays(self.view, self.snapshot, self.directions[which], self.distance_m[which], self.ids[which])

    def _hits(self, left_out: NDArray[np.bool_]) -> tuple[NDArray[np.int16], NDArray[np.float64]]:
        """Return the person each ray meets first, without the geoms left out, (n,), and the distance (n,) [m], -1 for none."""
        geom, hit_m = np.empty(self.ids.size, dtype=np.int32), np.empty(self.ids.size)
        trace_rays(
            self.snapshot, self.view.room_from_sensor_xyz, self.directions, geom, hit_m, left_out=left_out,
            range_max_m=float(self.distance_m.max()),  # nothing beyond all points hides any
            base=self.view.own_base,
        )  # fmt: skip
        nothing_before = (hit_m < 0) | (hit_m >= self.distance_m)
        return np.where(nothing_before, self.ids, self.snapshot.person_of_geom[geom]), hit_m


_SPACING_M = 0.25
_MOST_PLACES = 1000
_HEIGHTS_M = (0.1, 0.9, 1.6)
"""Feet, middle and head of a standing person [m]."""
_LEVELS_M = tuple(np.arange(0.1, 1.8, _PLANE_BAND_M).tolist())
"""Heights of which a scanner's plane is near one wherever it crosses a person [m]."""

_NO_PERSON = np.array([np.iinfo(np.int16).max], dtype=np.int16)


def sees_any_of(view: SensorView, empty: Snapshot, area: NDArray[np.float64]) -> bool:
    """Return True where a ray from the sensor reaches a possible point of a body in the area (k, 2) [m] of the empty room."""
    heights_m = _LEVELS_M if view.is_scanner else _HEIGHTS_M
    return bool(visible_share(view, empty, _points(area, heights_m)[None], _NO_PERSON)[0][0] > 0)


def _points(area: NDArray[np.float64], heights_m: Sequence[float]) -> NDArray[np.float64]:
    """Return points over the area at some heights, (n, 3) [m]; only the corners' mean if narrower than the grid."""
    low, high = area.min(axis=0), area.max(axis=0)
    spacing_m = max(_SPACING_M, float(np.sqrt(np.prod(high - low) / _MOST_PLACES)))
    x, y = np.meshgrid(np.arange(low[0], high[0], spacing_m), np.arange(low[1], high[1], spacing_m))
    places = np.stack([x.ravel(), y.ravel()], axis=-1) + spacing_m / 2
    inside = Area(area).contains(places)
    places = places[inside] if inside.any() else area.mean(axis=0, keepdims=True)
    return np.concatenate([np.column_stack([places, np.full(len(places), height)]) for height in heights_m])


OUTSIDE = -1
"""Value of an id image outside the lens's field."""


@runtime_checkable
class PersonImaging(Protocol):
    """Camera that can tell which person each of its pixels shows."""

    def person_image(self, snapshot: Snapshot) -> NDArray[np.int16]:
        """Return the id of the person at each pixel's centre, 0 for the room, -1 outside the lens's field, (height, width).

        In the pixels of its reported images, distortion included, but sharp and without noise.
        """
        ...


def person_boxes(people: NDArray[np.int16]) -> tuple[Box, ...]:
    """Return the boxes of all people in an id image (height, width), in the order of their ids."""
    from scipy.ndimage import find_objects  # takes a while to load, of no use without images

    inside = np.maximum(people, 0)
    count = np.bincount(inside.ravel())
    if len(count) < 2:
        return ()
    cut = set(np.unique(people[_rim(people)]).tolist())
    boxes = []
    for place, slices in enumerate(find_objects(inside), start=1):
        if slices is not None:
            rows, columns = slices
            width, height = columns.stop - columns.start, rows.stop - rows.start
            boxes.append(Box(place, columns.start, rows.start, width, height, int(count[place]), place in cut))
    return tuple(boxes)


def _rim(people: NDArray[np.int16]) -> NDArray[np.bool_]:
    """Return the pixels at the border of the image and of the lens's field, (height, width)."""
    outside = np.ones((people.shape[0] + 2, people.shape[1] + 2), dtype=np.uint8)
    outside[1:-1, 1:-1] = people == OUTSIDE
    near_outside = cv2.dilate(outside, cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3)))
    return near_outside[1:-1, 1:-1].astype(np.bool_)
