"""What all samples so far say about the unknowns, in sums that do not grow with time."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from poise.inertia.model import N_UNKNOWNS
from poise.types import Array

FORCE_GROUP, TORQUE_GROUP = 0, 1
"""The two groups of channels; each has its own noise."""


@dataclass
class _Level:
    """Sums over means of 2^k consecutive samples.

    Args:
        sums: (2, 17, 17) per channel group, sum of z z^T over blocks and channels.
        count: blocks summed.
        pending: (2, 3, 17) the block that waits for its neighbour, if any.
    """

    sums: Array = field(default_factory=lambda: np.zeros((2, N_UNKNOWNS + 1, N_UNKNOWNS + 1)))
    count: int = 0
    pending: Array | None = None


class InformationAccumulator:
    """Normal equations of the wrench model, kept apart for force and torque, and blocked in time.

    With z = [A, 1, y] a row of the regressor, the bias columns and the measurement, the sums of z z^T hold the
    information matrix, its right-hand side and the squares of the measurement: any weights of force against torque
    can still be chosen, and the residual of any solution is known without going through the samples again.
    The same sums over means of 2, 4, 8... consecutive samples show how residuals are correlated in time
    (Flyvbjerg and Petersen 1989, "Error estimates on averages of correlated data").

    Adding samples one by one, in chunks or at once gives the same sums; cost and memory do not grow with time.
    """

    def __init__(self) -> None:
        self._levels = [_Level()]

    @property
    def n_samples(self) -> int:
        """Samples added."""
        return self._levels[0].count

    @property
    def sums(self) -> Array:
        """(2, 17, 17) sum of z z^T per channel group (force, torque)."""
        return self._levels[0].sums.copy()

    @property
    def block_sums(self) -> list[tuple[int, int, Array]]:
        """(samples per block, blocks, (2, 17, 17) sums over block means), from pairs upwards."""
        return [(2**k, level.count, level.sums.copy()) for k, level in enumerate(self._levels) if k > 0]

    def add(self, regressor: ArrayLike, wrench: ArrayLike) -> None:
        """Add samples in the order of time.

        Args:
            regressor: (N, 6, 10), as `poise.inertia.regressor`, or (6, 10) for one.
            wrench: (N, 6) measured, N and N m, or (6,) for one.
        """
        matrix = np.asarray(regressor, dtype=np.float64).reshape(-1, 6, 10)
        rows = np.zeros((len(matrix), 6, N_UNKNOWNS + 1))
        rows[:, :, :10] = matrix
        rows[:, :, 10:16] = np.eye(6)
        rows[:, :, 16] = np.asarray(wrench, dtype=np.float64).reshape(-1, 6)
        blocks = rows.reshape(-1, 2, 3, N_UNKNOWNS + 1)
        for index in range(64):  # 2^64 samples never come
            if not len(blocks):
                break
            if index == len(self._levels):
                self._levels.append(_Level())
            blocks = _add_to_level(self._levels[index], blocks)

    def merge(self, other: "InformationAccumulator") -> None:
        """Add everything that another accumulator holds; blocks that waited for their neighbour stay single."""
        self._levels += [_Level() for _ in range(len(other._levels) - len(self._levels))]
        for mine, theirs in zip(self._levels, other._levels, strict=False):
            mine.sums += theirs.sums
            mine.count += theirs.count

    def residual_squares(self, unknowns: Array) -> Array:
        """(2,) sum of the squared residuals of force and torque, for unknowns (16,)."""
        return quadratic(self._levels[0].sums, unknowns)


def quadratic(sums: Array, unknowns: Array) -> Array:
    """(2,) sum of (y - A x)^2 per channel group, from the sums of z z^T; rounding cannot make it negative."""
    z_weights = np.append(-unknowns, 1.0)
    squares: Array = np.einsum("i,gij,j->g", z_weights, sums, z_weights)
    return squares.clip(min=0.0)


def correlation_factor(
    information: InformationAccumulator, unknowns: Array, used: Array, min_blocks: int = 16
) -> Array:
    """(2,) how many consecutive samples weigh as much as one independent one, for force and torque; at least 1.

    The variance of means of 2^k residuals falls as 2^-k when they are independent; what it is above that, at the
    block length where it is worst, is the factor by which the variance of slow parameters is really larger.
    What hangs together for longer than a sixteenth of the samples is not seen in full.

    Args:
        information: the samples.
        unknowns: (16,) their solution.
        used: (2,) degrees of freedom that the solution takes from each channel group.
        min_blocks: levels with fewer blocks say too little.
    """
    single = information.residual_squares(unknowns) / (3 * information.n_samples - used)
    factor = np.ones(2)
    for size, count, sums in information.block_sums:
        if count >= min_blocks:
            freedom = 3 * count - used
            blocked = size * quadratic(sums, unknowns) / freedom
            ratio = np.divide(blocked, single, out=np.ones(2), where=single > 0)
            by_chance = 1 + 3 * np.sqrt(2 / freedom)  # three standard errors of a variance from that many values
            factor = np.where(ratio > by_chance, np.maximum(factor, ratio), factor)
    return factor


def _add_to_level(level: _Level, blocks: Array) -> Array:
    """Sum (N, 2, 3, 17) blocks into a level and return the means of its completed pairs, the next level's blocks."""
    flat = blocks.swapaxes(0, 1).reshape(2, -1, N_UNKNOWNS + 1)
    level.sums += flat.swapaxes(1, 2) @ flat
    level.count += len(blocks)
    if level.pending is not None:
        blocks = np.concatenate([level.pending[None], blocks])
    paired = len(blocks) - len(blocks) % 2
    level.pending = blocks[-1].copy() if paired < len(blocks) else None
    return np.asarray((blocks[:paired:2] + blocks[1:paired:2]) / 2)
