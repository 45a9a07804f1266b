"""What the residual of a fit says of the sensor's calibration: gains and cross-talk between its channels.

A calibrated sensor is good to about one percent, and no payload follows the error: it is in proportion to the load,
turns with it, and does not average out. The wrench that is read is (1 + E) times that of the load. The entries of E are
independent and normal beforehand, of a size that the residual shows (empirical Bayes): what the channels have in
common, which no residual shows, is then as uncertain as what they do not.
"""

from dataclasses import dataclass

import numpy as np

from poise.inertia.verdict.slow_residual import LEVER, SlowResidual
from poise.types import Array

_SIZES = np.array([0.0, 3e-4, 1e-3, 3e-3, 0.01, 0.03, 0.1])
_CHANCES = np.array([0.7, 0.08, 0.08, 0.08, 0.04, 0.01, 0.01])
"""Standard deviation of an entry, and how probable it is beforehand."""

_FIT = 0.03
"""Of the entries while the noise is estimated."""

_LARGE, _SURELY = 0.05, 5.0
"""An entry that a calibrated sensor does not have, and standard deviations by which it is shown."""

_MOST_CORRELATED = 0.9
"""Of neighbouring averages."""

_NAMES = tuple(f"{what} {axis}" for what in ("force", "torque") for axis in "xyz")
_UNITS = np.repeat([1.0, LEVER], 3)
"""Entries between force and torque are in units of this lever, m."""


@dataclass(frozen=True, eq=False)
class ShownCalibration:
    """What a residual says of E.

    Args:
        entries, deviations: (6, 6) of E, row by row what a channel reads of each channel; between force and torque in
            units of a lever of 5 cm.
        covariance: (10, 10) of phi, that it adds.
    """

    entries: Array
    deviations: Array
    covariance: Array

    @property
    def worst(self) -> tuple[float, float]:
        """The largest entry that is clearly there, and the size from which on a finding says so."""
        row, column = self._clearest
        size, spread = abs(float(self.entries[row, column])), float(self.deviations[row, column])
        return size, _LARGE + _SURELY * spread

    @property
    def words(self) -> str:
        """The same, said."""
        row, column = self._clearest
        value, spread = float(self.entries[row, column]), float(self.deviations[row, column])
        if row == column:
            return f"{_NAMES[row]} reads {1 + value:.2f} +- {spread:.1g} times what it should (its gain)"
        lever = "" if (row < 3) == (column < 3) else f" at a lever of {LEVER:.2g} m"
        return f"{_NAMES[row]} shows {value:.1%} +- {spread:.1%} of {_NAMES[column]}{lever} (cross-talk)"

    @property
    def _clearest(self) -> tuple[int, int]:
        found = np.unravel_index(np.argmax(np.abs(self.entries) - _SURELY * self.deviations), (6, 6))
        return int(found[0]), int(found[1])


def calibration_of(slow: SlowResidual) -> ShownCalibration:
    """See the file. With little load or few attitudes, the residual says nothing, and little is added."""
    sums = _Sums(slow)
    fitted = _Fitted(sums, slow.white_levels)
    for _ in range(2):
        fitted = _Fitted(sums, fitted.noise())
    return fitted.answer()


class _Sums:
    """Sums over the averages, for each of the six channels; they do not depend on the weights of the channels."""

    def __init__(self, slow: SlowResidual) -> None:
        self.slow, self.sources = slow, slow.load / _UNITS
        by_channel = np.ascontiguousarray(slow.design.swapaxes(0, 1))  # (6, B, 16)
        turned = by_channel.swapaxes(1, 2)
        self.squares = turned @ by_channel
        self.across = turned @ self.sources
        self.pulls = (turned @ slow.residual.T[:, :, None])[..., 0]
        self.own, self.right = self.sources.T @ self.sources, slow.residual.T @ self.sources
        self.known = slow.known


class _Fitted:
    """Averages with a noise (6,) of each channel: linear in phi, bias and E.

    Args:
        sums: of the averages. levels: (6,) standard deviations of their noise, that of a sum of many.
    """

    def __init__(self, sums: _Sums, levels: Array) -> None:
        self._sums = sums
        weights = levels**-2.0
        samples = np.tensordot(weights, sums.squares, 1)
        prior = np.zeros((16, 16))
        prior[:10, :10] = _beyond(sums.known, samples[:10, :10])
        inverse = np.linalg.pinv(samples + prior, rcond=1e-14, hermitian=True)
        scale = weights * _UNITS
        across = (scale[:, None, None] * sums.across).swapaxes(0, 1).reshape(16, 36)
        self._taken = inverse @ across  # (16, 36) phi and bias take E for a payload
        self._shift = inverse @ (weights @ sums.pulls)
        own = np.kron(np.diag(weights * _UNITS**2), sums.own)
        values, self._axes = np.linalg.eigh(own - across.T @ self._taken)
        self._values = values.clip(min=0.0)
        self._pull = self._axes.T @ ((scale[:, None] * sums.right).ravel() - across.T @ self._shift)

    def noise(self) -> Array:
        """(6,) that is left, of force and of torque, as that of a sum: neighbours may be alike."""
        slow, sources = self._sums.slow, self._sums.sources
        count = len(sources)
        narrowed = self._values + _FIT**-2.0
        entries = (self._axes @ (self._pull / narrowed)).reshape(6, 6)
        unknowns = self._shift - self._taken @ entries.ravel()
        left = slow.residual - slow.design @ unknowns - (sources @ entries.T) * _UNITS
        freedom = max(6 * count - 16 - float(np.sum(self._values / narrowed)), 2.0 * count) / (6 * count)
        squares = (left**2).reshape(count, 2, 3).mean(axis=(0, 2)) / freedom
        together = (left[1:] * left[:-1]).reshape(count - 1, 2, 3).mean(axis=(0, 2)) / freedom
        alike = np.clip(together / np.maximum(squares, 1e-30), 0.0, _MOST_CORRELATED)
        least = slow.white_levels[[0, 3]] ** 2
        return np.repeat(np.sqrt(np.maximum(squares, least) * (1 + alike) / (1 - alike)), 3)

    def answer(self) -> ShownCalibration:
        """Averaged over the sizes that E may have."""
        variances = np.square(_SIZES)[:, None]
        grown = 1.0 + variances * self._values
        log = np.sum(variances * self._pull**2 / grown - np.log(grown), axis=1) / 2 + np.log(_CHANCES)
        chances = np.exp(log - log.max())
        chances /= chances.sum()
        means = variances * self._pull / grown  # (S, 36) along the axes
        mean = chances @ means
        second = (means.T * chances) @ means + np.diag(chances @ (variances / grown))
        spread = self._axes @ (second - np.outer(mean, mean)) @ self._axes.T
        shifts = self._taken[:10] @ self._axes
        return ShownCalibration(
            entries=(self._axes @ mean).reshape(6, 6),
            deviations=np.sqrt(np.diag(spread).clip(min=0.0)).reshape(6, 6),
            covariance=np.asarray(shifts @ second @ shifts.T),
        )


def _beyond(known: Array, shown: Array) -> Array:
    """(10, 10) information about phi that an estimate has beside what samples show, for example of a shape."""
    scale = np.sqrt((np.diag(known) + np.diag(shown)).clip(min=1e-100, max=1e100))
    unit = np.outer(scale, scale)
    values, axes = np.linalg.eigh(np.clip((known - shown) / unit, -1e12, 1e12))
    return np.asarray((axes * values.clip(min=1e-6)) @ axes.T * unit)
