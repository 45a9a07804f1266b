"""How good an estimate can be: Cramer-Rao bounds of a trial, with and without knowledge of parts and motion."""

import numpy as np

from benchmarks.identification.scenarios import Trial
from poise.inertia.model.metrics import expected_errors
from poise.inertia.model.wrench_regressor import regressor
from poise.types import Array

BOUNDS = {
    "bound": "Cramer-Rao, no prior, each acceleration measured once",
    "bound, smooth": "Cramer-Rao, no prior, accelerations known exactly (what perfect smoothing would give)",
    "bound, parts": "Bayesian Cramer-Rao, accelerations known, phi in the span of the parts, part masses +- 100 %",
}


def bounds(trial: Trial) -> dict[str, Array]:
    """(3,) the least mean e_m, e_c, e_I in % that an estimator without systematic error can have, for each of `BOUNDS`.

    The third has a prior: an estimator that believes in the same parts may fall below the first two; where the parts
    are wrong (rubber over a metal shaft) no estimator reaches it.
    """
    truth, box = trial.subject.truth, trial.subject.bounding_box
    noisy = fisher_information(trial, exact_motion=False)
    smooth = fisher_information(trial, exact_motion=True)
    covariances = {
        "bound": np.linalg.pinv(noisy, hermitian=True, rcond=1e-14),
        "bound, smooth": np.linalg.pinv(smooth, hermitian=True, rcond=1e-14),
        "bound, parts": _within_parts(trial, smooth),
    }
    return {name: expected_errors(covariance, truth, box)[0] for name, covariance in covariances.items()}


def fisher_information(trial: Trial, *, exact_motion: bool) -> Array:
    """(10, 10) the information of the samples on phi, an unknown bias eliminated.

    With accelerations as unknowns of their own, measured once with their noise, what is left for phi is the
    information in the wrench with the noise that they bring: A^T (S_w + J S_a J^T)^-1 A, J the derivative of the
    wrench by the accelerations, which is the same for every sample.
    """
    problem, noise, phi = trial.clean, trial.problem.noise, trial.subject.truth.phi
    covariance = np.diag(noise.wrench**2)
    if not exact_motion:
        axes, still = np.eye(3), np.zeros((3, 3))
        linear = regressor(-axes, still, still) @ phi * noise.linear_acceleration
        angular = regressor(still, still, axes) @ phi * noise.angular_acceleration
        covariance = covariance + linear.T @ linear + angular.T @ angular
    weight = np.linalg.inv(covariance)
    information = np.einsum("kri,rs,ksj->ij", problem.regressor, weight, problem.regressor, optimize=True)
    if not noise.has_bias:
        return np.asarray(information)
    mean_rows = weight @ problem.regressor.sum(axis=0)
    prior = np.diag(1 / np.repeat([noise.force_bias, noise.torque_bias], 3) ** 2)
    return np.asarray(information - mean_rows.T @ np.linalg.solve(len(problem) * weight + prior, mean_rows))


def _within_parts(trial: Trial, information: Array) -> Array:
    """(10, 10) covariance of phi = unit_parts m with m known beforehand to 100 % of what a homogeneous object has."""
    subject = trial.subject
    masses = subject.truth.mass * subject.part_volumes / subject.volume
    root = subject.unit_parts * masses  # per unit of relative deviation
    posterior = np.linalg.inv(root.T @ information @ root + np.eye(len(masses)))
    return np.asarray(root @ posterior @ root.T)
