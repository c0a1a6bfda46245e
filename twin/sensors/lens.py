"""Fisheye lenses: calibrations by name, and the way back from a pixel to the direction it sees."""

from __future__ import annotations

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray
from pydantic import Field, FiniteFloat, PositiveInt

from trackers.configuration import Strict
from trackers.errors import InputError
from trackers.rig import FisheyeIntrinsics

MAX_FIELD_OF_VIEW_DEG = 240.0
"""The widest lens that can be rendered: beyond it the side faces, seen at a slant, would grow without bound."""


class Lens(Strict):
    """A Kannala–Brandt calibration at its own picture size [px], as `cv2.fisheye` gives it; `k` = 0: equidistant.

    `fy` defaults to `fx`, the principal point `cx`, `cy` to the middle of the picture (pixel centres are integers).
    Outside `field_of_view_deg`, the full angle, pixels are black.
    """

    width: PositiveInt = Field(le=8192, description="width of the picture that was calibrated [px]")
    height: PositiveInt = Field(le=8192, description="height of the picture that was calibrated [px]")
    fx: float = Field(gt=0, description="focal length along a row [px]")
    fy: float | None = Field(default=None, gt=0, description="focal length along a column [px]; none: fx")
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
        """The intrinsics at this picture size (width, height) [px], or the lens's own.

        The picture is scaled alike in both directions, to fit, and keeps its place relative to the middle.
        Raises InputError where r(θ) stops growing inside the field of view.
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
        check_lens(intrinsics)
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


def radius_of_angle(lens: FisheyeIntrinsics) -> Polynomial:
    """r(θ), the distance from the principal point as a fraction of the focal length, θ in radians."""
    k1, k2, k3, k4 = lens.k
    return Polynomial([0, 1, 0, k1, 0, k2, 0, k3, 0, k4])


def check_lens(lens: FisheyeIntrinsics) -> None:
    """Raise InputError if the field of view is too wide to render, or r(θ) stops growing inside it."""
    field_deg = float(np.rad2deg(lens.field_of_view_rad))
    if field_deg > MAX_FIELD_OF_VIEW_DEG * (1 + 1e-12):
        raise InputError(f"lens: field of view {field_deg:g}° is too wide; at most {MAX_FIELD_OF_VIEW_DEG:g}° is valid")
    roots = radius_of_angle(lens).deriv().trim().roots()
    turns = roots.real[(np.abs(roots.imag) < 1e-9) & (roots.real > 0)]
    if turns.size and turns.min() <= lens.field_of_view_rad / 2:
        raise InputError(
            f"lens: with k = {list(lens.k)} the picture folds back {np.rad2deg(turns.min()):.1f}° from the axis; "
            f"a field of view below {np.rad2deg(2 * turns.min()):.1f}° is valid, not {field_deg:g}°"
        )


def angle_of_radius(lens: FisheyeIntrinsics, radius: NDArray[np.float64]) -> NDArray[np.float64]:
    """Angle from the optical axis [rad] at which r(θ) takes each value; NaN outside the field of view.

    Needs a lens that `check_lens` accepts.
    """
    r_of_theta = radius_of_angle(lens)
    slope = r_of_theta.deriv()
    grid = np.linspace(0, lens.field_of_view_rad / 2, 4096)
    at_grid = r_of_theta(grid)
    inside = radius <= at_grid[-1]
    wanted = np.where(inside, radius, at_grid[-1])
    theta = np.interp(wanted, at_grid, grid)
    for _ in range(3):  # Newton's method, begun within 4e-4 rad
        theta = theta - (r_of_theta(theta) - wanted) / slope(theta)
    return np.where(inside, theta, np.nan)


def viewing_directions(lens: FisheyeIntrinsics) -> NDArray[np.float64]:
    """Unit vectors that the pixels' centres see, in the camera frame (x right, y down, z ahead), (height, width, 3).

    NaN outside the field of view.
    """
    x, y = np.meshgrid((np.arange(lens.width) - lens.cx) / lens.fx, (np.arange(lens.height) - lens.cy) / lens.fy)
    radius = np.hypot(x, y)
    theta = angle_of_radius(lens, radius)
    across = np.ones_like(radius)
    np.divide(np.sin(theta), radius, out=across, where=radius > 0)
    directions = np.empty((lens.height, lens.width, 3))
    directions[..., 0], directions[..., 1], directions[..., 2] = across * x, across * y, np.cos(theta)
    return directions
