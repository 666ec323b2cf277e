"""Types of arguments and results, for annotations."""

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from nasm.numbers import RotationNumber

__all__ = ["BoolArray", "FloatArray", "IntArray", "OmegaLike"]

FloatArray: TypeAlias = NDArray[np.float64]
IntArray: TypeAlias = NDArray[np.int64]
BoolArray: TypeAlias = NDArray[np.bool_]

OmegaLike: TypeAlias = RotationNumber | str
"""A rotation number, or a string that denotes one, such as "gamma" or "[0;2,(1)]"."""
