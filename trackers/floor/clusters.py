"""Clusters of loaded elements on a pressure floor: places and loads of people."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pydantic import Field, PositiveInt
from scipy import ndimage

from trackers.arrays import Array, Float, Index, Int
from trackers.configuration import Strict
from trackers.errors import InputError
from trackers.observations import FloorFrame
from trackers.rig import FloorSensor

_EIGHT_NEIGHBOURS = np.ones((3, 3), dtype=bool)


class FloorClusterOptions(Strict):
    """Options of a person's load."""

    least_value: int = Field(
        default=5, ge=1, le=255, description="8-bit value from which an element is loaded; empty ones flicker below it"
    )
    least_load_n: float = Field(default=0.0, ge=0, description="a cluster that bears less is left out [N]")
    least_cells: PositiveInt = Field(default=1, description="a cluster of fewer elements is left out")


@dataclass(frozen=True, eq=False)
class FloorClusters:
    """k clusters of loaded elements that touch by a side or a corner, in the order of their first element, row by row."""

    load_n: Float[Array, "k"]  # their elements' loads together [N]
    centroid: Float[Array, "k 2"]  # middle of that load in the room, x, y [m]
    n_cell: Int[Index, "k"]
    cluster_of_cell: Int[Index, "rows columns"]  # the number of the cluster, −1 in none
    cell_load_n: Float[Array, "rows columns"]  # the load of elements in clusters, 0 elsewhere [N]

    def __len__(self) -> int:
        """Return the number of clusters."""
        return len(self.load_n)

    def share_of_cell(self) -> Float[Array, "rows columns"]:
        """Each element's share of the load of its cluster, 0 in none: Mori et al., eq. 3, by element."""
        total_n = np.append(self.load_n, 1.0)[self.cluster_of_cell]  # the last stands for −1
        return self.cell_load_n / total_n


def floor_clusters(
    frame: FloorFrame, floor: FloorSensor, options: FloorClusterOptions = FloorClusterOptions()
) -> FloorClusters:
    """Find the clusters in one frame of a floor. Raises InputError for a frame of another size than the rig's floor."""
    if frame.values.shape != (floor.rows, floor.columns):
        raise InputError(
            f"frame of {frame.sensor!r} has {' x '.join(map(str, frame.values.shape))} elements; "
            f"the rig says {floor.rows} x {floor.columns}"
        )
    loaded = frame.values >= options.least_value
    load_n = floor.load_n(frame.values)
    label = np.empty(loaded.shape, dtype=np.intp)
    count = ndimage.label(loaded, _EIGHT_NEIGHBOURS, output=label)
    assert isinstance(count, int)  # as the output array was given
    total_n: Array = np.bincount(label.ravel(), load_n.ravel(), count + 1).astype(float)
    n_cell = np.bincount(label.ravel(), minlength=count + 1)
    kept = (total_n >= options.least_load_n) & (n_cell >= options.least_cells)
    kept[0] = False  # the elements in no cluster
    number = np.where(kept, np.cumsum(kept) - 1, -1)[label]
    middle = np.stack(
        [np.bincount(label.ravel(), (load_n * axis).ravel(), count + 1) for axis in np.moveaxis(floor.centres, -1, 0)],
        axis=-1,
    )
    return FloorClusters(
        load_n=total_n[kept],
        centroid=middle[kept] / total_n[kept, None],
        n_cell=n_cell[kept],
        cluster_of_cell=number,
        cell_load_n=np.where(number >= 0, load_n, 0.0),
    )
