"""A room with a pressure floor and four ceiling cameras, and people of three colours who are painted into its pictures."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from trackers.area import Pose
from trackers.cameras.intrinsics import PinholeIntrinsics
from trackers.observations import NS_PER_S, FloorFrame, Image, Observation
from trackers.rig import FloorSensor, PinholeSensor, Rig, placed_camera

PERIOD_S = 0.1
LENS = PinholeIntrinsics(width=120, height=90, fx=80, fy=80, cx=59.5, cy=44.5)
SHIRTS = ((200, 30, 30), (30, 60, 200), (230, 200, 40), (40, 150, 60), (160, 60, 160))
TROUSERS = ((60, 60, 70), (90, 70, 50), (30, 90, 90), (120, 120, 120), (20, 20, 40))
HEIGHT_M = 1.75
LOAD = 120
"""What the element under somebody reads."""


def corner(x: float, y: float) -> Pose:
    """A camera in a corner, 2.4 m up, that looks at the middle of the room 0.9 m up."""
    eye, towards = np.array([x, y, 2.4]), np.array([0.0, 0.0, 0.9])
    ahead = (towards - eye) / np.linalg.norm(towards - eye)
    right = np.cross(ahead, [0, 0, 1.0])
    right /= np.linalg.norm(right)
    rotation = np.column_stack([right, np.cross(ahead, right), ahead])
    yaw = np.arctan2(rotation[1, 0], rotation[0, 0])
    pitch = np.arcsin(-rotation[2, 0])
    roll = np.arctan2(rotation[2, 1], rotation[2, 2])
    return Pose(xyz=(x, y, 2.4), rpy=(float(roll), float(pitch), float(yaw)))


def rig(n_camera: int = 4, *, floor: bool = True) -> Rig:
    """Up to four cameras, and a floor of 18 × 14 elements of 0.2 m."""
    corners = [(-2.3, -1.9), (2.3, -1.9), (2.3, 1.9), (-2.3, 1.9)][:n_camera]
    sensors = {
        f"camera_{k}": PinholeSensor(
            topic=f"/camera_{k}/image/compressed", room_from_sensor=corner(*xy), intrinsics=LENS
        )
        for k, xy in enumerate(corners, start=1)
    }
    grid = FloorSensor(topic="/floor", room_from_sensor=Pose(xyz=(-1.8, -1.4, 0)), rows=14, columns=18, pitch_m=0.2)
    area = ((-1.8, -1.4), (1.8, -1.4), (1.8, 1.4), (-1.8, 1.4))
    return Rig(sensors={**sensors, **({"floor": grid} if floor else {})}, area=area)


def _wall(camera: PinholeSensor) -> NDArray[np.uint8]:
    """The empty room as a camera sees it: grey, lighter to the top."""
    shade = np.linspace(190, 140, camera.intrinsics.height)[:, None, None]
    return np.broadcast_to(shade, (camera.intrinsics.height, camera.intrinsics.width, 3)).astype(np.uint8)


def picture(camera: PinholeSensor, people: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.uint8]:
    """People (n, 2) at x, y [m], the nearest to the camera painted last."""
    drawn, placed = _wall(camera).copy(), placed_camera(camera)
    away = np.linalg.norm(people - placed.eye_m[:2], axis=1) if len(people) else np.empty(0)
    for number in np.argsort(-away):
        for low, high, width, colour in (
            (0.0, 0.85, 0.32, TROUSERS[number % len(TROUSERS)]),
            (0.85, 1.5, 0.45, SHIRTS[number % len(SHIRTS)]),
            (1.5, HEIGHT_M, 0.18, (90, 60, 40)),
        ):
            ends, _ = placed.project(np.array([[*people[number], low], [*people[number], high]]))
            if not np.isfinite(ends).all():
                continue
            half = round(width / 2 * camera.intrinsics.fx / float(away[number]))
            x, bottom, top = round(float(ends[:, 0].mean())), *np.rint(ends[:, 1]).astype(int).tolist()
            cv2.rectangle(drawn, (x - half, top), (x + half, bottom), colour, -1)
    return np.clip(drawn + rng.normal(0, 2, drawn.shape), 0, 255).astype(np.uint8)


def pressed(floor: FloorSensor, people: NDArray[np.float64]) -> NDArray[np.uint8]:
    """The floor under people (n, 2) [m]: the element under each, and a little on its neighbours."""
    away = np.linalg.norm(floor.centres[..., None, :] - people, axis=-1) if len(people) else np.full((14, 18, 1), 9.0)
    values = LOAD * np.exp(-0.5 * (away / 0.1) ** 2)
    return np.minimum(values.sum(axis=-1), 255).astype(np.uint8)


def walks(n_person: int, n_frame: int) -> NDArray[np.float64]:
    """Places (n_frame, n, 2) [m] of people who walk to and fro in lanes of their own."""
    t = PERIOD_S * np.arange(n_frame)[:, None]
    lane = (np.arange(n_person) - (n_person - 1) / 2) * 2.2 / max(n_person, 2)
    x = 0.8 * np.cos(0.8 * t + np.pi * np.arange(n_person))
    return np.stack([x, np.broadcast_to(lane, x.shape)], axis=-1)


def observe(on: Rig, places: NDArray[np.float64], seed: int = 0, start_s: float = 0.0) -> list[Observation]:
    """What the rig reports of people at these places (n_frame, n, 2)."""
    rng = np.random.default_rng(seed)
    seen: list[Observation] = []
    for number, people in enumerate(places):
        ns = round((start_s + number * PERIOD_S) * NS_PER_S)
        for name, camera in on.cameras().items():
            assert isinstance(camera, PinholeSensor)
            seen.append(Image(name, ns, picture(camera, people, rng)))
        seen += [FloorFrame(name, ns, pressed(floor, people)) for name, floor in on.floors().items()]
    return seen


def empty_room(on: Rig, n_frame: int = 3) -> Sequence[Observation]:
    """The same of nobody."""
    return observe(on, np.empty((n_frame, 0, 2)), seed=1)
