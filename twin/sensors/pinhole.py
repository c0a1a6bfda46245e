"""Pinhole cameras: any focal length and principal point, Brown–Conrady distortion, motion blur; one alone, or a pair with depth.

A view is drawn for the lens; with distortion, a table remaps the drawn view to the picture. A stereo camera draws two views of
one snapshot, and works out the depth of each pixel from them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from trackers.cameras import PinholeIntrinsics
from trackers.errors import InputError
from trackers.observations import DepthImage, Image
from trackers.rig import PinholeSensor, Pose, StereoSensor
from twin.instant.snapshot import Snapshot
from twin.sensors.camera import Matching, StereoMatcher, StereoNoise
from twin.sensors.render import OffscreenRenderer
from twin.sensors.render_scene import PersonPixels, RenderView, drawn_span, triple
from twin.sensors.sensor import Reading, State

LARGEST_BUFFER_PX = 16_384


@dataclass(frozen=True, eq=False)
class PinholeView:
    """View drawn for a camera, and the remapping of its buffer (height, width), rows from the bottom up, to the image.

    `maps`: position of each pixel in the buffer (fixed point, as for `cv2.remap`); None: identical.
    """

    view: RenderView
    width: int
    height: int
    maps: tuple[NDArray, NDArray] | None

    def picture(self, drawn: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Remap a drawing (RGBA) to the image (height, width, 3) RGB; a new array."""
        if self.maps is None:
            return cv2.flip(cv2.cvtColor(drawn, cv2.COLOR_RGBA2RGB), 0)  # pyright: ignore[reportReturnType]
        return cv2.cvtColor(cv2.remap(drawn, *self.maps, cv2.INTER_LINEAR), cv2.COLOR_RGBA2RGB)  # pyright: ignore[reportReturnType]

    def people(self, renderer: OffscreenRenderer, snapshot: Snapshot, eye_m: NDArray[np.float64]) -> NDArray[np.int16]:
        """Return the id of the person at each pixel of the image, 0 for the room, (height, width)."""
        drawn = np.empty((self.height, self.width, 4), dtype=np.uint8)
        geom_of_number = renderer.render(snapshot.data, eye_m, (self.view,), None, numbers=drawn)
        return self._pixels.people(drawn, geom_of_number, snapshot.person_of_geom)

    @cached_property
    def _pixels(self) -> PersonPixels:
        return PersonPixels(self.maps)


def pinhole_view(lens: PinholeIntrinsics, pose: Pose, eye_offset_m: float = 0.0) -> PinholeView:
    """Return the view of a camera with this pose (its optical frame in the room's), `eye_offset_m` to its right.

    An undistorted lens is drawn directly, its principal point by an off-axis frustum. Another is drawn wider, with at least
    one pixel for each of the image's. Raises InputError where that buffer would be too large.
    """
    if not lens.is_distorted:
        left, right = (-0.5 - lens.cx) / lens.fx, (lens.width - 0.5 - lens.cx) / lens.fx
        top, bottom = (0.5 + lens.cy) / lens.fy, (lens.cy - lens.height + 0.5) / lens.fy
        view = _view(pose, eye_offset_m, (left, right, bottom, top), (lens.width, lens.height))
        return PinholeView(view, lens.width, lens.height, None)
    directions = lens.directions()
    across, rise = directions[..., 0], -directions[..., 1]
    if np.isnan(across).any():
        raise InputError(
            f"distortion {list(lens.distortion)} (k1, k2, p1, p2, k3) leaves pixels without light; "
            "one that grows up to the picture's edge is valid"
        )
    density_x, density_y = _density(np.diff(across, axis=1)), _density(-np.diff(rise, axis=0))
    (left, width), (bottom, height) = drawn_span(across, density_x), drawn_span(rise, density_y)
    if max(width, height) > LARGEST_BUFFER_PX:
        raise InputError(
            f"distortion {list(lens.distortion)} (k1, k2, p1, p2, k3) needs a picture of {width} x {height} to be bent "
            f"from; at most {LARGEST_BUFFER_PX} a side is valid"
        )
    column = ((across - left) * density_x - 0.5).astype(np.float32)
    row = ((rise - bottom) * density_y - 0.5).astype(np.float32)
    edges = (left, left + width / density_x, bottom, bottom + height / density_y)
    maps = cv2.convertMaps(column, row, cv2.CV_16SC2)
    return PinholeView(_view(pose, eye_offset_m, edges, (width, height)), width, height, maps)


def _density(steps: NDArray[np.float64]) -> float:
    """Return the pixels of a drawing per unit of tangent, one for the smallest of these steps between the picture's pixels."""
    finest = float(steps.min())
    if finest <= 0:
        raise InputError(
            "distortion folds the picture over itself; coefficients under which neighbours stay neighbours are valid"
        )
    return 1.0 / finest


