"""InertialEstimate: uncertainties carried over to the centre of mass and the inertia about it."""

import numpy as np
import pytest
from simulated_loads import random_body

from poise.inertia import InertialEstimate, InertialParameters
from poise.inertia.model.solution import InertialSolution


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(17)


def estimate(phi, covariance) -> InertialEstimate:
    solution = InertialSolution(phi, covariance, np.zeros(6), np.eye(6), (), 1.0, 0.1, 0.01, 100, 100.0)
    return InertialEstimate.from_solution(solution, stamp=1, frame_id="ft", method="ols", rejected=())


def test_uncertainties_about_the_centre_are_those_of_a_monte_carlo(rng):
    body = random_body(rng)
    factor = rng.normal(size=(10, 10)) * 1e-3 * np.abs(body.phi)[:, None]
    covariance = factor @ factor.T
    answer = estimate(body.phi, covariance)
    draws = [InertialParameters.from_phi(phi) for phi in rng.multivariate_normal(body.phi, covariance, 20_000)]
    assert answer.mass_std == pytest.approx(np.std([draw.mass for draw in draws]), rel=0.03)
    np.testing.assert_allclose(answer.com_std, np.std([draw.com for draw in draws], axis=0), rtol=0.03)
    about_com = np.std([draw.inertia_vector for draw in draws], axis=0)
    np.testing.assert_allclose(answer.inertia_std, about_com, rtol=0.03)


def test_what_was_not_seen_makes_unknown_only_what_needs_it(rng):
    phi, covariance = random_body(rng).phi.copy(), np.eye(10) * 1e-6
    phi[[2, 9]] = np.nan  # m cy and izz
    covariance[[2, 9], :] = covariance[:, [2, 9]] = np.nan
    answer = estimate(phi, covariance)
    np.testing.assert_array_equal(np.isnan(answer.com_std), [False, True, False])
    np.testing.assert_array_equal(np.isnan(answer.inertia_std), [True, True, False, False, True, True])


def test_a_mass_that_was_not_seen_leaves_no_centre_and_no_inertia_about_it(rng):
    phi, covariance = random_body(rng).phi.copy(), np.eye(10) * 1e-6
    phi[0] = np.nan
    covariance[0, :] = covariance[:, 0] = np.nan
    answer = estimate(phi, covariance)
    assert np.isnan(answer.mass_std)
    assert np.isnan(answer.com_std).all()
    assert np.isnan(answer.inertia_std).all()
    assert not answer.consistent
