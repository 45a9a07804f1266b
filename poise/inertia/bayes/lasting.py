"""Errors of sensor and kinematics that last for a second: they do not average out, and widen the covariance."""

from collections.abc import Sequence

import numpy as np

from poise.geometry import STANDARD_GRAVITY
from poise.inertia.bayes.blocks import MomentBlocks
from poise.inertia.model import N_UNKNOWNS, NoiseLevels, signal_columns
from poise.types import Array, Mask

LOAD_ACCURACY = 0.01
"""Share of the load by which a real sensor and its kinematics err for a second; 0.8 % on recordings of a KUKA arm."""

_DURATION = 1.0
"""s, time constant of the errors' exponential autocorrelation."""

_LAGS, _NEAR = (2, 3, 4), 500_000_000
"""Blocks apart, and ns, at which residual means are multiplied."""

_LEAST_PAIRS, _NOTABLE = 12, 3.0
"""From this many pairs, and standard errors, on the residuals show how large lasting errors are."""

MEAN_UNKNOWNS = 5
"""Degrees of freedom that the answer takes from the means of one of the two groups of channels, about."""

_MOST_CORRELATED = 0.8
"""Of neighbouring blocks; what is more correlated lasts."""

_SHOWN_AFTER = 6.0
"""s of samples, after which the residuals show lasting errors and nothing is assumed of them."""

_EXCLUDED = 2.0
"""Standard errors above what the residuals show, beyond which they exclude a lasting error."""

_COLOURED = 0.5
"""Share of the noise of a sample that may last: sensors are filtered, and creep."""

_ARM = 0.05
"""m: lever of the weight at which the torque errs, at least."""


def neighbour_correlation(means: Array, blocks: MomentBlocks, keep: Mask) -> Array:
    """(2,) correlation of the errors of neighbouring blocks, of force and of torque; at least 0.

    A fit takes slow errors out of its residuals, so that these are less correlated than the errors are. The bias is
    removed to first order (Marriott and Pope 1954).

    Args:
        means: (B, 6) residual means, N and N m.
        blocks: the samples.
        keep: (B,) blocks that are used.
    """
    products, count = _products(means, blocks, keep, 1)
    if count < _LEAST_PAIRS:
        return np.zeros(2)
    shown = products / (3 * count * _mean_squares(means, keep))
    lost = MEAN_UNKNOWNS / (3 * count)
    return np.asarray(np.clip((shown + lost) / (1 - 3 * lost), 0.0, _MOST_CORRELATED))


def variance_of_sum(correlation: Array) -> Array:
    """(2,) of many errors of first order, in units of independent ones, by the correlation (2,) of neighbours."""
    return np.asarray((1 + correlation) / (1 - correlation))


def lasting_variances(means: Array, blocks: MomentBlocks, keep: Mask) -> Array:
    """(2,) variance of errors that last, of force and torque; 0 where chance explains the autocovariance.

    What the residual means of blocks that are not neighbours have in common is neither white noise nor noise with a
    short memory, whose correlation falls off as the power of that of neighbours.

    Args:
        means: (B, 6) residual means, N and N m.
        blocks: the samples.
        keep: (B,) blocks that are used.
    """
    common, error = _in_common(means, blocks, keep)
    return np.where(common > _NOTABLE * error, common, 0.0)


def _in_common(means: Array, blocks: MomentBlocks, keep: Mask) -> tuple[Array, Array]:
    """(2,) what residual means have in common beyond noise with a short memory, and its standard error by chance."""
    sums = [_products(means, blocks, keep, lag) for lag in _LAGS]
    count = sum(number for _, number in sums)
    if count < len(_LAGS) * _LEAST_PAIRS:
        return np.zeros(2), np.full(2, np.inf)
    total = _mean_squares(means, keep)
    short = neighbour_correlation(means, blocks, keep)
    fading = sum(number * short**lag for lag, (_, number) in zip(_LAGS, sums, strict=True)) / count
    common = sum(products for products, _ in sums) / (3 * count) - total * fading
    return common, total / np.sqrt(3 * count)


def _products(means: Array, blocks: MomentBlocks, keep: Mask, lag: int) -> tuple[Array, int]:
    """(2,) sums of products of means that are some blocks apart, and how many pairs there are."""
    both = keep[lag:] & keep[:-lag] & (blocks.start[lag:] - blocks.end[:-lag] < _NEAR)
    pairs = (means[lag:] * means[:-lag])[both]
    return np.array([pairs[:, :3].sum(), pairs[:, 3:].sum()]), len(pairs)


def _mean_squares(means: Array, keep: Mask) -> Array:
    """(2,) per channel."""
    used = means[keep] ** 2
    return np.array([used[:, :3].mean(), used[:, 3:].mean()])


