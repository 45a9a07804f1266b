"""Point mass discretization: Problem 1 as stated, its limits, and bodies that always can exist."""

import os
from dataclasses import replace

import numpy as np
import pytest
from problems import box_body, box_points, problem_of, wild_problem
from scipy.optimize import minimize
from simulated_loads import random_body

from poise.errors import ErrorCode, InputError, NoAnswerError
from poise.inertia.estimators.hps import static_regressor
from poise.inertia.estimators.pmd import dynamism, full_model_weight, minimise_sum_of_norms, pmd, unit_points
from poise.inertia.model.metrics import errors
from poise.inertia.model.parameters import InertialParameters
from poise.inertia.model.problem import IdentificationProblem, NoiseLevels
from poise.inertia.model.spread_points import spread
from poise.types import Array

RANDOM_INPUTS = int(os.environ.get("POISE_RANDOM_INPUTS", "200"))


def noisy_problem(rng: np.random.Generator, n_points: int = 8, liveliness: float = 1.0) -> IdentificationProblem:
    points = box_points(rng, n_points)
    return problem_of(box_body(), rng, 20, liveliness, NoiseLevels(), wrench_noise=1.0, shape_points=points)


def masses_of(problem: IdentificationProblem, **options: float) -> Array:
    """The point masses behind an answer, for ten points or fewer."""
    return np.linalg.lstsq(unit_points(problem.shape_points), pmd(problem, **options).phi, rcond=None)[0]


def objective(problem: IdentificationProblem, masses: Array, weight: Array, regularisation: float) -> float:
    """Problem 1 row by row, as it is written."""
    points = unit_points(problem.shape_points)
    full = problem.regressor @ points @ masses - problem.wrench
    static = static_regressor(problem.gravity_in_sensor) @ points[:4] @ masses - problem.wrench
    return float(
        np.linalg.norm((1 - weight)[:, None] * static)
        + np.linalg.norm(weight[:, None] * full)
        + regularisation * np.linalg.norm(masses)
    )


def test_dynamism_sums_squared_ratios_and_weights_are_its_tanh() -> None:
    rng = np.random.default_rng(1)
    problem = noisy_problem(rng)
    a, alpha, omega = (
        np.linalg.norm(signal, axis=1)
        for signal in (problem.linear_acceleration, problem.angular_acceleration, problem.angular_velocity)
    )
    nu = a**2 + alpha**2 + (omega / 0.5) ** 2
    np.testing.assert_allclose(dynamism(problem), nu)
    np.testing.assert_allclose(full_model_weight(problem, nu[0])[0], 0.99505, atol=1e-5)


def test_the_answer_minimises_problem_1_as_a_general_solver_does() -> None:
    for seed in range(5):
        problem = noisy_problem(np.random.default_rng(seed))
        weight = full_model_weight(problem, 30.0)
        found = masses_of(problem, c1=30.0)
        best = minimize(
            lambda masses, problem=problem, weight=weight: objective(problem, masses, weight, 0.1),
            np.full(8, 0.1),
            bounds=[(0, None)] * 8,
            method="SLSQP",
            options={"maxiter": 2000, "ftol": 1e-14},
        )
        assert objective(problem, found, weight, 0.1) <= best.fun * (1 + 1e-6)
        np.testing.assert_allclose(found, best.x, atol=2e-3 * best.x.sum())


@pytest.mark.parametrize(("c1", "static_only"), [(1e-9, False), (1e15, True)])
def test_at_the_ends_of_c1_one_model_is_left(c1: float, static_only: bool) -> None:
    problem = noisy_problem(np.random.default_rng(2))
    weight = np.full(len(problem), 0.0 if static_only else 1.0)
    np.testing.assert_allclose(full_model_weight(problem, c1), weight, atol=1e-9)
    found = masses_of(problem, c1=c1)
    rng = np.random.default_rng(3)
    least = objective(problem, found, weight, 0.1)
    for _ in range(200):  # convex: no step inside m >= 0 leads down
        other = np.maximum(found + rng.normal(size=8) * 10 ** rng.uniform(-4, -1), 0)
        assert objective(problem, other, weight, 0.1) >= least * (1 - 1e-7)


