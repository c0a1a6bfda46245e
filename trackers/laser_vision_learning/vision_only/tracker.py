"""People tracking by one camera alone: the paper's vision baseline, one detection-based particle filter per person.

After X. Song, J. Cui, H. Zha, H. Zhao: "Probabilistic detection-based particle filter for multi-target tracking" (BMVC
2008), which the paper only names. Per picture: background subtraction; a learned detector scores the window of a person at
every position of the floor; detections are optimally assigned to tracks by distance and colours. A detected person's
particles move, a share of them drawn about the detection, and are weighted by it. Another's are weighted by the scores
outside detections and by colours. So a partly hidden person is tracked where the detector has no peak of its own.

A picture that is foreground throughout is uninformative. A track outside the area or the picture is deleted at once when not
detected, as the camera cannot see it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Set
from typing import Any

import numpy as np

from trackers.arrays import Array, Bool, Float, Index, Int, Mask
from trackers.arrival_order import LATE
from trackers.configuration import validate
from trackers.errors import InputError, valid_names
from trackers.filters.gating import distances, mahalanobis
from trackers.filters.particle import Cloud, MixtureProposal, ParticleFilter
from trackers.laser_vision_learning.vision_only.options import VisionOnlyOptions
from trackers.laser_vision_learning.vision_only.picture_tracks import (
    AtDetections,
    ColourReader,
    PictureTracks,
    WhiteAcceleration,
    WithoutDetection,
)
from trackers.observations import NS_PER_S, DepthImage, Image, Observation
from trackers.prior import Prior
from trackers.rig import Rig, placed_camera
from trackers.tracking.roster import Stage, associate, left_over
from trackers.tracking.track_manager import TrackManager, coasting_within, measured_now
from trackers.tracks import Detection, Track, TrackFrame
from trackers.vision.foreground import Foreground
from trackers.vision.person_detector import LEARNED, SHIPPED, PeopleSeen, PersonDetector, PersonModel


class VisionOnly:
    """Tracker of people by one camera (see module). Options: `VisionOnlyOptions`.

    background: pictures of the empty room; without any the background is learned, and a person who stands still from the
    start is detected when they move. Its `learned` may hold another model of people under "people" (made by
    `scripts/train-person-detector`). Frames have the pictures' stamps.

    Raises InputError for a wrong option, for a rig without a camera, and for a picture of another size than the rig's.
    """

    Options = VisionOnlyOptions

    def __init__(
        self, rig: Rig, background: Iterable[Observation] = (), rng: np.random.Generator | None = None, **options: Any
    ) -> None:
        self.options = validate(VisionOnlyOptions, options, "tracker laser-vision-learning-vision")
        known = Prior.of(background)
        self.camera = _camera_of(rig, self.options.camera, {each.sensor for each in known})
        self.unused_sensors = [name for name in rig.sensors if name != self.camera]
        self.losses: Counter[tuple[str, str]] = Counter()  # pictures dropped, by sensor and reason
        sensor = rig.cameras()[self.camera]
        empty_room = [_picture(each) for each in known if each.sensor == self.camera]
        self._foreground = Foreground(sensor.intrinsics, empty_room, self.options.foreground)
        self.background_learned_causally = self._foreground.learns_background
        camera, model = placed_camera(sensor), PersonModel.load(known.learned.get(LEARNED, SHIPPED))
        self._detector = PersonDetector(camera, rig.area, self.options.detector, model)
        self._manager = TrackManager(self.options.track_management, rig.area)
        self._clothes = ColourReader(camera, self.options.histogram)
        self._filter, self._rng = ParticleFilter(), rng or np.random.default_rng(0)
        self._people = PictureTracks.empty(self.options.filter.particles, self._clothes.size)
        self._ns, self._has_started = 0, False  # stamp of the last picture, and whether there was one
        self._detections: list[Detection] = []

    @property
    def warnings(self) -> list[str]:
        """That people far off are not looked for, where that is so."""
        return self._detector.warnings(self.camera)

    @property
    def discarded(self) -> int:
        """Number of pictures dropped: too late, or twice."""
        return self.losses.total()

    def update(self, observation: Observation) -> list[TrackFrame]:
        """Process one observation; return the frame of a picture. Other sensors than the camera are ignored.

        Raises InputError for an observation of the camera that is no picture.
        """
        self._detections = []
        if observation.sensor != self.camera:
            return []
        if self._has_started and observation.stamp_ns <= self._ns:
            self.losses[self.camera, LATE] += 1
            return []
        self._work(_picture(observation))
        return [TrackFrame(self._ns, tuple(self.tracks()))]

    def tracks(self) -> list[Track]:
        """Return all confirmed tracks by id, including those not detected for a while."""
        roster = self._people.roster
        shown = self._manager.reported(roster, self._ns) & self._manager.inside(self._people.positions)
        rows = shown.nonzero()[0][roster.id[shown].argsort()]
        means = roster.state.expectation(roster.state.state)[:, rows].T.tolist()
        measured = measured_now(roster, self._ns)[rows].tolist()
        return [
            Track(number, *mean, status="confirmed" if is_measured else "coasting")
            for number, mean, is_measured in zip(roster.id[rows].tolist(), means, measured, strict=True)
        ]

    def detections(self) -> list[Detection]:
        """Return the detections of the last picture, see `Detection`."""
        return self._detections

    def _work(self, picture: Image | DepthImage) -> None:
        ns, appearance = picture.stamp_ns, self.options.appearance
        elapsed_s = (ns - self._ns) / NS_PER_S if self._has_started else 0.0
        mask = self._foreground.mask(picture)
        if mask.mean() > self.options.most_foreground:
            mask = np.zeros_like(mask)
        self._ns, self._has_started = ns, True
        # positions are invalid after a gap in the pictures
        coast_s = self.options.track_management.coast_s
        self._people = self._people.select(coasting_within(self._people.roster, ns, coast_s, coast_s))
        seen = self._detector.detect(mask)
        self._detections = [
            Detection(ns, (self.camera,), "person", *position, variance_m2=trace / 2)
            for position, trace in zip(seen.position.tolist(), seen.covariance.trace(0, 1, 2).tolist(), strict=True)
        ]
        looks, known, covered = self._clothes.looks(picture.rgb, mask, seen.position)
        unlike = self._people.clothes.distance(looks, known)
        if unlike is None:
            unlike = np.full((len(self._people), len(seen)), np.nan)
        track, found = self._matches(seen, unlike, elapsed_s)
        self._filter_on(picture, mask, seen, track, found, elapsed_s)
        clear = known & (covered <= appearance.learn_covered)
        of_clear = clear[found]
        self._people = self._people.learned(
            track[of_clear], looks[found[of_clear]], unlike[:, found[of_clear]], appearance.memory
        )
        self._confirm()
        self._end()
        free = left_over(len(seen), found)
        self._start(seen, free[covered[free] <= self.options.track_management.start_covered], looks, clear)

    def _matches(
        self, seen: PeopleSeen, unlike: Float[Array, "n k"], elapsed_s: float
    ) -> tuple[Int[Index, "p"], Int[Index, "p"]]:
        """Associate tracks with detections, confirmed ones first, by predicted positions and colours."""
        rules = self.options.association
        mean, covariance = self._people.expected(elapsed_s)
        noise = seen.covariance.mean(axis=0) if len(seen) else np.eye(2)
        distances_to = mahalanobis(mean[:, None], covariance[:, None] + noise, seen.position)
        terms = [distances_to, rules.colour_weight * np.nan_to_num(unlike, nan=rules.unknown_colour)]
        vetoes = [
            distances_to > rules.gate,
            distances(mean, seen.position) > rules.radius_m,
            np.nan_to_num(unlike, nan=0.0) > rules.foreign_above,
        ]
        confirmed = self._people.roster.confirmed
        return associate([Stage(confirmed, terms, vetoes), Stage(~confirmed, terms, vetoes)])

    def _filter_on(
        self,
        picture: Image | DepthImage,
        mask: Mask,
        seen: PeopleSeen,
        track: Int[Index, "p"],
        found: Int[Index, "p"],
        elapsed_s: float,
    ) -> None:
        """Move and weight the particles of all tracks."""
        options, roster, clothes = self.options.filter, self._people.roster, self._people.clothes
        before, kept = roster.state.select(track), np.ones(track.size)
        by = AtDetections(seen.position[found], seen.covariance[found], before.state[2:], options.outlier)
        proposal = MixtureProposal(
            options.detected_share, WhiteAcceleration(elapsed_s, options.acceleration, kept), by.draw
        )
        after = self._filter.step_proposed(before, proposal, by.log_likelihood, self._rng)
        state, rest = roster.state.replaced(track, after), left_over(len(roster), track)
        if rest.size:
            kept = np.full(rest.size, np.exp(-elapsed_s / options.slowdown_s))
            without = WithoutDetection(
                scores=lambda positions: self._detector.places.read(seen.scores, positions),
                looks=lambda places: self._clothes.looks(picture.rgb, mask, places)[:2],
                taken=seen.position[found],
                reference=clothes.reference[rest],
                known=clothes.known[rest],
                options=options,
            )
            coast = WhiteAcceleration(elapsed_s, options.acceleration, kept)
            after = self._filter.step(state.select(rest), coast, without.log_likelihood, self._rng)
            state = state.replaced(rest, after)
        self._people = self._people.changed(roster=roster.measured(track, self._ns, state))

    def _confirm(self) -> None:
        roster = self._people.roster
        new = self._manager.to_confirm(roster, self._ns, 0)
        self._people = self._people.changed(roster=self._manager.confirm(roster, new))

    def _end(self) -> None:
        """Delete tracks that were not detected for too long, or are outside the area or the picture."""
        roster, positions = self._people.roster, self._people.positions
        kept = self._manager.lasting(roster, self._ns) & self._manager.inside(positions)
        kept &= self._detector.places.shows(positions) | measured_now(roster, self._ns)
        self._people = self._people.select(kept)

    def _start(
        self, seen: PeopleSeen, free: Int[Index, "f"], looks: Float[Array, "k bins"], clear: Bool[Mask, "k"]
    ) -> None:
        """Start tracks at good unassigned detections, away from all tracks."""
        options = self.options.filter
        free = free[seen.score[free] >= self.options.track_management.start_score]
        free = free[self._manager.may_start(seen.position[free], self._people.positions)]
        if free.size == 0:
            return
        position, at_rest = seen.position[free], np.zeros((free.size, 2))
        covariance = np.zeros((free.size, 4, 4))
        covariance[:, :2, :2] = seen.covariance[free]
        covariance[:, 2:, 2:] = options.start_speed_m_s**2 * np.eye(2)
        cloud = Cloud.normal(np.concatenate([position, at_rest], axis=1), covariance, options.particles, self._rng)
        self._people = self._people.joined(PictureTracks.started(cloud, looks[free], clear[free], self._ns))


def _camera_of(rig: Rig, name: str | None, reported: Set[str]) -> str:
    """Return the camera to use, preferably one that `reported` of the empty room.

    Raises InputError where the rig has none, or none of that name.
    """
    cameras = rig.cameras()
    if not cameras:
        raise InputError(
            f"tracker laser-vision-learning-vision: the rig has no camera (its sensors are {', '.join(rig.sensors)}); "
            "one of kind camera, fisheye or stereo is expected"
        )
    if name is not None and name not in cameras:
        raise InputError(
            f"tracker laser-vision-learning-vision: camera: {name!r} is no camera of the rig; {valid_names(name, cameras)}"
        )
    if name is not None or rig.main_sensor in cameras:
        return name or rig.main_sensor
    return min(cameras, key=lambda each: (each not in reported, each))


def _picture(observation: Observation) -> Image | DepthImage:
    """Return the observation as a picture; raises InputError for one of another kind."""
    if isinstance(observation, Image | DepthImage):
        return observation
    said = f"observation of {observation.sensor!r} is a {type(observation).__name__}"
    raise InputError(f"{said}; the rig has a camera of that name, and an Image or DepthImage is expected")
