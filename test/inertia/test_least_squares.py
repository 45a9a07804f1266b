"""Least squares of the wrench model: exact answers, honest uncertainty, what cannot be seen, sums that agree."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from simulated_loads import BIAS, GRAVITY, random_body, random_motion, static_regressor

from poise.errors import ErrorCode, NoAnswerError
from poise.inertia import InformationAccumulator, solve
from poise.inertia.model import regressor

FORCE_NOISE, TORQUE_NOISE = 0.1, 0.005


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(11)


def noise(rng, n):
    return rng.normal(size=(n, 6)) * np.repeat([FORCE_NOISE, TORQUE_NOISE], 3)


def accumulated(matrix, wrench):
    information = InformationAccumulator()
    information.add(matrix, wrench)
    return information


def test_covariances_are_symmetric_to_the_last_digit(rng):
    matrix = regressor(*random_motion(rng, 300))
    solution = solve(accumulated(matrix, matrix @ np.ones(matrix.shape[-1]) + noise(rng, 300)))
    for covariance in (solution.covariance, solution.bias_covariance):
        np.testing.assert_array_equal(covariance, covariance.T)


@pytest.mark.parametrize("still", [[0, 1, 2, 3, 4, 5], [3, 4, 5]])
def test_a_sensor_that_reads_zero_gives_an_answer(rng, still):
    """An unplugged amplifier reads zero everywhere; a point mass at the origin has no torque."""
    matrix = regressor(*random_motion(rng, 100))
    wrench = noise(rng, 100)
    wrench[:, still] = 0.0
    solution = solve(accumulated(matrix, wrench))
    assert abs(solution.phi[0]) < 0.1
    assert np.isfinite(solution.covariance[0, 0])


def test_without_noise_the_truth_comes_back_with_its_bias(rng):
    for _ in range(20):
        body = random_body(rng)
        matrix = regressor(*random_motion(rng, 100))
        solution = solve(accumulated(matrix, matrix @ body.phi + BIAS))
        np.testing.assert_allclose(solution.phi, body.phi, atol=1e-10)
        np.testing.assert_allclose(solution.bias, BIAS, atol=1e-9)
        assert solution.unidentified == ()
        assert solution.residual_force < 1e-5
        assert np.isfinite(solution.condition_number)


def test_the_answer_is_that_of_ordinary_least_squares_on_whitened_rows(rng):
    body = random_body(rng)
    matrix = regressor(*random_motion(rng, 80))
    wrench = matrix @ body.phi + BIAS + noise(rng, 80)
    weight = np.repeat([1 / FORCE_NOISE, 1 / TORQUE_NOISE], 3)
    rows = np.concatenate([matrix, np.broadcast_to(np.eye(6), (80, 6, 6))], axis=2) * weight[:, None]
    expected, *_ = np.linalg.lstsq(rows.reshape(-1, 16), (wrench * weight).ravel(), rcond=None)
    solution = solve(accumulated(matrix, wrench), noise=(FORCE_NOISE, TORQUE_NOISE))
    np.testing.assert_allclose(np.append(solution.phi, solution.bias), expected, rtol=1e-9, atol=1e-11)
    whitened = rows.reshape(-1, 16)
    expected_covariance = np.linalg.inv(whitened.T @ whitened)[:10, :10]
    np.testing.assert_allclose(solution.covariance, expected_covariance, rtol=1e-8, atol=1e-16)


def test_noise_of_force_and_torque_is_found_from_the_residuals(rng):
    body = random_body(rng)
    matrix = regressor(*random_motion(rng, 2000))
    wrench = matrix @ body.phi + BIAS + noise(rng, 2000)
    known = solve(accumulated(matrix, wrench), noise=(FORCE_NOISE, TORQUE_NOISE))
    found = solve(accumulated(matrix, wrench))
    assert found.residual_force == pytest.approx(FORCE_NOISE, rel=0.03)
    assert found.residual_torque == pytest.approx(TORQUE_NOISE, rel=0.03)
    np.testing.assert_allclose(found.phi, known.phi, atol=0.1 * np.sqrt(np.diag(known.covariance)).max())
    np.testing.assert_allclose(found.covariance, known.covariance, rtol=0.15, atol=1e-12)


def test_at_rest_mass_and_centre_come_out_and_the_inertia_is_named_unseen(rng):
    body = random_body(rng)
    matrix = static_regressor(rng, 24)
    solution = solve(accumulated(matrix, matrix @ body.phi + BIAS + noise(rng, 24)))
    assert solution.unidentified == ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    assert np.isnan(solution.phi[4:]).all()
    assert np.isnan(solution.covariance[4:]).all()
    assert np.isnan(solution.covariance[:, 4:]).all()
    assert solution.condition_number == np.inf
    deviation = np.sqrt(np.diag(solution.covariance)[:4])
    assert np.all(np.abs(solution.phi[:4] - body.phi[:4]) < 4 * deviation)
    assert np.all(np.isfinite(solution.bias))


def test_in_one_attitude_nothing_can_be_told_from_the_bias_and_it_is_said(rng):
    matrix = np.repeat(static_regressor(rng, 1), 50, axis=0)
    wrench = matrix @ random_body(rng).phi + BIAS + noise(rng, 50)
    with pytest.raises(NoAnswerError, match="attitudes") as caught:
        solve(accumulated(matrix, wrench))
    assert caught.value.code is ErrorCode.NOT_IDENTIFIABLE


def test_turning_about_one_level_axis_is_enough_for_mass_and_all_of_the_centre(rng):
    """Gravity stays in the x-z plane: its lever shows along y through x and z, along x and z through y."""
    angles = rng.uniform(-np.pi, np.pi, 60)
    gravity_in_sensor = Rotation.from_rotvec(np.outer(angles, [0, 1, 0])).apply([0, 0, -GRAVITY], inverse=True)
    matrix = regressor(gravity_in_sensor, np.zeros((60, 3)), np.zeros((60, 3)))
    body = random_body(rng)
    solution = solve(accumulated(matrix, matrix @ body.phi + BIAS + noise(rng, 60)))
    assert solution.unidentified == ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


def test_spinning_about_one_axis_shows_the_inertia_about_it_and_names_the_rest(rng):
    """About a vertical z: gravity is constant in the sensor, so the mass hides in the bias; so do ixx, ixy, iyy."""
    n = 200
    omega = np.outer(rng.normal(size=n), [0, 0, 1.0])
    alpha = np.outer(rng.normal(size=n), [0, 0, 4.0])
    matrix = regressor(np.tile([0, 0, -GRAVITY], (n, 1)), omega, alpha)
    body = random_body(rng)
    solution = solve(accumulated(matrix, matrix @ body.phi + BIAS + noise(rng, n)))
    assert solution.unidentified == ("m", "cz", "ixx", "ixy", "iyy")
    deviation = np.sqrt(np.diag(solution.covariance))
    for index in (1, 2, 6, 8, 9):
        assert abs(solution.phi[index] - body.phi[index]) < 4 * deviation[index]


def test_a_hair_of_excitation_is_not_taken_for_an_answer(rng):
    """Rotations of a few microradians, with sensor noise: formally solvable, physically nothing."""
    gravity_in_sensor = Rotation.from_rotvec(rng.normal(0.0, 1e-6, (300, 3))).apply([0, 0, -GRAVITY])
    matrix = regressor(gravity_in_sensor, np.zeros((300, 3)), np.zeros((300, 3)))
    with pytest.raises(NoAnswerError) as caught:
        solve(accumulated(matrix, matrix @ random_body(rng).phi + BIAS + noise(rng, 300)))
    assert caught.value.code is ErrorCode.NOT_IDENTIFIABLE


@pytest.mark.parametrize("n", [0, 1, 2, 3])
def test_fewer_samples_than_unknowns_is_an_error_with_a_code(n, rng):
    matrix = regressor(*random_motion(rng, n))
    with pytest.raises(NoAnswerError) as caught:
        solve(accumulated(matrix, matrix @ random_body(rng).phi))
    assert caught.value.code in (ErrorCode.TOO_FEW_SAMPLES, ErrorCode.NOT_IDENTIFIABLE)


def test_one_by_one_in_chunks_at_once_and_merged_are_the_same_answer(rng):
    body = random_body(rng)
    matrix = regressor(*random_motion(rng, 700))
    wrench = matrix @ body.phi + BIAS + noise(rng, 700)
    expected = solve(accumulated(matrix, wrench))
    single, chunked, left, right = (InformationAccumulator() for _ in range(4))
    for k in range(700):
        single.add(matrix[k], wrench[k])
    start = 0
    while start < 700:
        size = int(rng.integers(1, 60))
        chunked.add(matrix[start : start + size], wrench[start : start + size])
        start += size
    left.add(matrix[:301], wrench[:301])
    right.add(matrix[301:], wrench[301:])
    left.merge(right)
    for information in (single, chunked):
        solution = solve(information)
        np.testing.assert_allclose(solution.phi, expected.phi, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(solution.covariance, expected.covariance, rtol=1e-9, atol=1e-16)
    merged = solve(left)
    np.testing.assert_allclose(merged.phi, expected.phi, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(merged.covariance, expected.covariance, rtol=1e-8, atol=1e-16)


def test_memory_does_not_grow_with_the_samples(rng):
    information = InformationAccumulator()
    matrix = regressor(*random_motion(rng, 4096))
    for _ in range(16):
        information.add(matrix, np.zeros((4096, 6)))
    assert information.n_samples == 65536
    assert len(information.block_sums) <= 16


def test_the_covariance_covers_the_truth_as_often_as_it_says(rng):
    """Normalised squared errors over random loads, motions and noise: 10 on average, when sigma is honest."""
    squares = []
    for _ in range(200):
        body = random_body(rng)
        matrix = regressor(*random_motion(rng, 60))
        solution = solve(accumulated(matrix, matrix @ body.phi + BIAS + noise(rng, 60)))
        error = solution.phi - body.phi
        squares.append(error @ np.linalg.solve(solution.covariance, error))
    assert 0.8 < np.mean(squares) / 10 < 1.15


def test_noise_that_hangs_together_in_time_widens_the_covariance_to_what_it_really_is(rng):
    """Slow turning, drifting noise (AR(1)): one sample in 40 is new; a plain sigma would be six times too small."""
    n, memory = 4000, 0.95
    squares = []
    for _ in range(60):
        body = random_body(rng)
        phase = np.linspace(0, 2 * np.pi, n)[:, None] * [1, 2, 3] + rng.uniform(0, 2 * np.pi, 3)
        gravity_in_sensor = Rotation.from_euler("xyz", np.sin(phase)).apply([0, 0, -GRAVITY], inverse=True)
        matrix = regressor(gravity_in_sensor, np.zeros((n, 3)), np.zeros((n, 3)))
        drift = noise(rng, n) * np.sqrt(1 - memory**2)
        for k in range(1, n):
            drift[k] += memory * drift[k - 1]
        solution = solve(accumulated(matrix, matrix @ body.phi + BIAS + drift))
        error = (solution.phi - body.phi)[:4]
        squares.append(error @ np.linalg.solve(solution.covariance[:4, :4], error))
        assert solution.n_effective < n / 15
    assert 0.6 < np.mean(squares) / 4 < 1.5
