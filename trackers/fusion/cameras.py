"""Cameras of any lens, with depth or without: people in a picture, their colours, and whom the camera can see at all."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from trackers.area import Area
from trackers.arrays import Array, Bool, Float, Index, Int, Mask
from trackers.cameras.placed import PlacedCamera, through_people
from trackers.environment import Environment
from trackers.filters.gating import distances
from trackers.fusion.look import Expected, Look, detections_of, round_covariance
from trackers.fusion.motion import HEAD_PLACE, OUTLINE
from trackers.fusion.options import FusionOptions
from trackers.fusion.posture import DEPTH_SHOWN, SILHOUETTE_SHOWN
from trackers.likelihood.stereo_head import RangeOptions
from trackers.observations import DepthImage, Image, Observation
from trackers.rig import CameraSensor, Rig, StereoSensor
from trackers.tracking.track_manager import clear_of
from trackers.vision.foreground import Foreground
from trackers.vision.front_end import CameraFrontEnd, FrontEndOptions, PreparedPicture
from trackers.vision.histogram import ColourHistogram
from trackers.vision.person_detector import ROOMS, SILHOUETTES, PersonDetector, PersonModel
from trackers.vision.person_windows import ground_axes
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

_CELL_M, _CELLS = 0.5, 128
"""Pitch [m] and number of cells on each side; the lattice repeats beyond them, so that its size is fixed."""
_TRUSTED = 1.0
"""Number of looks that the belief weighs that a camera shows everybody in its picture."""


class ShownPlaces:
    """Share of the people at each place of the floor whom a camera shows: the mean of a Beta distribution for each cell.

    Learned from those whom other sensors measure: nobody tells which walls are where.

    The lattice lies along the camera's view, and is read and learned linearly between its cells.
    """

    def __init__(self, camera: PlacedCamera) -> None:
        self._eye, self._axes = camera.eye_m[:2], ground_axes(camera)
        self._asked, self._shown = np.zeros((_CELLS, _CELLS)), np.zeros((_CELLS, _CELLS))

    def share(self, place: Float[Array, "n 2"]) -> Float[Array, "n"]:
        """Return the share at places [m], 1 where nobody has been."""
        column, row, weight = self._cells(place)
        asked, shown = ((each[column, row] * weight).sum(axis=0) for each in (self._asked, self._shown))
        return (_TRUSTED + shown) / (_TRUSTED + asked)

    def learn(self, place: Float[Array, "n 2"], asked: Float[Array, "n"], shown: Bool[Mask, "n"]) -> None:
        """Learn of people at places [m] who were shown or not. asked: number of looks that each counts."""
        column, row, weight = self._cells(place)
        np.add.at(self._asked, (column, row), asked * weight)
        np.add.at(self._shown, (column, row), asked * shown * weight)

    def _cells(self, place: Float[Array, "n 2"]) -> tuple[Int[Index, "4 n"], Int[Index, "4 n"], Float[Array, "4 n"]]:
        """Return columns and rows of the four cells about each place [m], and their weights."""
        at = ((place - self._eye) @ self._axes / _CELL_M).T
        low = np.floor(at)
        x, y = at - low
        column, row = low.astype(np.intp)
        columns = np.stack([column, column + 1, column, column + 1]) % _CELLS
        rows = np.stack([row, row, row + 1, row + 1]) % _CELLS
        return columns, rows, np.stack([(1 - x) * (1 - y), x * (1 - y), (1 - x) * y, x * y])


class Camera:
    """One camera in its room. environment: None where it is not known."""

    def __init__(
        self,
        name: str,
        sensor: CameraSensor,
        empty_room: Sequence[Observation],
        options: FusionOptions,
        rig: Rig,
        area: Area | None,
        environment: Environment | None,
    ) -> None:
        self.names = (name,)
        self._front_end = CameraFrontEnd(name, sensor, empty_room, FrontEndOptions(), area)
        self.camera: PlacedCamera = self._front_end.camera
        self._environment = environment
        self._histogram = ColourHistogram()
        self._stereo = self._detector = None
        if isinstance(sensor, StereoSensor):
            self._stereo, self._kind = StereoCamera(self._front_end, sensor, None), options.stereo
        else:
            self._kind = options.camera
            self._silhouettes = Foreground(sensor.intrinsics, self._front_end.empty_room, SILHOUETTES)
            self._detector = PersonDetector(self.camera, rig.area, model=PersonModel.load(ROOMS))
        self.picture = packed_without_depth(np.zeros((1, 1, 3), np.uint8), np.zeros((1, 1), np.bool_))
        """The newest picture."""
        self._rgb = np.zeros((1, 1, 3), np.uint8)
        self._shown = ShownPlaces(self.camera)

    @property
    def learns_background(self) -> bool:
        """True where the background is learned as pictures come, for want of an empty room."""
        return self._front_end.learns_background

    @property
    def n_colour(self) -> int:
        """Number of bins of colour."""
        return self._histogram.size

    def look(self, observations: Mapping[str, Observation], expected: Expected, ns: int) -> Look | None:
        """Return the people in the camera's picture; None where there is none, or a blind one."""
        image = observations.get(self.names[0])
        if not isinstance(image, Image | DepthImage):
            return None
        prepared = self._front_end.prepare(image)
        if prepared is None:
            if self._detector is not None:
                self._silhouettes.pass_over(image)
            return None
        if self._stereo is not None and isinstance(image, DepthImage):
            return self._by_depth(prepared, expected, ns)
        self._rgb, self.picture = prepared.image.rgb, packed_without_depth(prepared.image.rgb, prepared.mask)
        return self._by_silhouettes(prepared, expected, ns)

    def _by_silhouettes(self, prepared: PreparedPicture, expected: Expected, ns: int) -> Look:
        assert self._detector is not None
        seen = self._detector.detect(self._silhouettes.mask(prepared.image, prepared.hsv))
        covariance = seen.covariance + self._error(seen.position)
        return self._looked(seen.position, covariance, expected, ns, np.full(len(seen), -1))

    def _error(self, place: Float[Array, "k 2"]) -> Float[Array, "k 2 2"]:
        """Return covariances of places by silhouettes [m²]: the flatter a camera looks, the less it tells how far."""
        way = place - self.camera.eye_m[:2]
        away = np.maximum(np.linalg.norm(way, axis=1), 1e-6)
        ahead = way / away[:, None]
        drop = abs(self.camera.eye_m[2] - _CHEST_M)
        steepness = np.maximum(drop / np.hypot(drop, away), _LEAST_STEEP)
        along = self._kind.sigma_m**2 * (1 / steepness**2 - 1)
        return self._kind.sigma_m**2 * np.eye(2) + along[:, None, None] * ahead[:, :, None] * ahead[:, None, :]

    def _by_depth(self, prepared: PreparedPicture, expected: Expected, ns: int) -> Look:
        """Return heads at the tops of what stands before the room, first of those who are expected."""
        assert self._stereo is not None
        self._rgb, self.picture = prepared.image.rgb, self._stereo.packed(prepared)
        points = self._stereo.foreground_points(self.picture)
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
        sight = head - self.camera.eye_m
        squared = (sight**2).sum(axis=1)
        along_m2 = RangeOptions().sigma(squared) ** 2 / squared
        covariance = round_covariance(self._kind.sigma_m**2 + (0.5 * drop_m) ** 2)
        covariance += along_m2[:, None, None] * sight[:, :2, None] * sight[:, None, :2]
        return self._looked(head[:, :2], covariance, expected, ns, owner, head)

    def _looked(self, position, covariance, expected: Expected, ns: int, owner, head=None) -> Look:
        starts = (owner < 0) & clear_of(position, expected.place, _OWN_M) & self._is_apart(position, expected)
        if head is not None and len(expected.head):  # an arm or a lap below a known head is no other's
            below = head[:, 2] < expected.head[:, 2, None] - _LOWER_M
            starts &= ~np.logical_or.reduce(below & (distances(expected.head[:, :2], position) < _LEGS_M), axis=0)
        return Look(
            self.names,
            self._kind,
            position,
            covariance,
            starts.astype(np.intp),
            owner,
            lambda points: self._missed(points, expected),
            by_posture=DEPTH_SHOWN if self._stereo is not None else SILHOUETTE_SHOWN,
            observes=OUTLINE if head is None else HEAD_PLACE,
            shown=detections_of(ns, self.names, "person", position, covariance),
        )

    def _is_apart(self, position: Float[Array, "k 2"], expected: Expected) -> Bool[Mask, "k"]:
        """Mark places whose silhouettes no known person's hides or is hidden by: two in one may look like a third."""
        known = expected.place
        if self._stereo is not None or not len(known) or not len(position):
            return np.ones(len(position), np.bool_)
        new, old = (np.column_stack([each, np.full(len(each), _CHEST_M)]) for each in (position, known))
        eye = self.camera.eye_m  # outlines of who sits overlap with others' as well: all as high as who stands
        by_old, by_new = (np.column_stack([each, np.full(len(each), _CROWN_M)]) for each in (known, position))
        either = hidden(eye, new, by_old, _OVERLAP_M) | hidden(eye, old, by_new, _OVERLAP_M).T
        return ~np.logical_or.reduce(either, axis=1)

    def _missed(self, points: Float[Array, "2 *n"], expected: Expected) -> Float[Array, "*n"]:
        at = points.reshape(2, -1).T
        visible = self._in_plain_sight(at, expected.crowns)
        return (1 - visible * self._kind.p_detect * self._shown.share(at)).reshape(points.shape[1:])

    def learn_shown(self, crowns: Float[Array, "n 3"], asked: Float[Array, "n"], shown: Bool[Mask, "n"]) -> None:
        """Learn where people are shown whom other sensors measure below their crowns [m]; asked: how much each tells."""
        place = crowns[:, :2]
        self._shown.learn(place, asked * self._in_plain_sight(place, crowns), shown)

    def _in_plain_sight(self, place: Float[Array, "k 2"], crowns: Float[Array, "n 3"]) -> Bool[Mask, "k"]:
        """Mark places [m] of people that neither the room, as far as it is told, nor another one below the crowns [m] hides."""
        visible = self._is_clear(np.column_stack([place, np.full(len(place), _CHEST_M)]), crowns)
        return visible if self._detector is None else visible & self._detector.places.shows(place)

    def sees(self, points: Float[Array, "k 3"], crowns: Float[Array, "n 3"]) -> Bool[Mask, "k"]:
        """Mark points [m] in the picture that neither the room nor another person below these crowns [m] hides."""
        return self._is_clear(points, crowns) & (self._shown.share(points[:, :2]) > _HARDLY)

    def _is_clear(self, points: Float[Array, "k 3"], crowns: Float[Array, "n 3"]) -> Bool[Mask, "k"]:
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
        if self._stereo is not None:
            return np.ones(len(heads), np.bool_)
        reach_m = np.maximum(_SHADOW_M, _SIGMAS * sigma_m)[:, None]
        meets, _ = through_people(self.camera.eye_m, heads, crowns[:, :2], reach_m, crowns[:, 2])
        return ~np.logical_or.reduce(meets & ~np.eye(len(heads), dtype=np.bool_), axis=1)

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
) -> list[Camera]:
    """Make the cameras of a rig; none where it has none."""
    return [Camera(name, sensor, empty_room, options, rig, area, environment) for name, sensor in rig.cameras().items()]
