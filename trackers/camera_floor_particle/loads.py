"""What the pressure floor says: how likely a body is at a place (eq. 3), who may be new, and what is the floor's own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float
from numpy.typing import NDArray
from scipy import ndimage

from trackers.arrays import Array, Mask
from trackers.camera_floor_particle.options import BodyOptions, CameraFloorParticleOptions
from trackers.floor.clusters import FloorClusters, floor_clusters
from trackers.observations import NS_PER_S, FloorFrame
from trackers.rig import FloorSensor

_OLDEST_S = 0.35
"""A frame older than this says nothing of now."""
_MOST_LOADED = 0.5
"""Share of the elements from which a frame is that of a broken floor."""


@dataclass(frozen=True, eq=False)
class Loads:
    """One frame's clusters, and the smoothed share of a cluster's load over the grid."""

    clusters: FloorClusters
    floor: FloorSensor
    share: Float[Array, "rows columns"]

    @classmethod
    def of(cls, clusters: FloorClusters, floor: FloorSensor, options: BodyOptions) -> Loads:
        """Of one frame, smoothed as the options say."""
        share = clusters.share_of_cell()
        if options.floor_smoothing_m:
            share = ndimage.gaussian_filter(share, options.floor_smoothing_m / floor.pitch_m, mode="constant")
        return cls(clusters, floor, share)

    def log_likelihood(self, places: Float[Array, "2 k"], options: BodyOptions) -> Float[Array, "k"]:
        """Log of π_f (eq. 3) at x, y [m]: of the element (paper), or in between the elements of the smoothed shares (ours)."""
        if options.floor_smoothing_m:
            pose = self.floor.room_from_sensor
            local = (places.T - pose.translation[:2]) @ np.linalg.inv(
                pose.rotation[:2, :2]
            ).T / self.floor.pitch_m - 0.5
            share = ndimage.map_coordinates(self.share, local.T[::-1], order=1, mode="constant")
        else:
            cell, inside = self.floor.cell_at(places.T)
            share = np.where(inside, self.share.ravel()[cell], 0.0)
        if options.no_load == "drop":
            with np.errstate(divide="ignore"):
                return np.log(share)
        return np.log(share + np.exp(options.no_load))

    def cluster_near(self, places: Float[Array, "n 2"], within_m: float) -> Bool[Mask, "n k"]:
        """Which cluster has an element within this distance of each place [m]."""
        number = self.clusters.cluster_of_cell
        loaded = number >= 0
        away = np.linalg.norm(places[:, None] - self.floor.centres[loaded], axis=-1)  # (n, elements)
        near = np.zeros((len(places), len(self.clusters)), np.bool_)
        person, element = (away < within_m).nonzero()
        near[person, number[loaded][element]] = True
        return near


class FloorWatch:
    """The newest frame of a floor as loads, less what the empty room has and what is stuck."""

    def __init__(
        self, floor: FloorSensor, empty_room: Sequence[FloorFrame], options: CameraFloorParticleOptions
    ) -> None:
        self._floor = floor
        self._options = options
        shape = (floor.rows, floor.columns)
        frames = [frame.values for frame in empty_room]
        median = np.median(frames, axis=0) if frames else np.zeros(shape)
        self._own = np.rint(median).astype(np.uint8)
        self._alone_ns: NDArray[np.int64] = np.zeros(shape, np.int64)  # since when loaded and nobody there; 0: not
        self._last: tuple[FloorFrame, Loads | None] | None = None
        self._is_broken, self._most_n = False, 0.0

    @property
    def doubt(self) -> str | None:
        """Why the floor has shown nobody yet; None where it has, or has said nothing at all."""
        if self._last is None or self._most_n >= self._options.detection.least_load_n:
            return None
        what = "weight almost everywhere" if self._is_broken else "nobody's weight"
        return f"has borne {what} so far, which is what finds people"

    def loads(self, frame: FloorFrame | None, ns: int) -> Loads | None:
        """What the newest frame says at stamp ns; None where it is too old, missing or that of a broken floor."""
        if frame is None or ns - frame.stamp_ns > _OLDEST_S * NS_PER_S:
            return None
        if self._last is None or self._last[0] is not frame:
            values = frame.values
            if values.shape == self._own.shape:  # another size is refused below, in words
                values = values - np.minimum(values, self._own)
            clusters = floor_clusters(replace(frame, values=values), self._floor, self._options.floor)
            self._is_broken = bool((clusters.cluster_of_cell >= 0).mean() > _MOST_LOADED)
            if not self._is_broken:
                self._most_n = max(self._most_n, float(clusters.load_n.max(initial=0.0)))
            self._last = frame, None if self._is_broken else Loads.of(clusters, self._floor, self._options.body)
        return self._last[1]

    def is_new(self, frame: FloorFrame | None, ns: int) -> bool:
        """Whether the frame has not been worked before."""
        return frame is not None and (self._last is None or self._last[0] is not frame)

    def learn_own(self, loads: Loads, nobody: Bool[Mask, "k"], ns: int) -> None:
        """Clusters over which cameras see nobody are, after a while, the floor's own load from now on."""
        number = loads.clusters.cluster_of_cell
        alone = (number >= 0) & np.append(nobody, False)[number]
        self._alone_ns = np.where(alone, np.where(self._alone_ns > 0, self._alone_ns, ns), 0)
        stuck = alone & (ns - self._alone_ns > self._options.detection.stuck_s * NS_PER_S)
        if stuck.any() and self._last is not None:
            self._own = np.where(stuck, self._last[0].values, self._own)
            self._last = None
