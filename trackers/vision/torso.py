"""The torso window: where in the image a person's shirt is, from the waist cluster that the scanner saw.

The window stands over the cluster: its sides are the bearings between which the scanner saw that person and none nearer,
so that a half hidden person's window covers the visible half; its top and bottom are heights above the floor. It is laid out
as a grid of points in the room and projected through the lens, so that it bends as the lens bends.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from jaxtyping import Bool, Float
from pydantic import Field, PositiveInt

from trackers.arrays import Array, Mask
from trackers.configuration import Strict
from trackers.laser.detections import Detections
from trackers.rig import FisheyeSensor, LaserSensor, PinholeSensor, placed_camera
from trackers.vision.person_windows import largest_overlap


class TorsoOptions(Strict):
    """Options of the place of the window on a person, and of its samples."""

    former_names: ClassVar[Mapping[str, str]] = {"min_inside": "min_in_picture"}

    low_m: float = Field(default=1.0, gt=0, description="lower edge of the window above the floor [m]")
    high_m: float = Field(default=1.35, gt=0, description="upper edge of the window above the floor [m]")
    kept_width: float = Field(
        default=0.7, gt=0, le=1, description="width of the window as a share of the cluster's, about its middle"
    )
    rows: PositiveInt = Field(default=24, description="samples of a window from top to bottom")
    columns: PositiveInt = Field(default=24, description="samples of a window from side to side")
    min_width_m: float = Field(default=0.06, ge=0, description="least width of a cluster that gets a window [m]")
    learn_width_m: float = Field(
        default=0.15,
        ge=0,
        description="least width of a cluster whose window is learned from [m]; 0: every window (ours)",
    )
    min_in_picture: float = Field(
        default=0.8, gt=0, le=1, description="least share of a window's samples that the picture must show"
    )
    max_overlap: float = Field(
        default=0.2,
        ge=0,
        le=1,
        description="share of a window that another may cover before it is not learned from; 1: every window is (ours)",
    )


@dataclass(frozen=True, eq=False)
class TorsoWindows:
    """One window a detection, in detection order."""

    pixels: Float[Array, "k rows columns 2"]  # u, v
    inside: Bool[Mask, "k rows columns"]  # whether the image shows the sample
    usable: Bool[Mask, "k"]  # whether the window may be compared
    clear: Bool[Mask, "k"]  # usable, wide enough and not overlapped by another: may be learned from

    def outline(self, index: int) -> Float[Array, "p 2"]:
        """The border of one window as a polygon of pixels, to draw it."""
        grid = self.pixels[index]
        return np.concatenate([grid[0], grid[1:, -1], grid[-1, -2::-1], grid[-2:0:-1, 0]])


class TorsoProjector:
    """Lays torso windows over the detections of one scanner in the images of one camera."""

    def __init__(self, laser: LaserSensor, camera: FisheyeSensor | PinholeSensor, options: TorsoOptions) -> None:
        self.options = options
        self._camera = placed_camera(camera)
        self._laser_rotation = laser.room_from_sensor.rotation
        self._laser_translation = laser.room_from_sensor.translation
        self._heights = np.linspace(options.high_m, options.low_m, options.rows)
        self._across = np.linspace(-0.5, 0.5, options.columns) * options.kept_width

    def windows(self, detections: Detections) -> TorsoWindows:
        """The windows of k detections."""
        options = self.options
        first, last = detections.angle.T
        middle = 0.5 * (first + last)
        angles = middle[:, None] + (last - first)[:, None] * self._across  # (k, columns)
        reach = detections.range_m[:, None]
        in_scan = np.stack([reach * np.cos(angles), reach * np.sin(angles)], axis=-1)  # (k, columns, 2)
        on_floor = in_scan @ self._laser_rotation[:2, :2].T + self._laser_translation[:2]
        points = np.empty((len(detections), options.rows, options.columns, 3))
        points[..., :2] = on_floor[:, None]
        points[..., 2] = self._heights[None, :, None]
        pixels, inside = self._camera.project(points)
        usable = (inside.mean(axis=(1, 2)) >= options.min_in_picture) & (detections.width_m >= options.min_width_m)
        clear = usable & (detections.width_m >= options.learn_width_m)
        clear &= largest_overlap(pixels) <= options.max_overlap
        return TorsoWindows(pixels, inside, usable, clear)
