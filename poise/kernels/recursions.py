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
    lengths: Array, masses: Array, seconds: Array, pull: Array, rate: Array, damping: float, steps: int
) -> tuple[Array, Array]:
    """Force and couple of a rope on its pivot, (N, 3) each, see `hanging_rope`; needs `COMPILED`.

    Args:
        lengths: (L,) m of the links, at most 16.
        masses: (L,) kg at their lower ends, 1 kg in all.
        seconds: (N,) ascending, two at least.
        pull: (N, 3) m/s2 on each mass.
        rate: (N, 3) rad/s of what the first link hangs from.
        damping: N m s/rad of each joint.
        steps: from the first time to the last, two at least.

    Raises:
        InputError: TYPE_MISMATCH for arrays of other shapes, or other numbers of links, times or steps.
    """
    at, weights = contiguous(seconds, -1, what="times"), contiguous(masses, -1, what="masses")
    if not 0 < len(weights) <= _MOST_LINKS:
        raise InputError(ErrorCode.TYPE_MISMATCH, f"a rope has 1 to {_MOST_LINKS} links, not {len(weights)}")
    if min(len(at), steps) < 2:
        raise InputError(ErrorCode.TYPE_MISMATCH, f"a rope needs two times and steps, not {len(at)} and {steps}")
    push, turned = contiguous(pull, len(at), 3, what="pulls"), contiguous(rate, len(at), 3, what="rates")
    rods, felt = contiguous(lengths, len(weights), what="lengths"), np.empty((len(at), 6))
    given = (address(rods), address(weights), address(at), address(push), address(turned))
    library.poise_rope(len(at), len(weights), *given, damping, steps, address(felt))
    return felt[:, :3], felt[:, 3:]


def between_stops(
    seconds: Array, push: Array, gap: float, settling: float, blur: float, drag: Array | None = None
) -> Array:
    """(3, N) position, velocity and acceleration of a part between two stops; needs `COMPILED`.

    Args:
        seconds, push, gap, settling, drag: see `poise.mismatch.effects.stops.between_stops`.
        blur: s on either side over which the acceleration is averaged.

    Raises:
        InputError: TYPE_MISMATCH for arrays of other shapes.
    """
    stamps = contiguous(seconds, -1, what="stamps")
    pushes = contiguous(push, len(stamps), what="pushes")
    drags = None if drag is None else contiguous(drag, len(stamps), what="drags")
    motion = np.empty((3, len(stamps)))
    given = address(stamps), address(pushes), None if drags is None else address(drags)
    library.poise_between_stops(len(stamps), *given, gap, settling, blur, address(motion))
    return motion
