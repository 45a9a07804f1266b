"""A payload that turns in its grip: its motion on springs, and its wrench."""

import numpy as np

from poise.kernels.arrays import address, contiguous
from poise.kernels.library import library
from poise.types import Array

_MOST_SPRINGS = 3


def turned_load(body: Array, moved: Array, motion: Array) -> Array:
    """(N, 6) force and torque about the pivot of a turned payload, see `grasp_compliance`; needs `COMPILED`.

    Args:
        body: (13,) mass, kg; first moment, kg m, and inertia, kg m2 (row-major), about the pivot.
        moved: (3, N, 3) angular velocity and acceleration of the sensor, and specific force at the pivot.
        motion: (3, N, 3) rotation vector of the payload, rad, and its two derivatives.

    Raises:
        InputError: TYPE_MISMATCH for arrays of other shapes.
    """
    given = contiguous(moved, 3, -1, 3, what="motion of the sensor")
    turned = contiguous(motion, *given.shape, what="motion of the payload")
    wrench = np.empty((given.shape[1], 6))
    properties = contiguous(body, 13, what="properties of the payload")
    library.poise_turned_load(len(wrench), *map(address, (properties, given, turned, wrench)))
    return wrench


def turned_in_grip(
    body: Array,
    moved: Array,
    step: Array,
    transition: Array,
    axes: Array,
    moments: Array,
    spring: tuple[float, float],
    ends: tuple[int, float, float],
) -> Array:
    """(3, N, 3) how a payload moves on equal springs about some axes, from rest; needs `COMPILED`.

    Args:
        body, moved: see `turned_load`.
        step: (N - 1,) s.
        transition: (S, 2, 2, N - 1) of the oscillator about each axis, at most three.
        axes: (S, 3) units. moments: (S,) kg m2 about them.
        spring: stiffness N m/rad and damping N m s/rad.
        ends: most rounds, the change of the turn at which they end, and the largest turn, rad.

    Raises:
        InputError: TYPE_MISMATCH for arrays of other shapes.
    """
    given = contiguous(moved, 3, -1, 3, what="motion of the sensor")
    n, springs = given.shape[1], min(len(moments), _MOST_SPRINGS)
    arrays = (
        contiguous(body, 13, what="properties of the payload"),
        given,
        contiguous(step, n - 1, what="steps"),
        contiguous(transition, springs, 2, 2, n - 1, what="transitions"),
        contiguous(axes, springs, 3, what="axes"),
        contiguous(moments, springs, what="moments of inertia"),
    )
    motion = np.zeros(given.shape)
    rounds, settled, largest = ends
    library.poise_turned_in_grip(n, springs, *map(address, arrays), *spring, rounds, settled, largest, address(motion))
    return motion
