"""Cameras of any lens, with depth or without: people in a picture, their colours, and whom the camera can see at all."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from trackers.area import Area
from trackers.arrays import Array, Bool, Float, Index, Int, Mask
from trackers.cameras.placed import PlacedCamera, through_people
from trackers.environment import Environment
from trackers.filters.gating import distances
from trackers.fusion.look import Expected, Look, detections_of, round_covariance
from trackers.fusion.motion import HEAD_PLACE, OUTLINE
from trackers.fusion.options import FusionOptions, KindOptions
from trackers.fusion.posture import DEPTH_SHOWN, SILHOUETTE_SHOWN, Shares
from trackers.likelihood.stereo_head import RangeOptions
from trackers.observations import DepthImage, Image, Observation
from trackers.rig import CameraSensor, Rig, StereoSensor
from trackers.tracking.track_manager import clear_of
from trackers.vision.foreground import Foreground
from trackers.vision.front_end import CameraFrontEnd, FrontEndOptions, PreparedPicture
from trackers.vision.histogram import ColourHistogram
from trackers.vision.person_detector import ROOMS, SILHOUETTES, PersonDetector, PersonModel
from trackers.vision.person_windows import ShownPlaces
from trackers.vision.stereo_picture import StereoCamera, head_of, heads_in_plan, packed_without_depth

_CHEST_M, _CROWN_M, _SHADOW_M = 1.1, 1.65, 0.25
"""Heights of a chest and of the crown of who stands, and how near to another's axis a line of sight is hidden [m]."""
_SIGMAS = 2.5
"""A head may be within so many standard deviations of where it is expected."""
_SAME_M, _OVERLAP_M = 0.3, 0.45
"""A place so near to another is its own; silhouettes nearer than this, across the sight, may be one [m]."""
_LEAST_STEEP = 0.08
"""Sine of the angle below the horizon at which a person is looked at, at least: sizes tell something as well."""
_OWN_M = 0.45
"""Points of a stereo picture this near to an expected head are its person's [m]."""
_BELOW_M, _LEGS_M = 0.35, 0.8
"""Points so far below that head may be this far beside it: arms and legs of a person who sits [m]."""
_LOWER_M = 0.2
"""A head so much lower than a known one beside it is a part of that one's body [m]."""
_LEAST_M2 = 0.06
"""Area of foreground that shows a person in one stereo picture [m²]."""
_TORSO = np.stack(np.meshgrid(np.linspace(-0.12, 0.12, 8), np.linspace(0.54, 0.8, 10)), axis=-1)
"""Across the line of sight [m], and up as a share of the stature: where clothes are looked at."""
_LEAST_SAMPLES = 12
_HARDLY = 0.3
"""Share of the people shown at a place below which a wall hides it that nobody has told."""

_HALF_BODY_M = 0.12
"""Half the depth of a body: depths that are less exact tell neither one person from another nor where they are [m]."""
_DISPARITY_PX = 0.15
"""Standard deviation of the disparity of matched pictures [px]."""


