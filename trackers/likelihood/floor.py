"""Pressure floors and the room: front end, clusters of loaded elements, and likelihoods of a position.

Clusters tell places and loads of people. By them, the likelihood is the share of a cluster's load there (Mori et al., eq. 3); by
the room, a head is in free space, at plausible heights (Suzuki et al., eq. 8).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, FiniteFloat, PositiveInt
from scipy import ndimage

from trackers.arrays import Array, Bool, Float, Index, Int, Mask
from trackers.configuration import Strict
from trackers.environment.model import Environment
from trackers.errors import InputError
from trackers.observations import NS_PER_S, FloorFrame
from trackers.rig import FloorSensor

_EIGHT_NEIGHBOURS = np.ones((3, 3), dtype=bool)
_OLDEST_S = 0.35
"""Greatest age of a usable frame."""
_MOST_LOADED = 0.5
"""Share of loaded elements from which the floor is broken."""


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
    cluster_of_cell: Int[Index, "rows columns"]  # the number of the cluster, −1 in none
    cell_load_n: Float[Array, "rows columns"]  # the load of elements in clusters, 0 elsewhere [N]

    def __len__(self) -> int:
        """Return the number of clusters."""
        return len(self.load_n)

    def share_of_cell(self) -> Float[Array, "rows columns"]:
        """Return each element's share of the load of its cluster, 0 in none: Mori et al., eq. 3, by element."""
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
        cluster_of_cell=number,
        cell_load_n=np.where(number >= 0, load_n, 0.0),
    )


class FloorLikelihoodOptions(Strict):
    """Options of the floor's likelihood."""

    no_load: float | Literal["drop"] = Field(
        default=-7.0,
        description='log-likelihood over an element without load (ours); "drop": the place is impossible (the paper)',
    )
    smoothing_m: float = Field(
        default=0.12,
        ge=0,
        description="standard deviation by which a cluster's load is smoothed over the floor (ours) [m]; 0: as measured (eq. 3)",
    )


@dataclass(frozen=True, eq=False)
class FloorLikelihood:
    """Shares of the clusters' load in one frame, over the grid."""

    options: FloorLikelihoodOptions
    floor: FloorSensor
    share: Float[Array, "rows columns"]

    @classmethod
    def of(cls, clusters: FloorClusters, floor: FloorSensor, options: FloorLikelihoodOptions) -> FloorLikelihood:
        """Make the likelihood of one frame's clusters, smoothed by the options."""
        share = clusters.share_of_cell()
        if options.smoothing_m:
            share = ndimage.gaussian_filter(share, options.smoothing_m / floor.pitch_m, mode="constant")
        return cls(options, floor, share)

    def log_likelihood(self, places: Float[Array, "2 k"]) -> Float[Array, "k"]:
        """Return log π_f (eq. 3) at x, y [m]: f(x, y) is interpolated between the middles of elements."""
        pose = self.floor.room_from_sensor
        local = (places.T - pose.translation[:2]) @ np.linalg.inv(pose.rotation[:2, :2]).T / self.floor.pitch_m - 0.5
        share = ndimage.map_coordinates(self.share, local.T[::-1], order=1, mode="constant")
        if self.options.no_load == "drop":
            with np.errstate(divide="ignore"):
                return np.log(share)
        return np.log(share + np.exp(self.options.no_load))


@dataclass(frozen=True, eq=False)
class Loads:
    """Clusters of one frame, and the likelihood of positions by them."""

    clusters: FloorClusters
    floor: FloorSensor
    likelihood: FloorLikelihood

    def cluster_near(self, places: Float[Array, "n 2"], within_m: float) -> Bool[Mask, "n k"]:
        """Return a mask of the clusters with an element within this distance of each place [m]."""
        number = self.clusters.cluster_of_cell
        loaded = number >= 0
        away = np.linalg.norm(places[:, None] - self.floor.centres[loaded], axis=-1)  # (n, elements)
        near = np.zeros((len(places), len(self.clusters)), np.bool_)
        person, element = (away < within_m).nonzero()
        near[person, number[loaded][element]] = True
        return near


