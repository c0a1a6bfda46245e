"""The arrays that functions take and hand back. Their shapes stand beside them, `Float[Array, "n 2"]` (jaxtyping).

A name stands for one size throughout a call; the test run checks dtypes and shapes at every call, nothing else does.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
ArrayOrNumber = Array | np.float64
Index = NDArray[np.intp]
Mask = NDArray[np.bool_]
Singles = NDArray[np.float32]
Bytes = NDArray[np.uint8]