class Camera:
    """One camera in its room: its newest picture, whom it can see, and their colours. environment: None where it is not known.

    `prepare` looks at a picture once, whichever source asks for it.
    """

    def __init__(
        self,
        name: str,
        sensor: CameraSensor,
        empty_room: Sequence[Observation],
        area: Area | None,
        environment: Environment | None,
    ) -> None:
        self.name, self.sensor = name, sensor
        self.front_end = CameraFrontEnd(name, sensor, empty_room, FrontEndOptions(), area)
        self.camera: PlacedCamera = self.front_end.camera
        self.stereo, self._tells_to_m = None, 0.0
        if isinstance(sensor, StereoSensor):
            self.stereo, self._tells_to_m = StereoCamera(self.front_end, sensor, None), depths_tell_to_m(sensor)
        self.shown = ShownPlaces(self.camera)
        self.picture = packed_without_depth(np.zeros((1, 1, 3), np.uint8), np.zeros((1, 1), np.bool_))
        """The newest picture."""
        self._environment = environment
        self._histogram = ColourHistogram()
        self._rgb = np.zeros((1, 1, 3), np.uint8)
        self._image: Image | DepthImage | None = None
        self._prepared: PreparedPicture | None = None

    @property
    def n_colour(self) -> int:
        """Number of bins of colour."""
        return self._histogram.size

    @property
    def depths_to_m(self) -> float:
        """Distance up to which the newest picture's depths tell people apart [m]: 0 where it has none."""
        return self._tells_to_m if self.picture.knows_depth else 0.0

    def away_m(self, place: Float[Array, "k d"]) -> Float[Array, "k"]:
        """Return the distances of places from the camera over the floor [m]."""
        return np.hypot(*(place[:, :2] - self.camera.eye_m[:2]).T)

    def prepare(self, image: Image | DepthImage) -> PreparedPicture | None:
        """Take a picture, and return it prepared; None if it is blind."""
        if image is not self._image:
            self._image, self._prepared = image, self.front_end.prepare(image)
            if (prepared := self._prepared) is not None:
                self._rgb = prepared.image.rgb
                if self.stereo is not None and isinstance(image, DepthImage):
                    self.picture = self.stereo.packed(prepared)
                else:
                    self.picture = packed_without_depth(self._rgb, prepared.mask)
        return self._prepared

    def sees(self, points: Float[Array, "k 3"], crowns: Float[Array, "n 3"]) -> Bool[Mask, "k"]:
        """Mark points [m] in the picture that neither the room nor another person below these crowns [m] hides."""
        return self.is_clear(points, crowns) & (self.shown.share(points[:, :2]) > _HARDLY)

    def is_clear(self, points: Float[Array, "k 3"], crowns: Float[Array, "n 3"]) -> Bool[Mask, "k"]:
        """Mark points [m] in the picture that neither the room, as far as it is told, nor a person below the crowns [m] hides."""
        seen = self.camera.project(points)[1]
        if self._environment is not None and seen.any():
            seen &= self._environment.visible(self.camera.eye_m, points)
        if len(crowns) and seen.any():
            seen &= ~hidden(self.camera.eye_m, points, crowns, _SHADOW_M).any(axis=1)
        return seen

    def stands_alone(
        self, heads: Float[Array, "n 3"], sigma_m: Float[Array, "n"], crowns: Float[Array, "n 3"]
    ) -> Bool[Mask, "n"]:
        """Mark heads [m] whose outlines are their own: depths tell them from others, silhouettes where nobody is on the sight.

        sigma_m: standard deviation of each on each axis; nobody is on any sight to where the head may be.
        """
        apart = self.away_m(heads) < self.depths_to_m
        reach_m = np.maximum(_SHADOW_M, _SIGMAS * sigma_m)[:, None]
        meets, _ = through_people(self.camera.eye_m, heads, crowns[:, :2], reach_m, crowns[:, 2])
        return apart | ~np.logical_or.reduce(meets & ~np.eye(len(heads), dtype=np.bool_), axis=1)

    def colours(
        self, crowns: Float[Array, "n 3"], stature_m: Float[Array, "n"]
    ) -> tuple[Float[Array, "n bins"], Bool[Mask, "n"]]:
        """Return histograms of the clothes of people below crowns [m], and whose are clearly seen, in the newest picture."""
        n, place = len(crowns), crowns[:, :2]
        sight = place - self.camera.eye_m[:2]
        right = np.stack([sight[:, 1], -sight[:, 0]], axis=1) / np.maximum(np.linalg.norm(sight, axis=1), 1e-6)[:, None]
        points = np.empty((n, *_TORSO.shape[:2], 3))
        points[..., :2] = place[:, None, None] + _TORSO[..., :1] * right[:, None, None]
        points[..., 2] = _TORSO[..., 1] * stature_m[:, None, None]
        pixels, inside = self.camera.project(points)
        mask = self.picture.mask
        column, row = np.nan_to_num(np.moveaxis(pixels, -1, 0)).round().astype(np.intp)
        inside &= mask[row.clip(0, mask.shape[0] - 1), column.clip(0, mask.shape[1] - 1)]
        chest = np.column_stack([place, 0.65 * stature_m])
        clear = (inside.sum(axis=(1, 2)) >= _LEAST_SAMPLES) & self.sees(chest, crowns)
        return self._histogram.of_windows(self._rgb, pixels, inside), clear


