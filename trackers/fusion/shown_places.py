"""Places at which a camera shows people, learned from those whom other sensors measure: nobody tells which walls are where."""

from __future__ import annotations

import numpy as np

from trackers.arrays import Array, Bool, Float, Index, Int, Mask
from trackers.cameras.placed import PlacedCamera
from trackers.vision.person_windows import ground_axes

_CELL_M, _CELLS = 0.5, 128
"""Pitch [m] and number of cells on each side; the lattice repeats beyond them, so that its size is fixed."""
_TRUSTED = 1.0
"""Number of looks that the belief weighs that a camera shows everybody in its picture."""


class ShownPlaces:
    """Share of the people at each place of the floor whom a camera shows: the mean of a Beta distribution for each cell.

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
        columns = np.stack([column, column + 1, column, column + 1]) % _CELLS
        rows = np.stack([row, row, row + 1, row + 1]) % _CELLS
        return columns, rows, np.stack([(1 - x) * (1 - y), x * (1 - y), (1 - x) * y, x * y])
