"""Type of the arrays that kernels take and return."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
"""Array of floats of any shape."""