class CameraSource:
    """Source of people in the pictures of one camera, at some of the distances from it."""

    def __init__(self, camera: Camera, kind: KindOptions, by_posture: Shares) -> None:
        self.names, self.camera = (camera.name,), camera
        self._kind, self._by_posture = kind, by_posture

    @property
    def learns_background(self) -> bool:
        """True where the background is learned as pictures come, for want of an empty room."""
        return self.camera.front_end.learns_background

    def within_reach(self, place: Float[Array, "k 2"]) -> Bool[Mask, "k"]:
        """Mark places [m] as far from the camera as people are looked for by this source."""
        raise NotImplementedError

    def looked(
        self,
        position: Float[Array, "k 2"],
        covariance: Float[Array, "k 2 2"],
        starts: Bool[Mask, "k"],
        owner: Int[Index, "k"],
        observes: Float[Array, "2 s"],
        expected: Expected,
        ns: int,
    ) -> Look:
        """Return the look at measurements [m, m²]; starts: those that may be of people who are not known."""
        return Look(
            self.names,
            self._kind,
            position,
            covariance,
            starts.astype(np.intp),
            owner,
            lambda points: self._missed(points, expected),
            by_posture=self._by_posture,
            observes=observes,
            shown=detections_of(ns, self.names, "person", position, covariance),
        )

    def learn_shown(self, crowns: Float[Array, "n 3"], asked: Float[Array, "n"], shown: Bool[Mask, "n"]) -> None:
        """Learn where people are shown whom other sensors measure below their crowns [m]; asked: how much each tells."""
        place = crowns[:, :2]
        self.camera.shown.learn(place, asked * self._in_plain_sight(place, crowns), shown)

    def _missed(self, points: Float[Array, "2 *n"], expected: Expected) -> Float[Array, "*n"]:
        at = points.reshape(2, -1).T
        visible = self._in_plain_sight(at, expected.crowns)
        return (1 - visible * self._kind.p_detect * self.camera.shown.share(at)).reshape(points.shape[1:])

    def _in_plain_sight(self, place: Float[Array, "k 2"], crowns: Float[Array, "n 3"]) -> Bool[Mask, "k"]:
        """Mark places [m] of people that neither the room, as far as it is told, nor another one below the crowns [m] hides."""
        chest = np.column_stack([place, np.full(len(place), _CHEST_M)])
        return self.within_reach(place) & self.camera.is_clear(chest, crowns)


class Silhouettes(CameraSource):
    """People by their outlines before the empty room, as a learned model detects them, beyond what depths tell."""

    def __init__(self, camera: Camera, options: FusionOptions, area: ArrayLike | None) -> None:
        super().__init__(camera, options.camera, SILHOUETTE_SHOWN)
        sensor, empty_room = camera.sensor, camera.front_end.empty_room
        self._foreground = Foreground(sensor.intrinsics, empty_room, SILHOUETTES)
        self._detector = PersonDetector(camera.camera, area, model=PersonModel.load(ROOMS))

    def within_reach(self, place: Float[Array, "k 2"]) -> Bool[Mask, "k"]:
        """Mark places [m] beyond the depths that tell people apart."""
        return self.camera.away_m(place) >= self.camera.depths_to_m

    def look(self, observations: Mapping[str, Observation], expected: Expected, ns: int) -> Look | None:
        """Return the people in the camera's picture; None where there is none, or a blind one."""
        image = observations.get(self.camera.name)
        if not isinstance(image, Image | DepthImage):
            return None
        prepared = self.camera.prepare(image)
        if prepared is None:
            self._foreground.pass_over(self.camera.front_end.normalize_exposure(image))
            return None
        seen = self._detector.detect(self._foreground.mask(prepared.image, prepared.hsv))
        there = self.within_reach(seen.position)
        position, covariance = seen.position[there], seen.covariance[there]
        covariance = covariance + self._error(position)
        starts = clear_of(position, expected.place, _OWN_M) & self._is_apart(position, expected)
        return self.looked(position, covariance, starts, np.full(len(position), -1), OUTLINE, expected, ns)

    def _in_plain_sight(self, place: Float[Array, "k 2"], crowns: Float[Array, "n 3"]) -> Bool[Mask, "k"]:
        return super()._in_plain_sight(place, crowns) & self._detector.places.shows(place)

    def _error(self, place: Float[Array, "k 2"]) -> Float[Array, "k 2 2"]:
        """Return covariances of places by silhouettes [m²]: the flatter a camera looks, the less it tells how far."""
        eye_m = self.camera.camera.eye_m
        way = place - eye_m[:2]
        away = np.maximum(np.linalg.norm(way, axis=1), 1e-6)
        ahead = way / away[:, None]
        drop = abs(eye_m[2] - _CHEST_M)
        steepness = np.maximum(drop / np.hypot(drop, away), _LEAST_STEEP)
        along = self._kind.sigma_m**2 * (1 / steepness**2 - 1)
        return self._kind.sigma_m**2 * np.eye(2) + along[:, None, None] * ahead[:, :, None] * ahead[:, None, :]

    def _is_apart(self, position: Float[Array, "k 2"], expected: Expected) -> Bool[Mask, "k"]:
        """Mark places whose silhouettes no known person's hides or is hidden by: two in one may look like a third."""
        known = expected.place
        if not len(known) or not len(position):
            return np.ones(len(position), np.bool_)
        new, old = (np.column_stack([each, np.full(len(each), _CHEST_M)]) for each in (position, known))
        eye = self.camera.camera.eye_m  # outlines of who sits overlap with others' as well: all as high as who stands
        by_old, by_new = (np.column_stack([each, np.full(len(each), _CROWN_M)]) for each in (known, position))
        either = hidden(eye, new, by_old, _OVERLAP_M) | hidden(eye, old, by_new, _OVERLAP_M).T
        return ~np.logical_or.reduce(either, axis=1)


