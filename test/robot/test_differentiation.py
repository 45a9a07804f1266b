"""Derivatives of samples: exact for polynomials, close to optimal with noise, with true error bars."""

import numpy as np
import pytest
from scipy.interpolate import BSpline
from scipy.signal import savgol_filter
from scipy.spatial.transform import Rotation

from poise.errors import ErrorCode, InputError
from poise.robot import differentiate, differentiate_rotations
from poise.robot.splines import Design, Grid, SplineFit

RATE = 125.0


def nanoseconds(seconds):
    return np.round(np.asarray(seconds) * 1e9).astype(np.int64)


def fourier(seconds, rng, columns=3, base=2 * np.pi * 0.15, harmonics=5):
    """Position, velocity and acceleration of a random periodic motion, as an excitation of an arm is."""
    k = base * np.arange(1, harmonics + 1)
    a, b = rng.normal(size=(2, harmonics, columns)) * 0.5 / np.arange(1, harmonics + 1)[None, :, None]
    sine, cosine = np.sin(np.outer(seconds, k)), np.cos(np.outer(seconds, k))
    return sine @ a + cosine @ b, (cosine * k) @ a - (sine * k) @ b, -(sine * k**2) @ a - (cosine * k**2) @ b


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


def test_the_basis_is_the_quintic_b_spline():
    rng = np.random.default_rng(1)
    grid, coefficients = Grid(0.0, 0.1, 10), rng.normal(size=15)
    seconds = np.linspace(0.0, 0.999, 60)
    knots = 0.1 * np.arange(-5, 16)
    for derivative in range(3):
        ours = Design(grid, seconds).evaluate(coefficients[:, None], derivative)[:, 0]
        np.testing.assert_allclose(ours, BSpline(knots, coefficients, 5)(seconds, derivative), rtol=1e-11, atol=1e-11)


def test_a_quintic_polynomial_is_differentiated_exactly_on_uneven_stamps():
    rng = np.random.default_rng(2)
    stamps = nanoseconds(np.sort(rng.uniform(0.0, 4.0, 300)))
    t = (stamps - stamps[0]) * 1e-9
    polynomial = np.polynomial.Polynomial([0.3, -1.0, 0.5, 0.2, -0.05, 0.01])
    result = differentiate(stamps, polynomial(t)[:, None], gap=1.0)
    np.testing.assert_allclose(result.velocity[:, 0], polynomial.deriv()(t), atol=1e-9)
    np.testing.assert_allclose(result.acceleration[:, 0], polynomial.deriv(2)(t), atol=1e-7)


@pytest.mark.parametrize("noise", [1e-6, 1e-4, 1e-3])
def test_stated_errors_are_the_true_ones(noise):
    rng = np.random.default_rng(3)
    seconds = np.arange(0.0, 20.0, 1.0 / RATE)
    truth = fourier(seconds, rng, columns=8)
    result = differentiate(nanoseconds(seconds), truth[0] + rng.normal(size=truth[0].shape) * noise)
    for value, sigma, true in zip(
        (result.position, result.velocity, result.acceleration),
        (result.position_sigma, result.velocity_sigma, result.acceleration_sigma),
        truth,
        strict=True,
    ):
        assert 0.8 < rms((value - true) / sigma) < 1.25
        assert 0.90 < np.mean(np.abs(value - true) < 1.96 * sigma) < 0.99


def test_splines_beat_the_best_savitzky_golay_filter_of_any_window():
    rng = np.random.default_rng(4)
    seconds = np.arange(0.0, 20.0, 1.0 / RATE)
    position, _, acceleration = fourier(seconds, rng)
    samples = position + rng.normal(size=position.shape) * 1e-4
    inner = slice(60, -60)
    best = min(
        rms((savgol_filter(samples, window, order, deriv=2, delta=1 / RATE, axis=0) - acceleration)[inner])
        for window in range(7, 121, 6)
        for order in (3, 4, 5)
    )
    ours = rms((differentiate(nanoseconds(seconds), samples).acceleration - acceleration)[inner])
    assert ours < best / 1.5


