"""Recursions from sample to sample: a pendulum, a rope, and a part between stops."""

import numpy as np

from poise.errors import ErrorCode, InputError
from poise.kernels.arrays import address, contiguous
from poise.kernels.library import library
from poise.types import Array

_MOST_LINKS = 16
"""MOST_LINKS in kernels/recursions.c."""


def pendulum(start: Array, drive: Array, turn: Array, half: float) -> Array:
    """(N, 3) positions of a pendulum on the unit sphere; needs `COMPILED`.

    Args:
        start: (2, 3) at the first step, and before it.
        drive, turn: (N, 3) see `poise.mismatch.effects.part_motion.hanging`.
        half: half of the damping in a step.

    Raises:
        InputError: TYPE_MISMATCH for arrays of other shapes.
    """
    push = contiguous(drive, -1, 3, what="drives")
    turned = contiguous(turn, len(push), 3, what="turns")
    begin = contiguous(start, 2, 3, what="the start")
    places = np.empty(push.shape)
    library.poise_pendulum(len(push), address(begin), address(push), address(turned), half, address(places))
    return places


def rope(
    lengths: Array, masses: Array, start: Array, drive: Array, turn: Array, damping: float, step: float
) -> tuple[Array, Array]:
    """Centres of mass (N, 3), m, and directions of the first link (N, 3) of a rope; needs `COMPILED`.

    Args:
        lengths: (L,) m of the links, at most 16.
        masses: (L,) kg at their lower ends.
        start: (3,) its direction at the first step, where it rests.
        drive: (N, 3) m/s2 on each mass.
        turn: (N, 3) rad/s of what the first link hangs from.
        damping: N m s/rad of each joint.
        step: s.

    Raises:
        InputError: TYPE_MISMATCH for arrays of other shapes, or more than 16 links.
    """
    push = contiguous(drive, -1, 3, what="drives")
    turned = contiguous(turn, len(push), 3, what="turns")
    begin, weights = contiguous(start, 3, what="the start"), contiguous(masses, -1, what="masses")
    if not 0 < len(weights) <= _MOST_LINKS:
        raise InputError(ErrorCode.TYPE_MISMATCH, f"a rope has 1 to {_MOST_LINKS} links, not {len(weights)}")
    centres, directions = np.empty(push.shape), np.empty(push.shape)
    rods = contiguous(lengths, len(weights), what="lengths")
    given = (address(rods), address(weights), address(begin), address(push), address(turned))
    library.poise_rope(len(push), len(weights), *given, damping, step, address(centres), address(directions))
    return centres, directions


def between_stops(seconds: Array, push: Array, gap: float, settling: float, blur: float) -> Array:
    """(3, N) position, velocity and acceleration of a part between two stops; needs `COMPILED`.

    Args:
        seconds, push, gap, settling: see `poise.mismatch.effects.part_motion.between_stops`.
        blur: s on either side over which the acceleration is averaged.

    Raises:
        InputError: TYPE_MISMATCH for arrays of other shapes.
    """
    stamps = contiguous(seconds, -1, what="stamps")
    pushes = contiguous(push, len(stamps), what="pushes")
    motion = np.empty((3, len(stamps)))
    library.poise_between_stops(len(stamps), address(stamps), address(pushes), gap, settling, blur, address(motion))
    return motion