class Depths(CameraSource):
    """Heads at the tops of what stands before the room, as far as depths tell one person from another."""

    def __init__(self, camera: Camera, stereo: StereoCamera, options: FusionOptions) -> None:
        super().__init__(camera, options.stereo, DEPTH_SHOWN)
        self._stereo = stereo

    def within_reach(self, place: Float[Array, "k 2"]) -> Bool[Mask, "k"]:
        """Mark places [m] as far as depths tell people apart."""
        return self.camera.away_m(place) < self.camera.depths_to_m

    def look(self, observations: Mapping[str, Observation], expected: Expected, ns: int) -> Look | None:
        """Return the heads in the camera's depths, first of those who are expected; None where there are none, or blind ones."""
        image = observations.get(self.camera.name)
        if not isinstance(image, DepthImage) or self.camera.prepare(image) is None:
            return None
        points = self._stereo.foreground_points(self.camera.picture)
        points = points[:, self.within_reach(points[:2].T)]
        away = distances(expected.head[:, :2], points[:2].T)
        nearest = away.argmin(axis=0) if len(away) else np.zeros(points.shape[1], np.intp)
        own = (away < np.where(points[2] < expected.head[:, 2:] - _BELOW_M, _LEGS_M, _OWN_M)).any(axis=0)
        owners, heads = [], []
        for row in range(len(away)):
            mine = points[:, own & (nearest == row)]
            if mine[3].sum() >= _LEAST_M2:
                owners.append(row)
                heads.append(head_of(mine))
        new = heads_in_plan(points[:, ~own], 2 * _LEAST_M2, _OWN_M)
        head = np.concatenate([np.reshape(heads, (-1, 3)), new])
        owner = np.concatenate([np.array(owners, np.intp), np.full(len(new), -1)])
        drop_m = np.maximum(1.2 - head[:, 2], 0.0)
        sight = head - self.camera.camera.eye_m
        squared = (sight**2).sum(axis=1)
        along_m2 = RangeOptions().sigma(squared) ** 2 / squared
        covariance = round_covariance(self._kind.sigma_m**2 + (0.5 * drop_m) ** 2)
        covariance += along_m2[:, None, None] * sight[:, :2, None] * sight[:, None, :2]
        starts = (owner < 0) & clear_of(head[:, :2], expected.place, _OWN_M)
        if len(expected.head):  # an arm or a lap below a known head is no other's
            below = head[:, 2] < expected.head[:, 2, None] - _LOWER_M
            starts &= ~np.logical_or.reduce(below & (distances(expected.head[:, :2], head[:, :2]) < _LEGS_M), axis=0)
        return self.looked(head[:, :2], covariance, starts, owner, HEAD_PLACE, expected, ns)


def hidden(
    eye_m: Float[Array, "3"], points: Float[Array, "k 3"], crowns: Float[Array, "n 3"], radius_m: float
) -> Bool[Mask, "k n"]:
    """Mark points [m] that other people hide, as upright cylinders below their crowns [m]; nobody hides their own."""
    meets, along = through_people(eye_m, points, crowns[:, :2], radius_m, crowns[:, 2])
    return meets & (along < 1) & (distances(points[:, :2], crowns[:, :2]) >= _SAME_M)


def cameras_of(
    rig: Rig,
    empty_room: Sequence[Observation],
    options: FusionOptions,
    area: Area | None,
    environment: Environment | None,
) -> list[CameraSource]:
    """Make the sources of the cameras of a rig, one or two of each; none where it has none."""
    sources: list[CameraSource] = []
    for name, sensor in rig.cameras().items():
        camera = Camera(name, sensor, empty_room, area, environment)
        if camera.stereo is not None:
            sources.append(Depths(camera, camera.stereo, options))
        sources.append(Silhouettes(camera, options, rig.area))
    return sources


def depths_tell_to_m(sensor: StereoSensor) -> float:
    """Return the distance up to which a stereo camera's depths are as exact as half a body is deep [m].

    The error of a distance z is that of the disparity times z² / (f b), f the focal length [px] and b the baseline.
    """
    if sensor.mode == "ideal":
        return np.inf
    usual = RangeOptions()
    per_m = usual.sigma_per_m
    if sensor.baseline_m is not None:
        per_m = _DISPARITY_PX / (sensor.intrinsics.fx * sensor.baseline_m)
    return float(np.sqrt((_HALF_BODY_M - usual.sigma_m) / per_m))
