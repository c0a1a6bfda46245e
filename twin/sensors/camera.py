"""Cameras apart from rendering: lenses, noise of image sensors, and stereo matching.

A scenario describes cameras by these; reading one imports neither MuJoCo nor a renderer. Noise: exposure, shot noise, read
noise, white balance. Disparities of two rectified images come from OpenCV's semi-global block matching.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field, FiniteFloat, model_validator

from trackers.cameras import FisheyeIntrinsics
from trackers.cameras.intrinsics import Side
from trackers.configuration import Strict
from trackers.errors import InputError
from trackers.observations import Image

MAX_FIELD_OF_VIEW_DEG = 240.0
"""Widest fisheye that can be rendered: beyond, the obliquely seen side faces would grow without bound."""

FocalLengthOfRows = Annotated[
    float | None, Field(gt=0, allow_inf_nan=False, description="focal length along a column [px]; none: fx")
]

PrincipalColumn = Annotated[
    FiniteFloat | None,
    Field(
        description="column of the principal point, pixel centres are integers [px]; none: the middle of the picture"
    ),
]

PrincipalRow = Annotated[
    FiniteFloat | None,
    Field(description="row of the principal point, pixel centres are integers [px]; none: the middle of the picture"),
]


class Lens(Strict):
    """A Kannala–Brandt calibration at its own picture size [px], as `cv2.fisheye` gives it; `k` = 0: equidistant.

    `fy` defaults to `fx`, the principal point `cx`, `cy` to the middle of the picture (pixel centres are integers).
    Outside `field_of_view_deg`, the full angle, pixels are black.
    """

    width: Side = Field(description="width of the picture that was calibrated [px]")
    height: Side = Field(description="height of the picture that was calibrated [px]")
    fx: float = Field(gt=0, allow_inf_nan=False, description="focal length along a row [px]")
    fy: FocalLengthOfRows = None
    cx: PrincipalColumn = None
    cy: PrincipalRow = None
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
        # SGBM skips its leftmost columns, whose far points are in both pictures: additional columns are given for that.
        grey = [
            cv2.copyMakeBorder(
                cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY), 0, 0, self._count, 0, cv2.BORDER_CONSTANT, value=(0.0,)
            )
            for picture in (left, right)
        ]
        steps = self._sgbm.compute(*grey)[:, self._count :]
        return np.maximum(steps, 0).astype(np.float32) / np.float32(_STEPS)


_UNIT = 16
"""Fixed-point steps per unit, for the noise bank and for σ; their product is shifted back by 8 bits."""

_SPARE = 1 << 18
"""Samples of the bank beyond one frame: the number of possible starts of a frame's noise."""


_Gain = Annotated[float, Field(gt=0, le=8)]
WhiteBalance = tuple[_Gain, _Gain, _Gain]
"""Gains on red, green and blue."""


@dataclass(frozen=True, eq=False)
class NoiseBank:
    """Normal noise drawn once; each frame uses a stretch from a random start."""

    unit_noise: NDArray[np.int16]  # (frame size + _SPARE,) standard normal, in steps of 1 / _UNIT
    sigma: NDArray[np.int16]  # (256,) σ at each grey value, in steps of 1 / _UNIT


