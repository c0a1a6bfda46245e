"""All scanners of one role, at waist or knee height, as one sensor: their detections, fused in the room frame.

Two scanners of a role see one body from two sides, and one sees into the other's shadow. Clusters of two scanners are paired
by optimal assignment within a gate; the others are kept.

Simplified: the scans of one frame are taken as simultaneous; two people behind one another before one scanner, and within
the gate of another's view of them, may be fused with each other's parts.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from itertools import compress

import numpy as np

from trackers.area import Area
from trackers.arrays import Array, Bool, Float, Mask
from trackers.errors import InputError
from trackers.filters.gating import distances, global_nearest_neighbour
from trackers.filters.motion import MEASUREMENT_VARIANCE_M2
from trackers.filters.rows import Rows
from trackers.laser.clusters import PAIR_M, STRIDE_M, Detections, pair_off, take_legs
from trackers.laser.layer import KneeOptions, LaserLayer, LayerOptions, WaistOptions
from trackers.observations import LaserScan, Observation
from trackers.rig import LaserSensor, Rig, Role
from trackers.tracks import Detection


def scanners_by_role(rig: Rig, wanted: Sequence[Role]) -> dict[Role, tuple[str, ...]]:
    """Return the names of the scanners for each `wanted` role that the rig can fill, waist first.

    A scanner's own `role` counts; one without is a waist scanner from 0.7 m up and a knee scanner below. At exactly 0 its
    height is unknown, and it is a knee scanner if one is wanted. Several of one role are ordered by name, but the rig's main
    sensor comes first. Raises InputError if no wanted role can be filled.
    """
    lasers = rig.lasers()
    found: dict[Role, tuple[str, ...]] = {}
    for name in sorted(lasers, key=lambda name: (name != rig.main_sensor, name)):
        role = _role(lasers[name], wanted)
        if role in wanted:
            found[role] = (*found.get(role, ()), name)
    if not found:
        there = ", ".join(
            f"{name} ({laser.role or f'at {laser.room_from_sensor.xyz[2]} m'})" for name, laser in lasers.items()
        )
        raise InputError(
            f"the rig has no laser scanner for {' or '.join(wanted)} height: {there or 'no laser at all'}; "
            f"a sensor of kind 'laser' with role {' or '.join(wanted)} is needed"
        )
    return {role: found[role] for role in ("waist", "knee") if role in found}


def _role(laser: LaserSensor, wanted: Sequence[Role]) -> Role:
    unknown = laser.role is None and laser.room_from_sensor.xyz[2] == 0
    return "waist" if unknown and "knee" not in wanted else laser.layer


@dataclass(frozen=True, eq=False)
class Points(Rows):
    """k samples of one frame in front of the room, of all scanners of a role."""

    place: Float[Array, "k 2"]  # axis of the body or leg met, in the room frame [m]
    width_m: Float[Array, "k"]  # width covered by the beam: the spacing of the beams there
    alone: Bool[Mask, "k"]  # continued by no neighbouring beam's: half of the beam may have met what is behind


MakeLayer = Callable[[str, LaserSensor, LayerOptions], LaserLayer]
"""Makes the layer of a scanner by its name."""


class ScannerGroup:
    """Scanners of one role by name, each with its pose and background; `detect` is called with frames in order.

    empty_room: observations of the room without people; a scanner without any learns its background. moving: makes the layers
    of scanners on bases that move, by name; None: these are taken to stand.
    """

    def __init__(
        self,
        scanners: Mapping[str, LaserSensor],
        empty_room: Sequence[Observation],
        options: LayerOptions,
        moving: MakeLayer | None = None,
    ) -> None:
        self._gate_m, self._least = options.fuse_m, options.cluster.min_samples
        self._noise_m2 = 0.0 if options.outlines else MEASUREMENT_VARIANCE_M2
        self.layers: dict[str, LaserLayer] = {}
        for name, sensor in scanners.items():
            if moving is not None and sensor.mounted_on is not None:
                self.layers[name] = moving(name, sensor, options)
                continue
            scans = [item for item in empty_room if isinstance(item, LaserScan) and item.sensor == name]
            self.layers[name] = LaserLayer(sensor, scans, options)

    @property
    def names(self) -> tuple[str, ...]:
        """The scanners, in the order of `Detections.scanner`'s columns."""
        return tuple(self.layers)

    @property
    def learns_background(self) -> bool:
        """True with a scanner without scans of the empty room."""
        return bool(self.learning)

    @property
    def learning(self) -> tuple[str, ...]:
        """The scanners without scans of the empty room."""
        return tuple(name for name, layer in self.layers.items() if layer.learns_background)

    @property
    def is_learning(self) -> bool:
        """True once such a scanner has reported."""
        return any(layer.is_learning for layer in self.layers.values())

    def detect(self, observations: Mapping[str, Observation], weak: bool = False) -> Detections:
        """Detect people in front of the room in the group's scans among `observations`, by sensor.

        Detections by the first scanner come first, in its order, with its ranges and angles. weak: whether to include those
        with too few samples, of all scanners together, to initiate a track.
        """
        n_scanner, scans = len(self.layers), self._scans(observations)
        if n_scanner == 1 and scans:  # there is nothing to fuse, and no other sees past
            alone = next(iter(self.layers.values())).detect(*scans.values())
            return alone if weak else alone.select(self.sufficient(alone))
        together = Detections.none(n_scanner)
        for column, (name, layer) in enumerate(self.layers.items()):
            if name in scans:
                together = fused(
                    together, layer.detect(scans[name]).of_scanner(column, n_scanner), self._gate_m, self._noise_m2
                )
        seen_past = np.zeros(len(together), np.bool_)
        for column, (name, layer) in enumerate(self.layers.items()):
            if name in scans and len(scans) > 1:
                seen_past |= layer.passes(scans[name], together.position.T) & ~together.scanner[:, column]
        return together.select(~seen_past if weak else ~seen_past & self.sufficient(together))

    def _scans(self, observations: Mapping[str, Observation]) -> dict[str, LaserScan]:
        return {name: scan for name in self.layers if isinstance(scan := observations.get(name), LaserScan)}

    def sufficient(self, detections: Detections) -> Bool[Mask, "k"]:
        """Return a mask of the detections with enough samples to initiate a track."""
        return detections.n_sample >= self._least

    @property
    def origins(self) -> Float[Array, "s 2"]:
        """Positions of the scanners [m], in the order of `Detections.scanner`'s columns."""
        return np.array([layer.origin_m for layer in self.layers.values()])

    def points(self, observations: Mapping[str, Observation]) -> Points:
        """Return all foreground samples of the group's scans among `observations`.

        Without those that another scanner sees past: a beam half on a leg and half on the wall reports a range between.
        """
        scans = self._scans(observations)
        found = [Points(np.empty((0, 2)), np.empty(0), np.empty(0, np.bool_))]
        for name, scan in scans.items():
            place, width_m, alone = self.layers[name].points(scan)
            kept = np.ones(len(place), np.bool_)
            for other, seen in scans.items():
                if other != name:
                    kept &= ~self.layers[other].passes(seen, place.T)
            found.append(Points(place, width_m, alone).select(kept))
        return reduce(Points.joined, found)

    def to_detections(self, detections: Detections, role: Role, ns: int) -> list[Detection]:
        """Return the detections of this group in a frame [ns]; a fully visible cluster has the measurement variance."""
        sensors = [tuple(compress(self.layers, seen)) for seen in detections.scanner.tolist()]
        variance = (MEASUREMENT_VARIANCE_M2 + detections.variance_m2).tolist()
        rows = zip(sensors, detections.position.tolist(), variance, detections.width_m.tolist(), strict=True)
        return [Detection(ns, seen_by, role, x, y, m2, width) for seen_by, (x, y), m2, width in rows]

    def seen_behind(self, points: Float[Array, "k 2"]) -> Bool[Mask, "k"]:
        """Select the room points [m] behind which a scanner knows the room, or has measured something."""
        return np.logical_or.reduce([layer.seen_behind(points) for layer in self.layers.values()])

    def leg_evidence(self, observations: Mapping[str, Observation], points: Float[Array, "k 2"]) -> Float[Array, "k"]:
        """Return the log-likelihood ratio of the likeliest leg about room points in any of the scans [nat]; −inf: none."""
        found = [self.layers[name].leg_evidence(scan, points) for name, scan in self._scans(observations).items()]
        return reduce(np.maximum, found, np.full(len(points), -np.inf))

    def missed(self, observations: Mapping[str, Observation], points: Float[Array, "2 *n"]) -> Float[Array, "*n"]:
        """Return the probability that none of the scans shows a person at room points."""
        chances = [self.layers[name].missed(scan, points) for name, scan in self._scans(observations).items()]
        return reduce(np.multiply, chances) if chances else np.ones(points.shape[1:])


