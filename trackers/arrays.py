"""The arrays that functions take and hand back; shapes stand beside them, as (n, 2)."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Mask = NDArray[np.bool_]
