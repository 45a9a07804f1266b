"""Divergences between bodies, and the body that is near both to a least-squares cost and to a prior."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from poise.errors import ErrorCode, NoAnswerError
from poise.inertia.model import InertialParameters, phi_of_pseudo_inertia, pseudo_inertia
from poise.types import Array

_MAX_ITERATIONS = 200
_MAX_HALVINGS = 50
_LONGEST_STEP = 3.0
"""Of the logarithm of an eigenvalue."""

# The squared Newton decrement says how far the objective is above its optimum, in units of the divergence. Arrived:
TOLERANCE = 1e-18
# or below what rounding leaves, as a share of the two large terms that cancel.
_ROUNDING = (64 * float(np.finfo(np.float64).eps)) ** 2
# Absurd priors (1 mm for an object of 1 m) leave more to rounding; no body feels this difference.
_GOOD_ENOUGH = 1e-3
# On the central path it need not be closer than this, and the data's weight grows by this factor.
_ON_THE_WAY = 0.3
_WEIGHT_GROWTH = 30.0


@dataclass(frozen=True)
class Divergence:
    """A sum over the eigenvalues x of X = L^-1 P L^-T, where L L^T is the pseudo-inertia of the prior.

    Args:
        value: of each eigenvalue.
        slope: x times the derivative of the value.
        curvature: (4,) -> (4, 4), x_i x_j times the divided differences of the derivative.
    """

    value: Callable[[Array], Array]
    slope: Callable[[Array], Array]
    curvature: Callable[[Array], Array]


def _geodesic_curvature(eigenvalues: Array) -> Array:
    """(4, 4) of 1/2 log^2, whose derivative is log(x) / x."""
    rows, columns = np.meshgrid(eigenvalues, eigenvalues, indexing="ij")
    gap = rows - columns
    alike = np.abs(gap) < 1e-5 * rows
    differences = columns * np.log(rows) - rows * np.log(columns)
    return np.asarray(np.where(alike, 1 - np.log(rows), differences / np.where(alike, 1.0, gap)))


DIVERGENCES = {
    "entropic": Divergence(lambda x: x - np.log(x) - 1, lambda x: x - 1, lambda x: np.ones((4, 4))),
    "geodesic": Divergence(lambda x: np.log(x) ** 2 / 2, np.log, _geodesic_curvature),
}
"""Lee, Wensing and Park 2019, eq. 19 (Bregman divergence of -log det) and eq. 17 (squared geodesic distance)."""


def _symmetric_basis() -> Array:
    """(10, 4, 4) an orthonormal basis of the symmetric matrices."""
    basis = np.zeros((10, 4, 4))
    for index, (row, column) in enumerate(zip(*np.triu_indices(4), strict=True)):
        basis[index, row, column] = basis[index, column, row] = 1.0 if row == column else np.sqrt(0.5)
    return basis


_BASIS = _symmetric_basis()
_ENTRIES = _BASIS.reshape(10, 16)
_DIAGONAL = _ENTRIES[:, ::5]
# Takes a symmetric G to the quadratic form tr(G Z Z) of Z in the basis.
_PRODUCTS = np.einsum("kij,ljm->klim", _BASIS, _BASIS)
_SQUARES = ((_PRODUCTS + _PRODUCTS.swapaxes(0, 1)) / 2).reshape(100, 16)


def unwhitening(prior: InertialParameters) -> Array:
    """(10, 10) U with phi = U x, x the entries of X (1 on the diagonal at the prior) in an orthonormal basis."""
    about_com = pseudo_inertia(prior.in_frame(np.eye(3), -prior.com).phi)  # well conditioned however far the body
    shift = np.eye(4)
    shift[:3, 3] = prior.com
    root = shift @ np.linalg.cholesky(about_com)
    return np.stack([phi_of_pseudo_inertia(root @ entry @ root.T) for entry in _BASIS], axis=1)


@dataclass(frozen=True, eq=False)
class _Point:
    """A positive definite X (4, 4) with its eigenvalues and vectors."""

    matrix: Array
    eigenvalues: Array
    vectors: Array

    @classmethod
    def of(cls, matrix: Array) -> "_Point":
        return cls(matrix, *np.linalg.eigh(matrix))

    @cached_property
    def entries(self) -> Array:
        """(10,) x."""
        return np.asarray(_ENTRIES @ self.matrix.ravel())

    @cached_property
    def root(self) -> Array:
        """(4, 4) R with R R^T = X."""
        return np.asarray(self.vectors * np.sqrt(self.eigenvalues))


@dataclass(frozen=True, eq=False)
class Objective:
    """x^T Q x - 2 q^T x + divergence(X), over positive definite X with entries x.

    Args:
        quadratic: (10, 10) Q, positive semidefinite.
        linear: (10,) q.
        divergence: from the prior, X = 1.
    """

    quadratic: Array
    linear: Array
    divergence: Divergence

    def pull(self, point: _Point) -> Array:
        """(10,) derivative of the quadratic part by x."""
        return np.asarray(2 * (self.quadratic @ point.entries - self.linear))

    def derivatives(self, point: _Point, curved: bool) -> tuple[Array, Array]:
        """(10,) slope and (10, 10) Hessian at Z = 0 along X + R Z R^T or, curved, along R exp(Z) R^T."""
        tangent = (point.root @ _BASIS @ point.root.T).reshape(10, 16) @ _ENTRIES.T
        slope = tangent @ self.pull(point) + _DIAGONAL @ self.divergence.slope(point.eigenvalues)
        hessian = 2 * tangent @ self.quadratic @ tangent.T
        hessian += (_ENTRIES * self.divergence.curvature(point.eigenvalues).ravel()) @ _ENTRIES.T
        if curved:  # which bends by R Z^2 R^T / 2
            hessian += (_SQUARES @ (slope @ _ENTRIES)).reshape(10, 10)
        return slope, hessian

    def search(self, point: _Point, step: Array, decrement: float, curved: bool) -> tuple[_Point, float] | None:
        """The first point along a step where the objective has gone down enough, and the share of the step; or None."""
        rates, directions = np.linalg.eigh((step @ _ENTRIES).reshape(4, 4))
        across, pull = point.root @ directions, self.pull(point)
        length = min(1.0, _LONGEST_STEP / float(np.abs(rates).max()))
        for _ in range(_MAX_HALVINGS):
            change = (across * (np.expm1(length * rates) if curved else length * rates)) @ across.T
            there = _Point.of(point.matrix + (change + change.T) / 2)
            if there.eigenvalues[0] > 0:
                # In differences, for the terms are large and nearly cancel.
                offset = _ENTRIES @ change.ravel()
                gained = offset @ self.quadratic @ offset + pull @ offset
                gained += np.sum(self.divergence.value(there.eigenvalues) - self.divergence.value(point.eigenvalues))
                if gained <= -0.1 * length * decrement + 1e-12:
                    return there, length
            length /= 2
        return None


def minimise(objective: Objective) -> Array:
    """(10,) the entries of the X that minimises an objective.

    The data come in little by little, from the weight that one Newton step does to their own: along this central path
    the iterates keep away from the edge of what can exist.

    Raises:
        NoAnswerError: SOLVER_FAILED.
    """
    point = _Point.of(np.eye(4))
    pull = float(np.linalg.norm(objective.pull(point)))
    weight = min(1.0, 1 / pull) if pull > 0 else 1.0
    while weight < 1:
        lighter = replace(objective, quadratic=weight * objective.quadratic, linear=weight * objective.linear)
        point = _newton(lighter, point, _ON_THE_WAY)
        weight = min(1.0, _WEIGHT_GROWTH * weight)
    return _newton(objective, point, TOLERANCE).entries


def _newton(objective: Objective, point: _Point, tolerance: float) -> _Point:
    """Newton's method with a line search, from a point to the minimum.

    Steps go along geodesics R exp(Z) R^T, where eigenvalues may change by powers of ten at once, or along straight
    lines X + R Z R^T, where the data's part is a parabola. When a step has to be shortened, that way leads along a
    bent valley, and the other one is taken next.
    """
    curved, decrement = True, np.inf
    for _ in range(_MAX_ITERATIONS):
        slope, hessian = objective.derivatives(point, curved)
        step = _downhill_step(hessian, -slope)
        decrement = float(-step @ slope)
        x = point.entries
        if decrement < tolerance + _ROUNDING * float(x @ objective.quadratic @ x + abs(objective.linear @ x)):
            return point
        found = objective.search(point, step, decrement, curved) if np.isfinite(decrement) else None
        if found is None:
            break
        point, length = found
        curved ^= length < 0.5
    if decrement < _GOOD_ENOUGH:
        return point
    raise NoAnswerError(
        ErrorCode.SOLVER_FAILED, "geo: Newton's method did not arrive; is the prior of the object's size, in SI units?"
    )


def _downhill_step(hessian: Array, downhill: Array) -> Array:
    """Newton's step; along directions of negative curvature the other way, so that it leads down."""
    try:
        np.linalg.cholesky(hessian)
    except np.linalg.LinAlgError:
        curvatures, directions = np.linalg.eigh(hessian)
        least = 1e-12 * np.abs(curvatures).max()
        return np.asarray(directions @ (directions.T @ downhill / np.maximum(np.abs(curvatures), least)))
    return np.asarray(np.linalg.solve(hessian, downhill))
