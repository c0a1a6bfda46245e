"""Environment file: one compressed .npz with its room, frame and a checksum."""

from __future__ import annotations

import hashlib
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from trackers.array_files import ArraySpec, read_arrays
from trackers.environment.grid import LARGEST_VOXEL_M, MOST_VOXELS, OCCUPIED, SMALLEST_VOXEL_M, Grid
from trackers.environment.model import Environment
from trackers.errors import InputError
from trackers.rig import Rig
from trackers.text_file import AnyPath

FORMAT, VERSION = "roomtwin environment", 1
FRAME = "room: metres, x-y floor, z up"

_EXPECTED = "a file that `twin environment` or trackers.environment.save_environment wrote"
_FARTHEST_M = 1e7
"""Greatest coordinate of a room, even in a national grid."""

_HEAD = {"format": ArraySpec("U"), "version": ArraySpec("iu")}
_ARRAYS = _HEAD | {
    "frame": ArraySpec("U"),
    "room": ArraySpec("U"),
    "area_m": ArraySpec("f", (None, 2), -_FARTHEST_M, _FARTHEST_M),
    "stations_m": ArraySpec("f", (None, 3), -_FARTHEST_M, _FARTHEST_M),
    "origin_m": ArraySpec("f", (3,), -_FARTHEST_M, _FARTHEST_M),
    "voxel_m": ArraySpec("f", (), SMALLEST_VOXEL_M, LARGEST_VOXEL_M),
    "state": ArraySpec("u", ("nx", "ny", "nz"), 0, OCCUPIED, most=MOST_VOXELS),
    "surface_m": ArraySpec("f", (None, 3), -_FARTHEST_M, _FARTHEST_M, most=3 * MOST_VOXELS),
    "top_m": ArraySpec("f", ("nx", "ny"), -_FARTHEST_M, _FARTHEST_M, may_be_nan=True, most=MOST_VOXELS),
    "floor_m": ArraySpec("f", (), -_FARTHEST_M, _FARTHEST_M),
    "ceiling_m": ArraySpec("f", (), -_FARTHEST_M, _FARTHEST_M, may_be_nan=True),
    "walls_m": ArraySpec("f", (None, 2, 2), -_FARTHEST_M, _FARTHEST_M),
    "fingerprint": ArraySpec("U"),
}
"""Arrays of a file."""


def save_environment(environment: Environment, path: AnyPath) -> str:
    """Write the environment and return its fingerprint; equal environments give equal bytes."""
    arrays = _arrays(environment)
    arrays["fingerprint"] = np.array(_fingerprint(arrays))
    with zipfile.ZipFile(path, "w") as archive:
        for name, array in arrays.items():
            # numpy's own savez stores the time of day.
            info = zipfile.ZipInfo(f"{name}.npy", (1980, 1, 1, 0, 0, 0))
            info.compress_type = zipfile.ZIP_DEFLATED
            with archive.open(info, "w", force_zip64=True) as member:
                np.lib.format.write_array(member, np.asarray(array), allow_pickle=False)
    return str(arrays["fingerprint"])


def load_environment(path: AnyPath, rig: Rig | None = None) -> Environment:
    """Load an environment; with a rig, check that it is of the rig's room (see `Environment.check`).

    Raises InputError for an invalid, damaged or incomplete file, for another version, for a grid of more than `MOST_VOXELS`,
    before decoding it, and for the environment of another room.
    """
    path = Path(path)
    head = read_arrays(path, _HEAD, _EXPECTED)
    if str(head["format"]) != FORMAT:
        raise InputError(f"{path}: format: {str(head['format'])!r} is not known here; {FORMAT!r} is expected")
    if int(head["version"]) != VERSION:
        raise InputError(
            f"{path}: version: {head['version']} is not known here; {VERSION} is expected: scan the room again"
        )
    arrays = read_arrays(path, _ARRAYS, _EXPECTED)
    if str(arrays["fingerprint"]) != _fingerprint(arrays):
        raise InputError(
            f"{path}: fingerprint: the contents are not those that were written ({arrays['fingerprint']}); "
            "an undamaged copy is expected"
        )
    if str(arrays["frame"]) != FRAME:
        raise InputError(f"{path}: frame: {str(arrays['frame'])!r} is not known here; {FRAME!r} is expected")
    environment = _environment(arrays)
    _check_surface(environment, path)
    if rig is not None:
        environment.check(str(path), room=rig.room, area=rig.area)
    return environment


def _check_surface(environment: Environment, path: Path) -> None:
    """Raise InputError for a grid and points that do not match."""
    grid, surface_m = environment.grid, environment.surface_m
    if min(grid.shape) < 2:
        raise InputError(f"{path}: state has shape {grid.shape}; 2 voxels or more along each axis are expected")
    n_occupied = np.count_nonzero(environment.state == OCCUPIED)
    if len(surface_m) != n_occupied:
        raise InputError(
            f"{path}: surface_m has {len(surface_m)} points and state {n_occupied} occupied voxels; a point each is expected"
        )
    outside = ((surface_m < grid.origin_m - grid.voxel_m) | (surface_m > grid.upper_m + grid.voxel_m)).any(axis=1)
    if outside.any():
        raise InputError(
            f"{path}: surface_m holds {surface_m[outside][0]}, outside the grid from {grid.origin_m} to {grid.upper_m} m; "
            "points in their voxels are expected"
        )


def _arrays(environment: Environment) -> dict[str, Any]:
    return {
        "format": np.array(FORMAT),
        "version": np.array(VERSION),
        "frame": np.array(FRAME),
        "room": np.array(environment.room),
        "area_m": environment.area_m,
        "stations_m": environment.stations_m,
        "origin_m": environment.grid.origin_m,
        "voxel_m": np.array(environment.grid.voxel_m),
        "state": environment.state,
        "surface_m": environment.surface_m,
        "top_m": environment.top_m,
        "floor_m": np.array(environment.floor_m),
        "ceiling_m": np.array(environment.ceiling_m),
        "walls_m": environment.walls_m,
    }


def _environment(arrays: dict[str, Any]) -> Environment:
    nx, ny, nz = arrays["state"].shape
    return Environment(
        room=str(arrays["room"]),
        area_m=arrays["area_m"],
        stations_m=arrays["stations_m"],
        grid=Grid(arrays["origin_m"], float(arrays["voxel_m"]), (nx, ny, nz)),
        state=arrays["state"],
        surface_m=arrays["surface_m"],
        top_m=arrays["top_m"],
        floor_m=float(arrays["floor_m"]),
        ceiling_m=float(arrays["ceiling_m"]),
        walls_m=arrays["walls_m"],
    )


def _fingerprint(arrays: dict[str, Any]) -> str:
    """Hash names, types, shapes and contents: the first 16 digits of a SHA-256."""
    digest = hashlib.sha256()
    for name in sorted(set(_ARRAYS) - {"fingerprint"}):
        array = np.ascontiguousarray(arrays[name])
        digest.update(f"{name} {array.dtype.str} {np.shape(arrays[name])}\n".encode())
        digest.update(array.tobytes())
    return digest.hexdigest()[:16]
