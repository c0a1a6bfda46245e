"""The places of the floor at which a camera may see a person, on a grid, and the window of a person at each."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Float32, Int
from numpy.typing import ArrayLike
from scipy.ndimage import map_coordinates

from trackers.area import Area
from trackers.arrays import Array, Index, Mask, Singles
from trackers.cameras.placed import PlacedCamera
from trackers.filters.gating import distances
from trackers.vision.person_windows import person_windows

_LEAST_CELL_PX = 1.0
"""A person with smaller cells is too small to be made out."""


class FloorPlaces:
    """Places `pitch_m` apart whose windows the picture shows by at least a share of `least_in_picture`.

    They are those of an area and `margin_m` about it, or without one those within `reach_m` of the camera.
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
        eye = camera.eye_m[:2]
        corners = eye + reach_m * np.array([(-1.0, -1.0), (1.0, 1.0)]) if area is None else np.asarray(area, float)
        margin_m = 0.0 if area is None else margin_m
        low, high = corners.min(axis=0) - margin_m, corners.max(axis=0) + margin_m
        columns, rows = np.ceil((high - low) / pitch_m).astype(int) + 1
        grid = low + pitch_m * np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).reshape(-1, 2)
        near = distances(grid, eye[None])[:, 0] <= reach_m if area is None else Area(area, margin_m).contains(grid)
        of_grid = near.nonzero()[0]
        windows = person_windows(camera, grid[of_grid], *cells)
        share = windows.inside.mean(axis=(1, 2))
        shown = (share >= least_in_picture) & (windows.cell_px >= _LEAST_CELL_PX)
        self.position: Float[Array, "n 2"] = grid[of_grid[shown]]
        self.windows = windows.select(shown)
        self.share_in_picture: Float[Array, "n"] = share[shown]
        self._of_grid: Int[Index, "n"] = of_grid[shown]
        self._low, self._pitch_m, self._shape = low, pitch_m, (int(rows), int(columns))
        self._whole = self.map(np.arange(len(self)), np.ones(len(self), np.float32))

    def __len__(self) -> int:
        return len(self.position)

    def map(self, index: Int[Index, "k"], values: Float32[Singles, "k"]) -> Float32[Singles, "rows columns"]:
        """The whole grid with values at the places at `index`, and 0 everywhere else."""
        grid = np.zeros(self._shape, np.float32)
        grid.flat[self._of_grid[index]] = values
        return grid

    def read(self, grid: Float32[Singles, "rows columns"], positions: Float[Array, "2 *n"]) -> Float[Array, "*n"]:
        """Read such a map at positions x and y [m], linear between its places; 0 beyond them."""
        column, row = (each - low for each, low in zip(positions, self._low, strict=True))
        return map_coordinates(grid, [row / self._pitch_m, column / self._pitch_m], np.float64, order=1)

    def shows(self, positions: Float[Array, "n 2"]) -> Bool[Mask, "n"]:
        """Mark positions [m] near one of these places: a person there is in the picture, unless hidden."""
        return self.read(self._whole, positions.T) > 0
