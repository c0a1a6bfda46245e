"""Stereo RGB-D camera: two views of one snapshot, and the depth of each pixel from them."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from trackers.observations import DepthImage
from trackers.rig import StereoSensor
from twin.instant.snapshot import Snapshot
from twin.sensors.camera import Matching, NoiseBank, StereoMatcher, StereoNoise
from twin.sensors.pinhole import PinholeView, checked_renderer, pinhole_view
from twin.sensors.render import OffscreenRenderer
from twin.sensors.sensor import Reading, State


@dataclass(frozen=True, eq=False)
class StereoState:
    """The noise of each view's image sensor."""

    left: NoiseBank | None = None
    right: NoiseBank | None = None


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
        """Return colour with noise, and depth; the state is the noise of the image sensors."""
        (snapshot,) = snapshots
        state = state if state is not None else StereoState()
        renderer = checked_renderer(self._renderer(), snapshot, self.name)
        lens = self._rig.intrinsics
        views = tuple(each.view for each in self._views)
        depth_m = None if self._rig.mode == "matched" else np.empty((lens.height, lens.width), dtype=np.float32)
        renderer.render(snapshot.data, self._eye_m, views, self._drawn, depth=depth_m)
        rgb, left = self._noise.expose(self._views[0].picture(self._drawn[: lens.height]), state.left, rng)
        if depth_m is None:
            ideal = self._views[1].picture(self._drawn[lens.height :])
            right_rgb, right = self._noise.expose(ideal, state.right, rng)
            depth_m = self._depth(self._matcher.disparity_px(rgb, right_rgb))
            state = StereoState(left, right)
        else:
            depth_m = self._measured(depth_m[::-1], rng)
            state = StereoState(left)
        return Reading(DepthImage(self.name, stamp_ns, rgb, self._within_range(depth_m))), state

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
