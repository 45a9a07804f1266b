"""Linear models of joint efforts, fitted to some blocks of a recording and compared with the others.

The normal matrices of the blocks are computed once, for all columns; a fit takes a part of their sums.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from poise.mismatch.effects import Effect, Values
from poise.mismatch.inference.box import box_minimum
from poise.types import Array

BLOCKS = 6
_RIDGE = 1e-9
"""Relative to the mean of the normal matrix's diagonal."""


@dataclass(frozen=True, eq=False)
class EffectFamily:
    """An effect at some of its non-linear values, with the columns (R, J, k) of its linear parameters.

    event: what the other blocks show does not predict it: it is brief, or its course is free inside a window.
    """

    effect: Effect | None
    values: Values
    columns: Array
    precision: Array
    lower: Array
    upper: Array
    event: bool = False

    @property
    def name(self) -> str:
        return self.effect.name if self.effect else ""


@dataclass(frozen=True, eq=False)
class BlockSums:
    """Normal matrices (B, J, K, K), vectors (B, J, K) and squares (B, J) of all columns; `places` of each family.

    `noise` (J,) is the variance of the readings that no effect has to explain: zero unless errors of the model cancel.
    """

    families: tuple[EffectFamily, ...]
    places: tuple[slice, ...]
    matrix: Array
    vector: Array
    square: Array
    rows: Array
    floor: Array
    noise: Array

    @cached_property
    def nominal(self) -> Array:
        """(J,) variance of the residual of the calibrated nominal model on held-out blocks."""
        return begun(self, [])[1]


def block_sums(families: Sequence[EffectFamily], target: Array, floor: Array, noise: Array) -> BlockSums:
    sizes = [family.columns.shape[2] for family in families]
    places = tuple(slice(int(end) - size, int(end)) for size, end in zip(sizes, np.cumsum(sizes), strict=True))
    edges = np.linspace(0, len(target), BLOCKS + 1).astype(int)
    shape = BLOCKS, target.shape[1], sum(sizes)
    matrix, vector, square = np.zeros((*shape, shape[2])), np.zeros(shape), np.zeros(shape[:2])
    for joint, measured in enumerate(target.T):
        whole = np.concatenate([family.columns[:, joint] for family in families], axis=1)
        acting = np.flatnonzero(whole.any(axis=0))  # most columns are of one other joint
        for block, (begin, end) in enumerate(itertools.pairwise(edges)):
            columns, wanted = whole[begin:end, acting], measured[begin:end]
            matrix[block, joint][np.ix_(acting, acting)] = columns.T @ columns
            vector[block, joint, acting], square[block, joint] = columns.T @ wanted, wanted @ wanted
    return BlockSums(tuple(families), places, matrix, vector, square, np.diff(edges), floor, noise)


def numbered(sums: BlockSums, chosen: Sequence[int]) -> list[tuple[int, slice]]:
    """Families of a set, the calibration first, with their places in the vector of its coefficients."""
    found, begin = [], 0
    for i in (0, *chosen):
        end = begin + sums.families[i].columns.shape[2]
        found.append((i, slice(begin, end)))
        begin = end
    return found


def index_of(sums: BlockSums, chosen: Sequence[int]) -> Array:
    return np.concatenate([np.arange(sums.places[i].start, sums.places[i].stop) for i in (0, *chosen)])


def bounded(sums: BlockSums, chosen: Sequence[int], matrix: Array, vector: Array) -> Array:
    """The least-squares coefficients with priors, inside their bounds."""
    families = [sums.families[i] for i in (0, *chosen)]
    precision, lower, upper = (
        np.concatenate([getattr(family, name) for family in families]) for name in ("precision", "lower", "upper")
    )
    ridge = precision + _RIDGE * np.trace(matrix) / max(len(matrix), 1)
    return box_minimum(matrix + np.diag(ridge), vector, lower, upper)


def solved(sums: BlockSums, chosen: Sequence[int], variance: Array) -> Array:
    """Coefficients of a fit to all blocks, joints weighted by their residual variance (J,)."""
    index = index_of(sums, chosen)
    matrix, vector = sums.matrix.sum(axis=0)[:, index][:, :, index], sums.vector.sum(axis=0)[:, index]
    return bounded(sums, chosen, np.einsum("jkl,j->kl", matrix, 1 / variance), (vector / variance[:, None]).sum(axis=0))


def block_errors(sums: BlockSums, chosen: Sequence[int], variance: Array) -> Array:
    """(B, J) mean square on each block of a fit to the other blocks."""
    index = index_of(sums, chosen)
    matrix, vector = sums.matrix[:, :, index[:, None], index], sums.vector[:, :, index]
    weighted = np.tensordot(1 / variance, matrix, (0, 1)), np.tensordot(1 / variance, vector, (0, 1))
    out = np.empty(sums.square.shape)
    for block in range(len(out)):
        rest = (weighted[0].sum(axis=0) - weighted[0][block], weighted[1].sum(axis=0) - weighted[1][block])
        values = bounded(sums, chosen, *rest)
        bent = matrix[block] @ values @ values
        out[block] = sums.square[block] - 2.0 * vector[block] @ values + bent
    return np.asarray(np.maximum(out, 0.0) / sums.rows[:, None])


def variance_of(error: Array, floor: Array) -> Array:
    """(J,)."""
    return np.asarray(np.maximum(error.mean(axis=0), floor))


def begun(sums: BlockSums, chosen: Sequence[int]) -> tuple[Array, Array]:
    """(B, J) error of a set with weights by its own residual, and that residual's variance (J,)."""
    variance = variance_of(sums.square / sums.rows[:, None], sums.floor)
    for _ in range(2):
        error = block_errors(sums, chosen, variance)
        variance = variance_of(error, sums.floor)
    return error, variance


def square_of(sums: BlockSums, chosen: Sequence[int], variance: Array) -> float:
    """Of the residual of a fit to all blocks, in units of the variance (J,)."""
    index, values = index_of(sums, chosen), solved(sums, chosen, variance)
    matrix, vector = sums.matrix.sum(axis=0)[:, index][:, :, index], sums.vector.sum(axis=0)[:, index]
    bent = matrix @ values @ values
    return float((sums.square.sum(axis=0) - 2.0 * vector @ values + bent) @ (1 / variance))


def relative(error: Array, variance: Array) -> float:
    return float(np.mean(error / variance))
