"""Windows in a picture that show an upright person at a position on the floor, for any lens and camera tilt.

A person window is a rectangle through the person's vertical axis, perpendicular to the line of sight and horizontal from
side to side: as high as a standing person, as wide as one with swinging arms. It is a grid of cells in the room, projected
to the picture; it therefore has the size, slant and bend of a person at that position. People are looked for at the places of
the floor whose windows the picture shows.

A torso window stands over a laser cluster. Its sides are the bearings between which the scanner saw this person and no
nearer one, so that the window of a partly occluded person covers the visible part. Its top and bottom are heights above the
floor.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, PositiveInt

from trackers.area import Area
from trackers.arrays import Array, Bool, Float, Float32, Index, Int, Mask, Singles
from trackers.cameras.placed import PlacedCamera
from trackers.configuration import Strict
from trackers.filters.rows import Rows
from trackers.laser.clusters import Detections
from trackers.rig import FisheyeSensor, LaserSensor, PinholeSensor, placed_camera

HEIGHT_M, DEPTH_M = 1.75, 0.5
"""Person for whom a window is cut: they are up to 1.95 m tall, and lean."""
_AROUND = 1.15
"""Length of the window relative to the person's."""
WIDTH_M = 1.0


@dataclass(frozen=True, eq=False)
class PersonWindows(Rows):
    """One window per position, cells row by row from the crown down and from left to right."""

    pixels: Float[Array, "n rows columns 2"]  # the cells' middles [px], NaN behind a pinhole
    inside: Bool[Mask, "n rows columns"]  # whether the picture shows them
    cell_px: Float[Array, "n"]  # side of a cell in the middle of the window
    right: Float[
        Array, "n 2"
    ]  # unit vectors on the floor: to the right, and ahead, from the camera's view of the position
    ahead: Float[Array, "n 2"]
    steepness: Float[Array, "n"]  # 0 for a level view of the person, 1 straight down


def person_windows(camera: PlacedCamera, places_m: Float[Array, "n 2"], rows: int, columns: int) -> PersonWindows:
    """Lay windows over positions on the floor, z = 0."""
    middle = np.concatenate([places_m, np.full((len(places_m), 1), HEIGHT_M / 2)], axis=1)
    sight = middle - camera.eye_m
    sight /= np.maximum(np.linalg.norm(sight, axis=1, keepdims=True), 1e-9)
    level = np.linalg.norm(sight[:, :2], axis=1)
    ahead = np.where(level[:, None] > 1e-6, sight[:, :2] / np.maximum(level, 1e-6)[:, None], (0.0, 1.0))
    right = np.stack([ahead[:, 1], -ahead[:, 0]], axis=1)
    down = -sight[:, 2]
    up = np.concatenate([ahead * down[:, None], level[:, None]], axis=1)  # perpendicular to the sight and to the right
    height = _AROUND * (HEIGHT_M * level + DEPTH_M * np.abs(down))
    across = ((np.arange(columns) + 0.5) / columns - 0.5) * WIDTH_M
    along = (0.5 - (np.arange(rows) + 0.5) / rows) * height[:, None]
    points = np.repeat((middle[:, None] + along[..., None] * up[:, None])[:, :, None], columns, axis=2)
    points[..., :2] += across[:, None] * right[:, None, None]
    pixels, inside = camera.project(points)
    next_cell = middle.copy()
    next_cell[:, :2] += right * (WIDTH_M / columns)
    cell = camera.project(next_cell)[0] - camera.project(middle)[0]
    return PersonWindows(pixels, inside, np.hypot(cell[:, 0], cell[:, 1]), right, ahead, np.abs(down))


_LEAST_CELL_PX = 1.0
"""Least side of a cell of a detectable person."""
_DIRECTIONS = 72


def _sees_people(camera: PlacedCamera, cells: tuple[int, int], least_in_picture: float, away_m: float) -> bool:
    """Return True where the picture holds enough of a person who stands so far off [m] in any direction."""
    angle = np.linspace(-np.pi, np.pi, _DIRECTIONS, endpoint=False)
    ring = camera.eye_m[:2] + away_m * np.column_stack([np.cos(angle), np.sin(angle)])
    windows = person_windows(camera, ring, *cells)
    return bool(((windows.inside.mean(axis=(1, 2)) >= least_in_picture) & (windows.cell_px >= _LEAST_CELL_PX)).any())


