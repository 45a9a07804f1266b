"""The wrench equation as a linear form of a few signals, whose second moments hold all that samples can say.

Every entry of the regressor A is a sum of 12 numbers that a moving sensor gives: u = g - a (3), alpha (3) and the six
products of omega with itself. With x = (u, alpha, omega omega, 1) and the wrench y, the sum of s s^T over samples
s = (x, y), 19 by 19, is enough to write down the normal equations for ANY 6x6 weight of the six channels, long after
the samples are gone. That is what errors in variables need: their weight depends on the answer.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from poise.inertia.parameters import UPPER, Array
from poise.inertia.problem import NoiseLevels
from poise.inertia.regressor import cross_matrix, regressor

N_MOTION = 13
"""u (3), alpha (3), omega omega as xx xy xz yy yz zz (6), one."""

N_SIGNALS = N_MOTION + 6
"""The same, then the wrench."""

N_UNKNOWNS = 16
"""phi (10), then the bias of force (3) and torque (3)."""

_ONE = N_MOTION - 1
# Where the nine entries of an inertia matrix are among the six of phi.
_SYMMETRIC = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])


def motion_signals(
    gravity_minus_acceleration: ArrayLike, angular_velocity: ArrayLike, angular_acceleration: ArrayLike
) -> Array:
    """(N, 13) x of samples in sensor axes: (N, 3) m/s2, (N, 3) rad/s, (N, 3) rad/s2."""
    omega = np.asarray(angular_velocity, dtype=np.float64)
    result = np.empty((len(omega), N_MOTION))
    result[:, :3] = gravity_minus_acceleration
    result[:, 3:6] = angular_acceleration
    result[:, 6:_ONE] = omega[:, UPPER[0]] * omega[:, UPPER[1]]
    result[:, _ONE] = 1.0
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


@dataclass(frozen=True, eq=False)
class Calibration:
    """What noisy accelerations say of the true ones (regression calibration, Carroll et al. 2006, section 4).

    Noise in a regressor makes a regression believe in excitation that is not there, and its answer too small. The
    best guess of the true signals, given the measured ones, does not: it is x minus the share of it that is noise.

    Args:
        map: (13, 13) takes measured signals x to the best guess of the true ones.
        scatter: (6, 6) covariance of the true u and alpha about that guess, (m/s2)^2 and (rad/s2)^2.
    """

    map: Array
    scatter: Array

    @classmethod
    def perfect(cls) -> "Calibration":
        """Accelerations without noise."""
        return cls(np.eye(N_MOTION), np.zeros((6, 6)))

    @classmethod
    def of(cls, motion: Array, count: float, noise: NoiseLevels, share: float = 1.0) -> "Calibration":
        """Find it from the signals' own energy.

        Args:
            motion: (13, 13) sum of x x^T.
            count: samples in it.
            noise: of one sample.
            share: of its variance that interpolation has left.
        """
        deviation = np.sqrt(share) * np.repeat([noise.linear_acceleration, noise.angular_acceleration], 3)
        scale = np.maximum(deviation, np.finfo(np.float64).eps)
        others, cross = motion[6:, 6:], motion[6:, :6]
        ridge = 1e-12 * np.trace(others) * np.eye(N_MOTION - 6)
        by_others = np.linalg.solve(others + ridge, cross).T  # what products of omega, and the mean, explain
        energy = (motion[:6, :6] - by_others @ cross) / (count * np.outer(scale, scale))
        eigenvalues, vectors = np.linalg.eigh(energy)
        true_share = 1 - 1 / eigenvalues.clip(min=1.0)
        gain = scale[:, None] * (vectors * true_share) @ vectors.T
        matrix = np.eye(N_MOTION)
        matrix[:6, :6] = gain / scale
        matrix[:6, 6:] = by_others - matrix[:6, :6] @ by_others
        return cls(matrix, gain * scale)


def residual_covariance(
    phi: Array, noise: NoiseLevels, calibration: Calibration, inflation: ArrayLike = (1.0, 1.0)
) -> Array:
    """(..., 6, 6) covariance of one sample's residual, when accelerations are noisy too.

    A change of u moves the wrench by [m 1; [mc]x], one of alpha by [[mc]x; -I]; both are the same at every sample.

    Args:
        phi: (..., 10).
        noise: of one sample.
        calibration: how well the accelerations are known.
        inflation: (2,) factor on the variance of force and torque.
    """
    first = cross_matrix(phi[..., 1:4])
    by_motion = np.empty((*phi.shape[:-1], 6, 6))
    by_motion[..., :3, :3] = phi[..., :1, None] * np.eye(3)
    by_motion[..., :3, 3:] = by_motion[..., 3:, :3] = first
    by_motion[..., 3:, 3:] = -phi[..., 4 + _SYMMETRIC]
    sensor = np.diag(noise.wrench**2 * np.repeat(inflation, 3))
    return np.asarray(sensor + by_motion @ calibration.scatter @ by_motion.swapaxes(-1, -2))


def normal_equations(moments: Array, weight: Array, calibration: Calibration) -> NormalEquations:
    """Weigh the sums of s s^T.

    Args:
        moments: (..., 19, 19).
        weight: (6, 6) inverse covariance of a residual.
        calibration: of the accelerations.
    """
    root = np.linalg.cholesky(weight)
    # (6, 16, 13): rows of the whitened wrench.
    weighted = (root.T @ (ENTRIES @ calibration.map).reshape(6, -1)).reshape(ENTRIES.shape)
    flat = weighted.transpose(1, 0, 2).reshape(N_UNKNOWNS, -1)
    right = np.moveaxis(weighted @ moments[..., None, :N_MOTION, :N_MOTION], -3, -2)  # (..., 16, 6, 13)
    information = right.reshape(*right.shape[:-2], -1) @ flat.T
    wrench = moments[..., :N_MOTION, N_MOTION:] @ root  # (..., 13, 6)
    vector = wrench.swapaxes(-1, -2).reshape(*wrench.shape[:-2], -1) @ flat.T
    return NormalEquations(information, vector)


def residual_moments(moments: Array, unknowns: Array, calibration: Calibration) -> tuple[Array, Array]:
    """(..., 6, 6) sum of r r^T and (..., 6) sum of r, of the residuals r = y - A phi - bias.

    Args:
        moments: (19, 19), or (B, 19, 19) for a single answer.
        unknowns: (16,), or (H, 16) for a single sum.
        calibration: of the accelerations.
    """
    rows = np.zeros((*unknowns.shape[:-1], 6, N_SIGNALS))
    rows[..., :N_MOTION] = -(unknowns[..., None, None, :] @ ENTRIES)[..., 0, :] @ calibration.map
    rows[..., range(6), range(N_MOTION, N_SIGNALS)] = 1.0
    half = rows @ moments
    return half @ rows.swapaxes(-1, -2), half[..., _ONE]


def log_likelihood(
    moments: Array, count: float, unknowns: Array, noise: NoiseLevels, calibration: Calibration, inflation: ArrayLike
) -> Array:
    """(H,) log likelihood of answers (H, 16), each with the noise that it says the accelerations make.

    Args:
        moments: (19, 19) sums over `count` samples.
        count: how many.
        unknowns: (H, 16).
        noise, calibration, inflation: as in `residual_covariance`.
    """
    covariance = residual_covariance(unknowns[:, :10], noise, calibration, inflation)
    squares, _ = residual_moments(moments, unknowns, calibration)
    misfit = np.trace(np.linalg.solve(covariance, squares), axis1=1, axis2=2)
    return np.asarray(-(misfit + count * np.linalg.slogdet(covariance)[1]) / 2)
