"""From a lens to the perspective faces that cover its field, and the table that bends them into its picture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trackers.cameras import FisheyeIntrinsics
from trackers.errors import InputError
from twin.sensors.render import View

MARGIN_PX = 2.0
"""Each face is drawn this much wider than its pixels need, so that bilinear taps stay inside it."""

# Face axes in the camera's frame (x right, y down, z ahead): forward, up. The sides hold the lens axis as their up, so
# that the strip they need lies along the rows of the buffer.
_FACES = (
    ((0, 0, 1), (0, -1, 0)),
    ((1, 0, 0), (0, 0, 1)),
    ((-1, 0, 0), (0, 0, 1)),
    ((0, 1, 0), (0, 0, 1)),
    ((0, -1, 0), (0, 0, 1)),
)


@dataclass(frozen=True, eq=False)
class FaceTable:
    """The faces to draw and, for each pixel of the picture, where in their common buffer its light lies.

    `views` are in the room frame. `column`, `row` (height, width) are places in the buffer [px], integers at pixel
    centres, rows from the bottom up as the renderer writes them; -2 outside the lens's field.
    """

    views: tuple[View, ...]
    width: int  # of the buffer [px]
    height: int
    column: NDArray[np.float32]
    row: NDArray[np.float32]


def build_face_table(lens: FisheyeIntrinsics, room_from_camera: NDArray[np.float64], oversampling: float) -> FaceTable:
    """The faces for a camera with this rotation (3, 3) and, for each pixel, its place in them.

    A face has `oversampling` pixels per radian at its middle for each that the picture has at most along its radius.
    Needs a lens that `check_fisheye` accepts; raises InputError where no pixel lies in its field.
    """
    directions = lens.pixel_rays()
    density = oversampling * _pixels_per_radian(lens)  # [px] per unit of tangent
    face_of_pixel = _nearest_face(directions)
    if (face_of_pixel < 0).all():
        raise InputError(
            f"lens: no pixel of the {lens.width} × {lens.height} picture lies in the field of view around "
            f"({lens.cx:g}, {lens.cy:g}); a principal point inside the picture is valid"
        )
    column = np.full(face_of_pixel.shape, -2.0)
    row = np.full(face_of_pixel.shape, -2.0)
    views: list[View] = []
    buffer_width = buffer_height = 0
    for number, (forward, up) in enumerate(_FACES):
        pixels = face_of_pixel == number
        if not pixels.any():
            continue
        axes = np.stack([np.cross(forward, up), up, forward])  # right, up, forward in the camera frame
        right, upward, ahead = axes @ directions[pixels].T
        across, rise = right / ahead, upward / ahead
        left, width = _span(across, density)
        bottom, height = _span(rise, density)
        column[pixels] = (across - left) * density - 0.5
        row[pixels] = (rise - bottom) * density - 0.5 + buffer_height
        in_room = room_from_camera @ axes.T  # columns: right, up, forward in the room frame
        views.append(
            View(
                forward=_triple(in_room[:, 2]),
                up=_triple(in_room[:, 1]),
                left=left,
                right=left + width / density,
                bottom=bottom,
                top=bottom + height / density,
                viewport=(0, buffer_height, width, height),
            )
        )
        buffer_width, buffer_height = max(buffer_width, width), buffer_height + height
    return FaceTable(tuple(views), buffer_width, buffer_height, column.astype(np.float32), row.astype(np.float32))


def _pixels_per_radian(lens: FisheyeIntrinsics) -> float:
    """The picture's finest scale along a radius [px/rad]."""
    slope = lens.radius_of_angle.deriv()(np.linspace(0, lens.field_of_view_rad / 2, 1000))
    return float(max(lens.fx, lens.fy) * slope.max())


def _nearest_face(directions: NDArray[np.float64]) -> NDArray[np.intp]:
    """Number of the face whose middle is nearest to each direction, (height, width); -1 outside the field.

    There is no back face: what lies behind the camera belongs to the side it leans to.
    """
    seen = np.isfinite(directions[..., 2])
    x, y, z = np.moveaxis(np.where(seen[..., None], directions, 0.0), -1, 0)
    towards = np.stack([z, x, -x, y, -y])
    return np.where(seen, towards.argmax(axis=0), -1)


def _span(values: NDArray[np.float64], density: float) -> tuple[float, int]:
    """Where a face begins (tangent) and how many pixels it needs to hold these places with a margin."""
    pixels = int(np.ceil((values.max() - values.min()) * density + 2 * MARGIN_PX))
    middle = (values.max() + values.min()) / 2
    return float(middle - pixels / density / 2), pixels


def _triple(vector: NDArray[np.float64]) -> tuple[float, float, float]:
    return float(vector[0]), float(vector[1]), float(vector[2])
