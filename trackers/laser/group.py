"""All scanners of one role as one sensor: what each shows in front of the room, fused in the room frame.

Two scanners of a role see one body from two sides, and one sees what stands in the other's shadow. Clusters of two scanners are
paired by optimal assignment within a gate; what one of them alone shows stays as it is.

Simplified: the scans of one moment are taken to be of one time; two who stand one behind the other before one scanner and
nearer than the gate to what another sees of them may be fused with each other's parts.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from trackers.filters.gating import global_nearest_neighbour
from trackers.filters.motion import MEASUREMENT_VARIANCE_M2
from trackers.laser.grouping import distances
from trackers.laser.layer import Detections, LaserLayer, LayerOptions
from trackers.observations import LaserScan, Observation
from trackers.rig import LaserSensor

Array = NDArray[np.float64]


class ScannerGroup:
    """The scanners of one role by name, each with its place and background; `detect` is called with moments in order.

    empty_room: observations of the room without people; a scanner without any learns its background as it goes.
    """

    def __init__(
        self, scanners: Mapping[str, LaserSensor], empty_room: Sequence[Observation], options: LayerOptions
    ) -> None:
        self._gate_m = options.fuse_m
        self.layers: dict[str, LaserLayer] = {}
        for name, sensor in scanners.items():
            scans = [item for item in empty_room if isinstance(item, LaserScan) and item.sensor == name]
            self.layers[name] = LaserLayer(sensor, scans, options)

    @property
    def names(self) -> tuple[str, ...]:
        """The scanners, in the order of `Detections.scanner`'s columns."""
        return tuple(self.layers)

    @property
    def learns_background(self) -> bool:
        """Whether a scanner came without scans of the empty room."""
        return any(layer.learns_background for layer in self.layers.values())

    def detect(self, observations: Mapping[str, Observation]) -> Detections:
        """What the group's scans among `observations`, by sensor, show in front of the room.

        Those that the first scanner sees come first, in its order; their ranges and angles are its own.
        """
        n_scanner = len(self.layers)
        together = Detections.none(n_scanner)
        for column, (name, layer) in enumerate(self.layers.items()):
            scan = observations.get(name)
            if isinstance(scan, LaserScan):
                together = fused(together, layer.detect(scan).of_scanner(column, n_scanner), self._gate_m)
        return together

    def missed(self, observations: Mapping[str, Observation], points: Array) -> Array:
        """How probably none of the scans shows anything of somebody at room points (2, ...), (...)."""
        chance = np.ones(points.shape[1:])
        for name, layer in self.layers.items():
            scan = observations.get(name)
            if isinstance(scan, LaserScan):
                chance *= layer.missed(scan, points)
        return chance


def fused(first: Detections, second: Detections, gate_m: float) -> Detections:
    """The detections of other scanners together: pairs nearer than `gate_m` become one, `first`'s before `second`'s.

    A pair's position is the average weighted by inverse variance, a half hidden cluster's being the greater; its variance that
    of the average, but never less than one whole cluster's, whose errors (gait, clothes, the way to the axis) both share. Its
    width is the larger one, its range and angles are those of `first`.
    """
    if len(first) == 0 or len(second) == 0:
        return second if len(first) == 0 else first
    apart = distances(first.position, second.position)
    mine, theirs = global_nearest_neighbour(apart, apart <= gate_m)
    R = MEASUREMENT_VARIANCE_M2
    weight, other_weight = 1 / (R + first.variance_m2[mine]), 1 / (R + second.variance_m2[theirs])
    total = weight + other_weight
    position, variance = first.position.copy(), first.variance_m2.copy()
    width, scanner = first.width_m.copy(), first.scanner.copy()
    position[mine] = (weight[:, None] * first.position[mine] + other_weight[:, None] * second.position[theirs]) / total[
        :, None
    ]
    variance[mine] = np.maximum(1 / total - R, 0.0)
    width[mine] = np.maximum(first.width_m[mine], second.width_m[theirs])
    scanner[mine] |= second.scanner[theirs]
    alone = np.ones(len(second), np.bool_)
    alone[theirs] = False
    averaged = Detections(position, variance, width, first.range_m, first.angle, scanner)
    return averaged.joined(second.select(alone))
