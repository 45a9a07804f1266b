"""GEO: least squares held to a prior by a divergence between pseudo-inertias (Lee, Wensing and Park 2019)."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from poise.errors import ErrorCode, InputError, NoAnswerError
from poise.inertia.least_squares import Solution
from poise.inertia.parameters import Array, InertialParameters, phi_of_pseudo_inertia, pseudo_inertia
from poise.inertia.pmd import unit_points
from poise.inertia.problem import IdentificationProblem, answer

MAX_ITERATIONS = 500
MAX_HALVINGS = 60
# Newton's decrement squared, in units of the divergence, below which the optimum is reached,
TOLERANCE = 1e-18
# or below what rounding leaves of the gradient, as a share of the two large terms that cancel in it,
ROUNDING = (64 * float(np.finfo(np.float64).eps)) ** 2
# and above which it is not, should no step lead down any more.
NOT_THERE = 1e-8


def geo(
    problem: IdentificationProblem,
    *,
    alpha: float = 1e-5,
    divergence: str = "entropic",
    prior: InertialParameters | None = None,
) -> Solution:
    """Minimise ||W^(1/2) (A phi - y)||^2 + gamma d(P(phi), P(prior)), gamma = alpha trace(A^T W A).

    d is one of
    - "entropic": tr(P0^-1 P) - log det(P0^-1 P) - 4, the Bregman divergence of -log det. Convex and, divided by gamma,
      self-concordant: Newton's method with a line search finds the one optimum.
    - "geodesic": 1/2 sum log^2 of the eigenvalues of P0^-1 P, the squared distance on the manifold (thesis eq. 3.29).
      Not convex in phi: Gauss-Newton steps go downhill from the entropic optimum to a stationary point.
    Both are infinite at the edge of what can exist, so that the answer is physically consistent by construction.
    W holds the inverse variances of force and torque. A bias, where the sensor may have one, is eliminated exactly.

    Args:
        problem: with parts or shape points, unless a prior is given.
        alpha: 1e-5 in thesis section 3.2.4.
        divergence: "entropic" or "geodesic".
        prior: by default `homogeneous_prior(problem)`.

    Raises:
        InputError: BAD_INPUT for another divergence or an alpha that is not positive, NOT_CONSISTENT for a prior that
            cannot exist, UNSUPPORTED when no shape is known to make a prior of.
        NoAnswerError: TOO_FEW_SAMPLES for none at all, NOT_IDENTIFIABLE when nothing weighs, SOLVER_FAILED.
    """
    if divergence not in _DIVERGENCES or not (np.isfinite(alpha) and alpha > 0):
        raise InputError(
            ErrorCode.BAD_INPUT, f"geo: divergence {divergence!r}, alpha {alpha}: take entropic or geodesic, alpha > 0"
        )
    if not len(problem):
        raise NoAnswerError(ErrorCode.TOO_FEW_SAMPLES, "geo: no samples; a prior alone is not an estimate")
    prior = homogeneous_prior(problem) if prior is None else prior
    if not prior.is_consistent:
        raise InputError(ErrorCode.NOT_CONSISTENT, "geo: the prior is no body that can exist; mend its inertia")
    rows = (problem.regressor / problem.noise.wrench[:, None]).reshape(-1, 10)
    gamma = alpha * float(np.sum(rows**2))
    normal, right, bias_of = _without_bias(problem)
    coordinates = _Coordinates.at(prior)
    quadratic = coordinates.unwhiten.T @ normal @ coordinates.unwhiten / gamma
    linear = coordinates.unwhiten.T @ right / gamma
    whitened = _minimise(quadratic, linear, _ENTROPIC, _IDENTITY)
    if divergence != "entropic":
        whitened = _minimise(quadratic, linear, _DIVERGENCES[divergence], whitened)
    phi = coordinates.unwhiten @ whitened
    return answer(problem, phi, bias=bias_of(phi))


def homogeneous_prior(problem: IdentificationProblem) -> InertialParameters:
    """The object as if it were of one density, with the mass that the forces show.

    Its inertia about the sensor's origin is that of the shape about the same origin, once. Erratum: the thesis' public
    code takes second moments about the sensor's origin and then adds the parallel-axis term m (c c 1 - c c^T) to them
    as if they were about the centre of mass, so that the offset counts twice (and all of its tetrahedra alike,
    whatever their volumes). That code also takes the true mass; nobody has it before the object was weighed.

    Raises:
        InputError: UNSUPPORTED when the problem has neither parts nor shape points.
        NoAnswerError: NOT_IDENTIFIABLE when the forces show no mass.
    """
    specific, force = problem.gravity_minus_acceleration, problem.wrench[:, :3]
    if problem.noise.has_bias and len(problem) > 1:  # a constant is no weight
        specific, force = specific - specific.mean(axis=0), force - force.mean(axis=0)
    squares = float(np.sum(specific**2))
    mass = float(np.sum(specific * force)) / squares if squares > 0 else 0.0
    if not mass > 0:
        raise NoAnswerError(ErrorCode.NOT_IDENTIFIABLE, "geo: the forces show no weight; is their sign right?")
    if problem.unit_parts is not None and problem.part_volumes is not None:
        shares = problem.part_volumes / problem.part_volumes.sum()
        return InertialParameters.from_phi(mass * (problem.unit_parts @ shares))
    if problem.shape_points is not None:
        return InertialParameters.from_phi(mass * unit_points(problem.shape_points).mean(axis=1))
    raise InputError(ErrorCode.UNSUPPORTED, "geo needs a prior: give one, or parts or shape points to make it of")


@dataclass(frozen=True)
class _Divergence:
    """A sum over the eigenvalues of P0^-1 P.

    Args:
        value, slope: of one eigenvalue (elementwise).
        curvature: (4,) eigenvalues -> (4, 4) divided differences of the slope, or a positive stand-in for them.
    """

    value: Callable[[Array], Array]
    slope: Callable[[Array], Array]
    curvature: Callable[[Array], Array]


def _log_differences(eigenvalues: Array) -> Array:
    """(4, 4) squared divided differences of the logarithm: Gauss-Newton's part of the curvature of 1/2 log^2."""
    rows, columns = eigenvalues[:, None], eigenvalues[None, :]
    ratio = np.log(rows / columns) / 2
    # (log a - log b) / (a - b) = x / sinh(x) / sqrt(a b) with x = log(a / b) / 2, which is smooth at a = b.
    return np.asarray((_over_sinh(ratio)) ** 2 / (rows * columns))


