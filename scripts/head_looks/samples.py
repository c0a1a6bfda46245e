"""Pixels of heads with the truth about each: face or hair, and where on the head.

Each scene is recorded twice with the same seed, the second time with skin and hair in colours that nothing else has, so that
every pixel of the first is known to be one, the other, or neither.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from trackers.cameras import CameraGroup
from trackers.likelihood.stereo_head import StereoHeadOptions
from trackers.observations import DepthImage
from trackers.rig import placed_camera
from trackers.vision.head_colours import colour_numbers
from trackers.vision.head_outlines import cells_shown, inner_points, outlines
from twin.recording.reader import Recording
from twin.recording.tables import read_truth

_PURE = 0.75
"""Saturation that paint has and cloth, green and navy caps among it, has not."""
_RIM = np.ones((3, 3), np.uint8)
"""Pixels that touch others are left out: JPEG mixes their colours."""
PAINT = {"skin": "#00ff00", "hair": "#0000ff"}
_POINTS = 200
_NEAR_M = 0.35
_LEAST_SEEN = 0.6
"""Of the points of a head so many must be at its distance: else something stands before it."""


@dataclass(frozen=True, eq=False)
class Head:
    """n pixels of one head in one picture: cell of the head, number of the colour, hue and saturation, face or hair."""

    cell: NDArray[np.intp]
    colour: NDArray[np.intp]
    hue_saturation: NDArray[np.intp]  # (n, 2)
    face: NDArray[np.bool_]
    hair: NDArray[np.bool_]


def heads(plain: Path, painted: Path) -> Iterator[Head]:
    """Every head that is wholly seen in the recordings of two folders."""
    recording, truth = Recording(plain / "recording.mcap"), read_truth(plain / "truth.csv")
    labels = {(each.sensor, each.stamp_ns): each for each in Recording(painted / "recording.mcap").observations()}
    for picture in recording.observations():
        label = labels[picture.sensor, picture.stamp_ns]
        assert isinstance(picture, DepthImage)
        assert isinstance(label, DepthImage)
        camera, now = placed_camera(recording.rig.cameras()[picture.sensor]), truth.stamps_ns == picture.stamp_ns
        people = np.stack([truth.head_x[now], truth.head_y[now], truth.head_z[now], truth.head_yaw[now]])
        seen_as = outlines(CameraGroup([camera]), people[:, None], StereoHeadOptions().semi_axes_m)
        columns, rows = (np.rint(each).astype(np.intp) for each in seen_as.pixels(inner_points(_POINTS)))
        inside = (columns >= 0) & (columns < camera.intrinsics.width) & (rows >= 0) & (rows < camera.intrinsics.height)
        colour, hsv = colour_numbers(picture.rgb), cv2.cvtColor(picture.rgb, cv2.COLOR_RGB2HSV)
        face, hair = (_painted(label.rgb, channel) for channel in (1, 2))
        away_m = np.linalg.norm(camera.points(picture.depth_m) - camera.eye_m, axis=-1)
        for k in np.flatnonzero(seen_as.seen & inside.all(axis=0)):
            at = rows[:, k], columns[:, k]
            on = np.abs(away_m[at] - seen_as.range_m[k]) < _NEAR_M
            if on.mean() >= _LEAST_SEEN:
                at = at[0][on], at[1][on]
                cell = cells_shown(_POINTS)[on, seen_as.aspects()[k]]
                yield Head(cell, colour[at].astype(np.intp), hsv[at][:, :2].astype(np.intp), face[at], hair[at])


def _painted(rgb: NDArray[np.uint8], channel: int) -> NDArray[np.bool_]:
    """Mark the pixels of a picture that have the colour of one channel alone, and whose neighbours do."""
    others = np.delete(rgb, channel, axis=2).max(axis=2)
    is_pure = (rgb[..., channel] > 30) & (others < (1 - _PURE) * rgb[..., channel])
    return cv2.erode(is_pure.view(np.uint8), _RIM).astype(np.bool_)
