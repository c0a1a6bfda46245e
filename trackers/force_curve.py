"""Conversion between the load on a force-sensing resistor and the 8-bit value of its voltage divider."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from trackers.arrays import Array
from trackers.configuration import Strict

FULL_SCALE = 255
"""Value of an element without resistance: the whole supply voltage."""


class ForceCurve(Strict):
    """Force-sensing resistor in a divider with a measuring resistor, digitised to 8 bits.

    Its conductance grows with load^`exponent` (resistance falls as an inverse power law); the divider's share of the supply
    voltage is 1 / (1 + (half_scale_n / load)^exponent): one half where the resistance equals the measuring resistor's. Below
    `threshold_n` the element reads 0; above `saturation_n` it is constant. All in newton on the element.

    Source: Interlink Electronics, FSR integration guide (force curve with turn-on threshold, power law and saturation at a
    pressure; voltage divider). Default: 10 kg/cm² on 14.5 cm² (the 38.1 mm square of FSR 406), so that one element holds the
    step of a walking adult.
    """

    half_scale_n: float = Field(
        default=200.0, gt=0, allow_inf_nan=False, description="load at which an element reads half of 255 [N]"
    )
    exponent: float = Field(default=0.9, gt=0, le=2, description="power of the load with which the conductance grows")
    threshold_n: float = Field(
        default=5.0, ge=0, allow_inf_nan=False, description="load below which an element reads 0 [N]"
    )
    saturation_n: float = Field(
        default=1422.0, gt=0, allow_inf_nan=False, description="load above which an element reads no more [N]"
    )

    @model_validator(mode="after")
    def _consistent(self) -> ForceCurve:
        if self.threshold_n >= self.saturation_n:
            raise ValueError(f"threshold_n {self.threshold_n:g} must be below saturation_n {self.saturation_n:g}")
        if self.full_value < 1:
            raise ValueError(
                f"half_scale_n {self.half_scale_n:g} is so far above saturation_n {self.saturation_n:g} that no load is "
                f"ever seen in 8 bits; one below it is valid"
            )
        return self

    @property
    def full_value(self) -> int:
        """Reading of a saturated element."""
        return int(np.rint(self.signal(np.array(self.saturation_n))))

    def signal(self, load_n: Array) -> Array:
        """Compute the divider's voltage in 8-bit steps, before rounding, for loads of any shape [N]."""
        held = np.minimum(load_n, self.saturation_n)
        conductance = (held / self.half_scale_n) ** self.exponent  # relative to the measuring resistor's
        return np.where(load_n >= self.threshold_n, FULL_SCALE * conductance / (1 + conductance), 0.0)

    def values(self, load_n: Array) -> NDArray[np.uint8]:
        """Return the readings of elements under these loads [N], same shape."""
        return np.rint(self.signal(load_n)).astype(np.uint8)

    def load_n(self, values: NDArray[np.uint8]) -> Array:
        """Convert values to loads [N], same shape: 0 for 0, saturation_n from a saturated element's value on.

        Inverse of `values` to half an 8-bit step, between threshold and saturation.
        """
        return self._loads[values]

    @property
    def _loads(self) -> Array:
        """The load of each of the 256 values [N]."""
        share = np.arange(1, FULL_SCALE) / FULL_SCALE
        loads = np.full(FULL_SCALE + 1, self.saturation_n)
        loads[0] = 0.0
        loads[1:-1] = self.half_scale_n * (share / (1 - share)) ** (1 / self.exponent)
        loads[self.full_value :] = self.saturation_n
        return np.minimum(loads, self.saturation_n)