def fused(
    first: Detections, second: Detections, gate_m: float, noise_m2: float = MEASUREMENT_VARIANCE_M2
) -> Detections:
    """Fuse detections of two scanners: pairs nearer than `gate_m` become one, `first`'s before `second`'s.

    A pair's position is the average weighted by inverse variance, which is larger for a partly occluded cluster. Its
    variance is that of the average, but at least one full cluster's, whose errors (gait, clothes, distance to the axis) both
    share. Its width is the larger one, its range and angles are those of `first`.
    """
    if len(first) == 0 or len(second) == 0:
        return second if len(first) == 0 else first
    apart = distances(first.position, second.position)
    mine, theirs = global_nearest_neighbour(apart, apart <= gate_m)
    R = noise_m2
    weight, other_weight = 1 / (R + first.variance_m2[mine]), 1 / (R + second.variance_m2[theirs])
    total = weight + other_weight
    position, variance = first.position.copy(), first.variance_m2.copy()
    n_sample, width, scanner = first.n_sample.copy(), first.width_m.copy(), first.scanner.copy()
    n_sample[mine] += second.n_sample[theirs]
    position[mine] = (weight[:, None] * first.position[mine] + other_weight[:, None] * second.position[theirs]) / total[
        :, None
    ]
    variance[mine] = np.maximum(1 / total - R, 0.0)
    width[mine] = np.maximum(first.width_m[mine], second.width_m[theirs])
    scanner[mine] |= second.scanner[theirs]
    alone = np.ones(len(second), np.bool_)
    alone[theirs] = False
    averaged = Detections(position, variance, n_sample, width, first.range_m, first.angle, scanner)
    return averaged.joined(second.select(alone))


