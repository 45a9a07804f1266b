"""The noise model of a signal: white inside a band, plus a coloured part that grows with speed; its whitening filter.

Each channel is n_t = sigma (e_t + g_t x_t): e white, x an Ornstein-Uhlenbeck process of unit variance and correlation
time tau, g_t^2 = (floor + slope * speed_t)^2 + motion_t / sigma^2, each channel with its parameters. `motion` is the
variance of the prediction by the errors of the measured motion. Where a filter removed the fast part of the noise, e
has the level that the noise has inside its band, and samples count by the share of the band that is left. Whitening is
the innovation of a Kalman filter, for stamps that need not be uniform.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dtbtrs

from poise.kernels import COMPILED, WhiteningFilters, likely_colours
from poise.mismatch.recorded import block_means, noise_level
from poise.types import Array

_FLOORS = (0.0, 0.1, 0.2, 0.35, 0.6, 1.0)
_SLOPES = (0.0, 0.15, 0.3, 0.5, 0.8)
_TAUS = (0.04, 0.08, 0.16, 0.32)
"""Tried values: coloured noise up to the size of the white noise at rest, and more at speed.

They are limits too: a larger slow residual is no sensor noise, even if a filter could whiten it.
"""
_EXCESS = 1.25
"""Largest ratio of the white level to the differences of neighbouring samples."""
_TOGETHER = 0.02
"""s that are averaged for the fit; the coloured part is slower."""
_ENOUGH = 4000
"""Averages that suffice for the fit; of more, parts of `_PART` are used."""
_PART = 200


@dataclass(frozen=True)
class NoiseColour:
    """The coloured part of a channel, in units of its white level: floor + slope * speed (rad/s), tau in s."""

    floor: float = 0.0
    slope: float = 0.0
    tau: float = 0.1


@dataclass(frozen=True, eq=False)
class SignalNoise:
    """The noise of a signal with C channels.

    Args:
        sigma: (C,) white level of a sample inside the band of the noise, in the signal's units.
        colours: of each channel.
        seconds: (N,) stamps.
        speed: (N,) rad/s.
        share: (C,) of the white variance that the samples have, see `NoiseLevel`; above 1 beside lines in the spectrum.
        band: (C,) share of independent samples, at most 1: their weight in the likelihood.
        block: samples whose average has white noise in all channels.
        motion: (N, C) variance of the prediction by the errors of the motion; None: the motion is exact.
    """

    sigma: Array
    colours: tuple[NoiseColour, ...]
    seconds: Array
    speed: Array
    share: Array
    band: Array
    block: int = 1
    motion: Array | None = None

    def whiten(self, values: Array, channel: NDArray[np.intp] | None = None) -> Array:
        """Unit white noise (k, C, N), when the columns of `values` (N, C, k) are noise of this kind.

        Args:
            values: (N, C, k); or (N, k), columns that act in one channel each.
            channel: (k,) the channels of such columns.
        """
        across = np.array(values.T, order="C")
        if channel is None:
            out = across
            for number, filtered in enumerate(self._filters):
                filtered(out[:, number], 1.0 / self.sigma[number])
            return out
        out = np.zeros((len(channel), len(self.colours), len(values)))
        for number, filtered in enumerate(self._filters):
            rows = channel == number
            if rows.any():
                chosen = across[rows]
                filtered(chosen, 1.0 / self.sigma[number])
                out[rows, number] = chosen
        return out

    @cached_property
    def compiled(self) -> WhiteningFilters:
        """`whiten`, compiled, for samples or blocks of them."""
        series = [[one.gain, *one.recursion] for one in self._filters]
        plain = np.array([one.plain for one in self._filters], dtype=np.int64)
        filters = np.array(series).swapaxes(0, 1)
        return WhiteningFilters(1.0 / np.asarray(self.sigma), plain, np.ascontiguousarray(filters))

    @cached_property
    def log_divisor(self) -> Array:
        """(N, C) logarithm of the divisor of a sample: minus it is a term of the log likelihood."""
        spread = np.stack([np.log(one.deviation) for one in self._filters], axis=1)
        return np.asarray((np.log(self.sigma) + spread) * self.band)

    @cached_property
    def total(self) -> Array:
        """(N, C) one sigma of the white and the coloured part together."""
        return np.asarray(np.sqrt(self.share + self._gain**2) * self.sigma)

    def with_channel(self, number: int, other: "SignalNoise") -> "SignalNoise":
        """The noise with one channel as the only one of another noise model."""
        arrays = {}
        for name in ("sigma", "share", "band"):
            arrays[name] = getattr(self, name).copy()
            arrays[name][number] = getattr(other, name)[0]
        colours = (*self.colours[:number], other.colours[0], *self.colours[number + 1 :])
        return replace(self, colours=colours, block=max(self.block, other.block), **arrays)

    def uncoloured(self) -> "SignalNoise":
        """White noise, constant in time, of the same spectral density at low frequencies."""
        period = float(np.median(np.diff(self.seconds)))
        taus = np.array([colour.tau for colour in self.colours])
        slow = np.mean(self._gain**2, axis=0) * np.maximum(2.0 * taus / period, 1.0)
        plain = (NoiseColour(),) * len(self.colours)
        return replace(self, sigma=self.sigma * np.sqrt(1.0 + slow), colours=plain, motion=None)

    @property
    def _gain(self) -> Array:
        """(N, C) size of the coloured part in units of the white level."""
        floor, slope = (np.array([getattr(each, name) for each in self.colours]) for name in ("floor", "slope"))
        return _gain_of(floor, slope, self.speed, 0.0 if self.motion is None else self.motion / self.sigma**2)

    @cached_property
    def _filters(self) -> tuple["_Innovation", ...]:
        gains = self._gain.T
        return tuple(_Innovation(self.seconds, *each) for each in zip(gains, self.colours, strict=True))


def _gain_of(floor: Array | float, slope: Array | float, speed: Array, moved: Array | float) -> Array:
    return np.asarray(np.sqrt(np.square(floor + slope * speed[:, None]) + moved))


class _Innovation:
    """The innovation of a white-plus-OU signal, divided by its deviation: a banded triangular solve per signal."""

    def __init__(self, seconds: Array, gain: Array, colour: NoiseColour) -> None:
        self.gain = gain
        self.plain = not gain.any()
        decay = np.exp(-np.diff(seconds, append=seconds[-1]) / colour.tau)
        variance, kalman = _stationary(gain, decay)
        self.deviation = np.sqrt(variance)
        self._weight = 1.0 / self.deviation
        self._band, self._drive = _recursion(gain, decay, kalman)

    @property
    def recursion(self) -> tuple[Array, Array, Array]:
        """(N,) each: what is left of the state, what of a value enters it, and the weight of the innovation."""
        return -self._band[1], self._drive, self._weight

    def __call__(self, values: Array, scale: float) -> None:
        """Replace signals (K, N) by the innovations of these signals times a factor."""
        values *= scale
        if self.plain or not len(values):  # without columns, dtbtrs writes beyond its arrays
            return
        right = np.empty(values.shape)
        right[:, 0] = 0.0
        np.multiply(self._drive[:-1], values[:, :-1], out=right[:, 1:])
        state = dtbtrs(self._band, right.T, uplo="L", overwrite_b=1)[0].T
        state *= self.gain
        values -= state
        values *= self._weight


def _stationary(gain: Array, decay: Array) -> tuple[Array, Array]:
    """Variance of the innovation and Kalman gain (N,), in units of the white noise.

    The variance p of the predicted state obeys p = a^2 p / (1 + g^2 p) + 1 - a^2 where g and a hold; then one step of
    the recursion from each sample to the next, which matters beside gaps.
    """
    square, usual = gain**2, float(np.median(decay)) ** 2
    rest = 1.0 - usual
    p = 2.0 * rest / (rest * (1.0 - square) + np.sqrt((rest * (1.0 - square)) ** 2 + 4.0 * square * rest) + 1e-300)
    p[1:] = (decay[:-1] ** 2) * (p[:-1] / (1.0 + square[:-1] * p[:-1]) - 1.0) + 1.0
    p[0] = 1.0
    variance = 1.0 + square * p
    return variance, gain * p / variance


def _recursion(gain: Array, decay: Array, kalman: Array) -> tuple[Array, Array]:
    """x+ = a (1 - k g) x + a k y as a lower bidiagonal system for all x at once: its band (2, N), and a k (N,)."""
    band = np.ones((2, len(gain)), order="F")
    band[1] = -decay * (1.0 - kalman * gain)
    return band, decay * kalman


def kept_share(span: float, tau: Array | float) -> Array:
    """Share of the variance of an Ornstein-Uhlenbeck process that its mean over a span (s) has."""
    x = span / np.asarray(tau)
    return np.asarray(2.0 * (x - 1.0 + np.exp(-x)) / x**2)


def fit_noise(
    seconds: Array,
    speed: Array,
    residual: Array,
    least: Array,
    *,
    motion: Array | None = None,
    band: Array | None = None,
    white: bool = False,
    coarse: bool = True,
) -> SignalNoise:
    """The most likely noise model for a residual that is noise alone.

    Args:
        seconds, speed: (N,).
        residual: (N, C) measured minus predicted.
        least: (C,) least size of the noise of a sample.
        band: (C,) share of independent samples; None: that of the residual. Likelihoods are comparable for one band.
        motion: (N, C) variance of the prediction by the errors of the motion.
        white: without a coloured part.
        coarse: see `white_level`.
    """
    period = float(np.median(np.diff(seconds)))
    level = noise_level(residual, period, coarse, least)
    sigma, share = level.sigma, level.share
    if band is not None:
        sigma, share = sigma * np.sqrt(share / band), band
    block = int(level.block.max())
    plain = (NoiseColour(),) * len(sigma)
    found = SignalNoise(sigma, plain, seconds, speed, share, share, block, motion)
    return found if white else _most_likely(found, residual, max(block, int(_TOGETHER / period), 1), period)


def _most_likely(start: SignalNoise, residual: Array, block: int, period: float) -> SignalNoise:
    """Each channel's colour and white level: the most likely of all candidates, on averages with white noise."""
    rows = _parts(len(residual) // block)
    seconds, speed, values = (block_means(each, block)[rows] for each in (start.seconds, start.speed, residual))
    motion = None if start.motion is None else block_means(start.motion, block)[rows]
    level = start.sigma / np.sqrt(block)
    gap = np.diff(seconds, append=seconds[-1])
    gap[gap < 0.0] = np.inf
    moved = None if motion is None else motion / level**2
    tried = [
        (floor, slope, tau)
        for floor, slope, tau in product(_FLOORS, _SLOPES, _TAUS)
        if motion is not None or floor or slope or tau == _TAUS[0]
    ]
    bounds = (level / _EXCESS) ** 2, (level * _EXCESS) ** 2
    kept = kept_share(block * period, np.array([tau for *_, tau in tried]))
    grown = np.sqrt(kept * block)
    floors, slopes = (grown * np.array([each[i] for each in tried]) for i in range(2))
    course = np.array([_TAUS.index(tau) for *_, tau in tried])
    decays = np.exp(-gap / np.array(_TAUS)[:, None])
    best = likely_colours if COMPILED else _likely_colours
    chosen, likely = best(values, speed, moved, (floors, slopes, kept, course), decays, bounds)
    pairs = zip(chosen.tolist(), start.colours, strict=True)
    colours = tuple(before if number < 0 else NoiseColour(*tried[number]) for number, before in pairs)
    sigma = np.where(chosen < 0, level, np.sqrt(likely)) * np.sqrt(block)
    return replace(start, sigma=sigma, colours=colours, share=_share(residual, sigma, start.share, block))


def _likely_colours(
    values: Array,
    speed: Array,
    motion: Array | None,
    colours: tuple[Array, Array, Array, NDArray[np.int64]],
    decays: Array,
    bounds: tuple[Array, Array],
) -> tuple[NDArray[np.int64], Array]:
    """See `poise.kernels.likely_colours`."""
    n, channels = values.shape
    best, likely = np.full(channels, -np.inf), np.zeros(channels)
    chosen = np.full(channels, -1)
    for number, (floor, slope, share, course) in enumerate(zip(*colours, strict=True)):
        gain = _gain_of(floor, slope, speed, np.zeros((1, 1)) if motion is None else share * motion)
        decay = decays[course][:, None]
        variance, kalman = _stationary(gain, decay)
        square = _squares(values, gain, kalman, decay[:, 0])
        # Most likely level for each candidate, kept near the level of neighbouring samples.
        level = np.clip(square / n, *bounds)
        loglik = -0.5 * (square / level + n * np.log(level)) - 0.5 * np.log(variance).sum(axis=0)
        better = loglik > best
        best, likely, chosen = (np.where(better, *pair) for pair in ((loglik, best), (level, likely), (number, chosen)))
    return chosen, likely


def _share(residual: Array, sigma: Array, least: Array, block: int) -> Array:
    """(C,) share of the white variance in the samples, by their scatter inside blocks; slow residuals do not count."""
    count = len(residual) // block
    scatter = residual[: count * block].reshape(count, block, -1).var(axis=1)
    found = np.median(block_means(scatter, max(min(_PART, count) // 4, 1)), axis=0) / sigma**2 + 1.0 / block
    return np.asarray(np.clip(found, least, _EXCESS**2 * least))


def _squares(values: Array, gain: Array, kalman: Array, decay: Array) -> Array:
    """(K,) sums of squared innovations of values (N, K), in units of their variance; of one gain together."""
    if gain.shape[1] == 1:
        return _of_one_gain(values, gain[:, 0], kalman[:, 0], decay)
    each = [_of_one_gain(values[:, [c]], gain[:, c], kalman[:, c], decay) for c in range(gain.shape[1])]
    return np.concatenate(each)


def _of_one_gain(values: Array, gain: Array, kalman: Array, decay: Array) -> Array:
    band, drive = _recursion(gain, decay, kalman)
    right = np.zeros(values.shape, order="F")
    np.multiply(drive[:-1, None], values[:-1], out=right[1:])
    innovation = values - gain[:, None] * dtbtrs(band, right, uplo="L", overwrite_b=1)[0]
    # 1 - k g is one over the variance.
    return np.asarray((1.0 - kalman * gain) @ innovation**2)


def _parts(count: int) -> NDArray[np.intp]:
    """Rows of parts, evenly spread, that together have at most `_ENOUGH` of `count` rows."""
    every = -(-count // _ENOUGH)
    rows = np.arange(count)
    return np.asarray(rows[rows // _PART % every == 0])
