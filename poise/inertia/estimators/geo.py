"""GEO: least squares held to a prior by a divergence between pseudo-inertias (Lee, Wensing and Park 2019)."""

from collections.abc import Callable

import numpy as np

from poise.errors import ErrorCode, InputError, NoAnswerError
from poise.inertia.estimators.answer import answer
from poise.inertia.estimators.divergence import DIVERGENCES, Objective, minimise, unwhitening
from poise.inertia.estimators.entry import EstimatorEntry
from poise.inertia.estimators.pmd import unit_points
from poise.inertia.estimators.sample_window import SampleWindow
from poise.inertia.model import IdentificationProblem, InertialParameters, InertialSolution
from poise.types import Array


def geo(
    problem: IdentificationProblem,
    *,
    alpha: float = 1e-5,
    divergence: str = "entropic",
    prior: InertialParameters | None = None,
) -> InertialSolution:
    """Minimise ||W^(1/2) (A phi - y)||^2 + gamma d(P(phi), P(prior)), gamma = alpha trace(A^T W A).

    d is one of
    - "entropic": tr(P0^-1 P) - log det(P0^-1 P) - 4, the Bregman divergence of -log det. Convex: there is one optimum
      and no other stationary point.
    - "geodesic": 1/2 sum log^2 of the eigenvalues of P0^-1 P, the squared distance on the manifold (thesis eq. 3.29).
      Not convex in phi: a minimum is found, starting at the prior, unless that is wrong by orders of magnitude.
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
    if divergence not in DIVERGENCES or not (np.isfinite(alpha) and alpha > 0):
        raise InputError(
            ErrorCode.BAD_INPUT, f"geo: divergence {divergence!r}, alpha {alpha}: take entropic or geodesic, alpha > 0"
        )
    if not len(problem):
        raise NoAnswerError(ErrorCode.TOO_FEW_SAMPLES, "geo: no samples; a prior alone is not an estimate")
    prior = homogeneous_prior(problem) if prior is None else prior
    if not prior.is_consistent:
        raise InputError(ErrorCode.NOT_CONSISTENT, "geo: the prior is no body that can exist; correct its inertia")
    rows = (problem.regressor / problem.noise.wrench[:, None]).reshape(-1, 10)
    gamma = alpha * float(np.sum(rows**2))
    normal, right, bias_of = _without_bias(problem)
    unwhiten = unwhitening(prior)
    quadratic, linear = unwhiten.T @ normal @ unwhiten / gamma, unwhiten.T @ right / gamma
    phi = unwhiten @ minimise(Objective(quadratic, linear, DIVERGENCES[divergence]))
    return answer(problem, phi, bias=bias_of(phi))


def homogeneous_prior(problem: IdentificationProblem) -> InertialParameters:
    """The object as if it were of one density, with the mass that the forces show.

    Its inertia about the sensor's origin is that of the shape about the same origin, once. Erratum: the thesis' public
    code takes second moments about the sensor's origin and then adds the parallel-axis term m (c c 1 - c c^T) to them
    as if they were about the centre of mass, so that the offset counts twice (and all of its tetrahedra alike,
    whatever their volumes). That code also takes the true mass, which is not known before the object was weighed.

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


ENTRY = EstimatorEntry(
    "geo",
    "least squares with a geometric prior from the shape",
    estimate=geo,
    stream=lambda prior: SampleWindow(geo, prior),
    needs_shape=True,
)
