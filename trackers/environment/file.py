"""An environment on disk: one compressed .npz that says what it is of, in which frame, and whether it is whole."""

from __future__ import annotations

import hashlib
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from trackers.environment.grid import Grid
from trackers.environment.model import Environment
from trackers.errors import InputError
from trackers.rig import Rig

FORMAT, VERSION = "roomtwin environment", 1
FRAME = "room: metres, x-y floor, z up"

_EXPECTED = "a file that `twin environment` or trackers.environment.save_environment wrote"
_SHAPES = {
    "format": (),
    "version": (),
    "frame": (),
    "room": (),
    "area_m": (None, 2),
    "stations_m": (None, 3),
    "origin_m": (3,),
    "voxel_m": (),
    "state": (None, None, None),
    "surface_m": (None, 3),
    "top_m": (None, None),
    "floor_m": (),
    "ceiling_m": (),
    "walls_m": (None, 2, 2),
    "fingerprint": (),
}
"""The arrays of a file and their shapes; None: any number."""


def save_environment(environment: Environment, path: Path) -> str:
    """Write the environment; the same environment gives the same bytes. Returns its fingerprint."""
    arrays = _arrays(environment)
    arrays["fingerprint"] = np.array(_fingerprint(arrays))
    with zipfile.ZipFile(path, "w") as archive:
        for name, array in arrays.items():
            # numpy's own savez stamps its members with the time of day.
            info = zipfile.ZipInfo(f"{name}.npy", (1980, 1, 1, 0, 0, 0))
            info.compress_type = zipfile.ZIP_DEFLATED
            with archive.open(info, "w", force_zip64=True) as member:
                np.lib.format.write_array(member, np.asarray(array), allow_pickle=False)
    return str(arrays["fingerprint"])


def load_environment(path: Path, rig: Rig | None = None) -> Environment:
    """The environment in a file; with a rig, checked to be of the room that the rig is in (see `Environment.check`).

    Raises InputError for a file that is none, of another version, damaged or incomplete, and for the environment of
    another room.
    """
    arrays = _read(path)
    if "format" not in arrays or arrays["format"].shape or str(arrays["format"]) != FORMAT:
        raise InputError(f"{path}: holds no environment but {_listed(arrays)}; {_EXPECTED} is expected")
    version = arrays.get("version", np.array(None))
    if version.shape or version.dtype.kind not in "iu" or int(version) != VERSION:
        raise InputError(f"{path}: version: {version} is not known here; {VERSION} is expected: scan the room again")
    for name, shape in _SHAPES.items():
        if name not in arrays:
            raise InputError(f"{path}: {name} is missing; {_EXPECTED} is expected")
        found = arrays[name].shape
        if len(found) != len(shape) or any(want is not None and want != have for want, have in zip(shape, found)):  # noqa: B905
            raise InputError(f"{path}: {name} has shape {found}; {_written(shape)} is expected")
    if str(arrays["fingerprint"]) != _fingerprint(arrays):
        raise InputError(
            f"{path}: fingerprint: the contents are not those that were written ({arrays['fingerprint']}); "
            "an undamaged copy is expected"
        )
    if str(arrays["frame"]) != FRAME:
        raise InputError(f"{path}: frame: {str(arrays['frame'])!r} is not known here; {FRAME!r} is expected")
    environment = _environment(arrays)
    if rig is not None:
        environment.check(str(path), room=rig.room, area=rig.area)
    return environment


def _read(path: Path) -> dict[str, Any]:
    try:
        archive = np.load(path, allow_pickle=False)
        if isinstance(archive, np.ndarray):
            raise InputError(f"{path}: is one array, not an .npz of several; {_EXPECTED} is expected")
        with archive:
            return {name: archive[name] for name in archive.files}
    except OSError as error:
        reason = error.strerror or "not an .npz"
        raise InputError(f"{path}: cannot be read ({reason}); {_EXPECTED} is expected") from error
    except (ValueError, EOFError, zipfile.BadZipFile, zipfile.LargeZipFile) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{path}: is not an .npz, or a damaged one; {_EXPECTED} is expected") from error


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
    """The first 16 digits of a SHA-256 over names, types, shapes and contents."""
    digest = hashlib.sha256()
    for name in sorted(set(_SHAPES) - {"fingerprint"}):
        array = np.ascontiguousarray(arrays[name])
        digest.update(f"{name} {array.dtype.str} {np.shape(arrays[name])}\n".encode())
        digest.update(array.tobytes())
    return digest.hexdigest()[:16]


def _listed(arrays: dict[str, Any]) -> str:
    return f"the arrays {', '.join(sorted(arrays))}" if arrays else "nothing"


def _written(shape: tuple[int | None, ...]) -> str:
    return f"({', '.join('n' if size is None else str(size) for size in shape)})"
