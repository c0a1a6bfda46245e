"""One scanner at one height: from a scan to detections of people in the room frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import ClassVar, TypeVar

import numpy as np
from pydantic import Field, PositiveInt

from trackers.arrays import Array, Bool, Float, Mask
from trackers.configuration import Strict, described
from trackers.filters.gating import distances
from trackers.laser.background import BackgroundOptions, KnownBackground, LearnedBackground
from trackers.laser.bearings import ACROSS, DetectionModel, DetectionOptions, beams_of_turn, counter_clockwise, returns
from trackers.laser.clusters import (
    ClusterOptions,
    Clusters,
    Detections,
    directions,
    find_clusters,
    padded_ranges,
    pushed_back,
    trunks,
)
from trackers.laser.legs.classifier import shipped as shipped_legs
from trackers.laser.legs.features import leg_clusters
from trackers.laser.outlines import shipped
from trackers.observations import LaserScan
from trackers.rig import LaserSensor

Layer = TypeVar("Layer", bound="LayerOptions")

_NARROW_M, _BEHIND_M, _SURE = 0.06, 0.15, 0.9
"""Half the width of the narrowest object, distance behind it at which a beam has passed it [m]; a probability."""
_NO_RETURN_SHARE = 0.5
"""Share of what a beam that returns from behind tells of a place, that one without tells: dark clothes return nothing."""
_LEG_REACH_M = 0.3
"""Greatest distance of the leg of a walking person from the middle of both [m]."""
_ARM_HALF_DEPTH_M = 0.04
"""Half the thickness of an arm in a sleeve [m]."""


class LayerOptions(Strict):
    """Parameters of a scanner at one height."""

    cluster: ClusterOptions = Field(description="how samples become clusters")
    background: BackgroundOptions = Field(default=BackgroundOptions(), description="what of a scan is the room")
    free_space: DetectionOptions = Field(
        default=DetectionOptions(), description="negative evidence of beams that go on"
    )
    weak_samples: PositiveInt | None = Field(
        default=None,
        description="least samples of a cluster that goes on with a track, but alone starts none, where nothing nearer is "
        "beside it; null: the same as of any other (ours)",
    )
    half_depth_m: float = Field(
        ge=0,
        description="how far the body's axis lies behind a cluster's middle, along the beam [m]; 0: not at all (ours)",
    )
    side_half_depth_m: float | None = Field(
        default=None,
        ge=0,
        description="how far the axis lies behind the middle of a body seen from its side, which its width tells [m]; "
        "null: as from the front (ours)",
    )
    body_width_m: float | None = Field(
        default=None,
        gt=0,
        description="width to which a narrower, partly occluded cluster is completed [m]; null: it is not (ours)",
    )
    hidden_variance_m2: float = Field(
        default=0.02,
        ge=0,
        description="measurement variance added for a partly occluded cluster [m²] (ours)",
    )
    outlines: bool = Field(
        default=False,
        description="whether a body's axis and its variance follow from the outline that is seen of it, learned from bodies of "
        "the twin, in place of the depth, width and variance above (ours)",
    )
    satellite_width_m: float | None = Field(
        default=None,
        gt=0,
        description="width below which a cluster beside a wider one is its arm [m]; null: arms are people (ours)",
    )
    satellite_reach_m: float = Field(
        default=0.42, gt=0, description="how far from its trunk's axis a partly occluded arm may be [m] (ours)"
    )
    arm_reach_m: float = Field(
        default=0.7, gt=0, description="how far from its trunk's axis an arm in full view may be [m] (ours)"
    )
    trunks_apart_m: float = Field(
        default=0.25,
        ge=0,
        description="distance within which there is no second trunk: of two clusters the narrower is a piece of the wider, which "
        "an arm before it cuts in two [m] (ours)",
    )
    fuse_m: float = Field(
        default=0.35,
        ge=0,
        description="gate within which clusters of two scanners of this role are one body's or one leg's [m]; 0: never (ours)",
    )


def _of_layer(field: str) -> str:
    """Return the description of a field of every layer, for layers with another default."""
    return described(LayerOptions, field)


class WaistOptions(LayerOptions):
    """Scanner at waist height: one trunk per person, arms beside it."""

    cluster: ClusterOptions = Field(
        default=ClusterOptions(jump_m=0.08, min_width_m=0.06), description=_of_layer("cluster")
    )
    half_depth_m: float = Field(default=0.11, ge=0, description=_of_layer("half_depth_m"))
    side_half_depth_m: float | None = Field(default=0.168, ge=0, description=_of_layer("side_half_depth_m"))
    body_width_m: float | None = Field(default=0.3, gt=0, description=_of_layer("body_width_m"))
    hidden_variance_m2: float = Field(default=0.003, ge=0, description=_of_layer("hidden_variance_m2"))
    satellite_width_m: float | None = Field(default=0.16, gt=0, description=_of_layer("satellite_width_m"))


class KneeOptions(LayerOptions):
    """Scanner at knee height: two legs per person."""

    cluster: ClusterOptions = Field(
        default=ClusterOptions(jump_m=0.08, jump_spacings=1.0, min_samples=2, min_width_m=0.03),
        description=_of_layer("cluster"),
    )
    free_space: DetectionOptions = Field(
        default=DetectionOptions(width_m=0.08, half_width_m=0.25, hidden_up_to=0.5),
        description=_of_layer("free_space"),
    )
    weak_samples: PositiveInt | None = Field(default=1, description=_of_layer("weak_samples"))
    half_depth_m: float = Field(default=0.04, ge=0, description=_of_layer("half_depth_m"))
    fuse_m: float = Field(default=0.2, ge=0, description=_of_layer("fuse_m"))


class ScannerOptions(Strict):
    """Scanner options common to all trackers; a layer's other parameters depend on its height."""

    jump_m: float = Field(
        default=0.08, gt=0, description="distance between neighbouring samples above which a cluster is split [m]"
    )
    margin_m: float = Field(
        default=0.12, gt=0, description="how much nearer than the room a sample must be to be foreground [m]"
    )
    memory_s: ClassVar[float] = 60.0
    """Time constant with which a background learned from the scans fades [s]."""
    p_detect: float = Field(
        default=0.95,
        ge=0,
        lt=1,
        description="detection probability of a body that nothing occludes; 0: where a scan shows nothing is no evidence (ours)",
    )
    half_depth_m: float = Field(
        ge=0,
        description="how far the body's axis lies behind a cluster's middle, along the beam [m]; 0: not at all (ours)",
    )

    def over(self, defaults: Layer) -> Layer:
        """Return the parameters of a layer: these over the `defaults` of its height."""
        background = {"margin_m": self.margin_m, "memory_s": self.memory_s}
        return defaults.model_copy(
            update={
                "cluster": defaults.cluster.model_copy(update={"jump_m": self.jump_m}),
                "background": defaults.background.model_copy(update=background),
                "free_space": defaults.free_space.model_copy(update={"detected": self.p_detect}),
                "half_depth_m": self.half_depth_m,
            }
        )


