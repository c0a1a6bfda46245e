"""Cameras of any lens, with depth or without: whom they can see at all, and their colours."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trackers.area import Area
from trackers.arrays import Array, Bool, Float, Mask
from trackers.cameras.placed import PlacedCamera, through_people
from trackers.environment import Environment
from trackers.filters.gating import distances
from trackers.likelihood.stereo_head import RangeOptions
from trackers.observations import DepthImage, Image, Observation
from trackers.rig import CameraSensor, StereoSensor
from trackers.vision.front_end import CameraFrontEnd, FrontEndOptions, PreparedPicture
from trackers.vision.histogram import ColourHistogram
from trackers.vision.person_windows import ShownPlaces
from trackers.vision.stereo_picture import StereoCamera, packed_without_depth

_SHADOW_M = 0.25
"""A line of sight so near to another person's axis is hidden [m]."""
_SIGMAS = 2.5
"""A head may be within so many standard deviations of where it is expected."""
_SAME_M = 0.3
"""A place so near to another is its own [m]."""
_TORSO = np.stack(np.meshgrid(np.linspace(-0.12, 0.12, 8), np.linspace(0.54, 0.8, 10)), axis=-1)
"""Across the line of sight [m], and up as a share of the stature: where clothes are looked at."""
_LEAST_SAMPLES = 12
_HARDLY = 0.3
"""Share of the people shown at a place below which a wall hides it that is not known."""
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
        self.stereo, self.depth_errors, self._tells_to_m = None, RangeOptions(), 0.0
        if isinstance(sensor, StereoSensor):
            self.stereo, self.depth_errors = StereoCamera(self.front_end, sensor, None), depth_errors(sensor)
            self._tells_to_m = depths_tell_to_m(self.depth_errors)
        self.shown = ShownPlaces(self.camera)
        self.picture = packed_without_depth(np.zeros((1, 1, 3), np.uint8), np.zeros((1, 1), np.bool_))
        """The newest picture."""
        self.points: Float[Array, "4 k"] = np.empty((4, 0))
        """Its foreground, x, y, z [m] and the area of each [m²], where depths are known."""
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
                    self.points = self.stereo.foreground_points(self.picture)
                else:
                    self.picture = packed_without_depth(self._rgb, prepared.mask)
        return self._prepared

    def sees(self, points: Float[Array, "k 3"], crowns: Float[Array, "n 3"]) -> Bool[Mask, "k"]:
        """Mark points [m] in the picture that neither the room nor another person below these crowns [m] hides."""
        clear = self.is_clear(points, crowns)
        if clear.any():
            clear &= self.shown.share(points[:, :2]) > _HARDLY
        return clear

    def is_clear(self, points: Float[Array, "k 3"], crowns: Float[Array, "n 3"]) -> Bool[Mask, "k"]:
        """Mark points [m] in the picture that neither the known room nor a person below the crowns [m] hides."""
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
        self, crowns: Float[Array, "n 3"], stature_m: Float[Array, "n"], asked: Bool[Mask, "n"]
    ) -> tuple[Float[Array, "n bins"], Bool[Mask, "n"]]:
        """Return histograms of the clothes of those asked for of people below crowns [m], in the newest picture.

        And whose are clearly seen; the histograms of others are empty.
        """
        found, clear = np.zeros((len(crowns), self.n_colour)), np.zeros(len(crowns), np.bool_)
        row = np.flatnonzero(asked)
        chest = np.column_stack([crowns[row, :2], 0.65 * stature_m[row]])
        row = row[self.sees(chest, crowns)]
        if not row.size:
            return found, clear
        place, stature_m = crowns[row, :2], stature_m[row]
        sight = place - self.camera.eye_m[:2]
        right = np.stack([sight[:, 1], -sight[:, 0]], axis=1) / np.maximum(np.linalg.norm(sight, axis=1), 1e-6)[:, None]
        points = np.empty((row.size, *_TORSO.shape[:2], 3))
        points[..., :2] = place[:, None, None] + _TORSO[..., :1] * right[:, None, None]
        points[..., 2] = _TORSO[..., 1] * stature_m[:, None, None]
        pixels, inside = self.camera.project(points)
        column, line = (np.where(inside, pixels[..., axis], 0.0).round().astype(np.intp) for axis in (0, 1))
        inside &= self.picture.mask[line, column]
        seen = inside.sum(axis=(1, 2)) >= _LEAST_SAMPLES
        clear[row] = seen
        found[clear] = self._histogram.of_windows(self._rgb, pixels[seen], inside[seen])
        return found, clear


def hidden(
    eye_m: Float[Array, "3"], points: Float[Array, "k 3"], crowns: Float[Array, "n 3"], radius_m: float
) -> Bool[Mask, "k n"]:
    """Mark points [m] that other people hide, as upright cylinders below their crowns [m]; nobody hides their own."""
    meets, along = through_people(eye_m, points, crowns[:, :2], radius_m, crowns[:, 2])
    return meets & (along < 1) & (distances(points[:, :2], crowns[:, :2]) >= _SAME_M)


def depth_errors(sensor: StereoSensor) -> RangeOptions:
    """Return how exact a stereo camera's distances are; those of a usual one where its baseline is not known.

    The error of a distance z is that of the disparity times z² / (f b), f the focal length [px] and b the baseline.
    """
    if sensor.mode == "ideal":
        return RangeOptions(sigma_per_m=0.0)
    if sensor.baseline_m is None:
        return RangeOptions()
    return RangeOptions(sigma_per_m=_DISPARITY_PX / (sensor.intrinsics.fx * sensor.baseline_m))


def depths_tell_to_m(errors: RangeOptions) -> float:
    """Return the distance up to which depths with these errors are as exact as half a body is deep [m]."""
    per_m = errors.sigma_per_m
    return float(np.sqrt((_HALF_BODY_M - errors.sigma_m) / per_m)) if per_m else np.inf