def scanner_groups(
    rig: Rig, empty_room: Sequence[Observation], moving: MakeLayer | None = None
) -> dict[Role, ScannerGroup]:
    """Return the scanners of a rig by role, waist first, with the default options of each layer.

    Raises InputError for a rig without a scanner of these roles.
    """
    lasers = rig.lasers()
    layers: dict[Role, LayerOptions] = {"waist": WaistOptions(), "knee": KneeOptions()}
    return {
        role: ScannerGroup({name: lasers[name] for name in names}, empty_room, layers[role], moving)
        for role, names in scanners_by_role(rig, tuple(layers)).items()
    }


def people_seen(
    seen: Mapping[Role, Detections],
    expected: Float[Array, "n 2"],
    area: Area | None = None,
    reach_m: float = 0.7,
) -> tuple[Float[Array, "k 2"], Bool[Mask, "k"]]:
    """Return people [m] by their trunks, else by their legs, and a mask of those surely people, not single legs.

    seen: detections by role, for the scanned roles; expected: predicted people [m], who are assigned legs first; area: limit
    of the search (None: everywhere); reach_m: greatest distance of legs from a predicted person, or from a trunk. Without
    waist scanners a single leg counts as a person.
    """
    trunks = seen["waist"].position if "waist" in seen else np.empty((0, 2))
    legs = seen["knee"].position if "knee" in seen else np.empty((0, 2))
    together = np.zeros(len(legs), np.bool_)
    by_legs, n_leg, free = take_legs(legs, together, expected, reach_m, STRIDE_M)
    new, n_new = pair_off(legs[free], PAIR_M)
    walkers = np.concatenate([by_legs[n_leg > 0], new])
    whole = (np.concatenate([n_leg[n_leg > 0], n_new]) > 1) | ("waist" not in seen)
    if len(trunks) and len(walkers):
        own = distances(walkers, trunks).min(axis=1) <= reach_m
        walkers, whole = walkers[~own], whole[~own]
    people, whole = np.concatenate([trunks, walkers]), np.concatenate([np.ones(len(trunks), np.bool_), whole])
    inside = np.ones(len(people), np.bool_) if area is None else area.contains(people)
    return people[inside], whole[inside]
