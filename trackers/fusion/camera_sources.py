"""Sources of people in pictures: silhouettes by cameras of any lens, and depths as far as they tell people apart."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from trackers.area import Area
from trackers.arrays import Array, Bool, Float, Index, Int, Mask
from trackers.environment import Environment
from trackers.filters.gating import distances
from trackers.fusion.look import Expected, Look, detections_of, round_covariance
from trackers.fusion.options import FusionOptions, KindOptions
from trackers.fusion.person_state import HEAD_PLACE, OUTLINE
from trackers.fusion.posture import DEPTH_SHOWN, SILHOUETTE_SHOWN, Shares
from trackers.fusion.shown_places import Camera, hidden
from trackers.observations import DepthImage, Image, Observation
from trackers.rig import Rig
from trackers.tracking.track_manager import clear_of
from trackers.vision.person_detector import ROOMS, SILHOUETTES, PersonDetector, PersonModel
from trackers.vision.stereo_picture import head_of, heads_in_plan

_CHEST_M, _CROWN_M, _OVERLAP_M = 1.1, 1.65, 0.45
"""Heights of a chest and of the crown of who stands; silhouettes nearer than the last, across the sight, may be one [m]."""
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
_ASIDE_M, _FRONT_M = 0.25, 0.08
"""Points of a person are this near to the axis across the sight, and their surfaces so far before it [m]."""
_SIGMAS, _LEAST_POINTS = 2.5, 12
"""A person's points are within so many standard deviations along the sight; fewer tell nothing."""


class CameraSource:
    """Source of people in the pictures of one camera, up to where depths tell people apart, or beyond."""

    of_legs = False

    def __init__(self, camera: Camera, kind: KindOptions, by_posture: Shares, *, beyond: bool) -> None:
        self.names, self.camera = (camera.name,), camera
        self._kind, self._by_posture, self._beyond = kind, by_posture, beyond
        self._visible = np.empty(0, np.bool_)  # of the people expected at the last look

    @property
    def learns_background(self) -> bool:
        """True where the background is learned as pictures come, for want of an empty room."""
        return self.camera.front_end.learns_background

    def within_reach(self, place: Float[Array, "k 2"]) -> Bool[Mask, "k"]:
        """Mark places [m] as far from the camera as people are looked for by this source."""
        return (self.camera.away_m(place) >= self.camera.depths_to_m) == self._beyond

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
        self._visible = self._in_plain_sight(expected.place, expected.crowns)
        return Look(
            self.names,
            self._kind,
            position,
            covariance,
            starts.astype(np.intp),
            owner,
            lambda points: self._missed(points, expected),
            known=self._missed_at(expected.place, self._visible),
            by_posture=self._by_posture,
            observes=observes,
            shown=detections_of(ns, self.names, "person", position, covariance),
        )

    def learn_shown(self, place: Float[Array, "n 2"], asked: Float[Array, "n"], shown: Bool[Mask, "n"]) -> None:
        """Learn where people are shown whom other sensors measure at places [m], those expected at the last look.

        asked: how much each tells.
        """
        self.camera.shown.learn(place, asked * self._visible, shown)

    def _missed(self, points: Float[Array, "2 *n"], expected: Expected) -> Float[Array, "*n"]:
        at = points.reshape(2, -1).T
        return self._missed_at(at, self._in_plain_sight(at, expected.crowns)).reshape(points.shape[1:])

    def _missed_at(self, place: Float[Array, "k 2"], visible: Bool[Mask, "k"]) -> Float[Array, "k"]:
        return 1 - visible * self._kind.p_detect * self.camera.shown.share(place)

    def _in_plain_sight(self, place: Float[Array, "k 2"], crowns: Float[Array, "n 3"]) -> Bool[Mask, "k"]:
        """Mark places [m] of people that neither the room, as far as it is known, nor another one below the crowns [m] hides."""
        chest = np.column_stack([place, np.full(len(place), _CHEST_M)])
        return self.within_reach(place) & self.camera.is_clear(chest, crowns)


