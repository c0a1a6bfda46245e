"""An environment on disk: one compressed .npz that says what it is of, in which frame, and whether it is whole."""

from __future__ import annotations

import hashlib
import lzma
import struct
import tokenize
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from trackers.environment.grid import OCCUPIED, Grid
from trackers.environment.model import Environment
from trackers.errors import InputError
from trackers.rig import Rig
from trackers.text_file import AnyPath

FORMAT, VERSION = "roomtwin environment", 1
FRAME = "room: metres, x-y floor, z up"

_EXPECTED = "a file that `twin environment` or trackers.environment.save_environment wrote"
_TEXT, _WHOLE, _BYTES, _NUMBERS = ("U", "text"), ("iu", "whole numbers"), ("u", "bytes"), ("f", "numbers")
"""What an array may hold: numpy's letters for it, and a word."""

_MAY_BE_NAN = ("top_m", "ceiling_m")
_LARGEST_BYTES = 2 * 10**9
"""What the arrays of a file may take together, unpacked."""

_BROKEN_NPZ = (
    zipfile.BadZipFile,
    zipfile.LargeZipFile,
    zlib.error,
    lzma.LZMAError,
    struct.error,
    EOFError,
    KeyError,
    MemoryError,  # a header that tells of more than there is
    NotImplementedError,  # a way of packing or encrypting that does not exist
    RuntimeError,
    SyntaxError,
    tokenize.TokenError,
    ValueError,
)
"""What numpy and zipfile raise on a file cut or overwritten at any place."""

_ARRAYS = {
    "format": (_TEXT, ()),
    "version": (_WHOLE, ()),
    "frame": (_TEXT, ()),
    "room": (_TEXT, ()),
    "area_m": (_NUMBERS, (None, 2)),
    "stations_m": (_NUMBERS, (None, 3)),
    "origin_m": (_NUMBERS, (3,)),
    "voxel_m": (_NUMBERS, ()),
    "state": (_BYTES, (None, None, None)),
    "surface_m": (_NUMBERS, (None, 3)),
    "top_m": (_NUMBERS, (None, None)),
    "floor_m": (_NUMBERS, ()),
    "ceiling_m": (_NUMBERS, ()),
    "walls_m": (_NUMBERS, (None, 2, 2)),
    "fingerprint": (_TEXT, ()),
}
"""The arrays of a file: what they hold, and their shapes; None: any number."""


def save_environment(environment: Environment, path: AnyPath) -> str:
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


def load_environment(path: AnyPath, rig: Rig | None = None) -> Environment:
    """The environment in a file; with a rig, checked to be of the room that the rig is in (see `Environment.check`).

    Raises InputError for a file that is none, of another version, damaged or incomplete, and for the environment of
    another room.
    """
    path = Path(path)
    arrays = _read(path)
    if "format" not in arrays or arrays["format"].shape or str(arrays["format"]) != FORMAT:
        raise InputError(f"{path}: holds no environment but {_listed(arrays)}; {_EXPECTED} is expected")
    version = arrays.get("version", np.array(None))
    if version.shape or version.dtype.kind not in "iu" or int(version) != VERSION:
        raise InputError(f"{path}: version: {version} is not known here; {VERSION} is expected: scan the room again")
    _check_arrays(arrays, path)
    if str(arrays["fingerprint"]) != _fingerprint(arrays):
        raise InputError(
            f"{path}: fingerprint: the contents are not those that were written ({arrays['fingerprint']}); "
            "an undamaged copy is expected"
        )
    if str(arrays["frame"]) != FRAME:
        raise InputError(f"{path}: frame: {str(arrays['frame'])!r} is not known here; {FRAME!r} is expected")
    _check_contents(arrays, path)
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
            unpacked = sum(member.file_size for member in archive.zip.infolist())
            if unpacked > _LARGEST_BYTES:
                raise InputError(
                    f"{path}: unpacks to {unpacked} bytes; at most {_LARGEST_BYTES}, a room in voxels, are expected"
                )
            return {name: archive[name] for name in archive.files}
    except InputError:
        raise
    except OSError as error:
        reason = error.strerror or "not an .npz"
        raise InputError(f"{path}: cannot be read ({reason}); {_EXPECTED} is expected") from error
    except _BROKEN_NPZ as error:
        raise InputError(f"{path}: is not an .npz, or a damaged one; {_EXPECTED} is expected") from error


def _check_arrays(arrays: dict[str, Any], path: Path) -> None:
    """Raise InputError where an array is missing, of another shape, or holds something else."""
    for name, ((kinds, word), shape) in _ARRAYS.items():
        if name not in arrays:
            raise InputError(f"{path}: {name} is missing; {_EXPECTED} is expected")
        found = arrays[name].shape
        if len(found) != len(shape) or any(want is not None and want != have for want, have in zip(shape, found)):  # noqa: B905
            raise InputError(f"{path}: {name} has shape {found}; {_written(shape)} is expected")
        if arrays[name].dtype.kind not in kinds:
            raise InputError(f"{path}: {name} holds {arrays[name].dtype}; {word} are expected")


def _check_contents(arrays: dict[str, Any], path: Path) -> None:
    """Raise InputError for arrays that no scan of a room gives, or that do not fit together."""
    for name, ((_, word), _) in _ARRAYS.items():
        if word == "numbers":
            bad = np.isinf(arrays[name]) if name in _MAY_BE_NAN else ~np.isfinite(arrays[name])
            if bad.any():
                raise InputError(f"{path}: {name} holds {arrays[name][bad].flat[0]}; finite numbers are expected")
    if not 0.01 <= arrays["voxel_m"] <= 0.5:
        raise InputError(f"{path}: voxel_m is {arrays['voxel_m']:g}; the side of a voxel, 0.01 to 0.5 m, is expected")
    state, columns = arrays["state"], arrays["top_m"].shape
    if state.dtype != np.uint8 or not state.size or state.max() > OCCUPIED:
        raise InputError(f"{path}: state is no grid of voxels unknown (0), free (1) or occupied (2); one is expected")
    if columns != state.shape[:2]:
        raise InputError(f"{path}: top_m has shape {columns}; {state.shape[:2]}, as state's columns, is expected")
    n_occupied, n_surface = np.count_nonzero(state == OCCUPIED), len(arrays["surface_m"])
    if n_surface != n_occupied:
        raise InputError(
            f"{path}: surface_m has {n_surface} points and state {n_occupied} occupied voxels; a point each is expected"
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
    """The first 16 digits of a SHA-256 over names, types, shapes and contents."""
    digest = hashlib.sha256()
    for name in sorted(set(_ARRAYS) - {"fingerprint"}):
        array = np.ascontiguousarray(arrays[name])
        digest.update(f"{name} {array.dtype.str} {np.shape(arrays[name])}\n".encode())
        digest.update(array.tobytes())
    return digest.hexdigest()[:16]


def _listed(arrays: dict[str, Any]) -> str:
    return f"the arrays {', '.join(sorted(arrays))}" if arrays else "nothing"


def _written(shape: tuple[int | None, ...]) -> str:
    return f"({', '.join('n' if size is None else str(size) for size in shape)})"