def test_measured_velocities_help_and_bad_ones_do_no_harm():
    rng = np.random.default_rng(5)
    seconds = np.arange(0.0, 20.0, 1.0 / RATE)
    position, velocity, acceleration = fourier(seconds, rng)
    samples = position + rng.normal(size=position.shape) * 1e-4
    stamps, noise = nanoseconds(seconds), rng.normal(size=position.shape)

    def error(rates):
        return rms(differentiate(stamps, samples, rates).acceleration - acceleration)

    alone = error(None)
    assert error(velocity + 1e-3 * noise) < 0.7 * alone
    assert error(velocity + 0.3 + 0.1 * noise) < 1.02 * alone  # wrong by a constant
    assert error(np.full_like(velocity, np.nan)) == alone


def test_nothing_is_derived_across_a_gap():
    rng = np.random.default_rng(6)
    seconds = np.arange(0.0, 8.0, 1.0 / RATE)
    position, velocity, _ = fourier(seconds, rng)
    away = (seconds > 3.0) & (seconds < 5.0)
    jumped = position + (seconds > 4.0)[:, None] * 10.0  # would be a velocity of 5 rad/s across the gap
    result = differentiate(nanoseconds(seconds[~away]), jumped[~away])
    np.testing.assert_allclose(result.velocity, velocity[~away], atol=1e-3)


def test_a_stretch_too_short_to_judge_gives_nan_and_the_rest_gives_answers():
    seconds = np.concatenate([np.arange(0, 2, 0.01), [5.0, 5.01, 5.02]])
    result = differentiate(nanoseconds(seconds), np.sin(seconds)[:, None])
    assert np.isnan(result.acceleration[-3:]).all()
    assert np.isfinite(result.acceleration[:-3]).all()
    assert np.isfinite(result.acceleration_sigma[:-3]).all()


def test_lost_samples_and_equal_stamps_are_survived():
    rng = np.random.default_rng(7)
    seconds = np.sort(np.concatenate([np.arange(0, 10, 0.008), [2.0, 2.0, 2.0]]))
    position, velocity, _ = fourier(seconds, rng)
    kept = rng.uniform(size=len(seconds)) > 0.2
    kept[:12] = True
    result = differentiate(nanoseconds(seconds[kept]), position[kept])
    np.testing.assert_allclose(result.velocity[20:-20], velocity[kept][20:-20], atol=1e-4)


@pytest.mark.parametrize(
    ("stamps", "position", "code"),
    [
        (np.arange(5), np.zeros((5, 2)), ErrorCode.TOO_FEW_SAMPLES),
        (np.zeros(50), np.zeros((50, 2)), ErrorCode.TOO_FEW_SAMPLES),
        (np.arange(50)[::-1], np.zeros((50, 2)), ErrorCode.TIME_BACKWARDS),
        (np.arange(50), np.full((50, 2), np.nan), ErrorCode.NOT_FINITE),
        (np.arange(50), np.zeros(50), ErrorCode.TYPE_MISMATCH),
        (np.arange(0), np.zeros((0, 2)), ErrorCode.TOO_FEW_SAMPLES),
    ],
)
def test_what_cannot_be_differentiated_is_said(stamps, position, code):
    with pytest.raises(InputError) as caught:
        differentiate(stamps, position)
    assert caught.value.code is code


def test_a_constant_spin_has_its_rate_and_no_acceleration():
    seconds = np.arange(0.0, 5.0, 0.01)
    omega = np.array([0.4, -1.2, 2.0])  # turns through several full turns
    start = Rotation.from_rotvec([0.5, 0.2, -0.7])
    result = differentiate_rotations(
        nanoseconds(seconds), (start * Rotation.from_rotvec(np.outer(seconds, omega))).as_matrix()
    )
    np.testing.assert_allclose(result.angular_velocity, np.tile(omega, (500, 1)), atol=1e-7)
    np.testing.assert_allclose(result.angular_acceleration, 0.0, atol=1e-4)


