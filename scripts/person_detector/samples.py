"""Windows of recordings with the truth about each: how far off the nearest visible person is, and where."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Self, cast

import numpy as np
from numpy.typing import NDArray

from trackers.arrays import Array, Mask
from trackers.cameras.placed import PlacedCamera
from trackers.observations import Image
from trackers.rig import placed_camera
from trackers.vision.foreground import Foreground
from trackers.vision.person_detector import COLUMNS, ROWS, SILHOUETTES, PersonDetector, PersonModel
from twin.recording.reader import Recording
from twin.recording.tables import read_truth

_HIDDEN = 0.15
"""Of who is seen less than this nothing is learned, and near them nothing either."""
_UNSURE_M = 0.4
_PLAIN = 0.3
"""A person seen at least so much, foot and waist in the picture, is owed a detection."""
_FAR_M = 9.0
_OF_FULL = 10
"""One window in so many of a picture that is foreground throughout is learned from too: it shows nobody."""


@dataclass(frozen=True, eq=False)
class Look:
    """A picture, and everybody who is in the room at its stamp."""

    picture: Image
    position_m: Array  # (n, 2)
    visible: Array  # (n,) share of the body that the camera sees
    in_area: Mask  # (n,)

    def in_plain_sight(self, camera: PlacedCamera) -> Mask:
        """People owed a detection, (n,)."""
        feet, waists = (np.insert(self.position_m, 2, height_m, axis=1) for height_m in (0.0, 0.9))
        return self.in_area & (self.visible >= _PLAIN) & camera.project(feet)[1] & camera.project(waists)[1]


@dataclass(frozen=True, eq=False)
class Scene:
    """Frames of one camera of a recording."""

    name: str
    camera: PlacedCamera
    area: Sequence[tuple[float, float]] | None
    foreground: Foreground
    looks: list[Look]


@dataclass(frozen=True, eq=False)
class Samples:
    """n windows, as the model gets them, and what is true of them."""

    inputs: NDArray[np.float32]  # (n, inputs)
    distance_m: Array  # (n,) of the nearest visible person
    offset_m: Array  # (n, 2) to them, to the right and ahead

    @classmethod
    def joined(cls, parts: Sequence[Self]) -> Self:
        """One after another."""
        return cls(*(np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(cls)))

    def mirrored(self) -> NDArray[np.float32]:
        """The inputs with left and right exchanged."""
        cells, besides = np.split(self.inputs, [ROWS * COLUMNS], axis=1)
        return np.concatenate([cells.reshape(-1, ROWS, COLUMNS)[:, :, ::-1].reshape(cells.shape), besides], axis=1)


def scenes(folder: Path) -> Iterator[Scene]:
    """One for each camera of the recording in a run's folder."""
    recording, truth = Recording(folder / "recording.mcap"), read_truth(folder / "truth.csv")
    for name, sensor in recording.rig.cameras().items():
        empty_room = [cast("Image", each) for each in recording.background if each.sensor == name]
        looks = []
        for picture in recording.observations():
            if picture.sensor == name:
                now = truth.stamps_ns == picture.stamp_ns
                position = np.stack([truth.x[now], truth.y[now]], axis=1)
                visible = np.nan_to_num(truth.visible[name][now])
                looks.append(Look(cast("Image", picture), position, visible, truth.in_area[now]))
        foreground = Foreground(sensor.intrinsics, empty_room, SILHOUETTES)
        yield Scene(f"{folder.name} {name}", placed_camera(sensor), recording.rig.area, foreground, looks)


def samples_of(scene: Scene, model: PersonModel) -> Samples:
    """The windows that a detector looks at in the pictures of a scene, but those that may mean somebody hidden."""
    detector = PersonDetector(scene.camera, scene.area, model=model)
    windows = detector.places.windows
    _, full = detector.candidates(np.ones((scene.camera.intrinsics.height, scene.camera.intrinsics.width), np.bool_))
    full = full[::_OF_FULL]
    parts = [Samples(full, np.full(len(full), _FAR_M), np.zeros((len(full), 2)))]
    for look in scene.looks:
        index, inputs = detector.candidates(scene.foreground.mask(look.picture))
        to = look.position_m[None] - detector.places.position[index, None]
        distance = np.hypot(to[..., 0], to[..., 1])
        hidden = look.visible < _HIDDEN
        far = np.full((len(index), 1), _FAR_M)
        seen = np.concatenate([distance + np.where(hidden, _FAR_M, 0.0), far], axis=1)
        nearest = seen.argmin(axis=1)
        unsure = (distance[:, hidden] < _UNSURE_M).any(axis=1)
        to = np.concatenate([to, np.zeros((len(index), 1, 2))], axis=1)[np.arange(len(index)), nearest]
        offset = np.stack([(to * windows.right[index]).sum(axis=1), (to * windows.ahead[index]).sum(axis=1)], axis=1)
        parts.append(Samples(inputs[~unsure], seen.min(axis=1)[~unsure], offset[~unsure]))
    return Samples.joined(parts)
