"""The first slip of a body on one patch under growing loads."""

import ctypes

import numpy as np

from poise.kernels.arrays import address, contiguous
from poise.kernels.library import library
from poise.types import Array


class _Patch(ctypes.Structure):
    """Layout of `struct patch` in kernels/slip.c."""

    _fields_ = [
        *((name, ctypes.c_void_p) for name in ("rest", "table", "motions")),
        *((name, ctypes.c_int64) for name in ("side", "count")),
        *((name, ctypes.c_double) for name in ("radius", "size", "handed", "friction", "weight")),
    ]


def first_slips(
    ways: Array, top: Array, rest: Array, table: Array, motions: Array, numbers: tuple[float, ...]
) -> Array:
    """(Q,) as `poise.assembly.statics.single_patch.SinglePatch._first_slip`; needs `COMPILED`.

    Args:
        ways: (6, Q) from the load at rest. top: (Q,). rest: (6,) load at rest.
        table: (T, T) normal force that friction needs, by azimuth and elevation of the load; NaN is filled in.
        motions: (D, 3) of unit dissipation, of which that force is the largest power.
        numbers: radius and size of the patch, whether its axes are right-handed (1, otherwise -1), friction, weight.

    Raises:
        InputError: TYPE_MISMATCH for arrays of other shapes.
    """
    count, side = len(top), len(table)
    given = contiguous(ways, 6, count, what="ways"), contiguous(top, count, what="the ends of the ways")
    kept = (
        contiguous(rest, 6, what="the load at rest"),
        contiguous(table, side, side, what="the table of friction"),
        contiguous(motions, -1, 3, what="motions"),
    )
    patch, end = _Patch(*map(address, kept), side, len(motions), *numbers), np.empty(count)
    library.poise_first_slips(ctypes.addressof(patch), count, *map(address, given), address(end))
    return end
