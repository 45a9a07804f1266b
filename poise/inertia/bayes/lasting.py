"""Errors of sensor and kinematics that last for a second: they do not average out, and widen the covariance."""

import numpy as np

from poise.geometry import STANDARD_GRAVITY
from poise.inertia.bayes.blocks import MomentBlocks
from poise.inertia.model import N_UNKNOWNS, NoiseLevels, signal_columns
from poise.types import Array, Mask

LOAD_ACCURACY = 0.01
"""Share of the load by which a real sensor and its kinematics err for a second; 0.8 % on recordings of a KUKA arm."""

_DURATION = 1.0
"""s, time constant of the errors' exponential autocorrelation."""

_LAGS, _NEAR = 3, 500_000_000
"""Blocks apart, and ns, at which residual means are multiplied."""

_LEAST_PAIRS, _NOTABLE = 12, 3.0
"""From this many pairs, and standard errors, on the residuals show how large lasting errors are."""

_SHOWN_AFTER = 2.0
"""s of samples, after which the residuals show lasting errors and nothing is assumed of them."""

_COLOURED = 0.5
"""Share of the noise of a sample that may last: sensors are filtered, and creep."""

_ARM = 0.05
"""m: lever of the weight at which the torque errs, at least."""


def lasting_variances(means: Array, blocks: MomentBlocks, keep: Mask) -> Array:
    """(2,) variance of errors that last, of force and torque; 0 where chance explains the autocovariance.

    White noise of neighbouring blocks is independent; what their residual means have in common is not noise.

    Args:
        means: (B, 6) residual means, N and N m.
        blocks: the samples.
        keep: (B,) blocks that are used.
    """
    products, count = np.zeros(2), 0
    for lag in range(1, min(_LAGS + 1, len(means))):
        both = keep[lag:] & keep[:-lag] & (blocks.start[lag:] - blocks.end[:-lag] < _NEAR)
        pair = (means[lag:] * means[:-lag])[both]
        products += [pair[:, :3].sum(), pair[:, 3:].sum()]
        count += len(pair)
    if count < _LAGS * _LEAST_PAIRS:
        return np.zeros(2)
    used = means[keep] ** 2
    total = np.array([used[:, :3].mean(), used[:, 3:].mean()])
    common = products / (3 * count)
    return np.where(common > _NOTABLE * total / np.sqrt(3 * count), common, 0.0)


def assumed_variances(phi: Array, noise: NoiseLevels, blocks: MomentBlocks, accuracy: float) -> Array:
    """(2,) variance of lasting errors of a load phi (10,) in its first seconds, before the residuals show them.

    Args:
        phi: of the load.
        noise: of a sample.
        blocks: the samples.
        accuracy: share of the load; 0: the noise is white, and all there is.
    """
    if not accuracy:
        return np.zeros(2)
    seconds = float(blocks.end[-1] - blocks.start[0]) * 1e-9
    unknown = max(1.0 - seconds / _SHOWN_AFTER, 0.0)
    weight = STANDARD_GRAVITY * phi[0]
    moment = STANDARD_GRAVITY * float(np.linalg.norm(phi[1:4])) + weight * _ARM
    by_noise = _COLOURED * np.array([noise.force, noise.torque])
    return np.asarray(unknown * ((accuracy * np.array([weight, moment])) ** 2 + by_noise**2))


def lasting_covariance(blocks: MomentBlocks, sums: Array, covariance: Array, weight: Array, variances: Array) -> Array:
    """(16, 16) covariance of phi and bias that lasting errors add.

    Args:
        blocks: those that are used.
        sums: (B, 13) of their signals.
        covariance: (16, 16) after the samples.
        weight: (6, 6) of a sample.
        variances: (2,) of the errors, of force and torque.
    """
    regressor = signal_columns(sums)
    gain = covariance @ regressor.swapaxes(1, 2) @ weight  # (B, 16, 6): change of the answer per error of a block
    seconds = (blocks.start + blocks.end) * 0.5e-9
    seconds -= seconds[0]
    together = np.exp(-np.abs(seconds[:, None] - seconds) / _DURATION)
    result = np.zeros((N_UNKNOWNS, N_UNKNOWNS))
    for channel, variance in enumerate(np.repeat(variances, 3)):
        if variance:
            along = gain[:, :, channel]
            result += variance * along.T @ together @ along
    return result
