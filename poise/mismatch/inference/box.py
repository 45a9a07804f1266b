"""Least squares with bounds from small normal matrices: an interior-point method."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dpotrf, dpotrs

from poise.types import Array

_GAP = 1e-4
"""Of half the square, within which the least is found."""
_MOST = 60


def box_minimum(normal: Array, right: Array, lower: Array, upper: Array) -> Array:
    """(k,) the least of x' normal x / 2 - right' x with lower <= x <= upper (Mehrotra 1992), to `_GAP`.

    Args:
        normal: (k, k) positive definite.
        right, lower, upper: (k,); bounds may be infinite.

    Raises:
        numpy.linalg.LinAlgError: `normal` is not positive definite.
    """
    low, high = np.isfinite(lower), np.isfinite(upper)
    if not (low.any() or high.any()):
        return _Factor(normal).solve(right)
    # Units in which the box, or the posterior of a coefficient without one, is about one.
    loose = np.maximum(1.0 / np.sqrt(np.diag(normal)), 1e-12)
    unit = np.where(low & high, np.maximum(np.where(low & high, upper - lower, 0.0) / 2, 1e-300), loose)
    scaled = _Box(normal * np.outer(unit, unit), right * unit, lower / unit, upper / unit)
    return np.asarray(np.clip(unit * scaled.minimum(), lower, upper))


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
        for _ in range(_MOST):
            rest = self.normal @ x - self.right - self._summed(self.sign * multiplier)
            if slack @ multiplier < _GAP and np.abs(rest).max() < small:
                break
            dx, risen = self._step(slack, multiplier, rest)
            moved = self.sign * dx[self.index]
            along = min(0.995 * min(_reach(slack, moved), _reach(multiplier, risen)), 1.0)
            x, slack, multiplier = x + along * dx, slack + along * moved, multiplier + along * risen
        near = slack**2 * np.maximum(np.diag(self.normal)[self.index], 1.0) < _GAP / len(x)
        return self._exact(x, self.index[near & (slack < multiplier)])

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

    def _exact(self, x: Array, held: NDArray[np.intp]) -> Array:
        """With some coefficients at their nearest bound, and the least of the others if it stays inside."""
        x = x.copy()
        x[held] = np.where(x - self.lower < self.upper - x, self.lower, self.upper)[held]
        free = np.setdiff1d(np.arange(len(x)), held)
        exact = x.copy()
        if len(free):
            rest = self.right[free] - self.normal[np.ix_(free, held)] @ x[held]
            exact[free] = _Factor(self.normal[np.ix_(free, free)]).solve(rest)
        return exact if ((exact >= self.lower) & (exact <= self.upper)).all() else x

    def _summed(self, values: Array) -> Array:
        """(k,) values of bounds, summed for each coefficient."""
        return np.asarray(np.bincount(self.index, weights=values, minlength=len(self.right)), dtype=np.float64)


def _reach(values: Array, change: Array) -> float:
    """The longest step, at most one, that keeps all values positive."""
    falling = change < 0.0
    return min(float(np.min(-values[falling] / change[falling], initial=np.inf)), 1.0)
