"""Array aliases: what the type checker is told about NumPy arrays.

Shapes stand in the docstrings, because NumPy's types have none.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Array32 = NDArray[np.float32]
Indices = NDArray[np.int64]
Mask = NDArray[np.bool_]
Picture8 = NDArray[np.uint8]
Picture = NDArray[np.uint8] | NDArray[np.uint16]
