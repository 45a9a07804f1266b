"""Oscillators and pendulums against closed forms, independent integration and energy."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from poise.mismatch.effects.part_motion import Oscillator, crept, hanging

GRAVITY = 9.80665


def uneven(duration, period, seed=0):
    """Stamps with a fifth of a period of jitter, and a twentieth of them lost."""
    rng = np.random.default_rng(seed)
    seconds = np.arange(0.0, duration, period)
    seconds += rng.uniform(-0.1, 0.1, len(seconds)) * period
    keep = rng.random(len(seconds)) > 0.05
    keep[0] = True
    return seconds[keep]


def test_creep_after_a_step_is_the_exponential():
    seconds = np.concatenate([[0.0, 1.0, 1.0 + 1e-9], 1.0 + uneven(20.0, 0.07)[1:]])
    load = (seconds > 1.0).astype(float)[:, None] * [2.0, -3.0]
    said = crept(seconds, load, 4.0)
    expected = (1.0 - np.exp(-np.maximum(seconds - 1.0, 0.0) / 4.0))[:, None] * [2.0, -3.0]
    np.testing.assert_allclose(said, expected, atol=1e-8)


@pytest.mark.parametrize("time_constant", [0.003, 0.5, 40.0])
def test_creep_of_a_ramp_is_exact_however_coarse_the_stamps(time_constant):
    seconds = uneven(10.0, 0.3)
    said = crept(seconds, 2.0 * seconds[:, None], time_constant)[:, 0]
    since = seconds - seconds[0]
    exact = 2.0 * (seconds - time_constant * (1.0 - np.exp(-since / time_constant)))
    np.testing.assert_allclose(said, exact, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("ratio", [0.02, 0.7, 1.0, 3.0])
def test_a_free_oscillation_has_its_closed_form_under_at_and_over_critical_damping(ratio):
    omega, seconds = 2 * np.pi * 3.0, uneven(4.0, 0.05)
    # A force that is let go: linear between the first two stamps, zero afterwards.
    force = np.zeros((len(seconds), 1))
    force[0] = 5.0
    x, dx = Oscillator(seconds, omega**2, 2 * ratio * omega)(force)
    root = np.sqrt(complex(ratio**2 - 1.0)) or 1e-6
    fast, slow = -omega * (ratio + root), -omega * (ratio - root)
    t = seconds[1:] - seconds[1]
    a = (dx[1, 0] - slow * x[1, 0]) / (fast - slow)
    b = x[1, 0] - a
    np.testing.assert_allclose(x[1:, 0], (a * np.exp(fast * t) + b * np.exp(slow * t)).real, atol=1e-7)


def test_a_forced_oscillation_is_that_of_an_independent_integration():
    omega, ratio, seconds = 2 * np.pi * 4.0, 0.05, uneven(6.0, 0.01)

    def push(t):
        return np.sin(7.0 * t) + 0.4 * np.cos(19.0 * t)

    solved = solve_ivp(
        lambda t, y: [y[1], push(t) - 2 * ratio * omega * y[1] - omega**2 * y[0]],
        (seconds[0], seconds[-1]),
        [push(seconds[0]) / omega**2, 0.0],
        t_eval=seconds,
        rtol=1e-10,
        atol=1e-13,
    )
    x, dx = Oscillator(seconds, omega**2, 2 * ratio * omega)(push(seconds)[:, None])
    np.testing.assert_allclose(x[:, 0], solved.y[0], atol=0.01 * np.abs(solved.y[0]).max())
    np.testing.assert_allclose(dx[:, 0], solved.y[1], atol=0.01 * np.abs(solved.y[1]).max())


def test_an_undamped_oscillator_keeps_its_energy():
    omega, seconds = 2 * np.pi * 5.0, uneven(60.0, 0.02)
    force = np.zeros((len(seconds), 1))
    force[0] = 3.0
    x, dx = Oscillator(seconds, omega**2, 0.0)(force)
    energy = (dx**2 + omega**2 * x**2)[1:, 0]
    np.testing.assert_allclose(energy, energy[0], rtol=1e-9)


def test_a_slow_force_moves_an_oscillator_as_a_spring_alone():
    seconds = uneven(40.0, 0.01)
    force = np.sin(0.2 * seconds)[:, None]
    x, _ = Oscillator(seconds, 400.0**2, 40.0)(force)
    np.testing.assert_allclose(x, force / 400.0**2, atol=2e-3 / 400.0**2)


def pendulum(seconds, pivot, length, damping, rate=(0.0, 0.0, 0.0)):
    """`hanging` with a pivot whose acceleration is a function of time."""
    gravity = np.array([0.0, 0.0, -GRAVITY])
    pull = np.array([gravity - pivot(t) for t in seconds]) / length
    turn = np.broadcast_to(np.array(rate), pull.shape)
    return pull, turn, hanging(seconds, pull, turn, np.sqrt(GRAVITY / length), damping)


@pytest.mark.parametrize("length", [0.04, 0.12])
def test_a_pendulum_swings_as_an_independent_integration_says_with_large_swings(length):
    def pivot(t):
        ramp = 1.0 - np.exp(-t)
        return ramp * np.array([3.0 * np.sin(5.0 * t), 2.0 * np.cos(8.0 * t), np.sin(3.0 * t)])

    seconds = uneven(8.0, 0.01)
    damping = 2 * 0.05 * np.sqrt(GRAVITY / length)
    rate = np.array([0.4, -0.7, 0.5])
    _, _, (u, du, ddu) = pendulum(seconds, pivot, length, damping, rate)

    def slope(t, y):
        b = (np.array([0.0, 0.0, -GRAVITY]) - pivot(t)) / length - damping * (y[3:] - np.cross(rate, y[:3]))
        return np.concatenate([y[3:], b - (y[:3] @ b + y[3:] @ y[3:]) * y[:3]])

    solved = solve_ivp(
        slope, (seconds[0], seconds[-1]), np.concatenate([u[0], du[0]]), t_eval=seconds, rtol=1e-9, atol=1e-10
    )
    assert np.abs(u[:, :2]).max() > 0.3
    np.testing.assert_allclose(u, solved.y[:3].T, atol=0.015)
    exact = np.array([slope(t, y)[3:] for t, y in zip(seconds, solved.y.T, strict=True)])
    np.testing.assert_allclose(ddu, exact, atol=0.03 * np.abs(exact).max())
    np.testing.assert_allclose(np.linalg.norm(u, axis=1), 1.0, atol=1e-12)


def test_a_small_swing_has_the_natural_frequency():
    """The pivot is pulled aside once; what follows decays at the period 2 pi sqrt(l / g)."""
    length, seconds = 0.1, np.arange(0.0, 20.0, 0.01)

    def pivot(t):
        return np.array([0.3 if t < 0.15 else 0.0, 0.0, 0.0])

    _, _, (u, _, _) = pendulum(seconds, pivot, length, 0.0)
    late = u[100:, 0]
    crossings = np.flatnonzero((late[:-1] < 0) & (late[1:] >= 0))
    at = crossings - late[crossings] / (late[crossings + 1] - late[crossings])
    assert np.diff(at).mean() * 0.01 == pytest.approx(2 * np.pi * np.sqrt(length / GRAVITY), rel=5e-4)


def test_an_undamped_pendulum_keeps_its_energy_and_a_damped_one_loses_it():
    length, seconds = 0.1, np.arange(0.0, 30.0, 0.01)

    def pivot(t):
        return np.array([4.0 if t < 0.3 else 0.0, 2.0 if t < 0.2 else 0.0, 0.0])

    for damping in (0.0, 0.4):
        _, _, (u, du, _) = pendulum(seconds, pivot, length, damping)
        energy = 0.5 * np.einsum("ni,ni->n", du, du) + GRAVITY / length * (1.0 + u[:, 2])
        free = energy[40:]
        if damping:
            # The means over some swings fall; to first order as exp(-c t).
            assert free[-400:].mean() < 0.01 * free[:400].mean()
        else:
            assert free[-1000:].mean() == pytest.approx(free[:1000].mean(), rel=2e-3)
            assert np.ptp(free) < 0.06 * free.mean()  # the error of a step comes and goes with the swing


def test_a_pendulum_at_rest_hangs_along_what_it_feels():
    seconds = uneven(3.0, 0.01)
    _, _, (u, du, ddu) = pendulum(seconds, lambda t: np.array([3.0, 0.0, 0.0]), 0.1, 0.3)
    felt = np.array([-3.0, 0.0, -GRAVITY])
    np.testing.assert_allclose(u, np.broadcast_to(felt / np.linalg.norm(felt), u.shape), atol=1e-9)
    np.testing.assert_allclose(du, 0.0, atol=1e-7)
    np.testing.assert_allclose(ddu, 0.0, atol=1e-6)