class FloorPlaces:
    """Positions `pitch_m` apart with at least a share of `least_in_picture` of their windows in the picture.

    They are those of an area and `margin_m` about it, or without one those within `reach_m` of the camera. They lie on a lattice
    through the camera's ground point, along its view: the same whatever the room's axes are.
    """

    def __init__(
        self,
        camera: PlacedCamera,
        area: ArrayLike | None,
        *,
        cells: tuple[int, int],
        pitch_m: float,
        margin_m: float,
        reach_m: float,
        least_in_picture: float,
    ) -> None:
        self._eye, self._axes = camera.eye_m[:2], ground_axes(camera)
        if area is None:
            outline = reach_m * np.array([(-1.0, -1.0), (1.0, 1.0)])
        else:
            outline = (np.asarray(area, float) - self._eye) @ self._axes
            outline = np.array([outline.min(axis=0) - margin_m, outline.max(axis=0) + margin_m])
        low = np.floor(outline[0] / pitch_m).astype(int)
        columns, rows = np.ceil(outline[1] / pitch_m).astype(int) - low + 1
        lattice = low + np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).reshape(-1, 2)
        grid = self._eye + pitch_m * lattice @ self._axes.T
        away_m = np.hypot(*(grid - self._eye).T)
        near = away_m <= reach_m if area is None else Area(area, margin_m).contains(grid)
        self.is_cut = area is None and _sees_people(camera, cells, least_in_picture, 1.02 * reach_m)
        """True where people farther off than `reach_m` would be in the picture, and are not looked for."""
        of_grid = near.nonzero()[0]
        windows = person_windows(camera, grid[of_grid], *cells)
        share = windows.inside.mean(axis=(1, 2))
        shown = (share >= least_in_picture) & (windows.cell_px >= _LEAST_CELL_PX)
        self.position: Float[Array, "n 2"] = grid[of_grid[shown]]
        self.windows = windows.select(shown)
        self.share_in_picture: Float[Array, "n"] = share[shown]
        self._of_grid: Int[Index, "n"] = of_grid[shown]
        self._low, self._pitch_m, self._shape = low[:, None], pitch_m, (int(rows), int(columns))
        self._whole = self.map(np.arange(len(self)), np.ones(len(self), np.float32))

    def __len__(self) -> int:
        return len(self.position)

    def map(self, index: Int[Index, "k"], values: Float32[Singles, "k"]) -> Float32[Singles, "rows columns"]:
        """Return the whole grid with values at `index` and 0 elsewhere."""
        grid = np.zeros(self._shape, np.float32)
        grid.flat[self._of_grid[index]] = values
        return grid

    def read(self, grid: Float32[Singles, "rows columns"], positions: Float[Array, "2 *n"]) -> Float[Array, "*n"]:
        """Read such a map at positions x and y [m], linear between its places; 0 beyond them."""
        from scipy.ndimage import map_coordinates  # costs a start that trackers of scanners alone need not pay

        flat = positions.reshape(2, -1)
        column, row = self._axes.T @ (flat - self._eye[:, None]) / self._pitch_m - self._low
        return map_coordinates(grid, [row, column], np.float64, order=1).reshape(positions.shape[1:])

    def shows(self, positions: Float[Array, "n 2"]) -> Bool[Mask, "n"]:
        """Return a mask of positions [m] near one of these: a person there is in the picture, unless hidden."""
        return self.read(self._whole, positions.T) > 0


def ground_axes(camera: PlacedCamera) -> Float[Array, "2 2"]:
    """Return two directions of the floor as columns: that of the picture's rows, or of its columns where that is upright."""
    across = camera.rotation[:2, int(np.hypot(*camera.rotation[:2, 0]) < np.sqrt(0.5))]
    across = across / np.hypot(*across)
    return np.array([[across[0], -across[1]], [across[1], across[0]]])


_CELL_M, _CELLS = 0.5, 128
"""Pitch [m] and number of cells on each side; the lattice repeats beyond them, so that its size is fixed."""
_TRUSTED = 1.0
"""Number of looks that the belief weighs that a camera shows everybody in its picture."""


class ShownPlaces:
    """Share of the people at each place of the floor whom a camera shows: the mean of a Beta distribution for each cell.

    Learned from those whom other sensors measure: nobody tells which walls are where.

    The lattice lies along the camera's view, and is read and learned linearly between its cells.
    """

    def __init__(self, camera: PlacedCamera) -> None:
        self._eye, self._axes = camera.eye_m[:2], ground_axes(camera)
        self._asked, self._shown = np.zeros((_CELLS, _CELLS)), np.zeros((_CELLS, _CELLS))

    def share(self, place: Float[Array, "n 2"]) -> Float[Array, "n"]:
        """Return the share at places [m], 1 where nobody has been."""
        column, row, weight = self._cells(place)
        asked, shown = ((each[column, row] * weight).sum(axis=0) for each in (self._asked, self._shown))
        return (_TRUSTED + shown) / (_TRUSTED + asked)

    def learn(self, place: Float[Array, "n 2"], asked: Float[Array, "n"], shown: Bool[Mask, "n"]) -> None:
        """Learn of people at places [m] who were shown or not. asked: number of looks that each counts."""
        column, row, weight = self._cells(place)
        np.add.at(self._asked, (column, row), asked * weight)
        np.add.at(self._shown, (column, row), asked * shown * weight)

    def _cells(self, place: Float[Array, "n 2"]) -> tuple[Int[Index, "4 n"], Int[Index, "4 n"], Float[Array, "4 n"]]:
        """Return columns and rows of the four cells about each place [m], and their weights."""
        at = ((place - self._eye) @ self._axes / _CELL_M).T
        low = np.floor(at)
        x, y = at - low
        column, row = low.astype(np.intp)
        columns = np.array([column, column + 1, column, column + 1]) % _CELLS
        rows = np.array([row, row, row + 1, row + 1]) % _CELLS
        return columns, rows, np.array([(1 - x) * (1 - y), x * (1 - y), (1 - x) * y, x * y])


