"""What has been learned of the silhouettes of people: two small networks over the cells of a window.

One says how near to the window's place a person stands, 1 there and exp(−d² / 2 σ²) at a distance of d (a heat map, so that
people next to each other have a peak each); the other where from the window's place that person is. Fitted by scikit-learn
(`scripts/train-person-detector`), kept as plain arrays, and worked out here in two products each.
"""

from __future__ import annotations

import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Float32
from numpy.typing import NDArray

from trackers.arrays import Array, Singles
from trackers.errors import InputError
from trackers.text_file import AnyPath

ROWS, COLUMNS = 14, 8
"""Cells of a window, of which the model is learned."""
INPUTS = ROWS * COLUMNS + 2
SHIPPED = Path(__file__).with_name("person_model.npz")
_PARTS = ("into", "into_bias", "out", "out_bias")


@dataclass(frozen=True, eq=False)
class Network:
    """One hidden layer of rectified linear units: y = W₂ᵀ max(0, W₁ᵀ x + b₁) + b₂."""

    into: Float32[Singles, "inputs hidden"]
    into_bias: Float32[Singles, "hidden"]
    out: Float32[Singles, "hidden outputs"]
    out_bias: Float32[Singles, "outputs"]

    def __call__(self, inputs: Float32[Singles, "n inputs"]) -> Float32[Singles, "n outputs"]:
        """What it says of n windows."""
        return np.maximum(inputs @ self.into + self.into_bias, 0) @ self.out + self.out_bias


@dataclass(frozen=True, eq=False)
class PersonModel:
    """The two networks, and how far off the second is on windows that it was not fitted to."""

    nearness: Network
    offset: Network  # to the right and ahead of the window's place, as the camera looks at it [m]
    deviation_m: Float[Array, "2"]  # standard deviations of that [m]

    def save(self, path: AnyPath) -> None:
        """Write the arrays to a file, the same bytes for the same model."""
        arrays = {
            f"{name}_{part}": getattr(getattr(self, name), part) for name in ("nearness", "offset") for part in _PARTS
        }
        np.savez(path, allow_pickle=False, deviation_m=self.deviation_m, **arrays)

    @classmethod
    def load(cls, path: AnyPath = SHIPPED) -> PersonModel:
        """The model in a file that `save` wrote. Raises InputError for one that is missing, damaged or no such model."""
        path = Path(path)
        try:
            with np.load(path, allow_pickle=False) as file:
                held = {name: file[name] for name in file.files}
        except (OSError, ValueError, EOFError, zipfile.BadZipFile) as error:
            raise InputError(
                f"{path}: cannot be read as a model of people ({error}); an .npz file is expected"
            ) from error
        deviation_m = held.get("deviation_m", np.empty(0))
        if deviation_m.shape != (2,) or not (deviation_m > 0).all():
            raise InputError(f"{path}: deviation_m is {deviation_m}; two lengths above 0 are expected")
        nearness, offset = _network(held, "nearness", 1, path), _network(held, "offset", 2, path)
        return cls(nearness, offset, deviation_m.astype(float))


def _network(held: dict[str, NDArray], name: str, outputs: int, path: Path) -> Network:
    missing = [f"{name}_{part}" for part in _PARTS if f"{name}_{part}" not in held]
    if missing:
        raise InputError(f"{path}: lacks {', '.join(missing)}; a file of scripts/train-person-detector is expected")
    parts = [held[f"{name}_{part}"] for part in _PARTS]
    hidden = parts[1].size
    wanted = [(INPUTS, hidden), (hidden,), (hidden, outputs), (outputs,)]
    for part, array, shape in zip(_PARTS, parts, wanted, strict=True):
        if array.shape != shape or array.dtype != np.float32 or not np.isfinite(array).all():
            raise InputError(
                f"{path}: {name}_{part} is {array.dtype} of shape {array.shape}; finite float32 of {shape} are expected"
            )
    return Network(*parts)
