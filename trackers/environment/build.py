"""Environments of walls, furniture and free space: built from a point cloud, and kept in a file.

The file is one compressed .npz with the environment's room, frame and a checksum.
"""

from __future__ import annotations

import hashlib
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field
from scipy import ndimage

from trackers.arrays import Array, Bool, Bytes, Float, Float32, Mask, Singles, UInt8
from trackers.configuration import Strict
from trackers.environment.grid import (
    FREE,
    LARGEST_VOXEL_M,
    MOST_VOXELS,
    OCCUPIED,
    SMALLEST_VOXEL_M,
    UNKNOWN,
    Grid,
    PointCloud,
    count_rays,
)
from trackers.environment.model import Environment
from trackers.environment.planes import find_ceiling, find_floor, find_walls
from trackers.errors import InputError, text_near_bound
from trackers.rig import Rig
from trackers.user_input.array_files import ArraySpec, read_arrays
from trackers.user_input.text_file import AnyPath, as_path, refuse_unless_lifted

_FEWEST_POINTS = 1000
_STRAY = 0.0005
"""Share of the points that may lie beyond the grid on each side, for example seen through a door."""
_BORDER_VOXELS = 3
_SURFACE_M = 0.025
"""Depth over which a column's top is averaged, down from its highest point [m]: the noise of a level surface."""
_CLOSED_VOXELS = (3, 3)
"""Size of the smallest gap in the tops of objects that stays open, in columns."""
_ON_THE_FLOOR_M = 0.04
"""Height above the floor up to which points are of the floor [m]."""


class EnvironmentOptions(Strict):
    """Options of the grid, and of occupancy."""

    voxel_m: float = Field(default=0.05, ge=SMALLEST_VOXEL_M, le=LARGEST_VOXEL_M, description="side of a voxel [m]")
    height_m: float = Field(default=3.0, ge=2.2, le=30, description="the grid reaches this high above the floor [m]")
    furniture_m: float = Field(
        default=2.2, gt=0, le=30, description="what is higher above the floor is no furniture but hangs there [m]"
    )
    hit_share: float = Field(
        default=0.15,
        gt=0,
        lt=1,
        description="a voxel is occupied if this share of the rays that came to it ended there",
    )


def build_environment(
    cloud: PointCloud,
    *,
    room: str = "",
    area: ArrayLike | None = None,
    options: EnvironmentOptions | None = None,
) -> Environment:
    """Build the environment from a point cloud of the empty room.

    `room`: its name, `area` (k, 2) [m]: its tracked area; both are kept for `Environment.check`.

    A voxel is occupied if enough of the rays that reached it ended in it, more than one did, and an adjacent voxel is
    occupied; free where rays passed; unknown where none came: inside and behind furniture, outside the walls. These rules
    reject points that beams on an edge put between two surfaces; rays grazing a surface do not free it either. Raises
    InputError for a cloud too small for a room and voxels too small for memory.
    """
    options = options or EnvironmentOptions()
    points = cloud.points_m
    if len(points) < _FEWEST_POINTS:
        raise InputError(
            f"point cloud: {len(points)} points are too few for a room; at least {_FEWEST_POINTS} are expected"
        )
    floor_m = find_floor(points[:, 2])
    ceiling_m = find_ceiling(points[:, 2], floor_m)
    walls_m = find_walls(points, floor_m, ceiling_m)
    grid = _grid(cloud, floor_m, ceiling_m, options)
    hits, passes = count_rays(cloud, grid)
    occupied = hits >= np.maximum(options.hit_share * (hits + passes), 1)
    occupied &= (hits > 1) | (passes == 0)
    occupied &= (passes == 0) | _has_neighbours(occupied, grid)
    state = np.full(grid.size, UNKNOWN, dtype=np.uint8)
    state[passes > 0] = FREE
    state[occupied] = OCCUPIED
    state = state.reshape(grid.shape)
    return Environment(
        room=room,
        area_m=np.empty((0, 2)) if area is None else np.array(area, dtype=float),
        stations_m=np.array(cloud.origins_m, dtype=float),
        grid=grid,
        state=state,
        surface_m=_surface(points, grid, occupied),
        top_m=_tops(points, grid, state, floor_m, options.furniture_m),
        floor_m=floor_m,
        ceiling_m=ceiling_m,
        walls_m=walls_m,
    )