def largest_overlap(pixels: Float[Array, "k rows columns 2"]) -> Float[Array, "k"]:
    """Return the largest share of each window's bounding box that another's covers."""
    k = len(pixels)
    if k < 2:
        return np.zeros(k)
    u, v = pixels[..., 0].reshape(k, -1), pixels[..., 1].reshape(k, -1)
    low = np.stack([u.min(axis=1), v.min(axis=1)], axis=1)
    high = np.stack([u.max(axis=1), v.max(axis=1)], axis=1)
    common = np.minimum(high[:, None], high[None]) - np.maximum(low[:, None], low[None])
    area = np.nan_to_num(np.prod(np.maximum(common, 0), axis=-1))  # points behind a pinhole have no pixels
    own = np.maximum(np.prod(high - low, axis=-1), 1e-9)
    np.fill_diagonal(area, 0)
    return (area / own[:, None]).max(axis=1)


class TorsoOptions(Strict):
    """Options of the window's position on a person, and of its samples."""

    former_names: ClassVar[Mapping[str, str]] = {"min_inside": "min_in_picture"}

    low_m: float = Field(default=1.0, gt=0, description="lower edge of the window above the floor [m]")
    high_m: float = Field(default=1.35, gt=0, description="upper edge of the window above the floor [m]")
    kept_width: float = Field(
        default=0.7, gt=0, le=1, description="width of the window as a share of the cluster's, about its middle"
    )
    rows: PositiveInt = Field(default=24, description="samples of a window from top to bottom")
    columns: PositiveInt = Field(default=24, description="samples of a window from side to side")
    min_width_m: float = Field(default=0.06, ge=0, description="least width of a cluster that gets a window [m]")
    learn_width_m: float = Field(
        default=0.15,
        ge=0,
        description="least width of a cluster whose window is learned from [m]; 0: every window (ours)",
    )
    min_in_picture: float = Field(
        default=0.8, gt=0, le=1, description="least share of a window's samples that the picture must show"
    )
    max_overlap: float = Field(
        default=0.2,
        ge=0,
        le=1,
        description="share of a window that another may cover before it is not learned from; 1: every window is (ours)",
    )


@dataclass(frozen=True, eq=False)
class TorsoWindows:
    """One window per detection, in detection order."""

    pixels: Float[Array, "k rows columns 2"]  # u, v
    inside: Bool[Mask, "k rows columns"]  # whether the image shows the sample
    usable: Bool[Mask, "k"]  # whether the window may be compared
    clear: Bool[Mask, "k"]  # usable, wide enough and not overlapped by another: may be learned from


class TorsoProjector:
    """Projector of torso windows over one scanner's detections into one camera's images."""

    def __init__(self, laser: LaserSensor, camera: FisheyeSensor | PinholeSensor, options: TorsoOptions) -> None:
        self.options = options
        self._camera = placed_camera(camera)
        self._laser_rotation = laser.room_from_sensor.rotation
        self._laser_translation = laser.room_from_sensor.translation
        self._heights = np.linspace(options.high_m, options.low_m, options.rows)
        self._across = np.linspace(-0.5, 0.5, options.columns) * options.kept_width

    def windows(self, detections: Detections) -> TorsoWindows:
        """Lay torso windows over k detections."""
        options = self.options
        first, last = detections.angle.T
        middle = 0.5 * (first + last)
        angles = middle[:, None] + (last - first)[:, None] * self._across  # (k, columns)
        reach = detections.range_m[:, None]
        in_scan = np.stack([reach * np.cos(angles), reach * np.sin(angles)], axis=-1)  # (k, columns, 2)
        on_floor = in_scan @ self._laser_rotation[:2, :2].T + self._laser_translation[:2]
        points = np.empty((len(detections), options.rows, options.columns, 3))
        points[..., :2] = on_floor[:, None]
        points[..., 2] = self._heights[None, :, None]
        pixels, inside = self._camera.project(points)
        usable = (inside.mean(axis=(1, 2)) >= options.min_in_picture) & (detections.width_m >= options.min_width_m)
        clear = usable & (detections.width_m >= options.learn_width_m)
        clear &= largest_overlap(pixels) <= options.max_overlap
        return TorsoWindows(pixels, inside, usable, clear)
