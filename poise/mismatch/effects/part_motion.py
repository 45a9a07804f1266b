"""Motion of a part on a spring or a rod: exact for stamps that need not be uniform."""

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg.lapack import dtbtrs

from poise.geometry import cross
from poise.kernels import COMPILED, pendulum
from poise.mismatch.recorded import hermite, linear_at
from poise.types import Array

_SWING_STEP, _LONGEST_STEP = 0.24, 0.03
"""rad of phase, and s: largest steps of a pendulum."""


def crept(seconds: Array, values: Array, time_constant: float) -> Array:
    """(N, K) s with T ds/dt = w - s, w linear between stamps (exact); s = w at the first.

    Args:
        seconds: (N,) ascending.
        values: (N, K) w.
        time_constant: T, s.
    """
    step = np.diff(seconds)
    decay = np.exp(-step / time_constant)
    # 1 - (1 - e^-x) / x, the share of the newer value (Franklin, Powell, Workman 1998, section 6.3).
    newer = 1.0 - (1.0 - decay) * time_constant / step
    right = np.array(values, dtype=np.float64, order="F")
    right[1:] = newer[:, None] * values[1:] + (1.0 - decay - newer)[:, None] * values[:-1]
    return accumulated(decay, right)


def accumulated(kept: Array, added: Array) -> Array:
    """(N, K) s[k + 1] = kept[k] s[k] + added[k + 1], s = added at the first; `added` is overwritten.

    Args:
        kept: (N - 1,). added: (N, K), in Fortran's order.
    """
    band = np.ones((2, len(added)), order="F")
    band[1, :-1] = -kept
    return np.asarray(dtbtrs(band, added, uplo="L", overwrite_b=1)[0])


class Oscillator:
    """x'' + c x' + k x = f with f linear and k, c constant between stamps: exact.

    Args:
        seconds: (N,) ascending.
        stiffness: k > 0, 1/s2: a number, or (N - 1,) of each interval.
        damping: c, 1/s: a number, or (N - 1,).
    """

    def __init__(self, seconds: Array, stiffness: ArrayLike, damping: ArrayLike) -> None:
        self._step, self._k, self._c = np.broadcast_arrays(np.diff(seconds), stiffness, damping)
        self._matrix = transition(self._step, self._k, self._c)
        # s+ = M s + g for all stamps at once: a lower triangular system with three bands.
        self._band = np.zeros((4, 2 * len(seconds)), order="F")
        self._band[0] = 1.0
        self._band[2, :-2:2], self._band[3, :-2:2] = -self._matrix[0, 0], -self._matrix[1, 0]
        self._band[1, 1:-2:2], self._band[2, 1:-2:2] = -self._matrix[0, 1], -self._matrix[1, 1]

    def __call__(self, forcing: Array) -> tuple[Array, Array]:
        """Displacement x and velocity dx, (N, K), under forces f (N, K); at the first stamp at rest, x = f / k."""
        k, c = self._k[:, None], self._c[:, None]
        # Of a force that grows linearly, a motion that does too: x = (f - c f'/k) / k, dx = f'/k.
        slope = np.diff(forcing, axis=0) / (self._step[:, None] * k)
        lag = c * slope
        begin, end = (forcing[:-1] - lag) / k, (forcing[1:] - lag) / k
        (m00, m01), (m10, m11) = self._matrix[..., None]
        state = np.empty((len(forcing), 2, forcing.shape[1]))
        state[0, 0], state[0, 1] = forcing[0] / k[0], 0.0
        state[1:, 0] = end - m00 * begin - m01 * slope
        state[1:, 1] = slope - m10 * begin - m11 * slope
        right = np.asfortranarray(state.reshape(2 * len(forcing), -1))
        solved = dtbtrs(self._band, right, uplo="L", overwrite_b=1)[0]
        return np.asarray(solved[::2]), np.asarray(solved[1::2])


