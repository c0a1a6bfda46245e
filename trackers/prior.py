"""Prior: all that a tracker may know of a room before people enter, live, from a recording and in a suite."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, overload

import numpy as np

from trackers.errors import InputError, valid_names
from trackers.observations import Image, Observation
from trackers.rig import PriorFiles, Rig, StereoSensor

if TYPE_CHECKING:
    from trackers.environment import Environment


@dataclass(frozen=True, eq=False)
class Prior(Sequence[Observation]):
    """Observations of the empty room, in order, and other prior knowledge; a tracker's `background`.

    environment: the room's walls, furniture and free space, in the room frame (None: unknown). learned: files that a tracker
    has learned beforehand, by name; untrusted, so read in a format that runs no code (no pickle).
    """

    background: Sequence[Observation] = ()  # of the empty room
    environment: Environment | None = None  # walls, furniture and free space, in the room frame
    learned: Mapping[str, Path] = field(default_factory=dict)  # files by name

    def __len__(self) -> int:
        return len(self.background)

    @overload
    def __getitem__(self, index: int) -> Observation: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[Observation]: ...
    def __getitem__(self, index: int | slice) -> Observation | Sequence[Observation]:
        return self.background[index]

    @classmethod
    def of(cls, background: Iterable[Observation]) -> Prior:
        """Return a prior as it is, and observations of an empty room as a prior without files."""
        return background if isinstance(background, Prior) else cls(tuple(background))

    @classmethod
    def read(cls, background: Iterable[Observation], files: PriorFiles, rig: Rig) -> Prior:
        """Read the prior's `files`, with absolute and existing paths, for a rig.

        Its pictures take the place of a camera's observations in `background`. Raises InputError for an environment that is
        damaged or of another room than the rig's, and for a picture that is none or not of the camera's size.
        """
        pictures = [_picture(name, Path(each), rig) for name, each in files.background.items()]
        kept = [each for each in background if each.sensor not in files.background]
        environment = None
        if files.environment is not None:
            from trackers.environment import load_environment

            environment = load_environment(Path(files.environment), rig)
        return cls((*kept, *pictures), environment, {name: Path(each) for name, each in files.learned.items()})


def _picture(name: str, path: Path, rig: Rig) -> Image:
    """Read a picture of the empty room for the camera `name` of a rig; raises InputError, see `Prior.read`."""
    import cv2

    field, cameras = f"prior.background.{name}", rig.cameras()
    if name not in cameras or isinstance(cameras[name], StereoSensor):
        valid = [each for each, sensor in cameras.items() if not isinstance(sensor, StereoSensor)]
        expected = valid_names(name, valid, none="none, as this rig has none")
        raise InputError(f"{field}: {name!r} is no camera of the rig that takes a picture alone; {expected}")
    try:  # as recorded pictures are read: what is calibrated are the sensor's rows and columns, whatever EXIF says
        content = np.frombuffer(path.read_bytes(), np.uint8)
        pixels = cv2.imdecode(content, cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
    except cv2.error:  # of an empty file, or one of more pixels than OpenCV reads
        pixels = None
    lens = cameras[name].intrinsics
    if pixels is None or pixels.shape[:2] != (lens.height, lens.width):
        found = "no picture" if pixels is None else f"{pixels.shape[1]} x {pixels.shape[0]} pixels"
        raise InputError(
            f"{field}: {path} is {found}; a PNG or JPEG of {lens.width} x {lens.height} pixels, as the camera's, is expected"
        )
    return Image(name, 0, np.ascontiguousarray(pixels[..., ::-1], dtype=np.uint8))
