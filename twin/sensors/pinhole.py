"""The pinhole camera: any focal length and principal point, Brown–Conrady distortion, motion blur."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from trackers.observations import Image
from trackers.rig import PinholeSensor
from twin.instant.snapshot import Snapshot
from twin.sensors.pinhole_view import PinholeView, pinhole_view
from twin.sensors.render import OffscreenRenderer
from twin.sensors.sensor import Reading, State


class Pinhole:
    """An ideal pinhole camera: sharp at every distance, no vignetting, no scatter. The camera stands still.

    With several `instants_s`, offsets from the stamp within the exposure, the picture is the mean of what is seen at
    each: motion blur of a global shutter. The mean is that of grey values, as the renderer's light is linear in them.

    `renderer` gives the renderer of the snapshots' model; it is called at the first observation, not before.
    Raises InputError for a lens that cannot be rendered.
    """

    def __init__(
        self,
        name: str,
        rig: PinholeSensor,
        renderer: Callable[[], OffscreenRenderer],
        *,
        instants_s: tuple[float, ...] = (0.0,),
    ) -> None:
        rig.intrinsics.check_view()
        self.name = name
        self.instants_s = instants_s
        self._rig = rig
        self._renderer = renderer
        self._eye_m = rig.room_from_sensor.translation

    @cached_property
    def view(self) -> PinholeView:
        """What is drawn for a picture."""
        return pinhole_view(self._rig.intrinsics, self._rig.room_from_sensor)

    @cached_property
    def _drawn(self) -> NDArray[np.uint8]:
        return np.zeros((self.view.height, self.view.width, 4), dtype=np.uint8)

    def observe(
        self, stamp_ns: int, snapshots: Iterable[Snapshot], state: State, rng: np.random.Generator
    ) -> tuple[Reading, State]:
        """The ideal picture; `rng` and `state` are not used."""
        rgb = self._mean_picture(snapshots) if len(self.instants_s) > 1 else self._only_picture(snapshots)
        return Reading(Image(self.name, stamp_ns, rgb)), state

    def person_image(self, snapshot: Snapshot) -> NDArray[np.int16]:
        """The id of the person at each pixel's centre, 0 for the room, (height, width)."""
        renderer = checked_renderer(self._renderer(), snapshot, self.name)
        return self.view.people(renderer, snapshot, self._eye_m)

    def rig_sensor(self) -> PinholeSensor:
        """What a tracker is told: where the camera is, its topic and its intrinsics."""
        return self._rig

    def _only_picture(self, snapshots: Iterable[Snapshot]) -> NDArray[np.uint8]:
        (snapshot,) = snapshots
        return self._picture(snapshot)

    def _mean_picture(self, snapshots: Iterable[Snapshot]) -> NDArray[np.uint8]:
        lens = self._rig.intrinsics
        light = np.zeros((lens.height, lens.width, 3), dtype=np.float32)
        for snapshot in snapshots:
            cv2.accumulate(self._picture(snapshot), light)
        return cv2.convertScaleAbs(light, alpha=1 / len(self.instants_s))  # pyright: ignore[reportReturnType]

    def _picture(self, snapshot: Snapshot) -> NDArray[np.uint8]:
        renderer = checked_renderer(self._renderer(), snapshot, self.name)
        renderer.render(snapshot.data, self._eye_m, (self.view.view,), self._drawn)
        return self.view.picture(self._drawn)


def checked_renderer(renderer: OffscreenRenderer, snapshot: Snapshot, camera: str) -> OffscreenRenderer:
    """The renderer; raises ValueError where it draws another model than the snapshot's."""
    if snapshot.model is not renderer.model:
        raise ValueError(f"camera {camera!r} was given a renderer of another model than the snapshot's")
    return renderer
