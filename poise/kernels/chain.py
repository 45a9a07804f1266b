"""Forward kinematics of a chain of joints to second order, for many samples at once."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from poise.kernels.arrays import address, contiguous
from poise.kernels.library import library
from poise.types import Array, Indices


@dataclass(frozen=True, eq=False)
class Chain:
    """Joints from a base to a frame.

    Args:
        placements: (J + 1, 12) rotation (row-major) and translation (m) of each joint in the one before, and of the
            frame in the last joint.
        axes: (J, 3) unit axis of each joint, in its own axes.
        slides: (J,) 1 for a prismatic joint, 0 for a revolute one.
    """

    placements: Array
    axes: Array
    slides: Indices


def chain_motion(chain: Chain, motion: ArrayLike, base: ArrayLike | None = None) -> tuple[Array, Array, Array]:
    """How the frame at the end of a chain moves; needs `COMPILED`.

    Args:
        chain: of J joints.
        motion: (3, N, J) positions, velocities and accelerations of the joints, rad or m, and per s and s2.
        base: (N, 21) rotation (row-major) and position of the base in the world, and in its own axes its angular
            velocity, its angular acceleration and the acceleration of its origin; None: at rest at the origin.

    Returns:
        Rotation (N, 3, 3) world <- frame, position (N, 3) m in the world; and (3, N, 3) angular velocity, angular
        acceleration and acceleration of the origin in the axes of the frame, without gravity.

    Raises:
        InputError: TYPE_MISMATCH for arrays of other shapes.
    """
    joints = len(chain.axes)
    placements = contiguous(chain.placements, joints + 1, 12, what="the placement of joints")
    axes = contiguous(chain.axes, joints, 3, what="axes of joints")
    given = contiguous(motion, 3, -1, joints, what="motion of joints")
    n = given.shape[1]
    moved = None if base is None else contiguous(base, n, 21, what="motion of the base")
    slides = contiguous(chain.slides, joints, what="kinds of joints").astype(np.int64)
    rotation, place, vectors = np.empty((n, 3, 3)), np.empty((n, 3)), np.empty((3, n, 3))
    arrays = (placements, axes, slides, given, moved, rotation, place, vectors)
    library.poise_chain_motion(n, joints, *map(address, arrays))
    return rotation, place, vectors
