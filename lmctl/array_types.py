"""Array types that the packages share, one name for each dtype."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
#: Positions in another array, as NumPy's own index functions return them.
IndexArray = NDArray[np.intp]
BoolArray = NDArray[np.bool_]
#: -1, 0 or 1 for each element.
SignArray = NDArray[np.int8]
