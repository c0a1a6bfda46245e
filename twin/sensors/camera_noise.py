"""Noise of an image sensor: exposure, shot noise, read noise, white balance."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from trackers.configuration import Strict
from trackers.observations import Image

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
        import cv2

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
    import cv2

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
