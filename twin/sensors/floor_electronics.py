"""Electronics of a pressure floor: cover, uneven resistors, hysteresis, read noise, dead and stuck elements."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, NonNegativeInt

from trackers.arrays import Array
from trackers.configuration import Strict
from trackers.observations import FULL_SCALE, FloorFrame, ForceCurve

Cell = tuple[NonNegativeInt, NonNegativeInt]

_GAIN_LEAST = 0.2
"""Least gain of a resistor, since a normal distribution has no lower end."""


@dataclass(frozen=True, eq=False)
class LoadFrame(FloorFrame):
    """Ideal frame with its underlying loads; never leaves the twin (its message carries the values alone)."""

    load_n: Array  # (rows, columns) [N]
    curve: ForceCurve


@dataclass(frozen=True, eq=False)
class FloorParts:
    """Elements of one floor as built, (rows, columns) each: their constant individual properties."""

    gain: Array  # gain of each resistor
    fixed: NDArray[np.int16]  # constant reading of a dead or stuck element; -1 for a working one


class FloorElectronics(Strict):
    """The errors of a floor of force-sensing resistors, in the order in which they arise.

    1. `crosstalk`: this share of an element's load goes to its four neighbours, a quarter to each: the cover bridges them.
       What would leave the grid stays. The sum does not change.
    2. `gain_sigma`: each resistor answers to its load times a factor of its own, normal about 1, drawn once.
    3. `hysteresis`: (what an unloaded resistor still shows - load) / shown. A rising load is shown as it is; a falling
       one once the shown load is larger by this share (a play operator: no creep, no dependence on time).
    4. The force curve's voltage, `read_sigma` of normal noise on it in 8-bit steps, rounded to 8 bits.
    5. Dead elements read 0, stuck ones always the same: those named (`dead_cells` [row, column], `stuck_cells` [row, column,
       value]), and each other one with probability `dead` and `stuck`, at a value drawn once.

    The force curve itself, its threshold, its saturation and the 8 bits are the device's, not errors: they are there when all of
    this is off. Data sheet of Interlink's FSR 400 series: hysteresis 10 %, part to part 6 % within a batch; their
    integration guide: 15 to 25 % between batches. The rest is ours.
    """

    crosstalk: float = Field(
        default=0.0, ge=0, le=0.8, description="share of an element's load that goes to its four neighbours, 0 to 0.8"
    )
    gain_sigma: float = Field(
        default=0.0,
        ge=0,
        le=0.5,
        description="spread of the resistors: standard deviation of the factor on an element's load",
    )
    hysteresis: float = Field(
        default=0.0, ge=0, le=0.5, description="share by which a resistor shows more than the load while the load falls"
    )
    read_sigma: float = Field(
        default=0.0, ge=0, le=50, description="standard deviation of the read noise [steps of 255]"
    )
    dead: float = Field(default=0.0, ge=0, le=1, description="probability that an element reads 0 at all times, 0 to 1")
    stuck: float = Field(
        default=0.0, ge=0, le=1, description="probability that an element reads the same value at all times, 0 to 1"
    )
    dead_cells: tuple[Cell, ...] = Field(
        default=(), description="elements that read 0, as [row, column], counted from 0"
    )
    stuck_cells: tuple[tuple[NonNegativeInt, NonNegativeInt, int], ...] = Field(
        default=(), description="elements that read the same, as [row, column, value 0 to 255]"
    )

    @property
    def is_off(self) -> bool:
        """True where the ideal frame passes unchanged."""
        smooth = self.crosstalk or self.gain_sigma or self.hysteresis or self.read_sigma
        return not (smooth or self.dead or self.stuck or self.dead_cells or self.stuck_cells)

    def check_cells(self, rows: int, columns: int) -> None:
        """Raise ValueError for a named element that is not on the grid, named twice, or stuck at no 8-bit value."""
        named = [*self.dead_cells, *(stuck[:2] for stuck in self.stuck_cells)]
        for row, column in named:
            if row >= rows or column >= columns:
                raise ValueError(
                    f"noise names the element [{row}, {column}] of a grid of {rows} rows and {columns} columns; "
                    f"[0, 0] to [{rows - 1}, {columns - 1}] are valid"
                )
            if named.count((row, column)) > 1:
                raise ValueError(
                    f"noise names the element [{row}, {column}] more than once as dead or stuck; once is valid"
                )
        for row, column, value in self.stuck_cells:
            if not 0 <= value <= FULL_SCALE:
                raise ValueError(
                    f"noise has the element [{row}, {column}] stuck at {value}; 0 to {FULL_SCALE} is valid"
                )

    def build(self, rows: int, columns: int, rng: np.random.Generator) -> FloorParts:
        """Draw a floor with these tolerances from `rng`; raises ValueError as `check_cells`."""
        self.check_cells(rows, columns)
        shape = (rows, columns)
        # All is drawn even if unused, so that one fault does not change another.
        spread, luck, value = (
            rng.standard_normal(shape),
            rng.random((2, *shape)),
            rng.integers(0, FULL_SCALE + 1, shape),
        )
        gain = np.maximum(1.0 + self.gain_sigma * spread, _GAIN_LEAST)
        fixed = np.full(shape, -1, dtype=np.int16)
        fixed[luck[0] < self.stuck] = value[luck[0] < self.stuck]
        fixed[luck[1] < self.dead] = 0
        for row, column in self.dead_cells:
            fixed[row, column] = 0
        for row, column, at in self.stuck_cells:
            fixed[row, column] = at
        return FloorParts(gain, fixed)

    def corrupt(
        self, observation: LoadFrame, state: FloorState | None, rng: np.random.Generator
    ) -> tuple[FloorFrame, FloorState]:
        """Return the frame as the device reports it; without a state, a floor is built first, from `rng`."""
        if state is None:
            rows, columns = observation.values.shape
            state = FloorState(self.build(rows, columns, rng), np.zeros((rows, columns)))
        load_n = spread_to_neighbours(observation.load_n, self.crosstalk) * state.parts.gain
        shown_n = _play(load_n, state.shown_n, self.hysteresis)
        signal = observation.curve.signal(shown_n)
        if self.read_sigma > 0:
            signal = signal + self.read_sigma * rng.standard_normal(signal.shape)
        # The converter's range, 0 to full scale.
        values = np.rint(signal).clip(0, FULL_SCALE).astype(np.uint8)
        fixed = state.parts.fixed
        values = np.where(fixed >= 0, fixed.astype(np.uint8), values)
        return FloorFrame(observation.sensor, observation.stamp_ns, values), FloorState(state.parts, shown_n)


@dataclass(frozen=True, eq=False)
class FloorState:
    """State from frame to frame: the floor's elements, and the load that each resistor shows (rows, columns) [N]."""

    parts: FloorParts
    shown_n: Array