class Silhouettes(CameraSource):
    """People by their outlines before the empty room, as a learned model detects them, beyond what depths tell."""

    def __init__(self, camera: Camera, options: FusionOptions, area: ArrayLike | None) -> None:
        super().__init__(camera, options.camera, SILHOUETTE_SHOWN, beyond=True)
        self._detector = PersonDetector(camera.camera, area, model=PersonModel.load(ROOMS))

    def look(self, observations: Mapping[str, Observation], expected: Expected, ns: int) -> Look | None:
        """Return the people in the camera's picture; None where there is none, or a blind one."""
        image = observations.get(self.camera.name)
        if not isinstance(image, Image | DepthImage):
            return None
        prepared = self.camera.prepare(image)
        if prepared is None:
            return None
        seen = self._detector.detect(prepared.differences.changed(SILHOUETTES))
        there = self.within_reach(seen.position)
        position, covariance = seen.position[there], seen.covariance[there]
        covariance = covariance + self._error(position)
        position, covariance = self._by_depths(position, covariance)
        starts = clear_of(position, expected.place, _OWN_M)
        starts[starts] = self._is_apart(position[starts], expected)
        return self.looked(position, covariance, starts, np.full(len(position), -1), OUTLINE, expected, ns)

    def _in_plain_sight(self, place: Float[Array, "k 2"], crowns: Float[Array, "n 3"]) -> Bool[Mask, "k"]:
        visible = super()._in_plain_sight(place, crowns)
        return visible & self._detector.places.shows(place) if visible.any() else visible

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

    def _by_depths(
        self, position: Float[Array, "k 2"], covariance: Float[Array, "k 2 2"]
    ) -> tuple[Float[Array, "k 2"], Float[Array, "k 2 2"]]:
        """Return places [m] and covariances [m²] by depths, too, where there are any: legs that a table hides mislead outlines.

        The depths of one person err together, so that their median is as exact as one of them.
        """
        camera = self.camera
        if not camera.depths_to_m or not len(position):
            return position, covariance
        eye_m = camera.camera.eye_m
        points = camera.points[:2] - eye_m[:2, None]
        away_m = camera.away_m(position)
        ahead = (position - eye_m[:2]) / away_m[:, None]
        along_m, aside_m = ahead @ points, np.stack([-ahead[:, 1], ahead[:, 0]], axis=1) @ points
        before = np.einsum("ka,kab,kb->k", ahead, covariance, ahead)
        by_depth = camera.depth_errors.sigma(away_m**2 + (eye_m[2] - _CHEST_M) ** 2) ** 2
        off_m = along_m + _FRONT_M - away_m[:, None]
        own = (np.abs(aside_m) < _ASIDE_M) & (np.abs(off_m) < _SIGMAS * np.sqrt(before + by_depth)[:, None])
        shown = own.sum(axis=1) >= _LEAST_POINTS
        middle = np.zeros(len(position))
        for k in np.flatnonzero(shown):
            middle[k] = np.median(off_m[k, own[k]])
        gain = np.where(shown, before / (before + by_depth), 0.0)
        position = position + (gain * middle)[:, None] * ahead
        less = (gain * before)[:, None, None] * ahead[:, :, None] * ahead[:, None, :]
        return position, covariance - less

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

    def __init__(self, camera: Camera, options: FusionOptions) -> None:
        super().__init__(camera, options.stereo, DEPTH_SHOWN, beyond=False)

    def look(self, observations: Mapping[str, Observation], expected: Expected, ns: int) -> Look | None:
        """Return the heads in the camera's depths, first of those who are expected; None where there are none, or blind ones."""
        image = observations.get(self.camera.name)
        if not isinstance(image, DepthImage) or self.camera.prepare(image) is None:
            return None
        points = self.camera.points
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
        along_m2 = self.camera.depth_errors.sigma(squared) ** 2 / squared
        covariance = round_covariance(self._kind.sigma_m**2 + (0.5 * drop_m) ** 2)
        covariance += along_m2[:, None, None] * sight[:, :2, None] * sight[:, None, :2]
        starts = (owner < 0) & clear_of(head[:, :2], expected.place, _OWN_M)
        if len(expected.head):  # an arm or a lap below a known head is no other's
            below = head[:, 2] < expected.head[:, 2, None] - _LOWER_M
            starts &= ~np.logical_or.reduce(below & (distances(expected.head[:, :2], head[:, :2]) < _LEGS_M), axis=0)
        return self.looked(head[:, :2], covariance, starts, owner, HEAD_PLACE, expected, ns)


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
            sources.append(Depths(camera, options))
        sources.append(Silhouettes(camera, options, rig.area))
    return sources
