"""Lenses that can be rendered, and fisheye calibrations by name."""

from __future__ import annotations

import numpy as np
from pydantic import Field, FiniteFloat, PositiveInt

from trackers.cameras import FisheyeIntrinsics
from trackers.cameras.intrinsics import LARGEST_SIDE_PX
from trackers.configuration import Strict
from trackers.errors import InputError

MAX_FIELD_OF_VIEW_DEG = 240.0
"""Widest fisheye that can be rendered: beyond, the obliquely seen side faces would grow without bound."""


class Lens(Strict):
    """A Kannala–Brandt calibration at its own picture size [px], as `cv2.fisheye` gives it; `k` = 0: equidistant.

    `fy` defaults to `fx`, the principal point `cx`, `cy` to the middle of the picture (pixel centres are integers).
    Outside `field_of_view_deg`, the full angle, pixels are black.
    """

    width: PositiveInt = Field(le=LARGEST_SIDE_PX, description="width of the picture that was calibrated [px]")
    height: PositiveInt = Field(le=LARGEST_SIDE_PX, description="height of the picture that was calibrated [px]")
    fx: float = Field(gt=0, allow_inf_nan=False, description="focal length along a row [px]")
    fy: float | None = Field(
        default=None, gt=0, allow_inf_nan=False, description="focal length along a column [px]; none: fx"
    )
    cx: FiniteFloat | None = Field(
        default=None,
        description="column of the principal point, pixel centres are integers [px]; none: the middle of the picture",
    )
    cy: FiniteFloat | None = Field(
        default=None,
        description="row of the principal point, pixel centres are integers [px]; none: the middle of the picture",
    )
    k: tuple[FiniteFloat, FiniteFloat, FiniteFloat, FiniteFloat] = Field(
        default=(0.0, 0.0, 0.0, 0.0), description="coefficients k1 to k4 of θ³, θ⁵, θ⁷, θ⁹; all 0: equidistant"
    )
    field_of_view_deg: float = Field(
        gt=0,
        le=MAX_FIELD_OF_VIEW_DEG,
        description="full angle over which the lens forms an image; outside it pixels are black [deg]",
    )

    def intrinsics(self, size: tuple[int, int] | None = None) -> FisheyeIntrinsics:
        """Return the intrinsics at this image size (width, height) [px], or the lens's own.

        The image is scaled alike in both directions, to fit, and keeps its place relative to the middle. Raises InputError
        where r(θ) stops growing inside the field of view.
        """
        width, height = size or (self.width, self.height)
        scale = min(width / self.width, height / self.height)
        middle_x, middle_y = (self.width - 1) / 2, (self.height - 1) / 2
        cx = self.cx if self.cx is not None else middle_x
        cy = self.cy if self.cy is not None else middle_y
        intrinsics = FisheyeIntrinsics(
            width=width,
            height=height,
            fx=self.fx * scale,
            fy=(self.fy or self.fx) * scale,
            cx=(width - 1) / 2 + (cx - middle_x) * scale,
            cy=(height - 1) / 2 + (cy - middle_y) * scale,
            k=self.k,
            field_of_view_rad=float(np.deg2rad(self.field_of_view_deg)),
        )
        check_fisheye(intrinsics)
        return intrinsics


LENSES = {
    # 185° fill the circle that fits the picture.
    "equidistant_185": Lens(width=600, height=600, fx=300 / float(np.deg2rad(92.5)), field_of_view_deg=185.0),
    # The calibration of OpenCV's own fisheye tests. Its corners see 80° off the axis; r(θ) grows up to 93°.
    "opencv_test_lens": Lens(
        width=1280,
        height=800,
        fx=558.478087865323,
        fy=560.506767351568,
        cx=620.458515360843,
        cy=381.939424848348,
        k=(-0.0014613319981768, -0.00329861110580401, 0.00605760088590183, -0.00374209380722371),
        field_of_view_deg=180.0,
    ),
}
"""Lenses by name."""


def check_fisheye(lens: FisheyeIntrinsics) -> None:
    """Raise InputError if a fisheye's field of view is too wide to render, or the lens cannot be (`check_view`)."""
    field_deg = float(np.rad2deg(lens.field_of_view_rad))
    if field_deg > MAX_FIELD_OF_VIEW_DEG * (1 + 1e-12):
        raise InputError(f"lens: field of view {field_deg:g}° is too wide; at most {MAX_FIELD_OF_VIEW_DEG:g}° is valid")
    lens.check_view()