@dataclass(frozen=True, eq=False)
class BuiltElectronics:
    """Electronics of one floor already built, so that the same elements are dead in its empty room and its run."""

    electronics: FloorElectronics
    parts: FloorParts

    def corrupt(
        self, observation: LoadFrame, state: FloorState | None, rng: np.random.Generator
    ) -> tuple[FloorFrame, FloorState]:
        """Return the frame as the device reports it, starting from an unloaded floor."""
        if state is None:
            state = FloorState(self.parts, np.zeros(observation.values.shape))
        return self.electronics.corrupt(observation, state, rng)


def spread_to_neighbours(load_n: Array, share: float) -> Array:
    """Move a share of each load (rows, columns) to the four neighbours; the sum stays."""
    if share == 0:
        return load_n
    quarter = (share / 4) * load_n
    out = (1 - share) * load_n
    out[1:] += quarter[:-1]
    out[:-1] += quarter[1:]
    out[:, 1:] += quarter[:, :-1]
    out[:, :-1] += quarter[:, 1:]
    # Load that would leave the grid stays at its edge.
    out[0] += quarter[0]
    out[-1] += quarter[-1]
    out[:, 0] += quarter[:, 0]
    out[:, -1] += quarter[:, -1]
    return out


def _play(load_n: Array, shown_n: Array, width: float) -> Array:
    """Return the loads shown by resistors [N] after `shown_n`: a play operator."""
    return np.clip(shown_n, load_n, load_n / (1 - width))


FLOOR_ELECTRONICS = {
    "off": FloorElectronics(),
    # Resistors of one batch under a thin cover, sorted before assembly.
    "default": FloorElectronics(crosstalk=0.04, gain_sigma=0.06, hysteresis=0.1, read_sigma=0.5),
    # Several batches, a stiff cover, years of feet.
    "worse": FloorElectronics(crosstalk=0.15, gain_sigma=0.2, hysteresis=0.2, read_sigma=1.5, dead=0.015, stuck=0.008),
}
"""Noise by name."""