def _grid(cloud: PointCloud, floor_m: float, ceiling_m: float, options: EnvironmentOptions) -> Grid:
    """Lay out the grid around the room; the floor lies in the middle of a layer, which contains its noise."""
    voxel = options.voxel_m
    low, high = np.quantile(cloud.points_m[:, :2], (_STRAY, 1 - _STRAY), axis=0)
    low = np.minimum(low, cloud.origins_m[:, :2].min(axis=0)) - _BORDER_VOXELS * voxel
    high = np.maximum(high, cloud.origins_m[:, :2].max(axis=0)) + _BORDER_VOXELS * voxel
    top = floor_m + options.height_m
    top = top if np.isnan(ceiling_m) else min(top, ceiling_m + 1.5 * voxel)
    bottom = floor_m - 1.5 * voxel
    lowest, highest = cloud.origins_m[:, 2].min(), cloud.origins_m[:, 2].max()
    if not floor_m < lowest <= highest < top:
        low, high = text_near_bound(lowest - floor_m, 0), text_near_bound(highest - floor_m, top - floor_m)
        raise InputError(
            f"point cloud: stations stand {low} to {high} m above the floor that was found at {floor_m:g} m; places above the "
            f"floor and below {top - floor_m:g} m are expected"
        )
    extent = np.array([*(high - low), top - bottom])
    shape = np.ceil(extent / voxel - 1e-9).astype(int)
    if shape.astype(float).prod() > MOST_VOXELS:
        refuse_unless_lifted(
            f"voxel_m: {voxel:g} m divides {extent[0]:.0f} x {extent[1]:.0f} x {extent[2]:.0f} m into too many voxels",
            f"{(extent.prod() / MOST_VOXELS) ** (1 / 3):.3f} m or more",
        )
    return Grid(np.array([*low, bottom]), voxel, (int(shape[0]), int(shape[1]), int(shape[2])))


def _has_neighbours(occupied: Bool[Mask, "size"], grid: Grid) -> Bool[Mask, "size"]:
    """Return a mask of the voxels with an occupied one among the 26 neighbours."""
    block = occupied.reshape(grid.shape).astype(np.uint8)
    for axis in range(3):
        block = ndimage.correlate1d(block, np.ones(3), axis=axis, mode="constant", output=np.uint8)
    return block.ravel() > occupied


def _surface(points: Float[Array, "n 3"], grid: Grid, occupied: Bool[Mask, "size"]) -> Float32[Singles, "m 3"]:
    """Average the points in each occupied voxel [m], in the voxels' order."""
    flat, inside = grid.flat(points)
    kept = inside & occupied[flat]
    row = np.cumsum(occupied)[flat[kept]] - 1
    count = int(occupied.sum())
    sums = [np.bincount(row, points[kept, axis], count) for axis in range(3)]
    return (np.stack(sums, axis=-1) / np.bincount(row, minlength=count)[:, None]).astype(np.float32)


def _tops(
    points: Float[Array, "n 3"], grid: Grid, state: UInt8[Bytes, "nx ny nz"], floor_m: float, furniture_m: float
) -> Float32[Singles, "nx ny"]:
    """Return the height [m] of the object in each column; the floor's without one; NaN where neither was seen.

    Gaps at most two columns wide are interpolated from their surroundings.
    """
    layer_m = grid.origin_m[2] + grid.voxel_m * np.arange(grid.shape[2])  # lower edges
    floor_layer = int(np.searchsorted(layer_m, floor_m, side="right")) - 1
    stands = (np.arange(grid.shape[2]) > floor_layer) & (layer_m < floor_m + furniture_m)
    # Objects flatter than half a voxel, a book or a rug, lie in the floor's own layer.
    stands[floor_layer] = True
    occupied = (state == OCCUPIED) & stands
    highest = grid.shape[2] - 1 - np.argmax(occupied[..., ::-1], axis=2)
    known = occupied.any(axis=2).ravel()
    highest = np.where(known, highest.ravel(), -1)
    flat, inside = grid.flat(points)
    column, layer = flat // grid.shape[2], flat % grid.shape[2]
    in_top = inside & (layer == highest[column])
    peak = np.full(known.size, -np.inf)
    np.maximum.at(peak, column[in_top], points[in_top, 2])
    near = inside & (points[:, 2] <= peak[column]) & (points[:, 2] > peak[column] - _SURFACE_M)
    counts = np.maximum(np.bincount(column[near], minlength=known.size), 1)
    top = np.bincount(column[near], points[near, 2], known.size) / counts
    open_floor = (state[..., floor_layer : floor_layer + 2] == FREE).any(axis=2).ravel()
    top = np.where(known, top, np.where(open_floor, floor_m, np.nan))
    top = np.where(top < floor_m + _ON_THE_FLOOR_M, floor_m, top).reshape(grid.shape[:2])
    # Rays at a grazing angle hit a table in rows: between two rows is table.
    deep = floor_m - 1
    closed = ndimage.grey_closing(np.nan_to_num(top, nan=deep), size=_CLOSED_VOXELS, mode="nearest")
    return np.where(closed > deep, closed, np.nan).astype(np.float32)


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
    with zipfile.ZipFile(as_path(path, "environment"), "w") as archive:
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
    path = as_path(path, "environment")
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
