"""The numbers of colours, against the definition of Y, Cr and Cb."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis.extra.numpy import arrays

from trackers.vision.head_colours import COLOURS, colour_numbers


def steps(numbers):
    """Steps of lightness, red chroma and blue chroma."""
    return np.stack([numbers >> 6, (numbers >> 3) & 7, numbers & 7]).astype(int)


def test_red_is_red_and_blue_is_blue():
    red, blue, grey = np.array([[[220, 30, 30], [30, 30, 220], [128, 128, 128]]], np.uint8)[0]
    red, blue, grey = (steps(colour_numbers(each.reshape(1, 1, 3)))[:, 0, 0] for each in (red, blue, grey))
    assert red[1] > grey[1] > blue[1]
    assert blue[2] > grey[2] > red[2]


@given(rgb=arrays(np.uint8, (4, 5, 3)))
def test_numbers_are_of_the_colour_to_a_step(rgb):
    """ITU-R BT.601; five or six bits of a channel leave 8 levels open, which is a step at most."""
    r, g, b = np.moveaxis(rgb.astype(float), -1, 0)
    luma = 0.299 * r + 0.587 * g + 0.114 * b
    red, blue = 0.713 * (r - luma) + 128, 0.564 * (b - luma) + 128
    expected = np.stack([luma // 16, ((red - 112) // 8).clip(0, 7), ((blue - 84) // 8).clip(0, 7)])
    numbers = colour_numbers(rgb)
    assert np.abs(steps(numbers) - expected).max() <= 1
    assert ((numbers >= 0) & (numbers < COLOURS)).all()
