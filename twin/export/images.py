"""Pictures with calibrations: a folder per camera with the pictures, their stamps, and the camera as ROS and OpenCV read it."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TextIO

from trackers.errors import InputError
from twin.export.pictures import pictures, write_calibration
from twin.export.recorded import Recorded
from twin.recording.tables import seconds_cell


def export_images(recordings: Sequence[Recorded], out: Path) -> None:
    """Write `SEQUENCE/CAMERA/` with `NNNNNN.jpg`, `depth/NNNNNN.png` (16 bits, mm), `stamps.csv` and calibrations.

    Raises InputError where no recording has a camera.
    """
    if not any(each.recording.rig.cameras() for each in recordings):
        raise InputError("--format images: the recording has no camera; one with pictures is expected")
    for recorded in recordings:
        cameras = recorded.recording.rig.cameras()
        with ExitStack() as stack:
            tables = {name: _opened(stack, out / recorded.name / name) for name in cameras}
            for name, camera in cameras.items():
                write_calibration(out / recorded.name / name, name, camera)
            for picture in pictures(recorded, cameras, depth=True):
                folder = out / recorded.name / picture.camera
                if picture.is_depth:
                    (folder / "depth").mkdir(exist_ok=True)
                    folder /= "depth"
                name = picture.save(folder)
                kind = "depth/" if picture.is_depth else ""
                tables[picture.camera].write(f"{picture.number},{seconds_cell(picture.stamp_ns)},{kind}{name}\n")


def _opened(stack: ExitStack, folder: Path) -> TextIO:
    folder.mkdir(parents=True)
    table = stack.enter_context((folder / "stamps.csv").open("w", encoding="utf-8"))
    table.write("frame,t,file\n")
    return table
