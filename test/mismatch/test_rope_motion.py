"""A rope from a moving point: its modes, small swings, large swings by another integration, and both forms of code."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from poise.kernels import rope
from poise.mismatch.effects import rope_motion
from poise.mismatch.effects.rope_motion import hanging_rope, rope_modes

GRAVITY = np.array([0.0, 0.0, -9.81])
SECONDS = np.arange(0.0, 12.0, 0.01)
STILL = np.zeros((len(SECONDS), 3))


def pushed(strength: float):
    """(N, 3) m/s2 along x on the pivot, from 1 s to 3.2 s."""
    along = strength * np.sin(2.0 * np.pi * (SECONDS - 1.0) / 1.1) * (np.abs(SECONDS - 2.1) < 1.1)
    return np.stack([along, STILL[:, 0], STILL[:, 0]], axis=1)


def test_the_slowest_mode_is_that_of_a_rope():
    modes = rope_modes(0.0)
    share = 4.0 / 2.404826**2  # of length and of mass; the first zero of the Bessel function J0
    rope = rope_motion._LENGTHS.sum() + 0.5  # the lowest mass is in the middle of its piece
    assert 1.0 / (modes.first * rope) == pytest.approx(share, rel=0.02)
    assert modes.share == pytest.approx(share, rel=0.02)


def test_a_heavy_tip_is_a_pendulum():
    modes = rope_modes(0.999)
    assert modes.share == pytest.approx(1.0, abs=2e-3)
    assert modes.first * rope_motion._LENGTHS.sum() == pytest.approx(1.0, abs=2e-3)


@pytest.mark.parametrize("tip", [0.0, 0.6])
def test_a_small_swing_has_the_frequency_and_damping_of_its_pendulum(tip):
    length, ratio = 0.2, 0.03
    force, _ = hanging_rope(SECONDS, GRAVITY - pushed(0.02), STILL, length, tip, ratio)
    free = force[SECONDS > 5.0, 0][::5]  # the faster modes have faded
    ahead = np.linalg.lstsq(np.stack([free[1:-1], free[:-2]], axis=1), free[2:], rcond=None)[0]
    rate = np.log(np.roots([1.0, *-ahead]).astype(complex))[0] / 0.05  # of a fading swing (Prony's method)
    frequency = np.sqrt(9.81 / length)
    assert abs(rate.imag) == pytest.approx(frequency, rel=0.01)
    assert -rate.real == pytest.approx(ratio * frequency, rel=0.15)  # its joints couple the modes


def test_large_swings_in_a_plane_are_those_of_lagrange_equations():
    """Angles of the links from the vertical, integrated by another method."""
    length, tip, ratio = 0.2, 0.2, 0.02
    modes = rope_modes(tip)
    links = length * modes.first * rope_motion._LENGTHS
    below = np.cumsum(modes.masses[::-1])[::-1]
    shared = np.minimum.outer(below, below) * np.outer(links, links)
    damping = 2.0 * ratio * np.sqrt(9.81 / length) * modes.damping * (length * modes.first) ** 2
    push = pushed(4.0)[:, 0]

    def second(angles, rates, aside):
        turn = np.subtract.outer(angles, angles)
        bends = np.diff(rates, prepend=0.0)
        torque = damping * (np.append(bends[1:], 0.0) - bends)
        torque -= below * links * (9.81 * np.sin(angles) + aside * np.cos(angles))
        return np.linalg.solve(shared * np.cos(turn), torque - (shared * np.sin(turn)) @ rates**2)

    def slope(t, state):
        return np.concatenate([state[4:], second(state[:4], state[4:], np.interp(t, SECONDS, push))])

    span = SECONDS[SECONDS < 6.0]
    solved = solve_ivp(slope, (0.0, span[-1]), np.zeros(8), t_eval=span, max_step=0.01, rtol=1e-8, atol=1e-9).y.T
    accelerations = np.array(
        [second(y[:4], y[4:], np.interp(t, SECONDS, push)) for t, y in zip(span, solved, strict=True)]
    )
    angles, rates = solved[:, :4], solved[:, 4:]
    along = np.cos(angles) * accelerations - np.sin(angles) * rates**2
    expected = -(along * links * below).sum(axis=1)
    force, twist = hanging_rope(SECONDS, GRAVITY - pushed(4.0), STILL, length, tip, ratio)
    assert np.abs(angles).max() > 1.0
    compared = span < 5.0  # later on, the swings of two integrations differ
    error = force[: len(span), 0] - expected
    assert np.sqrt(np.mean(error[compared] ** 2)) < 0.05 * np.sqrt(np.mean(expected[compared] ** 2))
    # The damper of the first joint turns the load about y, as the link turns (about -y for growing angles).
    about = -damping * rates[:, 0]
    assert np.sqrt(np.mean((twist[: len(span), 1] - about)[compared] ** 2)) < 0.05 * np.sqrt(
        np.mean(about[compared] ** 2)
    )


def test_both_forms_of_the_code_agree(monkeypatch):
    seconds = SECONDS[:150]
    rng = np.random.default_rng(3)
    pull, rate = GRAVITY + rng.normal(size=(150, 3)), rng.normal(size=(150, 3))
    compiled = hanging_rope(seconds, pull, rate, 0.3, 0.1, 0.05)
    monkeypatch.setattr(rope_motion, "COMPILED", False)
    plain = hanging_rope(seconds, pull, rate, 0.3, 0.1, 0.05)
    np.testing.assert_allclose(np.array(compiled), np.array(plain), atol=1e-7)


@pytest.mark.parametrize("length", [0.02, 1.5])
@pytest.mark.parametrize("ratio", [5e-4, 0.3])
def test_the_ends_of_the_ranges_stay_finite(length, ratio):
    force, twist = hanging_rope(SECONDS[:400], (GRAVITY - pushed(20.0))[:400], STILL[:400] + 5.0, length, 0.9, ratio)
    assert np.isfinite(force).all()
    assert np.isfinite(twist).all()
    assert np.abs(force).max() < 1e3


def test_the_number_of_steps_is_bounded(monkeypatch):
    steps = []

    def still(lengths, masses, start, drive, turn, damping, step):
        steps.append(len(drive))
        return np.zeros_like(drive), np.tile(start, (len(drive), 1))

    monkeypatch.setattr(rope_motion, "COMPILED", False)
    monkeypatch.setattr(rope_motion, "_moved", still)
    hanging_rope(SECONDS, GRAVITY - pushed(20.0), STILL, 0.02, 0.9, 0.3)
    assert steps[0] <= 2.0 * SECONDS[-1] / rope_motion._SHORTEST_STEP


@pytest.mark.parametrize(("links", "times"), [(1, 40), (2, 40), (5, 40), (4, 2), (4, 3)])
def test_both_forms_agree_for_other_links_and_short_recordings(links, times):
    rng = np.random.default_rng(links)
    seconds, masses = np.cumsum(rng.uniform(0.005, 0.015, times)), rng.dirichlet(np.ones(links))
    pull, rate = GRAVITY + rng.normal(size=(times, 3)), rng.normal(size=(times, 3))
    given = rng.uniform(0.05, 0.2, links), masses, seconds, pull, rate, 1e-4
    for steps in (2, 3, 5 * times):
        compiled, plain = rope(*given, steps), rope_motion._swung(*given, steps)
        np.testing.assert_allclose(np.array(compiled), np.array(plain), atol=1e-6)
