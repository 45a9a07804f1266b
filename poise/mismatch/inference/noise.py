"""The noise model of a signal: white, plus a coloured part that grows with speed; and its whitening filter.

Each channel is n_t = sigma (e_t + g_t x_t): e white, x an Ornstein-Uhlenbeck process of unit variance and
correlation time tau, g_t = floor + slope * speed_t, each channel with its parameters. Whitening is
the innovation of a Kalman filter, exact for stamps that are not uniform.
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np
from scipy.linalg.lapack import dtbtrs

from poise.mismatch.recorded import white_level
from poise.types import Array

_FLOORS = (0.0, 0.1, 0.2, 0.35, 0.6, 1.0)
_SLOPES = (0.0, 0.15, 0.3, 0.5, 0.8)
_TAUS = (0.04, 0.08, 0.16, 0.32)
"""Tried values: coloured noise up to the size of the white noise at rest, and more at speed.

They are limits too: a larger slow residual is no sensor noise, even if a filter could whiten it.
"""
_EXCESS = 1.15
"""Largest ratio of the white level to the differences of neighbouring samples."""


@dataclass(frozen=True)
class NoiseColour:
    """The coloured part of a channel, in units of its white level: floor + slope * speed (rad/s), tau in s."""

    floor: float = 0.0
    slope: float = 0.0
    tau: float = 0.1


@dataclass(frozen=True, eq=False)
class SignalNoise:
    """The noise of a signal with C channels; channels of a group share their colour.

    Args:
        sigma: (C,) white level of a sample, in the signal's units.
        groups: the channels of each group.
        colours: of each group.
        seconds: (N,) stamps.
        speed: (N,) rad/s.
    """

    sigma: Array
    groups: tuple[slice, ...]
    colours: tuple[NoiseColour, ...]
    seconds: Array
    speed: Array

    def whiten(self, values: Array) -> Array:
        """(N, C, k) -> (k, C, N): unit white noise, when `values` are noise of this kind."""
        out = np.zeros(values.shape[::-1])
        for channels, filtered in zip(self.groups, self._filters, strict=True):
            # Many columns act in one channel only.
            used = values[:, channels].any(axis=(0, 1))
            if used.any():
                part = values[:, channels, used].T / self.sigma[channels, None]
                out[used, channels] = filtered(part.reshape(-1, len(values))).reshape(part.shape)
        return out

    @cached_property
    def log_divisor(self) -> Array:
        """(N,) logarithm of the divisor of a sample over all channels: minus it is a term of the log likelihood."""
        sizes = [len(self.sigma[channels]) for channels in self.groups]
        spread = [size * np.log(one.deviation) for size, one in zip(sizes, self._filters, strict=True)]
        return np.asarray(np.log(self.sigma).sum() + np.sum(spread, axis=0))

    @cached_property
    def total(self) -> Array:
        """(N, C) one sigma of the white and the coloured part together."""
        out = np.empty((len(self.seconds), len(self.sigma)))
        for channels, colour in zip(self.groups, self.colours, strict=True):
            gain = colour.floor + colour.slope * self.speed
            out[:, channels] = np.sqrt(1.0 + gain**2)[:, None] * self.sigma[channels]
        return out

    @cached_property
    def _filters(self) -> tuple["_Innovation", ...]:
        return tuple(_Innovation(self.seconds, self.speed, colour) for colour in self.colours)


class _Innovation:
    """The innovation of a white-plus-OU signal, divided by its deviation: a banded triangular solve per signal."""

    def __init__(self, seconds: Array, speed: Array, colour: NoiseColour) -> None:
        self.gain = colour.floor + colour.slope * speed
        self.plain = colour.floor == 0.0 and colour.slope == 0.0
        n = len(seconds)
        decay = np.exp(-np.diff(seconds, append=seconds[-1]) / colour.tau)
        variance, kalman = np.empty(n), np.empty(n)
        p = 1.0
        for i, (g, a) in enumerate(zip(self.gain.tolist(), decay.tolist(), strict=True)):
            s = 1.0 + g * g * p
            k = p * g / s
            variance[i], kalman[i] = s, k
            p = a * a * (p - k * g * p) + 1.0 - a * a
        self.deviation = np.sqrt(variance)
        # x+ = a (1 - k g) x + a k y: a lower bidiagonal system for all x at once.
        self._band = np.ones((2, n), order="F")
        self._band[1] = -decay * (1.0 - kalman * self.gain)
        self._drive = decay * kalman

    def __call__(self, values: Array) -> Array:
        """(K, N) -> (K, N)."""
        if self.plain:
            return values
        right = np.zeros(values.shape)
        np.multiply(self._drive[:-1], values[:, :-1], out=right[:, 1:])
        state = dtbtrs(self._band, right.T, uplo="L", overwrite_b=1)[0].T
        state *= self.gain
        np.subtract(values, state, out=state)
        state /= self.deviation
        return np.asarray(state)


def fit_noise(
    seconds: Array,
    speed: Array,
    residual: Array,
    groups: tuple[slice, ...],
    given: tuple[float | None, ...],
    *,
    white: bool = False,
    coarse: bool = True,
) -> SignalNoise:
    """The most likely noise model for a residual that is noise alone.

    Args:
        seconds, speed: (N,).
        residual: (N, C) measured minus predicted.
        groups: channels of one unit.
        given: stated white level of each group, or None; the measured level, but at least half of the stated.
        white: without a coloured part.
        coarse: see `white_level`.
    """
    level = white_level(residual, coarse)
    for part, stated in zip(groups, given, strict=True):
        level[part] = np.maximum(level[part], 1e-9 if stated is None else 0.5 * stated)
    each = tuple(slice(channel, channel + 1) for channel in range(len(level)))
    if white:
        return SignalNoise(level, each, (NoiseColour(),) * len(each), seconds, speed)
    colours, sigma = _most_likely(seconds, speed, residual, level)
    return SignalNoise(sigma, each, colours, seconds, speed)


def _most_likely(seconds: Array, speed: Array, residual: Array, level: Array) -> tuple[tuple[NoiseColour, ...], Array]:
    """Each channel's colour and white level: all candidates run through their Kalman filters in parallel."""
    kinds = [
        NoiseColour(*kind) for kind in product(_FLOORS, _SLOPES, _TAUS) if kind[:2] != (0.0, 0.0) or kind[2] == _TAUS[0]
    ]
    floor, slope, tau = (np.array([getattr(kind, name) for kind in kinds]) for name in ("floor", "slope", "tau"))
    gain = floor + slope * speed[:, None]
    decay = np.exp(-np.diff(seconds, append=seconds[-1])[:, None] / tau)
    p, state = np.ones(len(kinds)), np.zeros((residual.shape[1], len(kinds)))
    square, log_variance = np.zeros_like(state), np.zeros(len(kinds))
    for g, a, y in zip(gain, decay, residual[:, :, None], strict=True):
        s = 1.0 + g * g * p
        k = p * g / s
        innovation = y - g * state
        square += innovation * innovation / s
        log_variance += np.log(s)
        state = a * (state + k * innovation)
        p = a * a * (p - k * g * p) + 1.0 - a * a
    n, channels = residual.shape
    # Most likely level for each candidate, kept near the level of neighbouring samples.
    sigma2 = np.clip(square / n, (level[:, None] / _EXCESS) ** 2, (level[:, None] * _EXCESS) ** 2)
    loglik = -0.5 * (square / sigma2 + n * np.log(sigma2)) - 0.5 * log_variance
    best = np.argmax(loglik, axis=1)
    return tuple(kinds[i] for i in best), np.sqrt(sigma2[np.arange(channels), best])