def assumed_variances(
    phi: Array, noise: NoiseLevels, means: Array, blocks: MomentBlocks, keep: Mask, accuracy: float
) -> Array:
    """(2,) variance of lasting errors of a load phi (10,) in its first seconds, unless the residuals exclude it.

    A fit takes a share of slow errors out of its residuals: in each channel, `MEAN_UNKNOWNS` / 3 unknowns follow the
    errors of two durations each.

    Args:
        phi: of the load.
        noise: of a sample.
        means: (B, 6) residual means, N and N m.
        blocks: the samples.
        keep: (B,) blocks that are used.
        accuracy: share of the load; 0: the noise is white, and all there is.
    """
    if not accuracy:
        return np.zeros(2)
    seconds = float(blocks.end[-1] - blocks.start[0]) * 1e-9
    unknown = max(1.0 - seconds / _SHOWN_AFTER, 0.0)
    weight = STANDARD_GRAVITY * phi[0]
    moment = STANDARD_GRAVITY * float(np.linalg.norm(phi[1:4])) + weight * _ARM
    by_noise = _COLOURED * np.array([noise.force, noise.torque])
    common, error = _in_common(means, blocks, keep)
    taken_out = 2 * _DURATION * MEAN_UNKNOWNS / 3 / max(seconds, _DURATION)
    most = (common.clip(min=0.0) + _EXCLUDED * error) * (1 + taken_out)
    return np.asarray(unknown * np.minimum((accuracy * np.array([weight, moment])) ** 2 + by_noise**2, most))


def gains(sums: Array, covariance: Array, weight: Array) -> Array:
    """(B, 16, 6) change of the answer per error of a block, N and N m.

    Args:
        sums: (B, 13) of the signals of blocks.
        covariance: (16, 16) after the samples.
        weight: (6, 6) of a sample.
    """
    return np.asarray(covariance @ signal_columns(sums).swapaxes(1, 2) @ weight)


def lasting_covariance(blocks: MomentBlocks, gain: Array, variances: Array) -> Array:
    """(16, 16) covariance of phi and bias that lasting errors add.

    Args:
        blocks: those that are used.
        gain: (B, 16, 6) see `gains`.
        variances: (2,) of the errors, of force and torque.
    """
    seconds = _middles(blocks)
    together = np.exp(-np.abs(seconds[:, None] - seconds) / _DURATION)
    return _summed(gain, [variance * together for variance in variances])


def averaged_out(blocks: MomentBlocks, gain: Array, covariance: Array, residual: Array, correlation: Array) -> Array:
    """(16, 16) by how much too large a covariance is in which all parameters have the variance of a sum of errors.

    Errors that are correlated over neighbouring blocks average out where the motion changes the sign of their effect.
    At most, what is left is the variance of errors that are not correlated.

    Args:
        blocks: those that are used.
        gain: (B, 16, 6) see `gains`.
        covariance: (16, 16) that is too large.
        residual: (6, 6) covariance of a sample, in which the variance is that of a sum, see `variance_of_sum`.
        correlation: (2,) of the errors of neighbouring blocks, of force and torque.
    """
    seconds = _middles(blocks)
    spacing = float(np.median(np.diff(seconds))) if len(seconds) > 1 else 1.0
    steps = np.abs(seconds[:, None] - seconds) / max(spacing, 1e-9)
    sizes = np.sqrt(np.outer(blocks.sizes, blocks.sizes))
    parts = []
    for group, each in enumerate(correlation):
        level = np.mean(np.diag(residual)[3 * group : 3 * group + 3])
        excess = np.eye(len(steps)) - each**steps / variance_of_sum(each)
        parts.append(level * excess / sizes if each else np.zeros(steps.shape))
    scale = np.sqrt(np.diag(covariance).clip(min=1e-30))
    values, axes = np.linalg.eigh(covariance / np.outer(scale, scale))
    root = axes * np.sqrt(values.clip(min=1e-12))
    inverse = axes / np.sqrt(values.clip(min=1e-12))
    shares, directions = np.linalg.eigh(inverse.T @ (_summed(gain, parts) / np.outer(scale, scale)) @ inverse)
    most = 1 - 1 / float(variance_of_sum(correlation.max()))
    inside = root @ directions
    return np.asarray((inside * shares.clip(0.0, most)) @ inside.T * np.outer(scale, scale))


def _summed(gain: Array, errors: Sequence[Array]) -> Array:
    """(16, 16) covariance of answers, by the covariance (B, B) of the errors of blocks of force, and of torque."""
    result = np.zeros((N_UNKNOWNS, N_UNKNOWNS))
    for channel in range(6):
        between = errors[channel // 3]
        if between.any():
            along = gain[:, :, channel]
            result += along.T @ between @ along
    return result


def _middles(blocks: MomentBlocks) -> Array:
    """(B,) s since the middle of the first block."""
    seconds = (blocks.start + blocks.end) * 0.5e-9
    return np.asarray(seconds - seconds[0])
