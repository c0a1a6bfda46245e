"""Fisheye camera: perspective faces of one scene update, remapped to the lens's picture by one table."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from trackers.cameras import FisheyeIntrinsics
from trackers.errors import InputError
from trackers.observations import Image
from trackers.rig import FisheyeSensor
from twin.instant.snapshot import Snapshot
from twin.sensors.camera import check_fisheye
from twin.sensors.pinhole import checked_renderer
from twin.sensors.render import OffscreenRenderer
from twin.sensors.render_scene import PersonPixels, RenderView, drawn_span, triple
from twin.sensors.sensor import Reading, State

# Face axes in the camera's frame (x right, y down, z ahead): forward, up. The sides have the lens axis as their up, so
# that their needed strip lies along the rows of the buffer.
_FACES = (
    ((0, 0, 1), (0, -1, 0)),
    ((1, 0, 0), (0, 0, 1)),
    ((-1, 0, 0), (0, 0, 1)),
    ((0, 1, 0), (0, 0, 1)),
    ((0, -1, 0), (0, 0, 1)),
)


@dataclass(frozen=True, eq=False)
class FaceTable:
    """Faces to draw, and the position of each pixel of the picture in their common buffer.

    `views` are in the room frame. `column`, `row` (height, width): positions in the buffer [px], integers at pixel centres,
    rows from the bottom up as the renderer writes them; -2 outside the lens's field.
    """

    views: tuple[RenderView, ...]
    width: int  # of the buffer [px]
    height: int
    column: NDArray[np.float32]
    row: NDArray[np.float32]


def build_face_table(lens: FisheyeIntrinsics, room_from_camera: NDArray[np.float64]) -> FaceTable:
    """Return the faces for a camera with this rotation (3, 3), and the position of each pixel in them.

    A face has as many pixels per radian at its middle as the image has at its finest along its radius. Needs a lens
    that `check_fisheye` accepts; raises InputError where no pixel lies in its field.
    """
    directions = lens.pixel_rays()
    density = _pixels_per_radian(lens)  # [px] per unit of tangent
    face_of_pixel = _nearest_face(directions)
    if (face_of_pixel < 0).all():
        raise InputError(
            f"lens: no pixel of the {lens.width} × {lens.height} picture lies in the field of view around "
            f"({lens.cx:g}, {lens.cy:g}); a principal point inside the picture is valid"
        )
    column = np.full(face_of_pixel.shape, -2.0)
    row = np.full(face_of_pixel.shape, -2.0)
    views: list[RenderView] = []
    buffer_width = buffer_height = 0
    for number, (forward, up) in enumerate(_FACES):
        pixels = face_of_pixel == number
        if not pixels.any():
            continue
        axes = np.stack([np.cross(forward, up), up, forward])  # right, up, forward in the camera frame
        right, upward, ahead = axes @ directions[pixels].T
        across, rise = right / ahead, upward / ahead
        left, width = drawn_span(across, density)
        bottom, height = drawn_span(rise, density)
        column[pixels] = (across - left) * density - 0.5
        row[pixels] = (rise - bottom) * density - 0.5 + buffer_height
        in_room = room_from_camera @ axes.T  # columns: right, up, forward in the room frame
        views.append(
            RenderView(
                forward=triple(in_room[:, 2]),
                up=triple(in_room[:, 1]),
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
    """Return the image's finest scale along a radius [px/rad]."""
    slope = lens.radius_of_angle.deriv()(np.linspace(0, lens.field_of_view_rad / 2, 1000))
    return float(max(lens.fx, lens.fy) * slope.max())


def _nearest_face(directions: NDArray[np.float64]) -> NDArray[np.intp]:
    """Return the index of the face whose middle is nearest to each direction, (height, width); -1 outside the field.

    There is no back face: directions behind the camera belong to the nearest side face.
    """
    seen = np.isfinite(directions[..., 2])
    x, y, z = np.moveaxis(np.where(seen[..., None], directions, 0.0), -1, 0)
    towards = np.stack([z, x, -x, y, -y])
    return np.where(seen, towards.argmax(axis=0), -1)


class Fisheye:
    """Ideal Kannala–Brandt camera: sharp at every distance, instantaneous shutter, no vignetting, no scatter.

    MuJoCo has no such projection, so up to five faces of a cube around the lens are drawn, as far as the field of view needs
    them, and remapped bilinearly. Pixels outside the field of view are black. The camera stands still.

    `renderer` returns the renderer of the snapshots' model; it is called at the first observation, not before. Raises
    InputError for a lens that cannot be rendered.
    """

    instants_s = (0.0,)

    def __init__(
        self,
        name: str,
        rig: FisheyeSensor,
        renderer: Callable[[], OffscreenRenderer],
    ) -> None:
        check_fisheye(rig.intrinsics)
        self.name = name
        self._rig = rig
        self._renderer = renderer
        self._eye_m = rig.room_from_sensor.translation

    @cached_property
    def _faces(self) -> _Faces:
        return _Faces(self._rig)

    @property
    def views(self) -> tuple[RenderView, ...]:
        """Views of the room that make up an image: the faces."""
        return self._faces.views

    @property
    def buffer_px(self) -> tuple[int, int]:
        """Width and height of the buffer in which the views are drawn [px]."""
        height, width = self._faces.drawn.shape[:2]
        return width, height

    def observe(
        self, stamp_ns: int, snapshots: Iterable[Snapshot], state: State, rng: np.random.Generator
    ) -> tuple[Reading, State]:
        """Return the ideal image; `rng` and `state` are not used."""
        (snapshot,) = snapshots
        self.draw_faces(snapshot)
        return Reading(Image(self.name, stamp_ns, self._faces.bend())), state

    def draw_faces(self, snapshot: Snapshot) -> None:
        """Draw and read the faces, the minimum cost of a picture."""
        renderer = checked_renderer(self._renderer(), snapshot, self.name)
        renderer.render(snapshot.data, self._eye_m, self._faces.views, self._faces.drawn)

    def person_image(self, snapshot: Snapshot) -> NDArray[np.int16]:
        """Return the id of the person at each pixel's centre, 0 for the room, -1 outside the field, (height, width)."""
        drawn, renderer = self._faces.drawn, checked_renderer(self._renderer(), snapshot, self.name)
        geom_of_number = renderer.render(snapshot.data, self._eye_m, self._faces.views, None, numbers=drawn)
        return self._faces.pixels.people(drawn, geom_of_number, snapshot.person_of_geom)

    def rig_sensor(self) -> FisheyeSensor:
        """Return the tracker's view of the sensor: pose, topic and intrinsics."""
        return self._rig


class _Faces:
    """Buffers of one camera, filled for each image."""

    def __init__(self, rig: FisheyeSensor) -> None:
        table = build_face_table(rig.intrinsics, rig.room_from_sensor.rotation)
        self.views = table.views
        self.drawn = np.zeros((table.height, table.width, 4), dtype=np.uint8)
        self._bent = np.empty((*table.column.shape, 4), dtype=np.uint8)
        # Fixed-point positions, to 1/32 px: twice as fast as floats.
        self._map = cv2.convertMaps(table.column, table.row, cv2.CV_16SC2)
        self.pixels = PersonPixels(self._map)

    def bend(self) -> np.ndarray:
        """Remap the drawn faces to the image, (height, width, 3) RGB; a new array."""
        cv2.remap(self.drawn, *self._map, cv2.INTER_LINEAR, dst=self._bent, borderMode=cv2.BORDER_CONSTANT)
        return cv2.cvtColor(self._bent, cv2.COLOR_RGBA2RGB)
