"""Torso windows and colour histograms."""

import numpy as np
import pytest
from synthetic_room import INTRINSICS, SHIRTS, camera_pose, image, rig, straight_walk

from trackers.laser.clusters import Detections
from trackers.rig import FisheyeSensor
from trackers.vision.histogram import ColourHistogram, HistogramOptions, chi_squared_distance, updated_reference
from trackers.vision.person_windows import TorsoOptions, TorsoProjector

RIG = rig()
NAMES = list(SHIRTS)


def detections_at(points, half_width=0.17) -> Detections:
    """Waist detections at ground points (k, 2) of the room; the scanner looks along +y."""
    points = np.asarray(points, float)
    range_m = np.hypot(points[:, 0], points[:, 1])
    angle = np.arctan2(points[:, 1], points[:, 0]) - np.pi / 2
    half = half_width / range_m
    width_m, scanner = np.full(len(points), 2 * half_width), np.ones((len(points), 1), np.bool_)
    angles = np.stack([angle - half, angle + half], axis=-1)
    return Detections(points, np.zeros(len(points)), np.full(len(points), 9), width_m, range_m, angles, scanner)


def projector(**options) -> TorsoProjector:
    camera = RIG.cameras()["camera"]
    return TorsoProjector(RIG.lasers()["waist"], camera, TorsoOptions(**options))


def torso_histograms(points, shirts, seed=0, **options):
    walk = straight_walk(points, np.zeros_like(np.asarray(points, float)), 1)
    shown = image(walk, 0, 0, np.random.default_rng(seed), shirts)
    windows = projector().windows(detections_at(points))
    return ColourHistogram(HistogramOptions(**options)).of_windows(shown.rgb, windows.pixels, windows.inside), windows


def test_the_window_stands_on_the_torso():
    point = np.array([0.8, 1.5])
    windows = projector(low_m=1.0, high_m=1.3).windows(detections_at([point]))
    corner_heights, across = (1.3, 1.0), np.array([point[1], -point[0]]) / np.hypot(*point)
    pose = camera_pose()
    for row, height in zip((0, -1), corner_heights, strict=True):
        for column, side in ((0, 0.7 * 0.17), (-1, -0.7 * 0.17)):
            # the first angle is the rightmost: counter-clockwise from the right
            expected, _ = INTRINSICS.project(
                (np.append(point + side * across, height) - pose.translation) @ pose.rotation
            )
            np.testing.assert_allclose(windows.pixels[0, row, column], expected, atol=1.0)
    assert windows.usable[0]
    assert windows.clear[0]


@pytest.mark.parametrize(("rgb", "hue_deg"), [((255, 0, 0), 0), ((0, 255, 0), 120), ((0, 0, 255), 240)])
def test_a_pixel_counts_in_the_bin_of_its_hue(rgb, hue_deg):
    plain, inside = np.full((1, 4, 3), rgb, np.uint8), np.ones((1, 4), np.bool_)
    (counts,) = ColourHistogram(HistogramOptions(smoothing_deg=0)).of_pixels(plain, inside)
    assert np.flatnonzero(counts).tolist() == [hue_deg]


def test_windows_that_overlap_are_not_learned_from():
    windows = projector().windows(detections_at([(0.0, 1.2), (0.08, 2.0), (1.2, 1.5)]))
    np.testing.assert_array_equal(windows.usable, [True, True, True])
    np.testing.assert_array_equal(windows.clear, [False, False, True])


def test_windows_outside_the_image_or_of_slivers_are_not_used():
    behind = FisheyeSensor(
        topic="c", room_from_sensor=camera_pose(), intrinsics=INTRINSICS.model_copy(update={"width": 200})
    )
    windows = TorsoProjector(RIG.lasers()["waist"], behind, TorsoOptions()).windows(detections_at([(0.5, 1.5)]))
    assert not windows.usable[0]
    assert not projector(min_width_m=0.12).windows(detections_at([(0.5, 1.5)], half_width=0.04)).usable[0]


