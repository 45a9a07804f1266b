"""Joint positions that jump by whole turns, as drivers of continuous joints report them."""

import numpy as np
from numpy.typing import ArrayLike

from poise.types import Array

_TURN = 2.0 * np.pi
_FASTEST = 30.0
"""rad/s: no joint is faster; beyond it, a step of more than half a turn is a jump."""


def without_turns(seconds: ArrayLike, position: ArrayLike) -> Array:
    """(N, J) positions without jumps by whole turns: each one follows the one before on the shorter way.

    A long step in a long time is a motion, and stays.

    Args:
        seconds: (N,) ascending. position: (N, J) rad; of joints that slide, m, no step is as long.
    """
    time, values = np.asarray(seconds, dtype=np.float64), np.asarray(position, dtype=np.float64)
    step = np.diff(values, axis=0)
    jump = (np.abs(step) > _TURN / 2.0) & (np.abs(step) > _FASTEST * np.maximum(np.diff(time), 0.0)[:, None])
    if not jump.any():
        return values
    turns = np.cumsum(np.where(jump, np.round(step / _TURN), 0.0), axis=0)
    return values - _TURN * np.concatenate([np.zeros((1, values.shape[1])), turns])
