"""Recursive total least squares: the batch's answer sample by sample, and what it grants to accelerations."""

from dataclasses import replace

import numpy as np
import pytest
from problems import EXACT, motion, problem_of
from simulated_loads import BIAS, random_body

from poise.errors import ErrorCode, NoAnswerError
from poise.inertia.estimators.ols import ols
from poise.inertia.estimators.rtls import RecursiveTotalLeastSquares, rtls
from poise.inertia.model.problem import IdentificationProblem, NoiseLevels
from poise.inertia.model.wrench_regressor import regressor
from poise.types import Array

BIASED = replace(EXACT, force_bias=np.inf, torque_bias=np.inf)


def noisy(problem: IdentificationProblem, rng: np.random.Generator) -> IdentificationProblem:
    n, noise = len(problem), problem.noise
    return replace(
        problem,
        wrench=problem.wrench + rng.normal(size=(n, 6)) * noise.wrench,
        linear_acceleration=problem.linear_acceleration + rng.normal(size=(n, 3)) * noise.linear_acceleration,
        angular_acceleration=problem.angular_acceleration + rng.normal(size=(n, 3)) * noise.angular_acceleration,
    )


def column_errors(noise: NoiseLevels) -> Array:
    """(10,) the mean error in each column of the weighted regressor, by sampling."""
    rng = np.random.default_rng(0)
    linear, angular = rng.normal(size=(2, 200_000, 3))
    drawn = regressor(-noise.linear_acceleration * linear, np.zeros_like(linear), noise.angular_acceleration * angular)
    return np.sqrt(np.mean((drawn / noise.wrench[:, None]) ** 2, axis=(0, 1)))


def batch(problem: IdentificationProblem) -> Array:
    """(10,) total least squares at one stroke, by the singular values of everything; bias columns projected out."""
    rows = problem.regressor / problem.noise.wrench[:, None]
    wrench = problem.wrench / problem.noise.wrench
    if problem.noise.has_bias:
        rows, wrench = rows - rows.mean(axis=0), wrench - wrench.mean(axis=0)
    scale = column_errors(problem.noise)
    augmented = np.column_stack([rows.reshape(-1, 10) / scale, wrench.ravel()])
    vector = np.linalg.svd(augmented, full_matrices=False)[2][-1]
    return -vector[:10] / vector[10] / scale


@pytest.mark.parametrize("noise", [EXACT, BIASED], ids=["zeroed sensor", "biased sensor"])
def test_recursive_equals_batch(noise: NoiseLevels) -> None:
    rng = np.random.default_rng(1)
    problem = noisy(problem_of(random_body(rng), rng, 200, noise=noise, bias=BIAS if noise.has_bias else None), rng)
    found, expected = rtls(problem), batch(problem)
    # The batch's column scales come from sampling, good to a few thousandths: that is all that differs.
    np.testing.assert_allclose(found.phi, expected, rtol=1e-4, atol=1e-8)


def test_the_triangle_keeps_the_singular_values_of_all_samples() -> None:
    rng = np.random.default_rng(2)
    problem = noisy(problem_of(random_body(rng), rng, 300), rng)
    estimator = RecursiveTotalLeastSquares(problem.noise)
    for count, (rows, wrench) in enumerate(zip(problem.regressor, problem.wrench, strict=True), start=1):
        estimator.add(rows, wrench)
        if count in (5, 50, 300):
            np.testing.assert_allclose(
                estimator.solve()[0], rtls(problem.select(slice(count))).phi, rtol=1e-9, atol=1e-15
            )
    assert estimator.n_samples == 300


@pytest.mark.parametrize("noise", [EXACT, BIASED], ids=["zeroed sensor", "biased sensor"])
def test_without_noise_the_truth_comes_out(noise: NoiseLevels) -> None:
    rng = np.random.default_rng(4)
    body = random_body(rng)
    bias = BIAS if noise.has_bias else np.zeros(6)
    found = rtls(problem_of(body, rng, 30, noise=noise, bias=bias))
    np.testing.assert_allclose(found.phi, body.phi, rtol=1e-7, atol=1e-10)
    np.testing.assert_allclose(found.bias, bias, atol=1e-7)


def test_exact_accelerations_leave_weighted_least_squares() -> None:
    rng = np.random.default_rng(5)
    noise = NoiseLevels(linear_acceleration=0.0, angular_acceleration=0.0)
    problem = noisy(problem_of(random_body(rng), rng, 60, noise=noise), rng)
    rows = (problem.regressor / noise.wrench[:, None]).reshape(-1, 10)
    expected = np.linalg.lstsq(rows, (problem.wrench / noise.wrench).ravel(), rcond=None)[0]
    np.testing.assert_allclose(rtls(problem).phi, expected, rtol=1e-9, atol=1e-12)


def test_noisy_accelerations_pull_least_squares_to_zero_and_total_least_squares_much_less() -> None:
    rng = np.random.default_rng(6)
    body = random_body(rng)
    noise = NoiseLevels(force=0.5, torque=0.05, linear_acceleration=0.5, angular_acceleration=2.0)
    problem = noisy(problem_of(body, rng, 6000, noise=noise), rng)
    inertia = slice(4, 10)
    shrunk = np.linalg.norm(ols(problem).phi[inertia] - body.phi[inertia])
    assert np.linalg.norm(rtls(problem).phi[inertia] - body.phi[inertia]) < shrunk / 2


def test_too_few_samples_are_refused() -> None:
    rng = np.random.default_rng(7)
    with pytest.raises(NoAnswerError) as caught:
        rtls(problem_of(random_body(rng), rng, 1))
    assert caught.value.code == ErrorCode.TOO_FEW_SAMPLES


def test_what_a_still_sensor_cannot_show_is_refused_not_made_up() -> None:
    rng = np.random.default_rng(8)
    with pytest.raises(NoAnswerError) as caught:
        rtls(problem_of(random_body(rng), rng, 30, liveliness=0.0))
    assert caught.value.code == ErrorCode.NOT_IDENTIFIABLE


def test_a_bias_and_a_single_attitude_are_refused() -> None:
    rng = np.random.default_rng(9)
    fields = motion(rng, 20, 0.0) | {"gravity_in_sensor": np.tile([0.0, 0.0, -9.8], (20, 1))}
    with pytest.raises(NoAnswerError) as caught:
        rtls(IdentificationProblem(**fields, wrench=np.ones((20, 6)), noise=BIASED))
    assert caught.value.code == ErrorCode.NOT_IDENTIFIABLE
