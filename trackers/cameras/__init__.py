"""Calibrated cameras, pinhole and fisheye: room to pixel, pixel to ray, ellipsoid to ellipse, a person's box."""

from trackers.cameras.ellipse import Ellipses, Ellipsoids
from trackers.cameras.fisheye import FisheyeIntrinsics
from trackers.cameras.intrinsics import Intrinsics
from trackers.cameras.pinhole import PinholeIntrinsics
from trackers.cameras.placed import CameraGroup, PlacedCamera

__all__ = [
    "CameraGroup",
    "Ellipses",
    "Ellipsoids",
    "FisheyeIntrinsics",
    "Intrinsics",
    "PinholeIntrinsics",
    "PlacedCamera",
]
