"""Calibrated cameras, pinhole and fisheye: room to pixel, pixel to ray, ellipsoid to ellipse, a person's box."""

from trackers.cameras.intrinsics import FisheyeIntrinsics, Intrinsics, PinholeIntrinsics
from trackers.cameras.placed import CameraGroup, Ellipses, Ellipsoids, PlacedCamera

__all__ = [
    "CameraGroup",
    "Ellipses",
    "Ellipsoids",
    "FisheyeIntrinsics",
    "Intrinsics",
    "PinholeIntrinsics",
    "PlacedCamera",
]
