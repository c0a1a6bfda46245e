"""A room of plain walls with stereo cameras in its corners, and people of ellipsoids, drawn by exact rays."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import cast

import numpy as np
from numpy.typing import NDArray
from synthetic_home import corner

from trackers.cameras import PlacedCamera
from trackers.cameras.intrinsics import PinholeIntrinsics
from trackers.observations import NS_PER_S, DepthImage, Observation
from trackers.rig import Rig, StereoSensor, placed_camera

PERIOD_S = 0.2
LENS = PinholeIntrinsics(width=160, height=120, fx=106, fy=106, cx=79.5, cy=59.5)
HEAD_M = (0.10, 0.08, 0.125)
_BODY_M = (0.16, 0.22, 0.62)
_ROOM = np.array([[-2.5, -2.1, 0.0], [2.5, 2.1, 2.7]])
SKIN, HAIR = (222, 178, 150), (40, 30, 25)
SHIRTS = ((200, 30, 30), (30, 60, 200), (40, 150, 60))


def rig(n_camera: int = 4) -> Rig:
    """Up to four stereo cameras in the corners."""
    corners = [(-2.3, -1.9), (2.3, -1.9), (2.3, 1.9), (-2.3, 1.9)][:n_camera]
    sensors = {
        f"stereo_{k}": StereoSensor(
            topic=f"/stereo_{k}/image/compressed", room_from_sensor=corner(*xy), intrinsics=LENS, baseline_m=0.12
        )
        for k, xy in enumerate(corners, start=1)
    }
    return Rig(sensors={**sensors}, area=((-2.0, -1.7), (2.0, -1.7), (2.0, 1.7), (-2.0, 1.7)))


def met(
    rays: NDArray, eye: NDArray, middle: NDArray, semi_axes_m: Sequence[float], yaw: float
) -> tuple[NDArray, NDArray]:
    """How far along rays (..., 3) from an eye an ellipsoid is met, inf where not, and the place in its own ball (..., 3)."""
    turn = np.array([[np.cos(yaw), np.sin(yaw), 0], [-np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
    way, start = rays @ turn.T / semi_axes_m, (eye - middle) @ turn.T / semi_axes_m
    a, b, c = (way**2).sum(-1), (way * start).sum(-1), (start**2).sum() - 1
    square = b**2 - a * c
    away = np.where(square > 0, (-b - np.sqrt(np.maximum(square, 0))) / a, np.inf)
    away = np.where(away > 0, away, np.inf)
    return away, start + np.where(np.isfinite(away), away, 0)[..., None] * way


@cache
def _empty(placed: PlacedCamera) -> tuple[NDArray, NDArray, NDArray, NDArray]:
    """What a camera sees of the walls: its rays, their lengths squared, how far along them a wall is, and its colour."""
    rays = placed.pixel_rays
    with np.errstate(divide="ignore"):
        walls = np.where(rays > 0, (_ROOM[1] - placed.eye_m) / rays, (_ROOM[0] - placed.eye_m) / rays)
    rgb = np.full((*rays.shape[:2], 3), 170.0) - 15.0 * (walls.argmin(-1) == 2)[..., None]
    return rays, (rays**2).sum(-1), walls.min(-1), rgb


def picture(
    camera: StereoSensor, heads: NDArray, rng: np.random.Generator, ns: int, name: str, noise_m: float = 0.02
) -> DepthImage:
    """What a camera shows of people whose heads (n, 4) are at x, y, z [m] and face yaw [rad]."""
    placed = placed_camera(camera)
    eye = placed.eye_m
    rays, square, *walls = _empty(placed)
    away, rgb = (each.copy() for each in walls)
    for number, (x, y, z, yaw) in enumerate(heads):
        for middle, semi_axes_m in (((x, y, z - 0.12 - _BODY_M[2]), _BODY_M), ((x, y, z), HEAD_M)):
            towards = np.subtract(middle, eye)
            along = rays @ towards
            # rays that come near enough: none else needs to be looked at
            about = (along > 0) & (along**2 >= (towards @ towards - max(semi_axes_m) ** 2) * square)
            seen, place = met(rays[about], eye, np.array(middle), semi_axes_m, yaw)
            face = (np.abs(np.arctan2(place[:, 1], place[:, 0])) < 1.3) & (place[:, 2] < 0.4)
            is_head = semi_axes_m is HEAD_M
            paint = np.where(face[:, None], SKIN, HAIR) if is_head else np.full((len(seen), 3), SHIRTS[number % 3])
            nearer = seen < away[about]
            rgb[about] = np.where(nearer[:, None], paint, rgb[about])
            away[about] = np.where(nearer, seen, away[about])
    depth = away * (rays @ placed.rotation[:, 2])
    depth = depth + noise_m * rng.standard_normal(depth.shape)
    rgb = np.clip(rgb + rng.normal(0, 2, rgb.shape), 0, 255).astype(np.uint8)
    return DepthImage(name, ns, rgb, np.round(depth, 3).astype(np.float32))


def walks(n_person: int, n_frame: int) -> NDArray[np.floating]:
    """Heads (n_frame, n, 4) of people who walk to and fro in lanes of their own, looking where they walk."""
    t = PERIOD_S * np.arange(n_frame)[:, None]
    phase = 0.6 * t + np.pi * np.arange(n_person)
    lane = (np.arange(n_person) - (n_person - 1) / 2) * 2.2 / max(n_person, 2)
    x, yaw = 0.9 * np.cos(phase), np.where(np.sin(phase) > 0, np.pi, 0.0)
    return np.stack(
        [x, *(np.broadcast_to(each, x.shape) for each in (lane, 1.6 - 0.08 * np.arange(n_person))), yaw], -1
    )


def observe(on: Rig, heads: NDArray, seed: int = 0) -> list[DepthImage]:
    """What the rig reports of heads (n_frame, n, 4)."""
    rng = np.random.default_rng(seed)
    return [
        picture(cast("StereoSensor", camera), people, rng, round(number * PERIOD_S * NS_PER_S), name)
        for number, people in enumerate(heads)
        for name, camera in on.sensors.items()
    ]


def empty_room(on: Rig, n_frame: int = 3) -> Sequence[Observation]:
    """The same of nobody."""
    return observe(on, np.empty((n_frame, 0, 4)), seed=1)