def transition(h: Array, k: Array, c: Array) -> Array:
    """(2, 2, n) what x and dx of an `Oscillator` become after h seconds without force, for h, k and c (n,)."""
    rate = k - c**2 / 4.0
    root = np.sqrt(np.abs(rate)) + 1e-12
    # A damping beyond the critical one turns cosine and sine into the hyperbolic ones.
    fade = np.exp(-c * h / 2.0)
    cosine = fade * np.where(rate >= 0.0, np.cos(root * h), np.cosh(np.minimum(root * h, 300.0)))
    sine = fade * np.where(rate >= 0.0, np.sin(root * h), np.sinh(np.minimum(root * h, 300.0))) / root
    return np.array([[cosine + c / 2.0 * sine, sine], [-k * sine, cosine - c / 2.0 * sine]])


def hanging(seconds: Array, pull: Array, rate: Array, frequency: float, damping: float) -> tuple[Array, Array, Array]:
    """Direction of a spherical pendulum in the world, and its first and second derivative, (N, 3) each.

    u'' = b - (u.b + |u'|^2) u, b = pull - c (u' - omega x u), |u| = 1; it begins in steady state along the pull.
    Integrated by the SHAKE method (Hairer, Lubich, Wanner 2006, section VII.1.4), the step's square scaled so that a
    small swing has exactly the natural frequency.

    Args:
        seconds: (N,) ascending.
        pull: (N, 3) 1/s2, (gravity minus acceleration of the pivot) over the length, world axes.
        rate: (N, 3) rad/s of the vessel, world axes.
        frequency: rad/s, natural, of small swings.
        damping: c, 1/s, against the vessel.
    """
    # Step sizes from a geometric ladder: they do not change with every frequency that is tried.
    finer = max(np.ceil(2.0 * np.log2(frequency * _LONGEST_STEP / _SWING_STEP)), 0.0)
    count = int(np.ceil((seconds[-1] - seconds[0]) / _LONGEST_STEP * 2.0 ** (finer / 2.0))) + 1
    even = np.linspace(seconds[0], seconds[-1], count)
    step = float(even[1] - even[0])
    square = 2.0 * (1.0 - np.cos(frequency * step)) / frequency**2
    half = damping * square / (2.0 * step)
    drive = linear_at(seconds, pull * (square / (1.0 + half)), even)
    turn = linear_at(seconds, rate * (damping * square / (1.0 + half)), even)
    steady = drive[:3] / np.linalg.norm(drive[:3], axis=1, keepdims=True)
    before = 3.0 * steady[0] - 3.0 * steady[1] + steady[2]
    places = (pendulum if COMPILED else _shaken)(np.stack([steady[0], before]), drive, turn, half)
    # The same correction for the speed: of a sine, a central difference says sin(w h) / (w h) of it.
    speeds = np.gradient(places, axis=0, edge_order=2) * (frequency / np.sin(frequency * step))
    u, du = (hermite(even, places.T, speeds.T, seconds, derivative).T for derivative in (0, 1))
    return _with_second(pull, rate, damping, u, du)


def _with_second(pull: Array, rate: Array, damping: float, u: Array, du: Array) -> tuple[Array, Array, Array]:
    u = u / np.linalg.norm(u, axis=1, keepdims=True)
    force = pull - damping * (du - cross(rate, u))
    inward = np.einsum("ni,ni->n", u, force) + np.einsum("ni,ni->n", du, du)
    return u, du, force - inward[:, None] * u


def _shaken(start: Array, drive: Array, turn: Array, half: float) -> Array:
    """See `poise.kernels.pendulum`. Plain floats: arrays of three numbers would be slower."""
    (x, y, z), (x0, y0, z0) = start.tolist()
    a, b = 2.0 / (1.0 + half), (1.0 - half) / (1.0 + half)
    out: list[float] = []
    for px, py, pz, wx, wy, wz in zip(*drive.T.tolist(), *turn.T.tolist(), strict=True):
        out += (x, y, z)
        fx = a * x - b * x0 + px + wy * z - wz * y
        fy = a * y - b * y0 + py + wz * x - wx * z
        fz = a * z - b * z0 + pz + wx * y - wy * x
        # Back to the sphere along the rod.
        along = fx * x + fy * y + fz * z
        beyond = along * along - (fx * fx + fy * fy + fz * fz - 1.0)
        held = along - (beyond**0.5 if beyond > 0.0 else 0.0)
        x0, y0, z0 = x, y, z
        x, y, z = fx - held * x, fy - held * y, fz - held * z
    return np.array(out).reshape(-1, 3)
