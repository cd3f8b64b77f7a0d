"""Elements of contiguous arrays by their flat index.

``values[i, j]`` multiplies by strides that are known only at run time, in every access; here the caller has worked out
the index once, and it serves all arrays of the same shape. Whoever launches a kernel that uses these makes sure that
its arrays are contiguous.
"""

import warp as wp


@wp.func_native("return values.data[index];")
def flat(values: wp.array2d[float], index: int) -> float:
    """Element of a contiguous array."""
    ...


@wp.func_native("values.data[index] = value;")
def put(values: wp.array2d[float], index: int, value: float):
    """Set an element of a contiguous array."""
    ...


@wp.func_native("values.data[index] = value;")
def put4(values: wp.array4d[float], index: int, value: float):
    """The same for an array with four indices."""
    ...
