"""Noise that is correlated over tenths of a second: it is found in the residuals, and makes an answer less certain."""

from dataclasses import replace

import numpy as np
import pytest
from composites import composite, measured, without_shape
from scipy.signal import lfilter

from poise.inertia.bayes.blocks import MomentBlocks
from poise.inertia.bayes.estimator import PoiseEstimator, poise
from poise.inertia.bayes.lasting import neighbour_correlation
from poise.inertia.model.problem import NoiseLevels


def filtered(rng: np.random.Generator, count: int, memory: float) -> np.ndarray:
    """Noise (count, 6) of variance one, half of it white, half of it correlated over some samples."""
    keep = np.exp(-1.0 / memory)
    slow = lfilter([np.sqrt(1 - keep**2)], [1, -keep], rng.normal(size=(count + 500, 6)), axis=0)[500:]
    return np.sqrt(0.5) * (slow + rng.normal(size=(count, 6)))


def test_noise_that_is_correlated_over_tenths_of_a_second_widens_the_intervals():
    squares, late = [], []
    quiet = NoiseLevels(linear_acceleration=1e-3, angular_acceleration=1e-3, force_bias=0.5, torque_bias=0.02)
    for seed in range(16):
        rng = np.random.default_rng([79, seed])
        phi = composite(rng).phi
        phi *= 0.5 / phi[0]
        problem = without_shape(measured(rng, phi, samples=500, speed=0.5, noise=quiet))
        noise = quiet.wrench * filtered(rng, 500, 15.0)
        solution = poise(replace(problem, wrench=problem.regressor @ phi + noise))
        squares.append((solution.phi - phi)[:4] ** 2 / np.diag(solution.covariance)[:4])
        late.append((solution.delay / solution.delay_std) ** 2)
    assert 0.4 < np.mean(squares) < 1.5
    assert np.mean(late) < 2.0  # 4.3 when only the variance of the means of blocks counts


@pytest.mark.parametrize("correlation", [0.0, 0.3, 0.6])
def test_the_correlation_of_errors_is_found_in_what_a_fit_leaves(correlation: float):
    rng = np.random.default_rng(80)
    found = []
    for _ in range(20):
        means = lfilter([1.0], [1, -correlation], rng.normal(size=(140, 6)), axis=0)[100:]
        trend = np.linspace(-1, 1, 40)
        means -= means.mean(axis=0) + np.outer(trend, trend @ means) / (trend @ trend)
        blocks = MomentBlocks(
            np.zeros((40, 1, 19, 19)),
            np.zeros((40, 1)),
            np.full(40, 10),
            np.arange(40) * 100_000_000,
            np.arange(40) * 100_000_000 + 90_000_000,
        )
        found.append(neighbour_correlation(means, blocks, np.ones(40, dtype=bool)))
    assert np.mean(found) == pytest.approx(correlation, abs=0.08)


def test_noise_below_the_notable_and_heavy_tails_count_with_their_mean_square():
    rng = np.random.default_rng(81)
    phi = composite(rng).phi
    phi *= 0.5 / phi[0]
    stated = NoiseLevels(linear_acceleration=1e-3, angular_acceleration=1e-3, force_bias=0.5, torque_bias=0.02)
    clean = without_shape(measured(rng, phi, samples=600, speed=0.5, noise=stated))
    for noise in (1.06 * rng.normal(size=(600, 6)), rng.standard_t(3, size=(600, 6)).clip(-3, 3)):
        problem = replace(clean, wrench=clean.regressor @ phi + stated.wrench * noise)
        estimator = PoiseEstimator(None, stated)
        estimator.add_problem(problem)
        solution = estimator.solve()
        used = np.sqrt(estimator._search._sample) * [stated.force, stated.torque]
        left = np.array([solution.residual_force, solution.residual_torque])
        assert (used > 1.02 * stated.wrench[[0, 3]]).all()
        np.testing.assert_allclose(used, left, rtol=0.04)


def test_a_hypothesis_that_was_dropped_comes_back_with_the_delay_of_the_others():
    rng = np.random.default_rng(11)
    phi = composite(rng).phi
    problem = without_shape(measured(rng, 0.3 * phi / phi[0], samples=400, delay=0.01))
    estimator = PoiseEstimator(None, problem.noise)
    estimator.add_problem(problem)
    estimator.solve()
    search = estimator._search
    posterior, normals = search.posterior, search._normals()
    alone = replace(posterior, bias_cases=np.full_like(posterior.bias_cases, posterior.bias_cases[0]))
    delays = [search.grid.estimate(log).mean for log in search.average.along(normals, alone)[0]]
    np.testing.assert_allclose(delays, delays[posterior.bias_cases[0]], atol=0.002)