def _view(
    pose: Pose, eye_offset_m: float, edges: tuple[float, float, float, float], size: tuple[int, int]
) -> RenderView:
    right, down, ahead = pose.rotation.T
    left_edge, right_edge, bottom, top = edges
    return RenderView(
        forward=triple(ahead),
        up=triple(-down),
        left=left_edge,
        right=right_edge,
        bottom=bottom,
        top=top,
        viewport=(0, 0, *size),
        offset_m=triple(eye_offset_m * right),
    )


class Pinhole:
    """Ideal pinhole camera: sharp at every distance, no vignetting, no scatter. The camera stands still.

    With several `instants_s`, offsets from the stamp within the exposure, the image is their mean: motion blur of a global
    shutter. Grey values are averaged, as the renderer's light is linear in them.

    `renderer` returns the renderer of the snapshots' model; it is called at the first observation, not before. Raises
    InputError for a lens that cannot be rendered.
    """

    def __init__(
        self,
        name: str,
        rig: PinholeSensor,
        renderer: Callable[[], OffscreenRenderer],
        *,
        instants_s: tuple[float, ...] = (0.0,),
    ) -> None:
        rig.intrinsics.check_view()
        self.name = name
        self.instants_s = instants_s
        self._rig = rig
        self._renderer = renderer
        self._eye_m = rig.room_from_sensor.translation

    @cached_property
    def view(self) -> PinholeView:
        """View drawn for an image."""
        return pinhole_view(self._rig.intrinsics, self._rig.room_from_sensor)

    @property
    def views(self) -> tuple[RenderView, ...]:
        """Views of the room that make up an image."""
        return (self.view.view,)

    @property
    def buffer_px(self) -> tuple[int, int]:
        """Width and height of the buffer in which the views are drawn [px]."""
        return self.view.width, self.view.height

    @cached_property
    def _drawn(self) -> NDArray[np.uint8]:
        return np.zeros((self.view.height, self.view.width, 4), dtype=np.uint8)

    def observe(
        self, stamp_ns: int, snapshots: Iterable[Snapshot], state: State, rng: np.random.Generator
    ) -> tuple[Reading, State]:
        """Return the ideal image; `rng` and `state` are not used."""
        rgb = self._mean_picture(snapshots) if len(self.instants_s) > 1 else self._only_picture(snapshots)
        return Reading(Image(self.name, stamp_ns, rgb)), state

    def person_image(self, snapshot: Snapshot) -> NDArray[np.int16]:
        """Return the id of the person at each pixel's centre, 0 for the room, (height, width)."""
        renderer = checked_renderer(self._renderer(), snapshot, self.name)
        return self.view.people(renderer, snapshot, self._eye_m)

    def rig_sensor(self) -> PinholeSensor:
        """Return the tracker's view of the sensor: pose, topic and intrinsics."""
        return self._rig

    def _only_picture(self, snapshots: Iterable[Snapshot]) -> NDArray[np.uint8]:
        (snapshot,) = snapshots
        return self._picture(snapshot)

    def _mean_picture(self, snapshots: Iterable[Snapshot]) -> NDArray[np.uint8]:
        lens = self._rig.intrinsics
        light = np.zeros((lens.height, lens.width, 3), dtype=np.float32)
        for snapshot in snapshots:
            cv2.accumulate(self._picture(snapshot), light)
        return cv2.convertScaleAbs(light, alpha=1 / len(self.instants_s))  # pyright: ignore[reportReturnType]

    def _picture(self, snapshot: Snapshot) -> NDArray[np.uint8]:
        renderer = checked_renderer(self._renderer(), snapshot, self.name)
        renderer.render(snapshot.data, self._eye_m, (self.view.view,), self._drawn)
        return self.view.picture(self._drawn)


def checked_renderer(renderer: OffscreenRenderer, snapshot: Snapshot, camera: str) -> OffscreenRenderer:
    """Return the renderer; raises ValueError if it draws another model than the snapshot's."""
    if snapshot.model is not renderer.model:
        raise ValueError(f"camera {camera!r} was given a renderer of another model than the snapshot's")
    return renderer


