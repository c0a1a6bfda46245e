"""Windows of people at places of the floor."""

import numpy as np
import pytest
import synthetic_view as view

from trackers.rig import placed_camera
from trackers.vision.person_windows import person_windows


@pytest.mark.parametrize("fisheye", [False, True])
def test_a_window_holds_the_person_and_little_else(fisheye):
    on = view.rig(fisheye)
    camera = placed_camera(on.cameras()["camera"])
    for place in np.array([(0.3, 0.2), (2.0, 1.5), (-2.5, -1.0)]):
        windows = person_windows(camera, place[None], 40, 24)
        pixels = np.rint(windows.pixels[0]).astype(int)
        mask = view.mask(on, place)
        shown = mask[pixels[..., 1], pixels[..., 0]]
        assert shown.any(axis=1).mean() > 0.5  # from the crown to the soles
        assert not shown[:, [0, -1]].any() and not shown[[0, -1]].any()
        cell_px = float(windows.cell_px[0]) ** 2  # every pixel of the person is in some cell
        assert mask.sum() == pytest.approx(shown.sum() * cell_px * _height_over_width(windows), rel=0.25)


def _height_over_width(windows) -> float:
    """A cell's height over its width in the picture, by its neighbours in the middle."""
    rows, columns = windows.pixels.shape[1:3]
    middle = windows.pixels[0, rows // 2, columns // 2]
    down = np.hypot(*(windows.pixels[0, rows // 2 + 1, columns // 2] - middle))
    return float(down / np.hypot(*(windows.pixels[0, rows // 2, columns // 2 + 1] - middle)))


def test_a_window_is_upright_and_its_directions_are_the_view_s():
    camera = placed_camera(view.rig().cameras()["camera"])
    windows = person_windows(camera, np.array([(0.0, 0.0), (3.0, 1.0), (0.0, -7.0)]), 14, 8)
    np.testing.assert_allclose(windows.right[0], (1, 0), atol=1e-9)
    np.testing.assert_allclose(windows.ahead[0], (0, 1), atol=1e-9)
    np.testing.assert_allclose((windows.right * windows.ahead).sum(axis=1), 0, atol=1e-9)
    assert windows.steepness[2] == pytest.approx(1)  # right under the camera
    assert (np.diff(windows.pixels[:2, :, 4, 1], axis=1) > 0).all()  # rows go down the picture
    assert (np.diff(windows.pixels[:2, 7, :, 0], axis=1) > 0).all()  # columns to the right


def test_what_the_picture_does_not_show_is_not_inside():
    camera = placed_camera(view.rig().cameras()["camera"])
    windows = person_windows(camera, np.array([(0.0, 0.0), (4.5, 0.0), (0.0, -30.0)]), 14, 8)
    assert windows.inside[0].all() and 0 < windows.inside[1].mean() < 1 and not windows.inside[2].any()
