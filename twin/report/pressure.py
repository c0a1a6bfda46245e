"""A pressure floor from above: each element the brighter the more it bears."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from trackers.observations import FloorFrame
from trackers.rig import FloorSensor
from twin.report.birdseye import FloorView
from twin.report.palette import RGB

PRESSED: RGB = (255, 120, 70)
_STRONGEST = 0.95
_FULL_SCALE = 255.0


def draw_pressure(panel: NDArray[np.uint8], view: FloorView, floor: FloorSensor, frame: FloorFrame) -> None:
    """Lay the loaded elements of a floor over a drawing of the room, in place."""
    values = frame.values.astype(np.float32) / _FULL_SCALE
    opacity = _STRONGEST * np.sqrt(values)
    # the grid is an image of one pixel an element: an affine map takes it to the drawing
    origin, along_x, along_y = view.pixels(floor.corners[[0, 1, 3]])
    matrix = np.stack([(along_x - origin) / floor.columns, (along_y - origin) / floor.rows, origin], axis=1)
    matrix[:, 2] += matrix[:, :2] @ [0.5, 0.5] - 0.5  # pixels are named by their middles
    height, width = panel.shape[:2]
    laid = cv2.warpAffine(opacity, matrix, (width, height), flags=cv2.INTER_NEAREST)[..., None]
    panel[:] = (panel + laid * (np.array(PRESSED, dtype=np.float32) - panel)).astype(np.uint8)


def draw_grid(panel: NDArray[np.uint8], view: FloorView, floor: FloorSensor, colour: RGB) -> None:
    """Draw the lines between a floor's elements, in place."""
    corner, along_x, _, along_y = view.pixels(floor.corners)
    for count, across, along in ((floor.columns, along_x, along_y), (floor.rows, along_y, along_x)):
        for place in np.linspace(0, 1, count + 1):
            start = corner + place * (across - corner)
            end = start + (along - corner)
            cv2.line(panel, np.rint(start).astype(int).tolist(), np.rint(end).astype(int).tolist(), colour, 1)
