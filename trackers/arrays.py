"""Array types of arguments and results, with shapes in annotations, `Float[Array, "n 2"]` (jaxtyping).

A name is one size throughout a call; dtypes and shapes are checked in test runs only, which import jaxtyping first. Elsewhere
an annotation is `Any`, since jaxtyping imports `unittest.mock`, and that `asyncio`. The aliases are written out: from numpy 2.5
on `numpy.typing.NDArray[...]` is no class, which jaxtyping needs.
"""

import sys
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING or "jaxtyping" in sys.modules:
    from jaxtyping import (
        Bool as Bool,
        Complex as Complex,
        Float as Float,
        Float16 as Float16,
        Float32 as Float32,
        Int as Int,
        Int16 as Int16,
        Int32 as Int32,
        Integer as Integer,
        Shaped as Shaped,
        UInt8 as UInt8,
        UInt32 as UInt32,
    )
else:

    class _Unchecked:
        def __class_getitem__(cls, shape: Any) -> Any:
            return Any

    Bool = Complex = Float = Float16 = Float32 = Int = Int16 = Int32 = Integer = Shaped = UInt32 = UInt8 = _Unchecked

Array = np.ndarray[Any, np.dtype[np.float64]]
ArrayOrNumber = Array | np.float64
Index = np.ndarray[Any, np.dtype[np.intp]]
Mask = np.ndarray[Any, np.dtype[np.bool_]]
Singles = np.ndarray[Any, np.dtype[np.float32]]
Bytes = np.ndarray[Any, np.dtype[np.uint8]]
Floats = np.ndarray[Any, np.dtype[np.floating]]
"""Single or double precision."""
Complexes = np.ndarray[Any, np.dtype[np.complex128]]
Planar = Complexes
"""Places or directions on the floor, x + iy."""
AnyArray = np.ndarray[Any, np.dtype[Any]]
Nanoseconds = np.ndarray[Any, np.dtype[np.int64]]
