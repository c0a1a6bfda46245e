"""Cost of the commonest calls of camera trackers: points of depth, windows of colour, masks, ellipses, floor clusters."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import cv2
import numpy as np

from benchmarks.figure import Figure, median_ratio, median_s
from trackers.area import Pose
from trackers.cameras import Ellipsoids, PinholeIntrinsics, PlacedCamera
from trackers.likelihood.floor import floor_clusters
from trackers.observations import FloorFrame, Image
from trackers.rig import FloorSensor
from trackers.vision.colour_bins import HueSaturationValueBins, hsv_of
from trackers.vision.foreground import Foreground

_WINDOWS, _SAMPLES, _WINDOW_PX = 750, (10, 30), (30, 90)
_HEADS = 512
_ROUNDS = 100
_DISTORTION = (-0.25, 0.05, 0.001, -0.001, 0.0)
_LENS = PinholeIntrinsics(width=320, height=240, fx=250, fy=250, cx=159.5, cy=119.5, distortion=_DISTORTION)
_POSE = Pose(xyz=(0.0, 0.0, 2.5), rpy=(-2.0, 0.0, 0.3))


def measure() -> Iterator[Figure]:
    """Each on one 320 × 240 picture, by a distorted lens, beside the bare call that does the bulk of it."""
    cv2.setNumThreads(1)
    yield from _points()
    yield from _windows()
    yield from _mask()
    yield from _ellipses()
    yield from _clusters()


def _points() -> Iterator[Figure]:
    camera = PlacedCamera(_LENS, _POSE)
    depth_m = np.random.default_rng(0).uniform(0.5, 6, (240, 320)).astype(np.float32)
    depth_m[::7, ::5] = 0
    rays, points = np.ascontiguousarray(camera.points(np.ones_like(depth_m))), np.empty((240, 320, 3))
    yield Figure("depth to points, distorted lens", 1e3 * median_s(lambda: camera.points(depth_m)), "ms", "<= 2")
    ratio = median_ratio(lambda: camera.points(depth_m), lambda: np.multiply(rays, depth_m[..., None], points), _ROUNDS)
    yield Figure("depth to points, over the bare product of rays and depth", ratio, "×", "<= 2")


def _windows() -> Iterator[Figure]:
    rng = np.random.default_rng(0)
    bins, rgb = HueSaturationValueBins(), rng.integers(0, 256, (240, 320, 3), dtype=np.uint8)
    centres = rng.uniform(0, (320, 240), (_WINDOWS, 2))
    picture = bins.binned(hsv_of(rgb))

    def gathered() -> np.ndarray:
        return picture.windows(centres, _WINDOW_PX, _SAMPLES).histograms()

    numbers = picture.windows(centres, _WINDOW_PX, _SAMPLES).number.astype(np.intp)
    flat = (numbers + (bins.size + 1) * np.arange(_WINDOWS)[:, None]).ravel()
    yield Figure("a picture's colour bins (110)", 1e3 * median_s(lambda: bins.binned(hsv_of(rgb))), "ms", "")
    yield Figure(f"histograms of {_WINDOWS} windows of 300 samples", 1e3 * median_s(gathered), "ms", "<= 1.5")
    yield Figure(
        "histograms of windows, over the bare np.bincount",
        median_ratio(gathered, lambda: np.bincount(flat, minlength=_WINDOWS * (bins.size + 1)), _ROUNDS),
        "×",
        "",
    )


def _mask() -> Iterator[Figure]:
    rng = np.random.default_rng(0)
    empty = rng.integers(90, 110, (240, 320, 3), dtype=np.uint8)
    rgb = empty.copy()
    for column in (40, 140, 240):
        rgb[60:180, column : column + 40] = rng.integers(0, 256, 3)
    foreground, image = Foreground(_LENS, [Image("camera", 0, empty)]), Image("camera", 0, rgb)
    yield Figure("foreground mask", 1e3 * median_s(lambda: foreground.mask(image)), "ms", "")


def _ellipses() -> Iterator[Figure]:
    rng = np.random.default_rng(0)
    places = PlacedCamera(_LENS, _POSE)
    centres = places.eye_m + rng.uniform(1, 5, (_HEADS, 1)) * places.rays(rng.uniform(20, 220, (_HEADS, 2)))
    heads = Ellipsoids.upright(centres, (0.1, 0.08, 0.13), rng.uniform(-3, 3, _HEADS))
    for name, lens in (("straight", _LENS.model_copy(update={"distortion": (0.0,) * 5})), ("distorted", _LENS)):
        camera = PlacedCamera(lens, _POSE)
        yield Figure(
            f"ellipses of {_HEADS} heads, {name} lens", 1e3 * median_s(partial(camera.ellipses, heads)), "ms", ""
        )


def _clusters() -> Iterator[Figure]:
    values = np.zeros((14, 18), np.uint8)
    values[2:4, 3:5] = values[8:10, 9] = values[12, 14:16] = 90
    floor, frame = FloorSensor(topic="/floor", rows=14, columns=18, pitch_m=0.2), FloorFrame("floor", 0, values)
    yield Figure("clusters of a floor of 252 elements", 1e3 * median_s(lambda: floor_clusters(frame, floor)), "ms", "")
