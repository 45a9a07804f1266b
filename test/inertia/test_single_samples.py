"""Samples that come to `PoiseEstimator` one by one: the same sums as all at once, from arrays that are used again."""

import numpy as np
import pytest

from poise.errors import InputError
from poise.inertia.bayes import PoiseEstimator
from poise.inertia.model import InertialParameters, regressor

PAYLOAD = InertialParameters(1.3, np.array([0.02, -0.01, 0.1]), np.diag([4e-3, 3e-3, 2e-3]))


def samples(count: int) -> tuple[np.ndarray, list[np.ndarray]]:
    """Stamps and the five values of a turning sensor."""
    rng = np.random.default_rng(3)
    times = np.arange(count) * 0.01
    phases = times[:, None] * np.array([1.3, 1.7, 2.1])
    gravity = 9.81 * np.stack([np.sin(phases[:, 0]), np.cos(phases[:, 0]), np.zeros(count)], axis=1)
    omega, alpha, linear = np.sin(phases), 2.0 * np.cos(phases), 0.3 * np.sin(2 * phases)
    wrench = regressor(gravity - linear, omega, alpha) @ PAYLOAD.phi + rng.normal(size=(count, 6)) * 0.05
    return (times * 1e9).astype(np.int64), [gravity, linear, omega, alpha, wrench]


@pytest.mark.parametrize("count", [511, 512, 513, 1100])
def test_one_by_one_is_the_same_as_all_at_once(count) -> None:
    stamps, values = samples(count)
    values[4][7] = np.nan  # is rejected in both
    at_once, single = PoiseEstimator(), PoiseEstimator()
    at_once.add(stamps, *values)
    reused = [np.empty(value.shape[1]) for value in values]
    for row in range(count):
        for array, value in zip(reused, values, strict=True):
            array[:] = value[row]
        single.add(int(stamps[row]), *reused)
        for array in reused:
            array[:] = np.nan
    expected, found = at_once.solve(), single.solve()
    np.testing.assert_allclose(found.phi, expected.phi, rtol=1e-12)
    np.testing.assert_allclose(found.covariance, expected.covariance, rtol=1e-9, atol=1e-18)
    assert found.n_samples == expected.n_samples == count - 1
    assert found.rejected == expected.rejected


def test_single_samples_lists_and_portions_keep_their_order() -> None:
    stamps, values = samples(300)
    at_once, mixed = PoiseEstimator(), PoiseEstimator()
    at_once.add(stamps, *values)
    mixed.add(stamps[0], *(value[0] for value in values))
    mixed.add(int(stamps[1]), *(value[1].tolist() for value in values))
    mixed.add(stamps[2], *(value[2] for value in values))
    mixed.add(stamps[3], *(np.repeat(value[3], 2)[::2] for value in values))  # with gaps between the numbers
    mixed.add(stamps[4:], *(value[4:] for value in values))
    np.testing.assert_allclose(mixed.solve().phi, at_once.solve().phi, rtol=1e-12)
    assert mixed.solve().n_samples == at_once.solve().n_samples


def test_a_single_sample_of_wrong_shape_is_refused_at_once() -> None:
    stamps, values = samples(3)
    estimator = PoiseEstimator()
    with pytest.raises((InputError, ValueError)):
        estimator.add(stamps[0], *(value[0] for value in values[:4]), np.zeros(5))


def test_a_single_sample_of_whole_numbers_is_not_read_as_floats() -> None:
    values = [np.array(row) for row in ([0, 0, -10], [0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, -13, 1, 0, 0])]
    whole, floats = PoiseEstimator(), PoiseEstimator()
    for step in range(4):
        whole.add(step * 10_000_000, *values)
        floats.add(step * 10_000_000, *(value.astype(float) for value in values))
    np.testing.assert_array_equal(whole.solve().phi, floats.solve().phi)
