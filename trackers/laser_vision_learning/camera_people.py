"""People in a camera's picture, for tracks that no scanner shows (ours).

A camera above sees people whom others hide from low scanners. Its detector (`trackers.vision.person_detector`, the one of the
vision-only baseline) looks for people in the foreground. Detections and tracks are paired in one
assignment; those of tracks that no scanner shows measure them. A track that neither shows is missing the more,
the less the detector's scores allow for it.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from trackers.arrays import Array, Bool, Float, Index, Int, Mask
from trackers.configuration import Strict
from trackers.filters.gating import distances, mahalanobis_distances
from trackers.filters.particle import Cloud
from trackers.filters.rows import written
from trackers.laser_vision_learning.walking_model import WalkerTracks
from trackers.observations import NS_PER_S, DepthImage, Image
from trackers.prior import Prior
from trackers.rig import CameraSensor, placed_camera
from trackers.tracking.roster import Stage, associate
from trackers.tracking.track_manager import measured_now
from trackers.vision.foreground import Foreground
from trackers.vision.person_detector import LEARNED, SHIPPED, SILHOUETTES, PeopleSeen, PersonDetector, PersonModel


class CameraPeopleOptions(Strict):
    """Options of the detections that measure tracks."""

    detections: bool = Field(
        default=True, description="the camera's detector of people measures tracks that no scanner shows (ours)"
    )
    gate: ClassVar[float] = 4.0
    """Largest Mahalanobis distance of a track and a detection."""
    radius_m: ClassVar[float] = 1.0
    """And their largest distance [m]."""
    missed: ClassVar[float] = 0.1
    """Probability that the detector shows nothing of a person in the picture."""
    clutter_m2: ClassVar[float] = 0.01
    """Density of detections of no track [1/m²]."""
    claimed_m: ClassVar[float] = 0.35
    """Distance from a track that a scanner shows within which a detection is no hidden one's: bodies do not come nearer [m]."""
    outlier: ClassVar[float] = 1e-2
    """Likelihood of a place far from the detection, of that in its middle; and of one at which the picture shows nobody."""
    most_foreground: ClassVar[float] = 0.5
    """Share of foreground above which a picture says nothing: light or lens changed."""


class CameraPeople:
    """The detector of people of one camera; `measure` is called with pictures in order.

    background: pictures of the empty room; without any the background is learned as pictures come. area: corners (c, 2) of
    the tracked area [m].
    """

    def __init__(
        self, name: str, camera: CameraSensor, background: Prior, area: ArrayLike | None, options: CameraPeopleOptions
    ) -> None:
        self._options = options
        empty_room = [each for each in background if isinstance(each, Image | DepthImage) and each.sensor == name]
        self._foreground = Foreground(camera.intrinsics, empty_room, SILHOUETTES)
        model = PersonModel.load(background.learned.get(LEARNED, SHIPPED))
        self._detector = PersonDetector(placed_camera(camera), area, model=model)
        self._last: Image | DepthImage | None = None

    def measure(self, people: WalkerTracks, image: Image | DepthImage, ns: int) -> WalkerTracks:
        """Measure tracks that no scanner shows at a time [ns] by its picture. A frozen picture measures nothing."""
        last, self._last = self._last, image
        if last is not None and (image.stamp_ns <= last.stamp_ns or np.array_equal(image.rgb, last.rgb)):
            return people
        elapsed_s = 0.0 if last is None else (image.stamp_ns - last.stamp_ns) / NS_PER_S
        mask = self._foreground.mask(image)
        hidden = people.roster.confirmed & ~measured_now(people.roster, ns)
        if not hidden.any() or mask.mean() > self._options.most_foreground:
            return people
        # where the picture shows them, taken back or on to that time
        seen, late_s = self._detector.detect(mask), (image.stamp_ns - ns) / NS_PER_S
        shift = late_s * people.velocities
        track, found = self._matches(people, hidden, people.places + shift, seen)
        ours = hidden[track]
        track, found = track[ours], found[ours]
        people = self._measured(people, track, seen, found, shift[track], ns)
        rest = np.setdiff1d(np.flatnonzero(hidden & self._detector.places.shows(people.places + shift)), track)
        return self._missed(people, rest, seen, shift[rest], elapsed_s)

    def _matches(
        self, people: WalkerTracks, hidden: Bool[Mask, "n"], places: Float[Array, "n 2"], seen: PeopleSeen
    ) -> tuple[Int[Index, "p"], Int[Index, "p"]]:
        """Pair confirmed tracks and detections by likelihood ratios, in one assignment: one that scanners show takes its own."""
        cloud, options = people.cloud, self._options
        off = cloud.state[:2] - people.places.T[:, :, None]
        covariance = np.einsum("inp,jnp,np->nij", off, off, cloud.weights.normalised)
        noise = seen.covariance.mean(axis=0) if len(seen) else np.eye(2)
        apart, cost = mahalanobis_distances(
            places[:, None], (covariance + noise)[:, None], seen.position, np.zeros(len(seen))
        )
        cost += 2 * np.log(options.clutter_m2)
        away_m = distances(places, seen.position)
        scanned = people.roster.confirmed & ~hidden
        claimed = away_m[scanned].min(axis=0, initial=np.inf) < options.claimed_m
        vetoes = [apart > options.gate, away_m > options.radius_m, hidden[:, None] & claimed]
        unpaired = np.full(len(people), -2 * np.log(options.missed))
        return associate([Stage(people.roster.confirmed, [cost], vetoes, unpaired)])

    def _measured(
        self,
        people: WalkerTracks,
        track: Int[Index, "p"],
        seen: PeopleSeen,
        found: Int[Index, "p"],
        shift: Float[Array, "p 2"],
        ns: int,
    ) -> WalkerTracks:
        """Weigh the particles of these tracks by a Gaussian about their detections."""
        cloud = people.cloud.select(track)
        off = cloud.state[:2] - (seen.position[found] - shift).T[:, :, None]
        square = np.einsum("inp,nij,jnp->np", off, np.linalg.inv(seen.covariance[found]), off)
        weights = cloud.weights.updated(np.log(np.exp(-0.5 * square) + self._options.outlier))
        cloud = people.cloud.replaced(track, Cloud(cloud.state, weights))
        return people.changed(
            roster=people.roster.changed(state=cloud),
            missing_s=written(people.missing_s, track, 0.0),
            pictured_ns=written(people.pictured_ns, track, ns),
        )

    def _missed(
        self,
        people: WalkerTracks,
        track: Int[Index, "r"],
        seen: PeopleSeen,
        shift: Float[Array, "r 2"],
        elapsed_s: float,
    ) -> WalkerTracks:
        """Weigh the particles of tracks without a detection by the detector's scores; where it sees nobody they are missing."""
        if track.size == 0:
            return people
        cloud = people.cloud.select(track)
        score = self._detector.places.read(seen.scores, (cloud.state[:2] + shift.T[:, :, None]).reshape(2, -1))
        score = np.clip(score, self._options.outlier, 1.0).reshape(cloud.state.shape[1:])
        weights = cloud.weights.updated(np.log(score))
        missing_s = people.missing_s.copy()
        missing_s[track] += elapsed_s * (1 - np.exp(weights.log_mean))
        cloud = people.cloud.replaced(track, Cloud(cloud.state, weights))
        return people.changed(roster=people.roster.changed(state=cloud), missing_s=missing_s)