class FloorFrontEnd:
    """Front end of one floor: its newest frame without what the empty room bears.

    empty_room: its frames without people; least_load_n: what a person weighs at least [N];
    stuck_s: time after which a load over which no camera shows a person is the floor's own [s]; None: never.
    """

    def __init__(
        self,
        floor: FloorSensor,
        empty_room: Sequence[FloorFrame],
        clusters: FloorClusterOptions,
        load: FloorLikelihoodOptions = FloorLikelihoodOptions(),
        least_load_n: float = 0.0,
        stuck_s: float | None = None,
    ) -> None:
        self._floor, self._cluster_options, self._load_options = floor, clusters, load
        self._least_load_n, self._stuck_s = least_load_n, stuck_s
        shape = (floor.rows, floor.columns)
        frames = [frame.values for frame in empty_room]
        median = np.median(frames, axis=0) if frames else np.zeros(shape)
        self._own = np.rint(median).astype(np.uint8)
        self._alone_ns: NDArray[np.int64] = np.zeros(shape, np.int64)  # time since when loaded without a person; 0: not
        self._last: tuple[FloorFrame, Loads | None] | None = None
        self._is_broken, self._most_n = False, 0.0

    @property
    def warning(self) -> str | None:
        """Reason why the floor has shown no person yet; None if it has, or has reported nothing at all."""
        if self._last is None or self._most_n >= self._least_load_n:
            return None
        what = "weight almost everywhere" if self._is_broken else "no person's weight"
        return f"has borne {what} so far, which is what finds people"

    def loads(self, frame: FloorFrame | None, ns: int) -> Loads | None:
        """Return the newest frame's loads at stamp ns; None if it is too old, missing or of a broken floor."""
        if frame is None or ns - frame.stamp_ns > _OLDEST_S * NS_PER_S:
            return None
        if self._last is None or self._last[0] is not frame:
            clusters = self.clusters(frame)
            self._is_broken = clusters is None
            self._last = frame, None
            if clusters is not None:
                self._most_n = max(self._most_n, float(clusters.load_n.max(initial=0.0)))
                likelihood = FloorLikelihood.of(clusters, self._floor, self._load_options)
                self._last = frame, Loads(clusters, self._floor, likelihood)
        return self._last[1]

    def clusters(self, frame: FloorFrame) -> FloorClusters | None:
        """Return the clusters of a frame beyond what the empty room bears; None if the floor is broken.

        Raises InputError for a frame of another size than the rig's floor.
        """
        values = frame.values
        if values.shape == self._own.shape:  # another size is refused below, in words
            values = values - np.minimum(values, self._own)
        clusters = floor_clusters(replace(frame, values=values), self._floor, self._cluster_options)
        return None if (clusters.cluster_of_cell >= 0).mean() > _MOST_LOADED else clusters

    def is_new(self, frame: FloorFrame | None) -> bool:
        """Return whether the frame has not been processed before."""
        return frame is not None and (self._last is None or self._last[0] is not frame)

    def learn_own(self, loads: Loads, empty: Bool[Mask, "k"], ns: int) -> None:
        """Learn clusters over which cameras see no person for a while as the floor's own load (ours)."""
        if self._stuck_s is None:
            return
        number = loads.clusters.cluster_of_cell
        alone = (number >= 0) & np.append(empty, False)[number]
        self._alone_ns = np.where(alone, np.where(self._alone_ns > 0, self._alone_ns, ns), 0)
        stuck = alone & (ns - self._alone_ns > self._stuck_s * NS_PER_S)
        if stuck.any() and self._last is not None:
            self._own = np.where(stuck, self._last[0].values, self._own)
            self._last = None


class EnvironmentLikelihoodOptions(Strict):
    """Weights of a head's position (eq. 8), if the environment is known."""

    above_furniture: float = Field(
        default=0.5, ge=0, le=1, description="weight over furniture, region B; over chairs, where people sit, too"
    )
    odd_height: float = Field(default=0.2, ge=0, le=1, description="weight too low and too high, region C")
    low_m: FiniteFloat = Field(default=0.8, description="what is lower is too low (the paper gives no height) [m]")
    high_m: FiniteFloat = Field(default=1.9, description="what is higher is too high (the paper gives no height) [m]")
    radius_m: float = Field(
        default=0.08,
        ge=0,
        description="a head's middle is at least so far from what region A holds (ours); 0: the paper [m]",
    )


class EnvironmentLikelihood:
    """Likelihood of heads by one room; environment: None if unknown, with no effect."""

    def __init__(self, environment: Environment | None, options: EnvironmentLikelihoodOptions) -> None:
        self._environment, self._options = environment, options

    def log_likelihood(self, places: Float[Array, "k 3"]) -> Float[Array, "k"]:
        """Return the logarithm of the weight e (eq. 8) of heads at positions [m]; 0 for an unknown environment."""
        if self._environment is None:
            return np.zeros(len(places))
        options = self._options
        weight = self._environment.head_weight(
            places,
            above_furniture=options.above_furniture,
            odd_height=options.odd_height,
            low_m=options.low_m,
            high_m=options.high_m,
        )
        if options.radius_m:
            weight = weight * ~(self._environment.distance_to_surface(places) < options.radius_m)
        with np.errstate(divide="ignore"):
            return np.log(weight)
