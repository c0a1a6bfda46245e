"""One row per target: dataclasses of arrays that are selected from, joined and overwritten as one."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol, Self, runtime_checkable

import numpy as np

from trackers.arrays import AnyArray, Bool, Index, Int, Mask, Shaped

Selection = Int[Index, "k"] | Bool[Mask, "n"]
"""Indices of k targets, or a mask of all n."""


@runtime_checkable
class Batched(Protocol):
    """Any batch of n targets, with the operations common to `Rows`, `ImmState`, `Cloud` and `LogWeights`."""

    def __len__(self) -> int: ...

    def select(self, index: Selection) -> Self:
        """Return the targets at `index`."""
        ...

    def joined(self, other: Self) -> Self:
        """Concatenate these targets and `other`."""
        ...

    def replaced(self, index: Selection, other: Self) -> Self:
        """Replace the targets at `index` by `other`."""
        ...


class Rows:
    """Base of a frozen dataclass whose fields are arrays (n, ...), or batches of n (`Batched`)."""

    def __len__(self) -> int:
        for field in vars(self).values():
            return len(field)
        return 0

    def changed(self, **fields: Any) -> Self:
        """Replace fields (`dataclasses.replace` without its costly checks)."""
        return type(self)(**(vars(self) | fields))

    def select(self, index: Selection) -> Self:
        """Return the targets at `index`."""
        if index.dtype == np.bool_ and np.count_nonzero(index) == index.size:
            return self
        return self._field_by_field(lambda rows: rows[index], lambda batch: batch.select(index))

    def joined(self, other: Self) -> Self:
        """Concatenate these targets and `other`."""
        if len(other) == 0:
            return self
        return self._field_by_field(
            lambda rows, more: np.concatenate([rows, more]), lambda batch, more: batch.joined(more), other
        )

    def replaced(self, index: Selection, other: Self) -> Self:
        """Replace the targets at `index` by `other`."""
        return self._field_by_field(
            lambda rows, new: written(rows, index, new), lambda batch, new: batch.replaced(index, new), other
        )

    def _field_by_field(self, of_array: Callable[..., Any], of_batch: Callable[..., Any], *others: Self) -> Self:
        fields = {}
        for name, field in vars(self).items():
            change = of_array if isinstance(field, np.ndarray) else of_batch
            fields[name] = change(field, *(getattr(other, name) for other in others))
        return type(self)(**fields)


def written(array: Shaped[AnyArray, "n *each"], index: Selection, values: Any) -> Shaped[AnyArray, "n *each"]:
    """Copy an array with `values` at `index`."""
    copy = array.copy()
    copy[index] = values
    return copy


def marked(n: int, index: Selection) -> Bool[Mask, "{n}"]:
    """Return a mask of n targets with those at `index`."""
    mask = np.zeros(n, np.bool_)
    mask[index] = True
    return mask