def test_static_samples_give_mass_and_centre_of_mass_within_a_thousandth() -> None:
    """The sanity check of thesis section 3.1.4."""
    rng = np.random.default_rng(4)
    points = spread(box_points(rng, 2000), 56)
    problem = problem_of(box_body(), rng, 150, 0.0, NoiseLevels(), shape_points=points)
    found = errors(InertialParameters.from_phi(pmd(problem).phi), box_body(), [0.2, 0.1, 0.05])
    assert found.mass < 0.1
    assert found.com < 0.1


def test_few_point_masses_are_found_again_without_regularisation() -> None:
    rng = np.random.default_rng(5)
    points, masses = box_points(rng, 8), rng.uniform(0.05, 0.2, 8)
    body = InertialParameters.from_phi(unit_points(points) @ masses)
    problem = problem_of(body, rng, 30, 2.0, shape_points=points)
    np.testing.assert_allclose(masses_of(problem, c1=1e-9, regularisation=0.0), masses, rtol=1e-3)


def test_no_input_makes_a_body_that_cannot_exist() -> None:
    rng = np.random.default_rng(6)
    refused = 0
    for _ in range(RANDOM_INPUTS):
        problem = wild_problem(rng)
        try:
            answer = pmd(problem, c1=10 ** rng.uniform(-1, 5))
        except NoAnswerError as error:
            if error.code != ErrorCode.NOT_IDENTIFIABLE:  # noise that pulls upwards
                raise
            refused += 1
            continue
        assert InertialParameters.from_phi(answer.phi).is_consistent
    assert refused < 0.6 * RANDOM_INPUTS


def test_points_in_a_plane_are_refused() -> None:
    rng = np.random.default_rng(7)
    flat = box_points(rng, 30) * [1, 1, 0]
    with pytest.raises(InputError) as caught:
        pmd(problem_of(box_body(), rng, shape_points=flat))
    assert caught.value.code == ErrorCode.OBJECT_INVALID


def test_no_points_are_told_so() -> None:
    rng = np.random.default_rng(8)
    with pytest.raises(InputError) as caught:
        pmd(problem_of(box_body(), rng))
    assert caught.value.code == ErrorCode.UNSUPPORTED


def test_a_force_with_the_wrong_sign_is_told_so() -> None:
    problem = noisy_problem(np.random.default_rng(9))
    with pytest.raises(NoAnswerError) as caught:
        pmd(replace(problem, wrench=-problem.wrench))
    assert caught.value.code == ErrorCode.NOT_IDENTIFIABLE


def test_nonsense_does_not_come_through_the_solver() -> None:
    with pytest.raises(NoAnswerError) as caught:
        minimise_sum_of_norms([(np.full((3, 2), np.nan), np.ones(3))])
    assert caught.value.code == ErrorCode.SOLVER_FAILED


def test_points_are_spread_over_the_shape_and_lie_in_it() -> None:
    rng = np.random.default_rng(10)
    candidates = box_points(rng, 2000)
    chosen = spread(candidates, 56)
    assert 50 <= len(chosen) <= 56
    assert all(np.any(np.all(candidates == point, axis=1)) for point in chosen)

    def closest(points: Array) -> float:
        distances = np.linalg.norm(points[:, None] - points, axis=2)
        return float(distances[~np.eye(len(points), dtype=bool)].min())

    assert closest(chosen) > 3 * closest(rng.choice(candidates, 56))


def test_a_random_body_s_mass_survives_the_wrong_shape() -> None:
    rng = np.random.default_rng(11)
    body = random_body(rng)
    problem = problem_of(body, rng, 60, 0.0, NoiseLevels(), shape_points=box_points(rng, 56))
    assert pmd(problem).phi[0] == pytest.approx(body.mass, rel=0.2)
