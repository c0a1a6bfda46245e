"""Front end of the pressure floor: the newest frame's clusters, without the empty room's and stuck loads."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from trackers.arrays import Array, Bool, Float, Mask
from trackers.camera_floor_particle.options import CameraFloorParticleOptions
from trackers.likelihood.floor import FloorClusterOptions, FloorClusters, FloorLikelihood, floor_clusters
from trackers.observations import NS_PER_S, FloorFrame
from trackers.rig import FloorSensor

_OLDEST_S = 0.35
"""Greatest age of a usable frame."""
_MOST_LOADED = 0.5
"""Share of loaded elements from which the floor is broken."""


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
    """Front end of a floor: newest frame as loads; empty_room: frames without people."""

    def __init__(
        self, floor: FloorSensor, empty_room: Sequence[FloorFrame], options: CameraFloorParticleOptions
    ) -> None:
        self._floor = floor
        self._options = options
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
        if self._last is None or self._most_n >= self._options.track_management.least_load_n:
            return None
        what = "weight almost everywhere" if self._is_broken else "no person's weight"
        return f"has borne {what} so far, which is what finds people"

    def loads(self, frame: FloorFrame | None, ns: int) -> Loads | None:
        """Return the newest frame's loads at stamp ns; None if it is too old, missing or of a broken floor."""
        if frame is None or ns - frame.stamp_ns > _OLDEST_S * NS_PER_S:
            return None
        if self._last is None or self._last[0] is not frame:
            values = frame.values
            if values.shape == self._own.shape:  # another size is rejected below
                values = values - np.minimum(values, self._own)
            clusters = floor_clusters(
                replace(frame, values=values), self._floor, FloorClusterOptions(least_value=self._options.least_value)
            )
            self._is_broken = bool((clusters.cluster_of_cell >= 0).mean() > _MOST_LOADED)
            if not self._is_broken:
                self._most_n = max(self._most_n, float(clusters.load_n.max(initial=0.0)))
            likelihood = FloorLikelihood.of(clusters, self._floor, self._options.load)
            self._last = frame, None if self._is_broken else Loads(clusters, self._floor, likelihood)
        return self._last[1]

    def is_new(self, frame: FloorFrame | None) -> bool:
        """Return whether the frame has not been processed before."""
        return frame is not None and (self._last is None or self._last[0] is not frame)

    def learn_own(self, loads: Loads, empty: Bool[Mask, "k"], ns: int) -> None:
        """Learn clusters over which cameras see no person for a while as the floor's own load (ours)."""
        stuck_s = self._options.track_management.stuck_s
        if stuck_s is None:
            return
        number = loads.clusters.cluster_of_cell
        alone = (number >= 0) & np.append(empty, False)[number]
        self._alone_ns = np.where(alone, np.where(self._alone_ns > 0, self._alone_ns, ns), 0)
        stuck = alone & (ns - self._alone_ns > stuck_s * NS_PER_S)
        if stuck.any() and self._last is not None:
            self._own = np.where(stuck, self._last[0].values, self._own)
            self._last = None
