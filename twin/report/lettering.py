"""Text on pictures: OpenCV's own outline font, measured once and drawn crisp at any size."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from twin.report.palette import RGB

REGULAR, BOLD = 400, 650
TAG_PX = 14
"""Default height of a tag's letters."""


@cache
def _font() -> cv2.FontFace:
    return cv2.FontFace("sans")


@lru_cache(maxsize=512)
def text_width(text: str, size_px: int, weight: int = REGULAR) -> int:
    """Return the width [px] of a text written by `write`."""
    # The size of the picture only matters for wrapping, which is off.
    _, _, width, _ = cv2.getTextSize((8, 8), text, (0, 0), _font(), size_px, weight)
    return int(width)


def write(
    canvas: NDArray[np.uint8],
    text: str,
    x: float,
    baseline: float,
    colour: RGB,
    size_px: int,
    weight: int = REGULAR,
    align: Literal["left", "centre", "right"] = "left",
) -> None:
    """Write a line of text on an RGB canvas; x is its left end, middle or right end by `align` [px]."""
    if align != "left":
        x -= text_width(text, size_px, weight) / (2 if align == "centre" else 1)
    cv2.putText(canvas, text, (round(x), round(baseline)), colour, _font(), size_px, weight)


@dataclass(frozen=True)
class Tag:
    """A bold text on a filled box whose middle is at (x, y) [px]."""

    text: str
    x: float
    y: float
    fill: RGB
    colour: RGB


def write_tags(canvas: NDArray[np.uint8], tags: Sequence[Tag], size_px: int = TAG_PX) -> None:
    """Write tags, kept inside the canvas; overlapping ones move up."""
    height, width = canvas.shape[:2]
    half_height = size_px * 0.72
    placed: list[tuple[float, float, float]] = []  # x, y, half width
    for tag in sorted(tags, key=lambda tag: (-tag.y, tag.x)):
        half_width = text_width(tag.text, size_px, BOLD) / 2 + 5
        x = float(np.clip(tag.x, half_width, width - half_width))
        y = min(tag.y, height - half_height)
        for other_x, other_y, other_half_width in placed:  # from the lowest up
            if abs(x - other_x) < half_width + other_half_width and abs(y - other_y) < 2 * half_height:
                y = other_y - 2 * half_height - 1
        y = max(y, half_height)
        placed.append((x, y, half_width))
        placed.sort(key=lambda place: -place[1])
        corner = (round(x - half_width), round(y - half_height))
        opposite = (round(x + half_width), round(y + half_height))
        cv2.rectangle(canvas, corner, opposite, tag.fill, -1)
        write(canvas, tag.text, x, y + size_px * 0.36, tag.colour, size_px, BOLD, "centre")
