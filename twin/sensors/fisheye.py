"""The fisheye camera: perspective faces from one scene update, bent into the lens's picture by one table."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from trackers.observations import Image
from trackers.rig import FisheyeSensor
from twin.instant.snapshot import Snapshot
from twin.sensors.fisheye_faces import build_face_table
from twin.sensors.lens import check_fisheye
from twin.sensors.person_pixels import PersonPixels
from twin.sensors.render import OffscreenRenderer
from twin.sensors.sensor import Reading, State

OVERSAMPLING = 1.0
"""Pixels per radian of a face at its middle, for each of the picture's."""


class Fisheye:
    """An ideal Kannala–Brandt camera: sharp at every distance, instantaneous shutter, no vignetting, no scatter.

    MuJoCo has no such projection, so up to five faces of a cube around the lens are drawn, only as far as the field
    of view needs them, and remapped bilinearly. Pixels outside the field of view are black. The camera stands still.

    `renderer` gives the renderer of the snapshots' model; it is called at the first observation, not before.
    Raises InputError for a lens that cannot be rendered.
    """

    instants_s = (0.0,)

    def __init__(
        self,
        name: str,
        rig: FisheyeSensor,
        renderer: Callable[[], OffscreenRenderer],
        *,
        oversampling: float = OVERSAMPLING,
    ) -> None:
        check_fisheye(rig.intrinsics)
        self.name = name
        self._rig = rig
        self._renderer = renderer
        self._oversampling = oversampling
        self._eye_m = rig.room_from_sensor.translation

    @cached_property
    def _faces(self) -> _Faces:
        return _Faces(self._rig, self._oversampling)

    def observe(
        self, stamp_ns: int, snapshots: Iterable[Snapshot], state: State, rng: np.random.Generator
    ) -> tuple[Reading, State]:
        """The ideal picture; `rng` and `state` are not used."""
        (snapshot,) = snapshots
        self.draw_faces(snapshot)
        return Reading(Image(self.name, stamp_ns, self._faces.bend())), state

    def draw_faces(self, snapshot: Snapshot) -> None:
        """Draw and read the faces, which is what a picture costs at least."""
        renderer = self._renderer()
        if snapshot.model is not renderer.model:
            raise ValueError(f"camera {self.name!r} was given a renderer of another model than the snapshot's")
        renderer.render(snapshot.data, self._eye_m, self._faces.views, self._faces.drawn)

    def person_image(self, snapshot: Snapshot) -> NDArray[np.int16]:
        """The id of the person at each pixel's centre, 0 for the room, -1 outside the field, (height, width)."""
        drawn = self._faces.drawn
        views = self._faces.views
        geom_of_number = self._renderer().render(snapshot.data, self._eye_m, views, None, numbers=drawn)
        return self._faces.pixels.people(drawn, geom_of_number, snapshot.person_of_geom)

    def rig_sensor(self) -> FisheyeSensor:
        """What a tracker is told: where the camera is, its topic and its intrinsics."""
        return self._rig


class _Faces:
    """The buffers of one camera, filled anew for each picture."""

    def __init__(self, rig: FisheyeSensor, oversampling: float) -> None:
        table = build_face_table(rig.intrinsics, rig.room_from_sensor.rotation, oversampling)
        self.views = table.views
        self.drawn = np.zeros((table.height, table.width, 4), dtype=np.uint8)
        self._bent = np.empty((*table.column.shape, 4), dtype=np.uint8)
        # Fixed-point places, to 1/32 px: twice as fast as floats.
        self._map = cv2.convertMaps(table.column, table.row, cv2.CV_16SC2)
        self.pixels = PersonPixels(self._map)

    def bend(self) -> np.ndarray:
        """The picture in what was drawn last, (height, width, 3) RGB; a new array."""
        cv2.remap(self.drawn, *self._map, cv2.INTER_LINEAR, dst=self._bent, borderMode=cv2.BORDER_CONSTANT)
        return cv2.cvtColor(self._bent, cv2.COLOR_RGBA2RGB)