def coning(seconds, tilt=0.6, spin=1.5, precession=0.9):
    """R = Rz(p t) Rx(tilt) Rz(s t) with its body rates in closed form (Euler's angles, z-x-z)."""
    p, s = precession * seconds, spin * seconds
    rotation = Rotation.from_euler("ZXZ", np.column_stack([p, np.full_like(p, tilt), s])).as_matrix()
    a = precession * np.sin(tilt)
    omega = np.column_stack([a * np.sin(s), a * np.cos(s), np.full_like(s, precession * np.cos(tilt) + spin)])
    alpha = np.column_stack([a * spin * np.cos(s), -a * spin * np.sin(s), np.zeros_like(s)])
    return rotation, omega, alpha


@pytest.mark.parametrize("noise", [1e-5, 1e-3])
def test_rates_of_a_coning_body_and_their_stated_errors(noise):
    rng = np.random.default_rng(8)
    seconds = np.arange(0.0, 20.0, 0.01)
    rotation, omega, alpha = coning(seconds)
    shaken = rotation @ Rotation.from_rotvec(rng.normal(size=(len(seconds), 3)) * noise).as_matrix()
    result = differentiate_rotations(nanoseconds(seconds), shaken)
    # Up to twice too careful: where the body turns within a knot interval, part of the noise is along the quaternion.
    assert 0.5 < rms((result.angular_velocity - omega) / result.angular_velocity_sigma[:, None]) < 1.2
    assert 0.5 < rms((result.angular_acceleration - alpha) / result.angular_acceleration_sigma[:, None]) < 1.2
    assert rms(result.angular_acceleration - alpha) < 100 * noise


def test_a_matrix_that_is_no_rotation_is_refused_by_its_place():
    matrices = np.tile(np.eye(3), (40, 1, 1))
    matrices[17] *= 1.1
    with pytest.raises(InputError, match="sample 17"):
        differentiate_rotations(np.arange(40) * 10**7, matrices)


def test_noise_gain_is_that_of_the_whole_normal_matrix():
    rng = np.random.default_rng(9)
    seconds = np.sort(rng.uniform(0.0, 30.0, 2000))
    design = Design(Grid.across(seconds, 290), seconds)  # several blocks of the inverse
    fit = SplineFit(design, rng.normal(size=(2000, 1)))
    basis = [design.evaluate(np.eye(295), d) for d in range(3)]
    covariance = np.linalg.inv(basis[0].T @ basis[0])
    gains = fit.gains(seconds)
    for d, e in ((0, 0), (0, 2), (1, 1), (2, 2)):
        expected = np.einsum("ni,ij,nj->n", basis[d], covariance, basis[e])
        np.testing.assert_allclose(gains[50:-50, d, e], expected[50:-50], rtol=2e-3)


@pytest.mark.parametrize("with_rates", [False, True])
def test_joints_together_are_the_same_as_one_by_one(with_rates):
    """Splines, measured rates and rests of all joints are solved in one call; none of them sees another."""
    rng = np.random.default_rng(4)
    seconds = np.arange(750) * 2e-3 + rng.uniform(-2e-4, 2e-4, 750)
    stamps = np.round((seconds + 1.0) * 1e9).astype(np.int64)
    speeds = np.array([0.7, 2.3, 6.0, 0.0])
    position = np.sin(seconds[:, None] * speeds) + rng.normal(size=(750, 4)) * [1e-5, 1e-4, 1e-6, 1e-5]
    velocity = speeds * np.cos(seconds[:, None] * speeds) + rng.normal(size=(750, 4)) * [1e-3, 1e-4, 1e-2, 1e-3]
    rates = velocity if with_rates else None
    together = differentiate(stamps, position, rates)
    assert together.at_rest[:, 3].any()
    for k in range(4):
        alone = differentiate(stamps, position[:, [k]], None if rates is None else rates[:, [k]])
        assert alone.knot_spacing[0] == together.knot_spacing[k]
        np.testing.assert_array_equal(alone.at_rest[:, 0], together.at_rest[:, k])
        for name in ("position", "velocity", "acceleration", "covariance"):
            found, expected = getattr(together, name)[:, k], getattr(alone, name)[:, 0]
            np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-9 * np.abs(expected).max())
