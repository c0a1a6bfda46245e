"""Array types of arguments and results, with shapes in annotations, `Float[Array, "n 2"]` (jaxtyping).

A name is one size throughout a call; dtypes and shapes are checked in test runs only. The aliases are written out: from
numpy 2.5 on `numpy.typing.NDArray[...]` is no class, which jaxtyping needs.
"""

from typing import Any

import numpy as np

Array = np.ndarray[Any, np.dtype[np.float64]]
ArrayOrNumber = Array | np.float64
Index = np.ndarray[Any, np.dtype[np.intp]]
Mask = np.ndarray[Any, np.dtype[np.bool_]]
Singles = np.ndarray[Any, np.dtype[np.float32]]
Bytes = np.ndarray[Any, np.dtype[np.uint8]]
Floats = np.ndarray[Any, np.dtype[np.floating]]
"""Single or double precision."""
Complexes = np.ndarray[Any, np.dtype[np.complex128]]
AnyArray = np.ndarray[Any, np.dtype[Any]]
Nanoseconds = np.ndarray[Any, np.dtype[np.int64]]