class Stereo:
    """A rectified pair of global-shutter cameras without distortion, and the depth computed from its two images.

    Colour and depth are those of the left view. By the rig's `mode`, depth z comes of the disparity d = f b / z (focal
    length f [px], baseline b [m]) that matching the two noisy pictures finds (`matched`), of the true one with normal
    noise σ_d (`disparity-noise`; the error of depth is about z² σ_d / (f b)), or is true (`ideal`). It is 0, a hole, where
    nothing matches and outside `range_min_m` to `range_max_m`.

    Simplified: perfectly rectified and synchronous, both views exposed alike, no projected pattern, noise of neighbouring
    disparities independent in `disparity-noise`.

    `renderer` gives the renderer of the snapshots' model; it is called at the first observation, not before.
    Raises ValueError for a rig that does not say its mode and baseline.
    """

    instants_s = (0.0,)

    def __init__(
        self,
        name: str,
        rig: StereoSensor,
        renderer: Callable[[], OffscreenRenderer],
        *,
        matching: Matching,
        noise: StereoNoise,
        range_min_m: float,
        range_max_m: float,
    ) -> None:
        if rig.mode is None or rig.baseline_m is None:
            raise ValueError(f"stereo camera {name!r}: mode {rig.mode} and baseline {rig.baseline_m}; both are needed")
        self.name = name
        self._rig = rig
        self._renderer = renderer
        self._matching = matching
        self._noise = noise
        self._range_m = (range_min_m, range_max_m)
        self._focal_baseline = rig.intrinsics.fx * rig.baseline_m  # [px m]: disparity times depth
        self._eye_m = rig.room_from_sensor.translation

    @cached_property
    def _views(self) -> tuple[PinholeView, ...]:
        """The left view, and the right one where pictures are matched, one above the other in the buffer."""
        assert self._rig.baseline_m is not None
        lens, pose = self._rig.intrinsics, self._rig.room_from_sensor
        left = pinhole_view(lens, pose)
        if self._rig.mode != "matched":
            return (left,)
        right = pinhole_view(lens, pose, self._rig.baseline_m)
        above = replace(right.view, viewport=(0, lens.height, lens.width, lens.height))
        return left, replace(right, view=above)

    @cached_property
    def _drawn(self) -> NDArray[np.uint8]:
        lens = self._rig.intrinsics
        return np.zeros((len(self._views) * lens.height, lens.width, 4), dtype=np.uint8)

    @cached_property
    def _matcher(self) -> StereoMatcher:
        return StereoMatcher(self._matching, self._focal_baseline / self._range_m[0])

    def observe(
        self, stamp_ns: int, snapshots: Iterable[Snapshot], state: State, rng: np.random.Generator
    ) -> tuple[Reading, State]:
        """Return colour with noise, and depth; the state is the noise of the left and of the right image sensor."""
        (snapshot,) = snapshots
        left, right = state if state is not None else (None, None)
        renderer = checked_renderer(self._renderer(), snapshot, self.name)
        lens = self._rig.intrinsics
        views = tuple(each.view for each in self._views)
        depth_m = None if self._rig.mode == "matched" else np.empty((lens.height, lens.width), dtype=np.float32)
        renderer.render(snapshot.data, self._eye_m, views, self._drawn, depth=depth_m)
        rgb, left = self._noise.expose(self._views[0].picture(self._drawn[: lens.height]), left, rng)
        if depth_m is None:
            ideal = self._views[1].picture(self._drawn[lens.height :])
            right_rgb, right = self._noise.expose(ideal, right, rng)
            depth_m = self._depth(self._matcher.disparity_px(rgb, right_rgb))
        else:
            depth_m = self._measured(depth_m[::-1], rng)
        return Reading(DepthImage(self.name, stamp_ns, rgb, self._within_range(depth_m))), (left, right)

    def person_image(self, snapshot: Snapshot) -> NDArray[np.int16]:
        """Return the id of the person at each pixel's centre, 0 for the room, (height, width)."""
        renderer = checked_renderer(self._renderer(), snapshot, self.name)
        return self._views[0].people(renderer, snapshot, self._eye_m)

    def rig_sensor(self) -> StereoSensor:
        """Return the tracker's view of the sensor: pose, topics, intrinsics, baseline and mode."""
        return self._rig

    def _depth(self, disparity_px: NDArray[np.float32]) -> NDArray[np.float32]:
        """Convert disparities to depth [m], 0 where they are not above 0."""
        depth_m = np.zeros_like(disparity_px)
        np.divide(np.float32(self._focal_baseline), disparity_px, out=depth_m, where=disparity_px > 0)
        return depth_m

    def _measured(self, true_m: NDArray[np.float32], rng: np.random.Generator) -> NDArray[np.float32]:
        """Return the reported depth [m] of the true one."""
        sigma_px = self._noise.disparity_sigma_px
        if self._rig.mode == "ideal" or sigma_px == 0:
            return np.ascontiguousarray(true_m)
        noise_px = np.float32(sigma_px) * rng.standard_normal(true_m.shape, dtype=np.float32)
        return self._depth((self._focal_baseline / true_m + noise_px).astype(np.float32))

    def _within_range(self, depth_m: NDArray[np.float32]) -> NDArray[np.float32]:
        nearest_m, farthest_m = self._range_m
        return np.where((depth_m >= nearest_m) & (depth_m <= farthest_m), depth_m, np.float32(0))
