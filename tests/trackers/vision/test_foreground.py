"""Foreground masks of cameras: what differs from the empty room, shadows and specks left out."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy import ndimage

from trackers.cameras import PinholeIntrinsics
from trackers.errors import InputError
from trackers.observations import NS_PER_S, DepthImage, Image
from trackers.vision.foreground import Foreground, ForegroundOptions

WIDTH, HEIGHT = 80, 60
LENS = PinholeIntrinsics(width=WIDTH, height=HEIGHT, fx=60, fy=60, cx=39.5, cy=29.5)
BODY = (slice(20, 45), slice(30, 50))  # rows, columns
RAW = {"erode_px": 0, "dilate_px": 0, "least_area_px": 0}
WALL, FLOOR = (180, 170, 150), (150, 110, 70)


def room(seed: int = 0, noise: float = 2.0) -> np.ndarray:
    """A wall over a wooden floor, with the noise of a camera."""
    rgb = np.empty((HEIGHT, WIDTH, 3))
    rgb[: HEIGHT // 2], rgb[HEIGHT // 2 :] = WALL, FLOOR
    rgb += noise * np.random.default_rng(seed).standard_normal(rgb.shape)
    return np.rint(rgb).clip(0, 255).astype(np.uint8)


def picture(rgb: np.ndarray, t: float = 0.0) -> Image:
    return Image("camera", round(t * NS_PER_S), rgb)


def with_body(colour: tuple[int, int, int], seed: int = 1) -> np.ndarray:
    rgb = room(seed)
    rgb[BODY] = colour
    return rgb


def shaded(share: float, seed: int = 1) -> np.ndarray:
    rgb = room(seed).astype(float)
    rgb[BODY] *= share
    return np.rint(rgb).astype(np.uint8)


def of_body(mask: np.ndarray) -> tuple[float, float]:
    """The share of the body that is foreground, and the share of the rest."""
    body = np.zeros(mask.shape, bool)
    body[BODY] = True
    return float(mask[body].mean()), float(mask[~body].mean())


def foreground(pictures: int = 5, **options: float | bool) -> Foreground:
    empty = [picture(room(100 + seed)) for seed in range(pictures)]
    return Foreground(LENS, empty, ForegroundOptions.model_validate(options))


def test_the_empty_room_has_no_foreground():
    assert not foreground().mask(picture(room())).any()
    assert foreground(**RAW).mask(picture(room())).mean() < 0.001


@pytest.mark.parametrize("colour", [(200, 40, 40), (30, 30, 30), (250, 250, 250), (60, 90, 160), (40, 120, 60)])
def test_a_body_of_any_colour_is_foreground(colour: tuple[int, int, int]):
    on_body, beside = of_body(foreground(**RAW).mask(picture(with_body(colour))))
    assert on_body > 0.99
    assert beside < 0.001


def test_hue_alone_tells_too():
    turned = room()
    turned[30:45, 30:50] = room()[30:45, 30:50, [1, 2, 0]]  # as light and as saturated as the floor
    mask = foreground(**RAW).mask(picture(turned))
    assert mask[30:45, 30:50].mean() > 0.99
    assert mask.sum() < 15 * 20 + 5


@pytest.mark.parametrize("hue_deg", [100, 350])
def test_hue_counts_from_twenty_degrees_on_all_around_the_circle(hue_deg: int):
    def plain(hue_deg: int) -> Image:
        hsv = np.full((HEIGHT, WIDTH, 3), (hue_deg % 360 // 2, 200, 200), np.uint8)
        return picture(np.asarray(cv2.cvtColor(hsv, cv2.COLOR_HSV2RGB), np.uint8))

    before = Foreground(LENS, [plain(hue_deg)], ForegroundOptions.model_validate(RAW))
    changed = [bool(before.mask(plain(hue_deg + off)).any()) for off in (-26, -14, 14, 26)]
    assert changed == [True, False, False, True]


@pytest.mark.parametrize("share", [0.6, 0.7, 0.8])
def test_a_cast_shadow_is_not_foreground(share: float):
    on_body, _ = of_body(foreground(**RAW).mask(picture(shaded(share))))
    assert on_body < 0.05
    on_body, _ = of_body(foreground(**RAW, shadows=False).mask(picture(shaded(share))))
    assert on_body > 0.95


def test_where_no_shadow_can_fall_nothing_is_one():
    on_wall = np.zeros((HEIGHT, WIDTH), np.bool_)
    on_wall[: HEIGHT // 2] = True
    empty = [picture(room(seed)) for seed in range(5)]
    mask = Foreground(LENS, empty, ForegroundOptions.model_validate(RAW), ~on_wall).mask(picture(shaded(0.7)))
    assert mask[BODY][on_wall[BODY]].mean() > 0.95
    assert mask[BODY][~on_wall[BODY]].mean() < 0.05


def test_what_is_darker_than_any_shadow_is_foreground():
    on_body, _ = of_body(foreground(**RAW).mask(picture(shaded(0.3))))
    assert on_body > 0.99


def test_noise_makes_no_colours_in_the_dark():
    rng = np.random.default_rng(0)
    dark = [picture(rng.integers(0, 16, (HEIGHT, WIDTH, 3), dtype=np.uint8)) for _ in range(6)]
    assert not Foreground(LENS, dark[:5], ForegroundOptions.model_validate(RAW)).mask(dark[5]).any()


def test_specks_and_thin_lines_go_and_bodies_keep_their_size():
    rgb = with_body((200, 40, 40))
    rgb[5, 10:70] = 0  # a line one pixel wide
    rgb[8:12, 4:8] = 0  # a speck of 4 × 4
    mask = foreground().mask(picture(rgb))
    assert not mask[:14].any()
    on_body, beside = of_body(mask)
    assert on_body == 1
    assert beside < 0.03  # dilated a pixel wider than eroded
    assert foreground(least_area_px=10).mask(picture(rgb))[:14].any()


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(0, 40), st.sampled_from((0.001, 0.03, 0.1, 0.12)))
def test_regions_left_are_those_of_the_least_size(seed: int, least: int, share: float):
    rgb = room()
    rgb[np.random.default_rng(seed).random((HEIGHT, WIDTH)) < share] = 0
    raw = Foreground(LENS, [picture(room())], ForegroundOptions.model_validate(RAW)).mask(picture(rgb))
    large = ForegroundOptions.model_validate(RAW | {"least_area_px": least})
    left = Foreground(LENS, [picture(room())], large).mask(picture(rgb))
    label = np.empty(raw.shape, np.intp)
    ndimage.label(raw, np.ones((3, 3)), output=label)
    np.testing.assert_array_equal(left, raw & (np.bincount(label.ravel())[label] >= least))


def test_a_flicker_in_one_of_the_empty_pictures_is_outvoted():
    empty = [picture(room(seed)) for seed in range(4)] + [picture(with_body((0, 0, 0)))]
    assert not Foreground(LENS, empty).mask(picture(room(9))).any()


def test_a_background_is_learned_from_the_pictures_before():
    learner = Foreground(LENS)
    assert learner.learns_background
    assert not foreground().learns_background
    assert not learner.mask(picture(room(), 0.0)).any()
    on_body, beside = of_body(learner.mask(picture(with_body((200, 40, 40)), 0.1)))
    assert on_body > 0.99
    assert beside < 0.03


def test_who_stands_still_becomes_background_as_fast_as_it_drifts():
    learner = Foreground(LENS, options=ForegroundOptions(shadows=False))
    learner.mask(picture(room(noise=0), 0.0))
    body = room(noise=0)
    body[BODY] = np.array(WALL, np.uint8) - 80
    body[30:] = room(noise=0)[30:]
    shares = [learner.mask(picture(body, 0.1 * moment)).mean() for moment in range(1, 80)]
    # it takes 80 levels, less the 25 that do not count as a change, at 12 a second
    gone = next(moment for moment, share in enumerate(shares) if share == 0)
    assert 4.2 < 0.1 * gone < 5.2
    assert learner.mask(picture(room(noise=0), 8.1)).any()  # and whoever leaves then, leaves a hole


def test_a_picture_from_the_past_teaches_nothing():
    one, other = Foreground(LENS), Foreground(LENS)
    for learner in (one, other):
        learner.mask(picture(room(), 5.0))
    one.mask(picture(with_body((0, 0, 0)), 4.0))
    one.mask(picture(with_body((0, 0, 0)), 5.0))
    np.testing.assert_array_equal(one.mask(picture(shaded(0.8), 6.0)), other.mask(picture(shaded(0.8), 6.0)))


def test_a_depth_picture_has_colours_too():
    image = DepthImage("camera", 0, with_body((200, 40, 40)), np.ones((HEIGHT, WIDTH), np.float32))
    assert of_body(foreground().mask(image))[0] == 1


def test_pictures_of_another_size_are_refused():
    small = picture(np.zeros((30, 40, 3), np.uint8))
    with pytest.raises(
        InputError, match=r"image of 'camera' has shape \(30, 40, 3\); the rig's intrinsics say \(60, 80"
    ):
        foreground().mask(small)
    with pytest.raises(InputError, match="intrinsics"):
        Foreground(LENS, [small])


def test_a_constant_that_was_an_option_is_accepted_with_its_value_alone():
    assert ForegroundOptions.model_validate({"shadow_darkest": 0.5}) == ForegroundOptions()
    with pytest.raises(ValueError, match=r"shadow_darkest: is no option any more, and always 0\.5 \(got 0\.9\)"):
        ForegroundOptions.model_validate({"shadow_darkest": 0.9})
