"""Noise of a scanner: range noise, mixed pixels, drop-out, quantisation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from trackers.configuration import Strict
from trackers.observations import LaserScan


class LaserNoise(Strict):
    """The errors of a time-of-flight scanner, in the order in which they arise.

    1. Mixed pixels. A beam `divergence_deg` wide that straddles an edge sees both surfaces. Where neighbouring ranges
       differ by more than `edge_m`, the edge lies anywhere between the two beams' axes with equal probability; a beam
       whose footprint reaches over it reports, with probability `mixed_pixel`, the mean of both ranges weighted with
       the share of the footprint on each (Ye and Borenstein 2002, on the SICK LMS200), else its own.
    2. Gaussian noise with standard deviation `sigma_m` + `sigma_per_m` · range.
    3. `quantisation_m`: ranges come in multiples of this step (0: none).
    4. `dropout`: the probability that a beam gets no echo. It then reads +inf, as in REP 117: a scanner cannot tell a
       beam that was swallowed from one that met nothing.

    A range that leaves [range_min_m, range_max_m] on the way is NaN below and +inf above.
    Simplified: errors are independent from beam to beam and scan to scan; no dependence on colour or incidence angle.
    """

    sigma_m: float = Field(default=0.0, ge=0, le=1, description="standard deviation of a range [m]")
    sigma_per_m: float = Field(
        default=0.0, ge=0, le=0.1, description="added standard deviation per metre of range [m/m]"
    )
    quantisation_m: float = Field(
        default=0.0, ge=0, le=1, description="step of which ranges are multiples [m]; 0: none"
    )
    dropout: float = Field(
        default=0.0, ge=0, le=1, description="probability that a beam gets no echo and reads +inf, 0 to 1"
    )
    mixed_pixel: float = Field(
        default=0.0,
        ge=0,
        le=1,
        description="probability that a beam over an edge reports the mean of both surfaces, 0 to 1",
    )
    divergence_deg: float = Field(default=0.86, gt=0, le=10, description="width of a beam [deg]")
    edge_m: float = Field(
        default=0.1,
        gt=0,
        le=10,
        description="difference of neighbouring ranges from which on there is an edge between them [m]",
    )

    @property
    def is_off(self) -> bool:
        """True if the ideal scan passes unchanged."""
        return not (self.sigma_m or self.sigma_per_m or self.quantisation_m or self.dropout or self.mixed_pixel)

    def corrupt(self, observation: LaserScan, state: None, rng: np.random.Generator) -> tuple[LaserScan, None]:
        """Return the scan as the device reports it; keeps no state."""
        scan = observation
        ranges = scan.ranges_m.copy()
        if self.mixed_pixel > 0:
            self._mix(ranges, scan.ranges_m, scan.angle_increment_rad, rng)
        if self.sigma_m > 0 or self.sigma_per_m > 0:
            noise = rng.standard_normal(ranges.size, dtype=np.float32)
            noise *= self._sigma_m(ranges)
            ranges += noise
        if self.quantisation_m > 0:
            ranges /= self.quantisation_m
            np.rint(ranges, out=ranges)
            ranges *= self.quantisation_m
        np.putmask(ranges, ranges < scan.range_min_m, np.nan)
        np.putmask(ranges, ranges > scan.range_max_m, np.inf)
        if self.dropout > 0:
            np.putmask(ranges, rng.random(ranges.size, dtype=np.float32) < self.dropout, np.inf)
        return replace(scan, ranges_m=ranges), None

    def _sigma_m(self, ranges: NDArray[np.float32]) -> float | NDArray[np.float32]:
        """Return the standard deviation [m] at each range; finite where there is no return, which noise leaves as it is."""
        if self.sigma_per_m == 0:
            return self.sigma_m
        finite = np.where(np.isfinite(ranges), ranges, np.float32(0))
        return np.float32(self.sigma_m) + np.float32(self.sigma_per_m) * finite

    def _mix(
        self,
        ranges: NDArray[np.float32],
        ideal: NDArray[np.float32],
        increment_rad: float,
        rng: np.random.Generator,
    ) -> None:
        """Move beams that straddle an edge between the two surfaces, in place."""
        # A jump to +inf or NaN is no mixed pixel: only one surface returns an echo.
        echo = np.where(ideal < np.inf, ideal, np.float32(np.nan))
        left = (np.abs(echo[1:] - echo[:-1]) > self.edge_m).nonzero()[0]
        if left.size == 0:
            return
        beam = np.concatenate([left, left + 1])  # the beams on either side of each edge
        other = np.concatenate([left + 1, left])
        edge = rng.random(left.size)  # place of the edge between the two axes, in beam spacings
        footprint = np.deg2rad(self.divergence_deg) / abs(increment_rad)  # in beam spacings
        # Share of the footprint on the other surface.
        share = 0.5 - np.concatenate([edge, 1 - edge]) / footprint
        mixed = (share > 0) & (rng.random(beam.size) < self.mixed_pixel)
        beam, other, share = beam[mixed], other[mixed], share[mixed]
        ranges[beam] = (1 - share) * ideal[beam] + share * ideal[other]


LASER_NOISE = {
    "off": LaserNoise(),
    # SICK LMS200: σ 5 mm in the 8 m range, 10 mm steps, 15 mrad beam.
    "default": LaserNoise(sigma_m=0.005, quantisation_m=0.01, dropout=0.005, mixed_pixel=0.5),
    "worse": LaserNoise(sigma_m=0.02, sigma_per_m=0.005, quantisation_m=0.01, dropout=0.05, mixed_pixel=0.9),
    # A Hokuyo of 768 beams over 270°, 1 mm steps, as measured on walls 2 m to 9 m away, σ 3.9 mm in the middle of them, 4 of
    # 41 000 readings lost (so the rate is known to a factor of about two), scans of the leg_tracker data set. The share of
    # mixed pixels is not measured; the beam is the 40 mm at 4 m of the maker's URG series.
    "hokuyo": LaserNoise(
        sigma_m=0.0019, sigma_per_m=0.00055, quantisation_m=0.001, dropout=0.0001, mixed_pixel=0.5, divergence_deg=0.57
    ),
}
"""Noise by name."""
