"""Linear filters as physics has them: first and second order, exactly discretised, on stamps that need not be even."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline
from scipy.linalg import expm
from scipy.signal import lfilter

Array = NDArray[np.float64]


def at_times(seconds: Array, values: Array, wanted: Array) -> Array:
    """(M, ...) values (N, ...) at other times, by a cubic spline; held constant outside."""
    inside = np.clip(wanted, seconds[0], seconds[-1])
    return np.asarray(make_interp_spline(seconds, values, k=3, axis=0)(inside))


def low_passed(seconds: Array, values: Array, time_constant: float) -> Array:
    """(N, ...) y with T dy/dt = x - y, x linear between samples (exact), in steady state at the first sample."""
    if time_constant <= 0.0:
        return np.array(values)

    def even(x: Array, step: float) -> Array:
        decay = np.exp(-step / time_constant)
        share = (1.0 - decay) * time_constant / step
        # y+ = decay y + (share - decay) x + (1 - share) x+
        first = (1.0 - (1.0 - share)) * x[:1]
        return np.asarray(lfilter([1.0 - share, share - decay], [1.0, -decay], x, axis=0, zi=first)[0])

    return _evenly(seconds, values, even, finest=time_constant / 2)


def oscillated(seconds: Array, forcing: Array, frequency: float, damping: float) -> tuple[Array, Array]:
    """Displacement z and velocity dz of z'' + 2 zeta w z' + w^2 z = x, x linear between samples (exact).

    In rest at the static deflection x / w^2 at the first sample.

    Args:
        seconds: (N,).
        forcing: (N, ...) x.
        frequency: w / 2 pi, Hz.
        damping: zeta, a ratio.

    Returns:
        z and dz, (N, ...).
    """
    omega = 2.0 * np.pi * frequency
    system = np.array([[0.0, 1.0], [-(omega**2), -2.0 * damping * omega]])

    def even(x: Array, step: float) -> Array:
        # First-order hold: the exponential of [A B 0; 0 0 1; 0 0 0] (Franklin, Powell, Workman 1998, section 6.3).
        block = np.zeros((4, 4))
        block[:2, :2], block[1, 2], block[2, 3] = system * step, step, 1.0
        power = expm(block)
        state, hold, ramp = power[:2, :2], power[:2, 2], power[:2, 3]
        flat = x.reshape(len(x), -1)
        # s+ = state s + (hold - ramp) x + ramp x+; each component of s is a second-order filter of x.
        denominator = [1.0, -np.trace(state), np.linalg.det(state)]
        old, new = hold - ramp, ramp
        cross = np.array([[-state[1, 1], state[0, 1]], [state[1, 0], -state[0, 0]]])
        out = []
        start = flat[:1] / omega**2
        for row in range(2):
            numerator = np.array([new[row], old[row] + cross[row] @ new, cross[row] @ old])
            out.append(_filtered(numerator, np.array(denominator), flat, start if row == 0 else 0.0 * start))
        return np.stack(out, axis=-1).reshape(*x.shape, 2)

    both = _evenly(seconds, forcing, even, finest=1.0 / (12.0 * frequency))
    return both[..., 0], both[..., 1]


def _filtered(numerator: Array, denominator: Array, x: Array, before: Array) -> Array:
    """(N, C) difference equation with x and y constant (y = before) ahead of the first sample."""
    first = numerator[1] * x[:1] + numerator[2] * x[:1] - denominator[1] * before - denominator[2] * before
    second = numerator[2] * x[:1] - denominator[2] * before
    return np.asarray(lfilter(numerator, denominator, x, axis=0, zi=np.concatenate([first, second]))[0])


def _evenly(seconds: Array, values: Array, even: Callable[[Array, float], Array], finest: float) -> Array:
    """Carry values to an even grid, filter them there, and bring the result back to the stamps."""
    steps = np.diff(seconds)
    period = float(np.median(steps))
    if np.abs(steps - period).max() < 1e-6 * period + 1e-9 and period <= finest:
        return even(np.asarray(values, dtype=np.float64), period)
    span = float(seconds[-1] - seconds[0])
    count = int(min(np.ceil(span / max(min(period, finest), period / 8)), 40 * len(seconds))) + 1
    grid = np.linspace(seconds[0], seconds[-1], count)
    return at_times(grid, even(at_times(seconds, values, grid), float(grid[1] - grid[0])), seconds)
