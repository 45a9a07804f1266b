"""Least squares with bounds from small normal matrices: pivots between bounds, or an interior-point method."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dpotrf, dpotrs

from poise.kernels import COMPILED, bounded_minimum
from poise.types import Array

_GAP = 1e-4
"""Of half the square, within which the least is found."""
_MOST = 60
_NEARBY, _NEARER = 1.0, 30.0
"""Of half the square: the gap below which pivoting is tried, and the factor by which it falls until the next time."""
_PIVOTS, _PATIENCE = 20, 2
"""Changes of the set of bounds that hold, and changes in a row without progress, after which pivoting is given up."""
_TOUCH, _FLAT = 1e-6, 1e-10
"""Distance from a bound, in widths of the box, at which it holds, and relative slope that is rounding."""


def box_minimum(normal: Array, right: Array, lower: Array, upper: Array, near: Array | None = None) -> Array:
    """(k,) the least of x' normal x / 2 - right' x with lower <= x <= upper.

    From a similar problem, block principal pivoting (Judice and Pires 1994) takes few solutions and is exact. Where it
    makes no progress, Mehrotra's method (1992) comes near enough for pivoting to end, or to `_GAP`.

    Args:
        normal: (k, k) positive definite.
        right, lower, upper: (k,); bounds may be infinite.
        near: (k,) the least of a similar problem; None: none is known.

    Raises:
        numpy.linalg.LinAlgError: `normal` is not positive definite.
    """
    bounded = np.isfinite(lower) | np.isfinite(upper)
    if not bounded.any():
        return _Factor(normal).solve(right)
    if bounded.all():
        return _boxed(normal, right, lower, upper, near)
    # Coefficients without bounds follow the others.
    held, free = np.flatnonzero(bounded), np.flatnonzero(~bounded)
    factor, across = _Factor(normal[free[:, None], free]), normal[free[:, None], held]
    following = factor.solve(np.column_stack([across, right[free]]))
    schur = normal[held[:, None], held] - across.T @ following[:, :-1]
    pulled = right[held] - across.T @ following[:, -1]
    x = np.empty(len(right))
    x[held] = _boxed(schur, pulled, lower[held], upper[held], None if near is None else near[held])
    x[free] = following[:, -1] - following[:, :-1] @ x[held]
    return x


def _boxed(normal: Array, right: Array, lower: Array, upper: Array, near: Array | None) -> Array:
    """The least where every coefficient has a bound."""
    if COMPILED:
        return bounded_minimum(normal, right, lower, upper, near)
    if near is not None:
        width = _TOUCH * np.where(np.isfinite(upper - lower), upper - lower, 1.0)
        side = (near >= upper - width).astype(np.int8) - (near <= lower + width)
        pivoted = _pivoted(normal, right, lower, upper, side)
        if pivoted is not None:
            return pivoted
    # Units in which the box, or the posterior of a coefficient with one bound, is about one.
    low, high = np.isfinite(lower), np.isfinite(upper)
    loose = np.maximum(1.0 / np.sqrt(np.diag(normal)), 1e-12)
    unit = np.where(low & high, np.maximum(np.where(low & high, upper - lower, 0.0) / 2, 1e-300), loose)
    scaled = _Box(normal * np.outer(unit, unit), right * unit, lower / unit, upper / unit)
    return np.asarray(np.clip(unit * scaled.minimum(), lower, upper))


def _pivoted(normal: Array, right: Array, lower: Array, upper: Array, side: NDArray[np.int8]) -> Array | None:
    """The least by pivoting: coefficients beyond a bound are held there, held ones that pull inwards are freed.

    Args:
        normal, right, lower, upper: see `box_minimum`.
        side: (k,) -1 and 1: held at the lower and the upper bound at first; 0: free. Changed.
    """
    fewest, patience = len(right) + 1, _PATIENCE
    scale = _FLAT * np.sqrt(np.diag(normal))
    for _ in range(_PIVOTS):
        held = side != 0
        x = np.where(side < 0, lower, np.where(side > 0, upper, 0.0))
        free = np.flatnonzero(~held)
        if len(free):
            rest = right[free] - normal[free] @ x
            x[free] = _Factor(normal[free[:, None], free]).solve(rest)
        slope = normal @ x - right
        below, above = ~held & (x < lower), ~held & (x > upper)
        freed = held & (side * slope > scale * (1.0 + np.abs(x)))
        wrong = below | above | freed
        count = int(wrong.sum())
        if not count:
            return np.asarray(np.clip(x, lower, upper))
        patience = _PATIENCE if count < fewest else patience - 1
        if not patience:
            return None
        fewest = min(count, fewest)
        side[below], side[above], side[freed] = -1, 1, 0
    return None


class _Factor:
    def __init__(self, matrix: Array) -> None:
        self._lower, failed = dpotrf(matrix, lower=1)
        if failed:
            raise np.linalg.LinAlgError("the normal matrix is not positive definite")

    def solve(self, right: Array) -> Array:
        return np.asarray(dpotrs(self._lower, right, lower=1)[0])


@dataclass(frozen=True, eq=False)
class _Box:
    """A problem in units of its box."""

    normal: Array
    right: Array
    lower: Array
    upper: Array

    @cached_property
    def index(self) -> NDArray[np.intp]:
        """(s,) the coefficient of each finite bound, the lower bounds first."""
        return np.concatenate([np.flatnonzero(np.isfinite(each)) for each in (self.lower, self.upper)])

    @cached_property
    def sign(self) -> Array:
        """(s,) of the way from each bound inwards."""
        low = int(np.isfinite(self.lower).sum())
        return np.where(np.arange(len(self.index)) < low, 1.0, -1.0)

    @cached_property
    def bound(self) -> Array:
        """(s,)."""
        return np.where(self.sign > 0, self.lower[self.index], self.upper[self.index])

    def minimum(self) -> Array:
        """(k,) the least of half the square."""
        # One unit from each bound at least.
        x = np.clip(np.zeros(len(self.right)), self.lower + 1.0, np.maximum(self.upper - 1.0, self.lower + 1.0))
        slack = self.sign * (x[self.index] - self.bound)
        pushed = self.sign * (self.normal @ x - self.right)[self.index]
        multiplier = np.maximum(pushed, 0.0) + max(float(np.mean(np.abs(pushed))), 1e-3)
        small = 1e-6 * (1.0 + float(np.abs(self.right).max()))
        tried = _NEARBY
        for _ in range(_MOST):
            gap = float(slack @ multiplier)
            if gap < tried:
                side = np.zeros(len(x), dtype=np.int8)
                active = slack < multiplier
                side[self.index[active]] = -self.sign[active]
                pivoted = _pivoted(self.normal, self.right, self.lower, self.upper, side)
                if pivoted is not None:
                    return pivoted
                tried = gap / _NEARER
            rest = self.normal @ x - self.right - self._summed(self.sign * multiplier)
            if gap < _GAP and np.abs(rest).max() < small:
                break
            dx, risen = self._step(slack, multiplier, rest)
            moved = self.sign * dx[self.index]
            along = min(0.995 * min(_reach(slack, moved), _reach(multiplier, risen)), 1.0)
            x, slack, multiplier = x + along * dx, slack + along * moved, multiplier + along * risen
        return x

    def _step(self, slack: Array, multiplier: Array, rest: Array) -> tuple[Array, Array]:
        """Changes of x and of the multipliers: a predictor, then a centred corrector."""
        factor = _Factor(self.normal + np.diag(self._summed(multiplier / slack)))
        aim = np.zeros(len(slack))
        gap = float(slack @ multiplier)
        for predicting in (True, False):
            wanted = aim / slack - multiplier
            dx = factor.solve(self._summed(self.sign * wanted) - rest)
            moved = self.sign * dx[self.index]
            risen = wanted - multiplier / slack * moved
            if predicting:
                after = (slack + _reach(slack, moved) * moved) @ (multiplier + _reach(multiplier, risen) * risen)
                aim = gap / len(slack) * (float(after) / gap) ** 3 - moved * risen
        return dx, risen

    def _summed(self, values: Array) -> Array:
        """(k,) values of bounds, summed for each coefficient."""
        return np.asarray(np.bincount(self.index, weights=values, minlength=len(self.right)), dtype=np.float64)


def _reach(values: Array, change: Array) -> float:
    """The longest step, at most one, that keeps all values positive."""
    falling = change < 0.0
    return min(float(np.min(-values[falling] / change[falling], initial=np.inf)), 1.0)
