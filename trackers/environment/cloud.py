"""A point cloud: what a range scanner met, and from where it saw each point."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from trackers.errors import InputError
from trackers.text_file import AnyPath


@dataclass(frozen=True, eq=False)
class PointCloud:
    """Points (n, 3) [m] in the room frame, the station (n,) each was seen from, and the stations' places (s, 3) [m].

    Between a station's place and each of its points the ray met nothing: that is what free space is known by.
    Raises InputError for arrays that do not fit together and for numbers that are not finite.
    """

    points_m: NDArray[np.float64]
    station: NDArray[np.int16]
    origins_m: NDArray[np.float64]

    def __post_init__(self) -> None:
        points, origins = np.shape(self.points_m), np.shape(self.origins_m)
        if len(points) != 2 or points[1] != 3:
            raise InputError(f"point cloud: points have shape {points}; (n, 3) is expected")
        if len(origins) != 2 or origins[1] != 3 or not origins[0]:
            raise InputError(f"point cloud: origins have shape {origins}; (s, 3) with at least one station is expected")
        if np.shape(self.station) != points[:1]:
            raise InputError(
                f"point cloud: there are {points[0]} points and the stations of {np.shape(self.station)}; one for each "
                "point is expected"
            )
        if points[0] and not (self.station.min() >= 0 and self.station.max() < origins[0]):
            raise InputError(
                f"point cloud: stations {self.station.min()} to {self.station.max()} are named and {origins[0]} given; "
                f"0 to {origins[0] - 1} are expected"
            )
        for name, values in (("points", self.points_m), ("origins", self.origins_m)):
            if not np.isfinite(values).all():
                raise InputError(f"point cloud: {name} hold NaN or infinity; leave out rays that met nothing")

    def write_ply(self, path: AnyPath) -> None:
        """Write the points as binary PLY (float32 x, y, z and the station), which CloudCompare and others open."""
        record = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("station", "<i2")])
        rows = np.empty(len(self.points_m), dtype=record)
        for axis, name in enumerate("xyz"):
            rows[name] = self.points_m[:, axis]
        rows["station"] = self.station
        head = ["ply", "format binary_little_endian 1.0", "comment room frame, metres, z up"]
        head += [f"comment station {place[0]:.6f} {place[1]:.6f} {place[2]:.6f}" for place in self.origins_m]
        head += [f"element vertex {len(rows)}", *(f"property float {axis}" for axis in "xyz"), "property short station"]
        head += ["end_header", ""]
        Path(path).write_bytes("\n".join(head).encode() + rows.tobytes())