def test_the_papers_shirts_are_told_apart_wherever_their_wearers_stand():
    places = np.array([(-1.4, 1.2), (-0.7, 2.4), (0.0, 1.4), (0.8, 2.2), (1.5, 1.3)])
    here, _ = torso_histograms(places, NAMES)
    there, _ = torso_histograms(places, NAMES[2:] + NAMES[:2], seed=1)
    distance = chi_squared_distance(here, there[np.argsort((np.arange(5) + 2) % 5)])
    assert distance.diagonal().max() < 0.25
    assert distance[~np.eye(5, dtype=bool)].min() > 0.6


def test_hue_alone_cannot_tell_white_from_black():
    """Why brightness bins were added to the paper's histogram."""
    places = np.array([(-0.8, 1.5), (0.8, 1.5)])
    ours, _ = torso_histograms(places, ["white", "black"])
    again, _ = torso_histograms(places, ["white", "black"], seed=3)
    hue, _ = torso_histograms(places, ["white", "black"], grey_bins=0, smoothing_deg=0)
    hue_again, _ = torso_histograms(places, ["white", "black"], seed=3, grey_bins=0, smoothing_deg=0)
    assert np.ptp(chi_squared_distance(ours, again)) > 0.8
    assert chi_squared_distance(hue, hue_again).diagonal().max() > 0.2  # noise against noise


def test_the_papers_histogram_is_360_bins_of_hue():
    histogram = ColourHistogram(HistogramOptions(grey_bins=0, smoothing_deg=0))
    assert histogram.size == 360
    rgb = np.array([[(255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 0, 128)]], np.uint8)
    counted = histogram.of_pixels(rgb, np.ones((1, 4), bool))
    np.testing.assert_array_equal(np.flatnonzero(counted[0]), [0, 120, 240, 329])
    np.testing.assert_allclose(counted[0][counted[0] > 0], 0.25)


def test_red_lies_on_both_ends_of_the_circle():
    histogram = ColourHistogram(HistogramOptions(grey_bins=0))
    reds = np.array([[(255, 0, 4)], [(255, 4, 0)], [(0, 255, 0)]], np.uint8)
    counted = histogram.of_pixels(reds, np.ones((3, 1), bool))
    distance = chi_squared_distance(counted, counted)
    assert distance[0, 1] < 0.1
    assert distance[0, 2] == pytest.approx(1)


def test_chi_squared_distance_runs_from_0_to_1_and_is_symmetric():
    rng = np.random.default_rng(0)
    histograms = rng.dirichlet(np.full(360, 0.05), 6)
    distance = chi_squared_distance(histograms, histograms)
    np.testing.assert_allclose(distance.diagonal(), 0)
    np.testing.assert_allclose(distance, distance.T)
    assert ((distance >= 0) & (distance <= 1)).all()
    by_hand = 0.5 * sum((a - b) ** 2 / (a + b) for a, b in zip(histograms[0], histograms[1], strict=True) if a + b > 0)
    assert distance[0, 1] == pytest.approx(by_hand)
    assert chi_squared_distance(np.empty((0, 4)), histograms[:, :4]).shape == (0, 6)


def test_reference_follows_equation_7():
    old, new = np.array([[1.0, 0.0]]), np.array([[0.0, 1.0]])
    np.testing.assert_allclose(updated_reference(old, new, 0.4), [[0.4, 0.6]])


def test_nothing_inside_gives_an_empty_histogram_not_nan():
    histogram = ColourHistogram()
    counted = histogram.of_pixels(np.zeros((2, 5, 3), np.uint8), np.zeros((2, 5), bool))
    np.testing.assert_array_equal(counted, 0)
    np.testing.assert_array_equal(chi_squared_distance(counted, counted), 0)
    assert histogram.of_windows(
        np.zeros((4, 4, 3), np.uint8), np.empty((0, 2, 2, 2)), np.empty((0, 2, 2), bool)
    ).shape == (
        0,
        histogram.size,
    )


def test_pixels_of_points_behind_the_camera_are_left_out():
    rgb = np.full((4, 6, 3), 90, np.uint8)
    pixels = np.tile([1.0, 2.0], (1, 2, 3, 1))
    inside = np.ones((1, 2, 3), np.bool_)
    whole = ColourHistogram().of_windows(rgb, pixels, inside)
    pixels[0, 1], inside[0, 1] = np.nan, False
    np.testing.assert_allclose(ColourHistogram().of_windows(rgb, pixels, inside), whole)
