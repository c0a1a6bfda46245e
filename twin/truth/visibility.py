"""How much of each person each sensor can see, by rays: independent of any renderer."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trackers.pinhole import PinholeIntrinsics
from trackers.rig import RigSensor
from twin.scenario.cameras import PinholeDescription, StereoDescription
from twin.scenario.floor import FloorDescription
from twin.scenario.sensors import FisheyeDescription, LaserDescription, SensorDescription
from twin.sensors.rays import cast
from twin.snapshot import Snapshot

_PLANE_BAND_M = 0.15
"""A point on the body counts for a scanner when it lies within this of the scan plane [m] (it is moved into it)."""


@dataclass(frozen=True, eq=False)
class SensorView:
    """Where a sensor looks from, and what it can reach at best."""

    room_from_sensor_xyz: NDArray[np.float64]  # (3,) [m]
    room_from_sensor_rotation: NDArray[np.float64]  # (3, 3)
    is_scanner: bool
    half_field_rad: float  # from the sensor's x axis (scanner) or its optical axis (camera)
    range_max_m: float
    picture: PinholeIntrinsics | None = None  # of a pinhole: its picture's edges bound the view, not an angle


def sensor_view(sensor: RigSensor, description: SensorDescription) -> SensorView | None:
    """The view of a sensor that hangs where the rig says and sees as its description says; None: it feels, a floor."""
    pose = sensor.room_from_sensor
    match description:
        case FloorDescription():
            return None
        case LaserDescription():
            half = np.deg2rad(description.field_of_view_deg) / 2
            return SensorView(pose.translation, pose.rotation, True, half, description.range_max_m)
        case FisheyeDescription():
            half = description.intrinsics().field_of_view_rad / 2
            return SensorView(pose.translation, pose.rotation, False, half, np.inf)
        case PinholeDescription() | StereoDescription():
            # How far its depth reaches says nothing of how far its picture does.
            return SensorView(pose.translation, pose.rotation, False, np.pi / 2, np.inf, description.intrinsics())


def visible_share(
    view: SensorView, snapshot: Snapshot, points: NDArray[np.float64], ids: NDArray[np.int16]
) -> NDArray[np.float64]:
    """Share, 0 to 1, of the points on each body (n_people, n_point, 3) [m] that a ray from the sensor reaches, (n_people,).

    A ray reaches a point when it meets that person first, or nothing before the point. For a scanner the points are
    those near its plane, moved into it, so that the share speaks of what the sweep can meet; 0 where no part of the
    body crosses the plane. `ids` are the people's ids, as in the snapshot's `person_of_geom`.
    """
    if len(points) == 0:
        return np.zeros(0)
    counted, met = first_met(view, snapshot, points, ids)
    total = counted.sum(axis=1)
    reached = (met == ids[:, None]).sum(axis=1)
    return np.divide(reached, total, out=np.zeros(len(points)), where=total > 0)


def first_met(
    view: SensorView, snapshot: Snapshot, points: NDArray[np.float64], ids: NDArray[np.int16]
) -> tuple[NDArray[np.bool_], NDArray[np.int16]]:
    """Which points of each body (n_people, n_point, 3) count for a sensor, and whom a ray towards each meets first.

    Both (n_people, n_point). The id is the body's own where the ray reaches the point, that of whoever stands before
    it, 0 for the room, and -1 where no ray goes: points that do not count, or lie out of the sensor's field or range.
    """
    local = (points - view.room_from_sensor_xyz) @ view.room_from_sensor_rotation  # (n, k, 3)
    if view.is_scanner:
        counted = np.abs(local[..., 2]) <= _PLANE_BAND_M
        local = local * np.array([1.0, 1.0, 0.0])
        off_axis = np.abs(np.arctan2(local[..., 1], local[..., 0]))
    else:
        counted = np.ones(local.shape[:2], dtype=bool)
        off_axis = np.arctan2(np.hypot(local[..., 0], local[..., 1]), local[..., 2])
    distance = np.linalg.norm(local, axis=-1)
    candidate = counted & (off_axis <= view.half_field_rad) & (distance <= view.range_max_m) & (distance > 0)
    if view.picture is not None:
        candidate &= view.picture.project(local)[1]
    met = np.full(candidate.shape, -1, dtype=np.int16)
    person = np.broadcast_to(ids[:, None], candidate.shape)[candidate]
    if person.size:
        directions = (local[candidate] / distance[candidate, None]) @ view.room_from_sensor_rotation.T
        geom = np.empty(person.size, dtype=np.int32)
        hit_m = np.empty(person.size)
        normal = view.room_from_sensor_rotation[:, 2] if view.is_scanner else None
        # what lies beyond all points hides none of them
        farthest_m = float(distance[candidate].max())
        cast(
            snapshot, view.room_from_sensor_xyz, np.ascontiguousarray(directions), geom, hit_m, normal=normal,
            range_max_m=farthest_m,
        )  # fmt: skip
        nothing_before = (hit_m < 0) | (hit_m >= distance[candidate])
        met[candidate] = np.where(nothing_before, person, snapshot.person_of_geom[geom])
    return counted, met
