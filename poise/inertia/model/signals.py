"""The wrench equation as a linear form of a few signals, whose second moments hold all that samples can say.

Every entry of the regressor A is a sum of 12 numbers that a moving sensor gives: u = g - a (3), alpha (3) and the six
products of omega with itself. With x = (u, alpha, omega omega, 1) and the wrench y, the sum of s s^T over samples
s = (x, y), 19 by 19, is enough to write down the normal equations for ANY 6x6 weight of the six channels, long after
the samples are gone. That is what errors in variables need: their weight depends on the answer.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from poise.geometry import cross_matrix
from poise.inertia.model.parameters import UPPER
from poise.inertia.model.problem import NoiseLevels
from poise.inertia.model.wrench_regressor import regressor
from poise.kernels import COMPILED, weighed_sums
from poise.types import Array

N_MOTION = 13
"""u (3), alpha (3), omega omega as xx xy xz yy yz zz (6), one."""

N_SIGNALS = N_MOTION + 6
"""The same, then the wrench."""

N_UNKNOWNS = 16
"""phi (10), then the bias of force (3) and torque (3)."""

_ONE = N_MOTION - 1
_LEAST_VARIANCE = 1e-30
"""(rad/s2)^2, of no effect; the energy of a motion in units of it is finite."""
# All signals but alpha.
_OTHERS = np.array([0, 1, 2, *range(6, N_MOTION)])
# Where the nine entries of an inertia matrix are among the six of phi.
_SYMMETRIC = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])


def motion_signals(
    gravity_minus_acceleration: ArrayLike, angular_velocity: ArrayLike, angular_acceleration: ArrayLike
) -> Array:
    """(..., 13) x of samples in sensor axes: (..., 3) m/s2, (..., 3) rad/s, (..., 3) rad/s2."""
    omega = np.asarray(angular_velocity, dtype=np.float64)
    result = np.empty((*omega.shape[:-1], N_MOTION))
    result[..., :3] = gravity_minus_acceleration
    result[..., 3:6] = angular_acceleration
    result[..., 6:_ONE] = omega[..., UPPER[0]] * omega[..., UPPER[1]]
    result[..., _ONE] = 1.0
    return result


def _unknowns_by_signal() -> Array:
    """(6, 16, 13) E with [A, 1] = E x: entry (i, p, c) is what signal c adds to row i of unknown p."""
    zero, axes = np.zeros(3), np.eye(3)
    entries = np.zeros((6, N_UNKNOWNS, N_MOTION))
    for k in range(3):
        entries[:, :10, k] = regressor(axes[k], zero, zero)
        entries[:, :10, 3 + k] = regressor(zero, zero, axes[k])
    squares = [regressor(zero, axis, zero) for axis in axes]
    for k, (i, j) in enumerate(zip(*UPPER, strict=True)):
        mixed = regressor(zero, axes[i] + axes[j], zero) - squares[i] - squares[j]
        entries[:, :10, 6 + k] = squares[i] if i == j else mixed
    entries[:, 10:, _ONE] = np.eye(6)
    return entries


ENTRIES = _unknowns_by_signal()


def signal_columns(signals: Array) -> Array:
    """(N, 6, 16) the design [A, 1] of phi and bias, from signals (N, 13)."""
    return np.asarray((signals @ ENTRIES.reshape(-1, N_MOTION).T).reshape(-1, 6, N_UNKNOWNS))


def mixed(weights: Array, values: Array) -> Array:
    """(..., A, B) weighted sums of values (L, A, B) with weights (..., L)."""
    rows, columns = values.shape[1:]
    return np.asarray((weights @ values.reshape(len(values), -1)).reshape(*weights.shape[:-1], rows, columns))


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """What weighted samples say of the unknowns z = (phi, bias): -z^T H z / 2 + g^T z, up to a constant.

    Args:
        information: (..., 16, 16) H.
        vector: (..., 16) g.
    """

    information: Array
    vector: Array

    def mixed(self, weights: Array) -> "NormalEquations":
        """Weighted sums along the first axis (L,); weights are (L,), or (B, L) for B of them."""
        return NormalEquations(mixed(weights, self.information), weights @ self.vector)


def residual_covariance(phi: Array, noise: NoiseLevels, inflation: ArrayLike = (1.0, 1.0)) -> Array:
    """(..., 6, 6) covariance of one sample's residual y - A phi - bias, when accelerations are noisy too.

    An error of u moves the wrench by [m 1; [mc]x], one of alpha by [[mc]x; -I]; both are the same at every sample.

    Args:
        phi: (..., 10).
        noise: of one sample.
        inflation: (2,) factor on the variance of force and torque.
    """
    first = cross_matrix(phi[..., 1:4])
    by_motion = np.empty((*phi.shape[:-1], 6, 6))
    by_motion[..., :3, :3] = phi[..., :1, None] * np.eye(3)
    by_motion[..., :3, 3:] = by_motion[..., 3:, :3] = first
    by_motion[..., 3:, 3:] = -phi[..., 4 + _SYMMETRIC]
    by_motion *= np.repeat([noise.linear_acceleration, noise.angular_acceleration], 3)
    sensor = np.diag(noise.wrench**2 * np.repeat(inflation, 3))
    return np.asarray(sensor + by_motion @ by_motion.swapaxes(-1, -2))


def normal_equations(moments: Array, counts: ArrayLike, covariance: Array, noise: NoiseLevels) -> NormalEquations:
    """Weigh the sums of s s^T, with the noise of accelerations taken off (see `without_noise`).

    Args:
        moments: (..., 19, 19).
        counts: (...,) samples in them, as far as the noise of accelerations is concerned.
        covariance: (6, 6) of a residual; its inverse is the weight.
        noise: of one sample.
    """
    if COMPILED:
        shape = moments.shape[:-2]
        numbers = np.broadcast_to(np.asarray(counts, dtype=np.float64), shape).ravel()
        variance = max(noise.angular_acceleration**2, _LEAST_VARIANCE)
        sums = moments.reshape(-1, N_SIGNALS, N_SIGNALS)
        square, linear = weighed_sums(sums, numbers, covariance, variance, ENTRIES)
        return NormalEquations(square.reshape(*shape, N_UNKNOWNS, N_UNKNOWNS), linear.reshape(*shape, N_UNKNOWNS))
    root = np.linalg.inv(np.linalg.cholesky(covariance)).T
    weighted = (root.T @ ENTRIES.reshape(6, -1)).reshape(ENTRIES.shape)  # (6, 16, 13): rows of the whitened wrench
    motion = without_noise(moments[..., :N_MOTION, :N_MOTION], counts, noise)
    flat = weighted.transpose(1, 0, 2).reshape(N_UNKNOWNS, -1)
    right = np.moveaxis(weighted @ motion[..., None, :, :], -3, -2)  # (..., 16, 6, 13)
    information = right.reshape(*right.shape[:-2], -1) @ flat.T
    wrench = moments[..., :N_MOTION, N_MOTION:] @ root  # (..., 13, 6)
    vector = wrench.swapaxes(-1, -2).reshape(*wrench.shape[:-2], -1) @ flat.T
    return NormalEquations(information, vector)


def without_noise(motion: Array, counts: ArrayLike, noise: NoiseLevels) -> Array:
    """(..., 13, 13) sums of x x^T less what the noise of angular accelerations has added to them.

    That energy makes a regression believe in excitation that is not there, and its answer too small; on average it is
    the number of samples times the variance (errors in variables, Fuller 1987, "Measurement Error Models", 2.2). The
    average is off by its own scatter; so of the energy that no other signal explains, in each direction, that scatter
    is left, and an information matrix stays one. Beside gravity, the noise of linear accelerations does not matter.
    """
    variance = max(noise.angular_acceleration**2, _LEAST_VARIANCE)
    count = np.asarray(counts, dtype=np.float64)[..., None]
    energy, axes = np.linalg.eigh(_unexplained(motion) / variance)
    taken = np.minimum(count, energy - np.sqrt(2 * count)).clip(min=0.0)
    result = motion.copy()
    result[..., 3:6, 3:6] -= variance * (axes * taken[..., None, :]) @ axes.swapaxes(-1, -2)
    return result


def believable(noise: NoiseLevels, motion: Array, count: float) -> NoiseLevels:
    """The same noise, but no more of it in the angular acceleration than there is energy (13, 13) in `count` samples.

    Accelerations that were smoothed before are less noisy than one might say.
    """
    freedom = max(count - len(_OTHERS), 1.0)
    least = float(np.linalg.eigvalsh(_unexplained(motion))[0]) / freedom
    return replace(noise, angular_acceleration=min(noise.angular_acceleration, math.sqrt(max(least, 0.0))))


def _unexplained(motion: Array) -> Array:
    """(..., 3, 3) energy of the angular acceleration that no other signal explains."""
    cross = motion[..., _OTHERS, 3:6]
    others = motion[..., _OTHERS[:, None], _OTHERS]
    diagonal = np.einsum("...ii->...i", others)
    others = others + 1e-12 * (diagonal + diagonal.max(axis=-1, keepdims=True))[..., None] * np.eye(len(_OTHERS))
    return np.asarray(motion[..., 3:6, 3:6] - cross.swapaxes(-1, -2) @ np.linalg.solve(others, cross))


def residual_moments(moments: Array, unknowns: Array) -> tuple[Array, Array]:
    """(..., 6, 6) sum of r r^T and (..., 6) sum of r, of the residuals r = y - A phi - bias.

    Args:
        moments: (19, 19), or (B, 19, 19).
        unknowns: (16,), or (H, 16) where B is H or there is one sum.
    """
    rows = np.zeros((*unknowns.shape[:-1], 6, N_SIGNALS))
    rows[..., :N_MOTION] = -(unknowns[..., None, None, :] @ ENTRIES)[..., 0, :]
    rows[..., range(6), range(N_MOTION, N_SIGNALS)] = 1.0
    half = rows @ moments
    return half @ rows.swapaxes(-1, -2), half[..., _ONE]


def log_likelihood(moments: Array, unknowns: Array, noise: NoiseLevels, inflation: ArrayLike) -> Array:
    """(H,) log likelihood of answers (H, 16), each with the noise that it says the accelerations make.

    The true accelerations are unknown, too, at every sample, and take their most likely values. What is left is the
    misfit in units of its own covariance, as in total least squares, without that covariance's determinant.

    Args:
        moments: (19, 19) or (H, 19, 19) sums over samples.
        unknowns: (H, 16).
        noise, inflation: as in `residual_covariance`.
    """
    squares, _ = residual_moments(moments, unknowns)
    weighted = np.linalg.solve(residual_covariance(unknowns[:, :10], noise, inflation), squares)
    return np.asarray(-np.trace(weighted, axis1=1, axis2=2) / 2)
