"""Patches on bodies and what describes them: where they lie, whom they show, and each feature pixel by pixel."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from trackers.area import Pose
from trackers.cameras import FisheyeIntrinsics, PinholeIntrinsics, PlacedCamera
from trackers.vision.patches import FeatureOptions, PatchDescriber, PatchOptions, PatchSampler

LOOKING_DOWN = Pose(xyz=(0.0, -6.0, 6.0), rpy=(-2.2, 0.0, 0.0))
PINHOLE = PinholeIntrinsics(width=320, height=240, fx=250, fy=250, cx=159.5, cy=119.5)
CAMERAS = [
    PlacedCamera(PINHOLE, LOOKING_DOWN),
    PlacedCamera(PINHOLE.model_copy(update={"distortion": (-0.2, 0.05, 0.0, 0.0, 0.0)}), LOOKING_DOWN),
    PlacedCamera(
        FisheyeIntrinsics(width=400, height=400, fx=120, fy=120, cx=199.5, cy=199.5, field_of_view_rad=3.2),
        LOOKING_DOWN,
    ),
]
APART = np.array([[0.0, 0.0], [-1.5, 0.5], [1.5, 1.0]])


@pytest.mark.parametrize("camera", CAMERAS, ids=["pinhole", "distorted", "fisheye"])
def test_patches_lie_on_the_body_before_any_camera(camera: PlacedCamera) -> None:
    patches = PatchSampler(camera).drawn(APART, np.random.default_rng(0))
    assert patches.shown.all()
    boxes, _ = camera.person_boxes(APART, 1.7, 0.5)
    inside = (patches.centre >= boxes[:, None, :2]) & (patches.centre <= boxes[:, None, 2:])
    assert inside.all()
    axis, _ = camera.project(np.array([[[x, y, z] for z in (0.15, 0.9, 1.65)] for x, y in APART]))
    np.testing.assert_allclose(PatchSampler(camera).middles(APART), axis[:, 1])
    assert (np.ptp(patches.centre, axis=1)[:, 1] > 0.6 * (axis[:, 0] - axis[:, 2])[:, 1]).all()


def test_a_patch_is_smaller_on_who_is_farther_away() -> None:
    side = PatchSampler(CAMERAS[0]).drawn(np.array([[0.0, -2.0], [0.0, 3.0]]), np.random.default_rng(0)).side
    assert side[0] > 1.2 * side[1]


def test_who_stands_behind_somebody_shows_what_sticks_out() -> None:
    positions = np.array([[0.0, 0.0], [0.05, 0.8]])
    patches = PatchSampler(CAMERAS[0]).drawn(positions, np.random.default_rng(0))
    assert patches.shown[0].all()
    hidden = ~patches.shown[1]
    assert 0 < hidden.sum() < hidden.size
    assert patches.centre[1][hidden][:, 1].mean() > patches.centre[1][~hidden][:, 1].mean()  # the legs


def test_others_may_stand_before_those_who_are_looked_at() -> None:
    both, sampler = np.array([[0.0, 0.0], [0.05, 0.8]]), PatchSampler(CAMERAS[0])
    alone = sampler.drawn(both[1:], np.random.default_rng(0))
    behind = sampler.drawn(both[1:], np.random.default_rng(0), None, both)
    assert alone.shown.all()
    assert 0 < behind.shown.sum() < behind.shown.size


def test_what_the_picture_does_not_show_is_no_patch() -> None:
    camera = CAMERAS[0]
    ray = camera.rays(np.array([0.0, 120.0]))
    edge = (camera.eye_m + ray * (0.9 - camera.eye_m[2]) / ray[2])[None, :2]  # the left border, half-way up the body
    patches = PatchSampler(camera).drawn(edge, np.random.default_rng(0))
    assert 0 < patches.shown.sum() < patches.shown.size
    np.testing.assert_array_equal(patches.shown, camera.intrinsics.contains(patches.centre))
    behind = PatchSampler(camera).drawn(np.array([[0.0, -30.0]]), np.random.default_rng(0))
    assert not behind.shown.any()


def test_patches_around_places_stay_within_reach() -> None:
    camera, here = CAMERAS[0], np.array([[0.0, 0.0]])
    sampler = PatchSampler(camera, PatchOptions(width_m=0.0, low_m=0.9, high_m=0.901))
    centre = sampler.drawn_around(here, 0.5, 500, np.random.default_rng(0)).centre[0]
    ring = 0.5 * np.stack([np.cos(np.arange(0, 6.3, 0.1)), np.sin(np.arange(0, 6.3, 0.1))], axis=1)
    outline = sampler.middles(ring).astype(np.float32)
    assert min(cv2.pointPolygonTest(outline, tuple(map(float, each)), True) for each in centre) > -0.3
    assert (np.ptp(centre, axis=0) > 0.8 * np.ptp(outline, axis=0)).all()


# --- features


def picture(seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (60, 80, 3), dtype=np.uint8)


CENTRE = np.array([[20.0, 20.0], [41.5, 30.5], [0.0, 0.0], [79.0, 59.0], [60.0, 2.0]])
SIDE = np.array([6.0, 9.0, 8.0, 8.0, 7.0])


def windows() -> list[tuple[slice, slice]]:
    """Rows and columns of the patches, moved inside the picture."""
    made = []
    for (u, v), side in zip(CENTRE, SIDE.astype(int), strict=True):
        left, top = (int(np.rint(each - (side - 1) / 2)) for each in (u, v))
        left, top = min(max(left, 0), 80 - side), min(max(top, 0), 60 - side)
        made.append((slice(top, top + side), slice(left, left + side)))
    return made


def test_colours_are_the_means_of_the_cells() -> None:
    rgb = picture()
    found = PatchDescriber(FeatureOptions(kinds=("rgb",), rgb_cells=2)).described(rgb, CENTRE, SIDE)
    for each, (rows, columns), side in zip(found, windows(), SIDE.astype(int), strict=True):
        patch, half = rgb[rows, columns].astype(float), side // 2
        cells = [
            patch[a, b].mean(axis=(0, 1))
            for a in (slice(half), slice(half, None))
            for b in (slice(half), slice(half, None))
        ]
        np.testing.assert_allclose(each, np.concatenate(cells))


def test_edges_are_shares_of_the_gradients_magnitude_by_orientation() -> None:
    rgb, options = picture(1), FeatureOptions(kinds=("edges",), orientations=6, least_edge=2.0)
    found = PatchDescriber(options).described(rgb, CENTRE[:2], SIDE[:2])
    grey = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY).astype(int)
    for each, (rows, columns) in zip(found, windows(), strict=False):
        sums = np.zeros(6)
        for v in range(rows.start, rows.stop):
            for u in range(columns.start, columns.stop):
                near = grey[v - 1 : v + 2, u - 1 : u + 2]
                du = (near[:, 2] - near[:, 0]) @ (1, 2, 1)
                dv = (near[2] - near[0]) @ (1, 2, 1)
                sums[int(np.arctan2(dv, du) % np.pi / np.pi * 6) % 6] += np.hypot(du, dv) / 8
        side = rows.stop - rows.start
        np.testing.assert_allclose(each, sums / (sums.sum() + 2.0 * side**2), atol=0.02)


def test_texture_is_haralicks() -> None:
    rgb, n = picture(2), 4
    found = PatchDescriber(FeatureOptions(kinds=("texture",), grey_levels=n)).described(rgb, CENTRE[:2], SIDE[:2])
    level = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY).astype(int) * n // 256
    for each, (rows, columns) in zip(found, windows(), strict=False):
        counts = np.zeros((n, n))
        for v in range(rows.start, rows.stop):
            for u in range(columns.start, columns.stop):
                for other in (level[v, u + 1], level[v + 1, u]):
                    counts[level[v, u], other] += 1
                    counts[other, level[v, u]] += 1
        p = counts / counts.sum()
        i, j = np.indices((n, n))
        mean = (p * i).sum()
        variance = (p * (i - mean) ** 2).sum()
        expected = [
            (p * (i - j) ** 2).sum(),
            (p**2).sum(),
            (p / (1 + (i - j) ** 2)).sum(),
            (p * (i - mean) * (j - mean)).sum() / variance,
            -(p[p > 0] * np.log(p[p > 0])).sum(),
        ]
        np.testing.assert_allclose(each, expected, atol=1e-6)


@pytest.mark.parametrize("kinds", [("rgb",), ("edges",), ("texture",), ("rgb", "edges", "texture")])
def test_a_picture_of_one_colour_is_described_too(kinds: tuple) -> None:
    describer = PatchDescriber(FeatureOptions(kinds=kinds))
    found = describer.described(np.full((60, 80, 3), 90, np.uint8), CENTRE, SIDE)
    assert found.shape == (5, describer.size)
    assert np.isfinite(found).all()
    assert (found == found[0]).all()
    if kinds == ("edges",):
        assert (found == 0).all()