def _over_sinh(x: Array) -> Array:
    small = np.abs(x) < 1e-6
    safe = np.where(small, 1.0, np.clip(x, -300, 300))
    return np.asarray(np.where(small, 1.0, safe / np.sinh(safe)))


_ENTROPIC = _Divergence(
    value=lambda x: x - np.log(x) - 1, slope=lambda x: 1 - 1 / x, curvature=lambda x: 1 / np.outer(x, x)
)
_GEODESIC = _Divergence(value=lambda x: np.log(x) ** 2 / 2, slope=lambda x: np.log(x) / x, curvature=_log_differences)
_DIVERGENCES = {"entropic": _ENTROPIC, "geodesic": _GEODESIC}


def _symmetric_basis() -> Array:
    """(10, 4, 4) an orthonormal basis of the symmetric matrices."""
    basis = np.zeros((10, 4, 4))
    for index, (row, column) in enumerate(zip(*np.triu_indices(4), strict=True)):
        basis[index, row, column] = basis[index, column, row] = 1.0 if row == column else np.sqrt(0.5)
    return basis


_BASIS = _symmetric_basis()
_IDENTITY = np.einsum("kii->k", _BASIS)


@dataclass(frozen=True, eq=False)
class _Coordinates:
    """phi = unwhiten @ x, where x are the entries of L^-1 P L^-T in `_BASIS` and L L^T is the prior's P."""

    unwhiten: Array

    @classmethod
    def at(cls, prior: InertialParameters) -> "_Coordinates":
        root = np.linalg.cholesky(pseudo_inertia(prior.phi))
        return cls(np.stack([phi_of_pseudo_inertia(root @ entry @ root.T) for entry in _BASIS], axis=1))


def _minimise(quadratic: Array, linear: Array, divergence: _Divergence, start: Array) -> Array:
    """(10,) x that minimises x^T Q x - 2 q^T x + sum of the divergence over the eigenvalues of X, by Newton's method.

    Raises:
        NoAnswerError: SOLVER_FAILED.
    """
    x = start
    eigenvalues, vectors = np.linalg.eigh(_matrix(x))
    for _ in range(MAX_ITERATIONS):
        turned = (vectors.T @ _BASIS @ vectors).reshape(10, 16)
        slope = turned[:, ::5] @ divergence.slope(eigenvalues)
        downhill = 2 * (linear - quadratic @ x) - slope
        hessian = 2 * quadratic + (turned * divergence.curvature(eigenvalues).ravel()) @ turned.T
        step = np.linalg.solve(hessian, downhill)
        decrement = float(step @ downhill)
        if not np.isfinite(decrement):
            break
        if decrement < TOLERANCE + ROUNDING * float(x @ quadratic @ x + abs(linear @ x)):
            return x + step if _is_positive(x + step) else x
        length, found = 1.0, None
        for _ in range(MAX_HALVINGS):
            trial = np.linalg.eigh(_matrix(x + length * step))
            if trial[0][0] > 0:
                # In differences, for both terms are large and nearly cancel.
                change = length * (length * (step @ quadratic @ step) - 2 * step @ (linear - quadratic @ x))
                change += np.sum(divergence.value(trial[0]) - divergence.value(eigenvalues))
                if change <= -0.25 * length * decrement + 1e-13:
                    found = trial
                    break
            length /= 2
        if found is None:
            if decrement < NOT_THERE:
                return x
            break
        x = x + length * step
        eigenvalues, vectors = found
    raise NoAnswerError(ErrorCode.SOLVER_FAILED, "geo: Newton's method did not arrive; are the samples in SI units?")


def _matrix(x: Array) -> Array:
    return np.tensordot(x, _BASIS, 1)


def _is_positive(x: Array) -> bool:
    return bool(np.linalg.eigvalsh(_matrix(x))[0] > 0)


def _without_bias(problem: IdentificationProblem) -> tuple[Array, Array, Callable[[Array], Array]]:
    """Normal matrix (10, 10) and right-hand side (10,) of phi with the best bias for each phi, and that bias."""
    weights = 1 / problem.noise.wrench**2
    rows, wrench = problem.regressor, problem.wrench
    normal = np.einsum("kri,r,krj->ij", rows, weights, rows)
    right = np.einsum("kri,r,kr->i", rows, weights, wrench)
    if not problem.noise.has_bias:
        return normal, right, lambda phi: np.zeros(6)
    spread = np.repeat([problem.noise.force_bias, problem.noise.torque_bias], 3)
    with np.errstate(divide="ignore"):
        information = len(problem) * weights + 1 / spread**2
    mean_rows = weights[:, None] * rows.sum(axis=0)
    mean_wrench = weights * wrench.sum(axis=0)
    normal = normal - mean_rows.T @ (mean_rows / information[:, None])
    right = right - mean_rows.T @ (mean_wrench / information)
    return normal, right, lambda phi: (mean_wrench - mean_rows @ phi) / information
