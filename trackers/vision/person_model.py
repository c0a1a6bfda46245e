"""A learned model of the silhouettes of people: two small networks over the cells of a window.

One says how near to the window's place a person stands, 1 there and exp(−d² / 2 σ²) at a distance of d (a heat map, so that
people next to each other have a peak each); the other where from the window's place that person is. Fitted by scikit-learn
(`scripts/train-person-detector`), kept as plain arrays, and worked out here in two products each.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Float32

from trackers.array_files import ArraySpec, read_arrays
from trackers.arrays import Array, Singles
from trackers.text_file import AnyPath

ROWS, COLUMNS = 14, 8
"""Cells of a window, of which the model is learned."""
INPUTS = ROWS * COLUMNS + 2
SHIPPED = Path(__file__).with_name("person_model.npz")
_PARTS = ("into", "into_bias", "out", "out_bias")
_OUTPUTS = {"nearness": 1, "offset": 2}
_LARGEST_WEIGHT, _LARGEST_M = 1e4, 10.0
_ARRAYS = {"deviation_m": ArraySpec("f", (2,), 1e-6, _LARGEST_M)} | {
    f"{name}_{part}": ArraySpec("f", shape, -_LARGEST_WEIGHT, _LARGEST_WEIGHT)
    for name, outputs in _OUTPUTS.items()
    for part, shape in zip(
        _PARTS,
        ((INPUTS, f"{name}'s hidden"), (f"{name}'s hidden",), (f"{name}'s hidden", outputs), (outputs,)),
        strict=True,
    )
}


@dataclass(frozen=True, eq=False)
class Network:
    """One hidden layer of rectified linear units: y = W₂ᵀ max(0, W₁ᵀ x + b₁) + b₂."""

    into: Float32[Singles, "inputs hidden"]
    into_bias: Float32[Singles, "hidden"]
    out: Float32[Singles, "hidden outputs"]
    out_bias: Float32[Singles, "outputs"]

    def __call__(self, inputs: Float32[Singles, "n inputs"]) -> Float32[Singles, "n outputs"]:
        """Return the outputs of n windows."""
        return np.maximum(inputs @ self.into + self.into_bias, 0) @ self.out + self.out_bias


@dataclass(frozen=True, eq=False)
class PersonModel:
    """The two networks, and how far off the second is on windows that it was not fitted to."""

    nearness: Network
    offset: Network  # to the right and ahead of the window's place, as the camera looks at it [m]
    deviation_m: Float[Array, "2"]  # standard deviations of that [m]

    def save(self, path: AnyPath) -> None:
        """Write the arrays to a file, the same bytes for the same model."""
        arrays = {f"{name}_{part}": getattr(getattr(self, name), part) for name in _OUTPUTS for part in _PARTS}
        np.savez(path, allow_pickle=False, deviation_m=self.deviation_m, **arrays)

    @classmethod
    def load(cls, path: AnyPath = SHIPPED) -> PersonModel:
        """The model in a file that `save` wrote. Raises InputError for one that is missing, damaged or no such model."""
        held = read_arrays(path, _ARRAYS, "a file that scripts/train-person-detector wrote")
        nearness, offset = (
            Network(*(held[f"{name}_{part}"].astype(np.float32) for part in _PARTS)) for name in _OUTPUTS
        )
        return cls(nearness, offset, held["deviation_m"].astype(float))
