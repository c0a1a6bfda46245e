"""Disparities of two rectified images by OpenCV's semi-global block matching."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from trackers.configuration import Strict

_STEPS = 16
"""Fixed-point steps per pixel of `cv2.StereoSGBM`."""

_MODES = {"3-way": "STEREO_SGBM_MODE_SGBM_3WAY", "5-way": "STEREO_SGBM_MODE_SGBM", "8-way": "STEREO_SGBM_MODE_HH"}


class Matching(Strict):
    """Semi-global block matching (Hirschmüller 2008, `cv2.StereoSGBM`) on grey pictures, to 1/16 px.

    A disparity's cost is a Birchfield–Tomasi difference over blocks of `block_px` (odd). Along `paths` ('3-way' is the
    fastest, '8-way' the densest) a step of one pixel costs `smooth` · block², a larger one `jump` · block². A match
    stands when its cost is `unique_percent` below the next best's, when matching from the right agrees within
    `left_right_px`, and when its patch of like disparities (within `speckle_range_px` from pixel to pixel) has at
    least `speckle_px` pixels; elsewhere is a hole.
    """

    block_px: int = Field(
        default=5, ge=1, le=21, description="side of the blocks that are compared, an odd number [px]"
    )
    smooth: float = Field(
        default=8.0,
        gt=0,
        le=1000,
        description="cost of a step of one pixel of disparity between neighbours, times block_px²",
    )
    jump: float = Field(
        default=32.0,
        gt=0,
        le=1000,
        description="cost of a larger step of disparity between neighbours, times block_px²; above `smooth`",
    )
    unique_percent: int = Field(default=8, ge=0, le=50, description="how far the next best match must cost more [%]")
    left_right_px: int = Field(
        default=1, ge=0, le=16, description="largest difference between matching from the left and from the right [px]"
    )
    speckle_px: int = Field(
        default=60,
        ge=0,
        le=10_000,
        description="number of pixels in the smallest patch of like disparities that stands [px]",
    )
    speckle_range_px: int = Field(default=2, ge=1, le=16, description="largest step of disparity within a patch [px]")
    paths: Literal["3-way", "5-way", "8-way"] = Field(
        default="5-way", description="directions along which costs are summed: 3-way is the fastest, 8-way the densest"
    )

    @model_validator(mode="after")
    def _consistent(self) -> Matching:
        if self.block_px % 2 == 0:
            raise ValueError(f"block_px {self.block_px} has no middle; an odd number is valid")
        if self.jump <= self.smooth:
            raise ValueError(f"jump {self.jump:g} is not above smooth {self.smooth:g}; a higher penalty is valid")
        return self


class StereoMatcher:
    """Matches rectified pictures up to a largest disparity; the disparity of a left pixel at column u is u − u′."""

    def __init__(self, matching: Matching, largest_px: float) -> None:
        import cv2

        # SGBM needs a multiple of 16, and cannot find a disparity between its last two.
        self._count = 16 * max(1, int(np.ceil((largest_px + 2) / 16)))
        block = matching.block_px**2
        create: Any = cv2.StereoSGBM.create
        self._sgbm = create(
            minDisparity=0,
            numDisparities=self._count,
            blockSize=matching.block_px,
            P1=round(matching.smooth * block),
            P2=round(matching.jump * block),
            disp12MaxDiff=matching.left_right_px,
            preFilterCap=31,
            uniquenessRatio=matching.unique_percent,
            speckleWindowSize=matching.speckle_px,
            speckleRange=matching.speckle_range_px,
            mode=getattr(cv2, _MODES[matching.paths]),
        )

    def disparity_px(self, left: NDArray[np.uint8], right: NDArray[np.uint8]) -> NDArray[np.float32]:
        """Match each pixel of the left image (height, width, 3) RGB; return its disparity [px], 0 where there is no match."""
        import cv2

        # SGBM skips its leftmost columns, whose far points are in both pictures: additional columns are given for that.
        grey = [
            cv2.copyMakeBorder(
                cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY), 0, 0, self._count, 0, cv2.BORDER_CONSTANT, value=(0.0,)
            )
            for picture in (left, right)
        ]
        steps = self._sgbm.compute(*grey)[:, self._count :]
        return np.maximum(steps, 0).astype(np.float32) / np.float32(_STEPS)