class CameraNoise(Strict):
    """Exposure and temporal noise, in grey values (0 to 255), equal and independent in red, green and blue.

    The ideal value is scaled by `exposure_gain` (saturating); then normal noise with variance `read_sigma`² + `shot` · value
    is added: read noise, and photon shot noise in its normal limit (EMVA 1288, linear camera model). Values are rounded and
    saturated to 8 bits; then each channel, noise included, is multiplied by its gain in `white_balance` [red, green, blue],
    as a camera balances raw values, and saturated again.

    Simplified: noise is drawn once per sensor and each frame uses it from one of 2¹⁸ random starts with a random sign,
    truncated at 6 σ; no fixed pattern, no demosaicking, no gamma, no motion blur.
    """

    read_sigma: float = Field(
        default=0.0, ge=0, le=10, description="standard deviation of the read noise [grey values of 255]"
    )
    shot: float = Field(
        default=0.0, ge=0, le=1, description="variance of the shot noise over the grey value [grey values]"
    )
    exposure_gain: float = Field(
        default=1.0, gt=0, le=10, description="factor on the ideal grey values, before the noise"
    )
    white_balance: WhiteBalance = Field(
        default=(1.0, 1.0, 1.0), description="factors on red, green and blue, after the noise"
    )

    @property
    def is_off(self) -> bool:
        """True where the ideal image passes unchanged."""
        return not self._is_noisy and self.exposure_gain == 1 and self.white_balance == (1, 1, 1)

    @property
    def _is_noisy(self) -> bool:
        return bool(self.read_sigma or self.shot)

    def corrupt(
        self, observation: Image, state: NoiseBank | None, rng: np.random.Generator
    ) -> tuple[Image, NoiseBank | None]:
        """Return the image as the device reports it; the state is the noise bank, drawn from `rng` at the first call."""
        rgb, state = self.expose(observation.rgb, state, rng)
        return replace(observation, rgb=rgb), state

    def expose(
        self, rgb: NDArray[np.uint8], state: NoiseBank | None, rng: np.random.Generator
    ) -> tuple[NDArray[np.uint8], NoiseBank | None]:
        """Apply exposure and noise to ideal pixels (height, width, 3); return a new array if anything changes."""
        if self.exposure_gain != 1:
            rgb = np.asarray(cv2.convertScaleAbs(rgb, alpha=self.exposure_gain), dtype=np.uint8)
        if self._is_noisy:
            if state is None or state.unit_noise.size != rgb.size + _SPARE:
                state = self._draw_bank(rgb.size, rng)
            rgb = _with_noise(rgb, state, rng)
        if self.white_balance != (1, 1, 1):
            table = np.rint(np.clip(np.arange(256)[:, None] * np.array(self.white_balance), 0, 255)).astype(np.uint8)
            rgb = np.asarray(cv2.LUT(rgb, table[:, None]), dtype=np.uint8)
        return rgb, state

    def _draw_bank(self, size: int, rng: np.random.Generator) -> NoiseBank:
        sigma = np.sqrt(self.read_sigma**2 + self.shot * np.arange(256))
        unit = rng.standard_normal(size + _SPARE, dtype=np.float32).clip(-6, 6)
        return NoiseBank(np.rint(unit * _UNIT).astype(np.int16), np.rint(sigma * _UNIT).astype(np.int16))


def _with_noise(rgb: NDArray[np.uint8], bank: NoiseBank, rng: np.random.Generator) -> NDArray[np.uint8]:
    start, negative = int(rng.integers(_SPARE)), bool(rng.integers(2))
    noise = cv2.LUT(rgb, bank.sigma)  # (height, width, 3) int16
    np.multiply(noise, bank.unit_noise[start : start + rgb.size].reshape(rgb.shape), out=noise)
    np.add(noise, np.int16(_UNIT * _UNIT // 2), out=noise)
    np.right_shift(noise, 8, out=noise)
    value = rgb.astype(np.int16)
    (np.subtract if negative else np.add)(value, noise, out=value)
    return np.clip(value, 0, 255, out=value).astype(np.uint8)


CAMERA_NOISE = {
    "off": CameraNoise(),
    # An indoor machine-vision camera at moderate gain: signal-to-noise ratio about 36 dB in the lights.
    "default": CameraNoise(read_sigma=1.5, shot=0.03),
    "worse": CameraNoise(read_sigma=5.0, shot=0.2, exposure_gain=0.7),
}
"""Noise by name."""


class StereoNoise(CameraNoise):
    """Noise of both pictures of a stereo camera, and of disparities that are not matched.

    `disparity_sigma_px`: standard deviation of the disparity in mode 'disparity-noise'. In mode 'matched' the error follows
    from matching noisy pictures.
    """

    disparity_sigma_px: float = Field(
        default=0.0, ge=0, le=20, description="standard deviation of the disparity in mode 'disparity-noise' [px]"
    )


STEREO_NOISE = {
    "off": StereoNoise(),
    # A good matcher on a textured scene places an edge to about a quarter of a pixel.
    "default": StereoNoise(read_sigma=1.5, shot=0.03, disparity_sigma_px=0.25),
    "worse": StereoNoise(read_sigma=5.0, shot=0.2, exposure_gain=0.7, disparity_sigma_px=0.75),
}
"""Noise of stereo cameras by name."""
