"""Shapes of arrays in annotations: `Float64[np.ndarray, "n 3"]` is an array of float64 with n rows of three numbers.

The notation is that of jaxtyping. A name is a length, the same throughout a signature; a number is a length; `...`
stands for any lengths, and `#name` for a length or 1. `Num` is any kind of number, `Shaped` anything at all.

jaxtyping takes a tenth of a second to import, so these annotations do nothing at run time. Tests put jaxtyping's own
types in their place and check every call (`tests/checked_shapes.py`).
"""

from typing import Annotated as Bool
from typing import Annotated as Float32
from typing import Annotated as Float64
from typing import Annotated as Int64
from typing import Annotated as Num
from typing import Annotated as Shaped

__all__ = ["Bool", "Float32", "Float64", "Int64", "Num", "Shaped"]
