"""A grey floor seen by one camera from above, with people of three ellipsoids on it: trousers, shirt and head."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from trackers.area import Pose
from trackers.arrays import Array
from trackers.cameras import Ellipsoids, FisheyeIntrinsics, PinholeIntrinsics
from trackers.observations import NS_PER_S, Image
from trackers.rig import FisheyeSensor, PinholeSensor, Rig, placed_camera

AREA = ((-4.0, -3.0), (4.0, -3.0), (4.0, 3.0), (-4.0, 3.0))
PINHOLE = PinholeIntrinsics(width=320, height=240, fx=300, fy=300, cx=159.5, cy=119.5)
FISHEYE = FisheyeIntrinsics(width=320, height=320, fx=100, fy=100, cx=159.5, cy=159.5, field_of_view_rad=3.2)
COLOURS = ((200, 40, 40), (40, 60, 200), (230, 200, 40), (30, 150, 60))
_PARTS = ((0.43, 0.43, (0.14, 0.17)), (1.12, 0.34, (0.17, 0.24)), (1.58, 0.13, (0.1, 0.1)))
"""Height of the middle, half height and half widths of trousers, shirt and head [m]."""


def rig(fisheye: bool = False) -> Rig:
    """A camera 5 m up, 7 m before the middle of the area, looking at it; or a fisheye over it, looking straight down."""
    if fisheye:
        over = Pose.from_matrix(np.diag([1.0, -1.0, -1.0]), (0.0, 0.0, 4.0))
        return Rig(
            sensors={"camera": FisheyeSensor(topic="/camera/image", room_from_sensor=over, intrinsics=FISHEYE)},
            area=AREA,
        )
    down, level = np.sin(np.arctan2(5, 7)), np.cos(np.arctan2(5, 7))
    turned = np.array([[1.0, 0, 0], [0, -down, level], [0, -level, -down]])
    pose = Pose.from_matrix(turned, (0.0, -7.0, 5.0))
    return Rig(
        sensors={"camera": PinholeSensor(topic="/camera/image", room_from_sensor=pose, intrinsics=PINHOLE)}, area=AREA
    )


def picture(on: Rig, t: float, places: Array, colours=COLOURS, noise: int = 3) -> Image:
    """What the camera sees of people at places (n, 2) [m], in the order in which they hide each other."""
    camera = placed_camera(on.cameras()["camera"])
    lens = camera.intrinsics
    rng = np.random.default_rng(round(1000 * t))
    rgb = np.full((lens.height, lens.width, 3), 120, np.uint8)
    places = np.asarray(places, float).reshape(-1, 2)
    for person in np.argsort(-np.hypot(*(places - camera.eye_m[:2]).T), kind="stable"):
        shirt = colours[person % len(colours)]
        trousers = tuple(int(0.4 * each) for each in shirt)
        for (middle_m, half_m, (ahead_m, aside_m)), colour in zip(_PARTS, (trousers, shirt, (90, 60, 45)), strict=True):
            centre = np.array([[*places[person], middle_m]])
            ellipses, _ = camera.ellipses(Ellipsoids.upright(centre, (ahead_m, aside_m, half_m)))
            outline = ellipses.outline(24)[0]
            if np.isfinite(outline).all():
                cv2.fillPoly(rgb, [np.rint(outline).astype(np.int32)], colour)
    noisy = rgb.astype(np.int16) + rng.integers(-noise, noise + 1, rgb.shape)
    return Image("camera", round(t * NS_PER_S), np.clip(noisy, 0, 255).astype(np.uint8))


def mask(on: Rig, places: Array) -> NDArray[np.bool_]:
    """Where the camera sees these people, without noise."""
    return (picture(on, 0.0, places, noise=0).rgb != 120).any(axis=-1)
