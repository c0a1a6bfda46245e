"""The truth about pictures: the table `truth_boxes.csv` and the string on `/truth/boxes`.

One row a person and picture, in the order in which pictures were taken, people by id; columns as in `twin.truth.Box`, in
pixels. A picture that shows nobody is one row with only `t` and `camera`. Pictures without a row were not looked at:
boxes are made for a few pictures a second. Whoever is hidden from the camera altogether has no row. How much of each
person a camera sees, by rays, stands in truth.csv at the same `t`: visible_<camera>.
"""

from __future__ import annotations

from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from twin.recording.detail_rows import (
    DetailWriter,
    FrameRows,
    detail_writer,
    frame_json,
    frames_once,
    refuse_repeats,
    split_frames,
)
from twin.tables.columns import StampedRows, read_csv_columns
from twin.truth.frames import BoxFrame

BOX_COLUMNS = ("t", "camera", "id", "left", "top", "width", "height", "visible_px", "truncated")
_LEAST = {"id": 1, "left": 0, "top": 0, "width": 1, "height": 1, "visible_px": 1}


@dataclass(frozen=True, eq=False)
class BoxTable(StampedRows):
    """Boxes as columns, one element a person and picture, in the order of the file; units as in `twin.truth.Box`."""

    source: str
    frame_stamps_ns: NDArray[np.int64]  # (n_picture,) every picture that was looked at once, those without people too
    frame_camera: NDArray[np.str_]  # (n_picture,)
    stamps_ns: NDArray[np.int64]  # (n,)
    camera: NDArray[np.str_]  # (n,)
    id: NDArray[np.int64]
    left: NDArray[np.int64]
    top: NDArray[np.int64]
    width: NDArray[np.int64]
    height: NDArray[np.int64]
    visible_px: NDArray[np.int64]
    truncated: NDArray[np.bool_]


def box_writer(path: Path) -> AbstractContextManager[DetailWriter[BoxFrame]]:
    """A writer of `truth_boxes.csv`, see `detail_writer`."""
    return detail_writer(path, BOX_COLUMNS, _rows)


def read_boxes(path: Path) -> BoxTable:
    """Read a `truth_boxes.csv`; raises InputError naming file, line, column and value."""
    columns = read_csv_columns(path, BOX_COLUMNS, "table of boxes")
    stamps, cameras, somebody = split_frames(columns, "camera", BOX_COLUMNS[2:])
    rows = columns.take(somebody)
    numbers = {name: rows.integers(name, minimum=least) for name, least in _LEAST.items()}
    area = numbers["width"] * numbers["height"]
    for row in np.flatnonzero(numbers["visible_px"] > area)[:1]:
        rows.refuse(int(row), "visible_px", f"at most the box's {area[row]} pixels")
    refuse_repeats(rows, ("t", "camera", "id"))
    return BoxTable(
        str(path),
        *frames_once(stamps, cameras),
        stamps[somebody],
        cameras[somebody],
        **numbers,
        truncated=rows.flags("truncated"),
    )


def encode_boxes(frame: BoxFrame) -> memoryview:
    """A `std_msgs/String` (CDR) with a JSON list: one object a box, the columns of truth_boxes.csv."""
    return frame_json(_rows(frame), BOX_COLUMNS)


def _rows(frame: BoxFrame) -> FrameRows:
    names = BOX_COLUMNS[2:]
    return frame.stamp_ns, frame.camera, [{name: int(getattr(box, name)) for name in names} for box in frame.boxes]