def trunk_mask(clusters: Clusters, options: LayerOptions) -> Bool[Mask, "k"]:
    """Return a mask of the clusters that are no arm or piece of another; all where arms are people, as legs are."""
    if options.satellite_width_m is None:
        return np.ones(len(clusters), np.bool_)
    # a narrow cluster may be an arm, as thick from every side, not part of a trunk
    depth_m = np.where(clusters.width_m < options.satellite_width_m, _ARM_HALF_DEPTH_M, options.half_depth_m)
    return trunks(
        pushed_back(clusters.middle, depth_m),
        clusters.width_m,
        clusters.hidden_before | clusters.hidden_after,
        options.satellite_width_m,
        options.satellite_reach_m,
        options.arm_reach_m,
        options.trunks_apart_m,
    )


class LaserLayer:
    """Scanner with its pose, background and options; `detect` is called with its scans in order.

    empty_scans: scans of the room without people; without any, the background is learned causally.
    """

    def __init__(self, sensor: LaserSensor, empty_scans: Sequence[LaserScan], options: LayerOptions) -> None:
        self.options = options
        empty_scans = [scan for scan in empty_scans if not np.isnan(scan.ranges_m).all()]
        self.learns_background = not empty_scans
        self._least = options.weak_samples or options.cluster.min_samples
        self._free_space = DetectionModel(sensor, options.free_space, self._least)
        self._past_a_thing = DetectionModel(
            sensor, DetectionOptions(half_width_m=_NARROW_M, behind_m=_BEHIND_M, detected=_SURE)
        )
        self._room_from_scan = sensor.room_from_sensor.rotation[:2, :2].T.copy()
        self.origin_m = sensor.room_from_sensor.translation[:2]
        self._background = (
            KnownBackground(empty_scans, options.background) if empty_scans else LearnedBackground(options.background)
        )

    @property
    def is_learning(self) -> bool:
        """True if the background is learned, and a scan has arrived."""
        return isinstance(self._background, LearnedBackground) and self._background.has_started

    def detect(self, scan: LaserScan) -> Detections:
        """Detect trunks without their arms, or single legs, in front of the room."""
        options, scan = self.options, counter_clockwise(scan)
        foreground = self._foreground(scan)
        foreground = foreground & ~self._alone(scan, foreground)[1]
        clusters = find_clusters(scan, foreground, options.cluster, self._least)
        hidden = clusters.hidden_before | clusters.hidden_after
        if self._least < options.cluster.min_samples:
            # a beam half on an edge reports a range between it and the background
            kept = (clusters.n_sample >= options.cluster.min_samples) | ~hidden
            clusters, hidden = clusters.select(kept), hidden[kept]
        kept = trunk_mask(clusters, options)
        clusters, hidden = clusters.select(kept), hidden[kept]
        if options.outlines:
            axis, variance_m2 = shipped().axes(scan, foreground, clusters)
        else:
            axis = pushed_back(self._completed(clusters), self._half_depth_m(clusters.width_m, hidden))
            variance_m2 = np.where(hidden, options.hidden_variance_m2, 0.0)
        return Detections(
            position=self._in_room(axis),
            variance_m2=variance_m2,
            n_sample=clusters.n_sample,
            width_m=clusters.width_m,
            range_m=clusters.range_m,
            angle=_angles(scan, clusters),
            scanner=np.ones((len(clusters), 1), np.bool_),
        )

    def _foreground(self, scan: LaserScan) -> Bool[Mask, "n_beam"]:
        """Return a mask of the samples in front of the room."""
        return self._background.foreground(scan)

    def _as_scanned(self, points: Float[Array, "2 *n"]) -> Float[Array, "2 *n"]:
        """Return room points [m] in the frame that the detection models take them in."""
        return points

    def points(self, scan: LaserScan) -> tuple[Float[Array, "k 2"], Float[Array, "k"], Bool[Mask, "k"]]:
        """Return the foreground samples, moved back to the axis of their object, [m] in the room frame.

        With the width [m] that each beam covers, the spacing of the beams at its range, and a mask of the samples that are alone.
        Alone, a beam as wide as a leg meets half of it and half of what is behind, and its range lies between. Beside a nearer
        sample that is the case for certain, and the sample is left out.
        """
        scan, turn = counter_clockwise(scan), beams_of_turn(scan)
        foreground = self._foreground(scan)
        alone, beside_nearer = self._alone(scan, foreground)
        beams = (foreground & ~beside_nearer)[:turn].nonzero()[0]
        near = returns(scan)[0][beams]
        points = (near + self.options.half_depth_m) * directions(scan)[:, beams]
        return self._in_room(points.T), abs(scan.angle_increment_rad) * near, alone[beams]

    def _alone(self, scan: LaserScan, foreground: Bool[Mask, "n_beam"]) -> Bool[Mask, "2 n_beam"]:
        """Return masks of the foreground samples that no neighbour continues, and of those of them beside a nearer one."""
        turn, ranges = beams_of_turn(scan), returns(scan)[0]
        beams = foreground[:turn].nonzero()[0]
        padded = padded_ranges(np.where(np.isnan(ranges), np.inf, ranges)[:turn], turn, 1)
        before, after = padded[beams] - ranges[beams], padded[beams + 2] - ranges[beams]
        jump_m = self.options.cluster.jump_m + abs(scan.angle_increment_rad) * ranges[beams]
        found = np.zeros((2, foreground.size), np.bool_)
        found[0, beams] = (np.abs(before) > jump_m) & (np.abs(after) > jump_m)
        found[1, beams] = found[0, beams] & ((before < 0) | (after < 0))
        return found

    def _half_depth_m(self, width_m: Float[Array, "k"], hidden: Bool[Mask, "k"]) -> Float[Array, "k"] | float:
        """Return the distance from the visible middle of bodies of these widths to their axes.

        A trunk is about an ellipse. Its half extents across the beam, p, and along it, q, keep p² + q² as it turns, and the
        middle of its visible side lies π/4 q before its axis. For a partly `hidden` body the width is unknown: half way
        between front and side is assumed.
        """
        front, side = self.options.half_depth_m, self.options.side_half_depth_m
        if side is None:
            return front
        across = np.pi / 8 * width_m
        square = np.maximum(front**2 + side**2 - across**2, min(front, side) ** 2)
        turned = np.minimum(np.sqrt(square), max(front, side))
        return np.where(hidden, (front + side) / 2, turned)

    def missed(self, scan: LaserScan, points: Float[Array, "2 *n"]) -> Float[Array, "*n"]:
        """Return the probability that the scan does not detect a person at room points.

        Where the background is learned, beams without a return, which the empty room may show as well, tell less.
        """
        points = self._as_scanned(points)
        seen = self._free_space.seen(scan, points)
        if not self.learns_background:
            return 1 - seen
        ranges, hit, _ = returns(scan)
        returned = self._free_space.seen(replace(scan, ranges_m=np.where(hit, ranges, np.nan)), points)
        return 1 - (_NO_RETURN_SHARE * seen + (1 - _NO_RETURN_SHARE) * returned)

    def seen_behind(self, points: Float[Array, "k 2"]) -> Bool[Mask, "k"]:
        """Select the room points [m] behind which most beams across a body know the room, or have measured something."""
        x, y = self._room_from_scan @ (points - self.origin_m).T
        range_m, half_m = np.hypot(x, y), self._free_space.options.half_width_m
        bearing = np.arctan2(y, x) + ACROSS[:, None] * half_m / np.maximum(range_m, half_m)
        seen = self._background.seen_behind(bearing.ravel(), np.tile(range_m, ACROSS.size)).reshape(bearing.shape)
        return seen.mean(axis=0) > 0.5

    def leg_evidence(self, scan: LaserScan, points: Float[Array, "k 2"]) -> Float[Array, "k"]:
        """Return ln p(cluster | leg) / p(cluster | anything else) of the likeliest leg about room points [nat]; −inf: none."""
        scan = counter_clockwise(scan)
        clusters = leg_clusters(scan)
        at = self._in_room(pushed_back(clusters.middle, self.options.half_depth_m))
        near = distances(points, at) < _LEG_REACH_M
        return np.where(near, shipped_legs().evidence(scan, clusters), -np.inf).max(axis=1, initial=-np.inf)

    def passes(self, scan: LaserScan, points: Float[Array, "2 *n"]) -> Bool[Mask, "*n"]:
        """Return a mask of room points behind which the scan's beams continue on either side, close enough to tell."""
        apart = np.hypot(*(points - self.origin_m.reshape(2, *[1] * (points.ndim - 1)))) * abs(scan.angle_increment_rad)
        return (self._past_a_thing.seen(scan, self._as_scanned(points)) >= _SURE) & (apart < _NARROW_M)

    def _completed(self, clusters: Clusters) -> Float[Array, "k 2"]:
        """Return middles, shifted across the beam if one side of a body is hidden."""
        if self.options.body_width_m is None:
            return clusters.middle
        missing = np.maximum(self.options.body_width_m - clusters.width_m, 0) / 2
        side = clusters.hidden_after.astype(float) - clusters.hidden_before  # both hidden: in the middle
        across = clusters.middle[:, ::-1] * (-1.0, 1.0) / np.maximum(clusters.range_m, 1e-9)[:, None]
        return clusters.middle + across * (side * missing)[:, None]

    def _in_room(self, points: Float[Array, "k 2"]) -> Float[Array, "k 2"]:
        """Return points of the scan plane as ground points of the room [m]."""
        return points @ self._room_from_scan + self.origin_m


def _angles(scan: LaserScan, clusters: Clusters) -> Float[Array, "k 2"]:
    """Return the bearings of the first and last beam of each cluster, in ascending order [rad]."""
    beam = np.array([clusters.first_beam, clusters.last_beam], dtype=np.float64).T
    angle = scan.angle_min_rad + scan.angle_increment_rad * beam
    angle[clusters.last_beam < clusters.first_beam, 1] += 2 * np.pi
    return angle
