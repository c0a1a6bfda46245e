"""Pictures of dark rooms: what counts as foreground is the same in any light."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from synthetic_view import picture, rig

from trackers.errors import InputError
from trackers.observations import Image
from trackers.vision.front_end import CameraFrontEnd, FrontEndOptions

PLACES = np.array([[-1.5, 0.0], [0.5, 1.0], [2.0, -1.0]])
DULL = ((70, 60, 60), (150, 150, 150), (95, 100, 105))


def seen_in(light: float, tolerance: float = 0.08) -> np.ndarray:
    """Return the foreground of people in dull clothes, in a room of which this share of the light is left."""
    on = rig()

    def dimmed(image: Image) -> Image:
        return replace(image, rgb=np.asarray(cv2.convertScaleAbs(image.rgb, alpha=light), np.uint8))

    nobody = [dimmed(picture(on, 0.1 * k, np.empty((0, 2)), noise=1)) for k in range(5)]
    front_end = CameraFrontEnd("camera", on.cameras()["camera"], nobody, FrontEndOptions(exposure_tolerance=tolerance))
    prepared = front_end.prepare(dimmed(picture(on, 1.0, PLACES, DULL, noise=1)))
    assert prepared is not None
    return prepared.mask


@pytest.mark.parametrize("light", [0.2, 0.35, 0.5, 0.8])
def test_the_foreground_of_a_dark_room_is_that_of_a_lit_one(light: float) -> None:
    lit, dark = seen_in(1.0), seen_in(light)
    assert lit.sum() > 1000
    assert (lit ^ dark).sum() < 0.05 * lit.sum()


def test_exposure_is_left_as_it_is_where_the_options_say_so() -> None:
    lit, dark = seen_in(1.0, tolerance=0.0), seen_in(0.2, tolerance=0.0)
    assert dark.sum() < 0.6 * lit.sum()


def test_an_empty_room_in_full_darkness_is_lightened_within_bounds() -> None:
    on = rig()
    nobody = Image("camera", 0, np.zeros((240, 320, 3), np.uint8))
    front_end = CameraFrontEnd("camera", on.cameras()["camera"], [nobody], FrontEndOptions())
    prepared = front_end.prepare(replace(nobody, rgb=np.full((240, 320, 3), 1, np.uint8)))
    assert prepared is not None
    assert prepared.image.rgb.max() <= 10


@pytest.mark.parametrize("size", [(0, 0), (0, 320), (24, 32)])
def test_a_picture_of_another_size_is_refused_in_a_dark_room_too(size: tuple[int, int]) -> None:
    """The size is compared before the exposure: a picture without pixels has none to lighten."""
    camera, dark = rig().cameras()["camera"], Image("camera", 0, np.full((240, 320, 3), 20, np.uint8))
    other = replace(dark, rgb=np.zeros((*size, 3), np.uint8))
    with pytest.raises(InputError, match="the rig's intrinsics say"):
        CameraFrontEnd("camera", camera, [dark, other], FrontEndOptions())
    front_end = CameraFrontEnd("camera", camera, [dark], FrontEndOptions())
    for look in (front_end.prepare, front_end.pass_over):
        with pytest.raises(InputError, match="the rig's intrinsics say"):
            look(other)
