"""Pictures binned once, windows gathered from them: against OpenCV's histograms of each window cut out."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from trackers.vision.colour_bins import BinnedPicture, HueSaturationValueBins, hsv_of
from trackers.vision.histogram import ColourHistogram, HistogramOptions, bhattacharyya_distance, normalised

WIDTH, HEIGHT = 60, 40


def colours(seed: int, height: int = HEIGHT, width: int = WIDTH) -> np.ndarray:
    """A picture with dark, grey and coloured pixels."""
    rng = np.random.default_rng(seed)
    grey = rng.integers(0, 256, (height, width, 1))
    spread = rng.choice([0, 8, 200], (height, width, 1))
    return np.clip(grey + rng.integers(-1, 2, (height, width, 3)) * spread, 0, 255).astype(np.uint8)


def by_opencv(rgb: np.ndarray, bins: HueSaturationValueBins, mask: np.ndarray | None = None) -> np.ndarray:
    """The same histogram of a whole picture, by `cv2.calcHist`."""
    hsv = cv2.cvtColor(rgb, cv2.COLOR_RGB2HSV)
    coloured = (hsv[..., 1] > 255 * bins.saturation_above) & (hsv[..., 2] > 255 * bins.value_above)
    counted = np.ones(coloured.shape, bool) if mask is None else mask
    in_colour, in_grey = ((each & counted).astype(np.uint8) for each in (coloured, ~coloured))
    size = [bins.hue, bins.saturation]
    limits = [-1e-3, 180 - 1e-3, -1e-3, 256 - 1e-3]  # or OpenCV rounds levels that lie on an edge down
    parts = [cv2.calcHist([hsv], [0, 1], in_colour, size, limits)]
    if bins.value:
        parts.append(cv2.calcHist([hsv], [2], in_grey, [bins.value], limits[2:]))
    return np.concatenate([part.ravel() for part in parts])


def picture_of(bins: HueSaturationValueBins, rgb: np.ndarray) -> BinnedPicture:
    return bins.binned(hsv_of(rgb))


def whole(picture: BinnedPicture) -> np.ndarray:
    """The histogram of all of a picture, through one window as large."""
    height, width = picture.number.shape
    middle = [[(width - 1) / 2, (height - 1) / 2]]
    return picture.windows(middle, (width, height), (width, height)).histograms()[0]


@pytest.mark.parametrize("hue", range(1, 31))
def test_bins_are_opencvs(hue: int):
    rng = np.random.default_rng(hue)
    for _ in range(10):
        saturation, value = rng.integers([1, 0], 33).tolist()
        above = rng.uniform(0, 0.9)
        bins = HueSaturationValueBins(
            hue=hue, saturation=saturation, value=value, saturation_above=above, value_above=above / 2
        )
        rgb = colours(int(rng.integers(2**32)))
        counts = whole(picture_of(bins, rgb))
        assert counts.shape == (bins.size,)
        np.testing.assert_array_equal(counts, by_opencv(rgb, bins))


def test_the_default_is_perez_110_bins():
    bins = HueSaturationValueBins()
    assert bins.size == 110
    grey, dark_red, red = (30, 30, 30), (15, 0, 0), (200, 0, 0)
    counts = whole(picture_of(bins, np.array([[grey, dark_red, red]], np.uint8)))
    assert np.flatnonzero(counts).tolist() == [9, 100, 101]


def test_hue_and_saturation_alone_leave_grey_and_dark_out():
    bins = HueSaturationValueBins(hue=32, saturation=32, value=0)
    counts = whole(picture_of(bins, np.array([[(30, 30, 30), (15, 0, 0), (200, 0, 0), (200, 150, 120)]], np.uint8)))
    assert counts.shape == (1024,)
    assert counts.sum() == 2


@settings(max_examples=40, deadline=None, derandomize=True)
@given(st.integers(0, 2**32 - 1), st.integers(1, 20), st.integers(1, 20))
def test_windows_are_those_cut_out_of_the_picture(seed: int, width: int, height: int):
    rng = np.random.default_rng(seed)
    rgb, bins = colours(seed), HueSaturationValueBins()
    corners = rng.integers(-10, [WIDTH + 10, HEIGHT + 10], (6, 2))
    centres = corners + np.array([width - 1, height - 1]) / 2 + rng.uniform(-0.4, 0.4, (6, 2))
    counts = picture_of(bins, rgb).windows(centres, (width, height), (width, height)).histograms()
    for (left, top), found in zip(corners, counts, strict=True):
        inside = rgb[max(top, 0) : max(top + height, 0), max(left, 0) : max(left + width, 0)]
        expected = by_opencv(np.ascontiguousarray(inside), bins) if inside.size else np.zeros(bins.size)
        np.testing.assert_array_equal(found, expected)


def test_a_window_of_fewer_samples_takes_them_evenly():
    bins = HueSaturationValueBins()
    samples = picture_of(bins, colours(1)).windows([[30.0, 20.0]], (12, 30), (4, 10))
    every_third = picture_of(bins, colours(1)[7:35:3, 26:37:3])
    np.testing.assert_array_equal(samples.histograms()[0], whole(every_third))


def test_windows_may_differ_in_size_and_lie_nowhere():
    picture = picture_of(HueSaturationValueBins(), colours(2))
    centres = [[30.0, 20.0], [30.0, 20.0], [np.nan, np.nan], [1e9, -1e9]]
    counts = picture.windows(centres, [(4, 4), (8, 8), (4, 4), (4, 4)], (4, 4)).histograms()
    assert counts.sum(axis=1).tolist() == [16, 16, 0, 0]
    assert not np.array_equal(counts[0], counts[1])
    assert picture.windows(np.empty((0, 2)), (4, 4), (4, 4)).histograms().shape == (0, 110)


def test_only_the_foreground_counts_where_asked():
    bins, rgb = HueSaturationValueBins(), colours(3)
    mask = np.random.default_rng(3).random((HEIGHT, WIDTH)) < 0.3
    np.testing.assert_array_equal(whole(bins.binned(hsv_of(rgb), mask)), by_opencv(rgb, bins, mask))


def test_samples_anywhere_are_the_pixels_they_fall_in():
    bins, rgb = HueSaturationValueBins(), colours(4)
    pixels = [[-0.5, -0.5], [0.49, 0.49], [WIDTH - 0.51, 0], [-0.51, 0], [WIDTH - 0.5, 0], [np.nan, 0]]
    each = picture_of(bins, rgb).windows(pixels, (1, 1), (1, 1)).histograms()
    np.testing.assert_array_equal(each.sum(axis=0), by_opencv(rgb[:1, [0, 0, -1]].copy(), bins))
    assert each.sum(axis=1).tolist() == [1, 1, 1, 0, 0, 0]


@pytest.mark.parametrize("grey", [0, 20])
def test_a_set_of_pixels_is_binned_one_by_one(grey: int):
    histogram = ColourHistogram(HistogramOptions(hue_bins=360, grey_bins=grey, smoothing_deg=0.0))
    rng = np.random.default_rng(5)
    rgb, inside = colours(5, 7, 90), rng.random((7, 90)) < 0.7
    of_each = histogram.of_pixels(rgb.reshape(-1, 1, 3), inside.reshape(-1, 1)).reshape(7, 90, -1)
    together = histogram.of_pixels(rgb, inside)
    np.testing.assert_allclose(together, of_each.sum(axis=1) / inside.sum(axis=1)[:, None], atol=1e-5)
    np.testing.assert_allclose(together.sum(axis=1), 1)


def test_bhattacharyya_distance_is_opencvs():
    counts = np.random.default_rng(6).integers(0, 9, (8, 110)).astype(float)
    histograms = normalised(counts)
    distance = bhattacharyya_distance(histograms[:3], histograms)
    for row in range(3):
        for column in range(8):
            theirs = cv2.compareHist(
                histograms[row].astype(np.float32), histograms[column].astype(np.float32), cv2.HISTCMP_BHATTACHARYYA
            )
            assert distance[row, column] == pytest.approx(theirs, abs=1e-3)
    np.testing.assert_allclose(np.diagonal(distance), 0, atol=1e-7)
    np.testing.assert_array_equal(bhattacharyya_distance(histograms, np.zeros((1, 110))), np.ones((8, 1)))
