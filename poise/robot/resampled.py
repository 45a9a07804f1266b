"""Sampled positions to position, velocity and acceleration at other stamps, by splines that choose their knots."""

import itertools
from dataclasses import dataclass, replace

import numpy as np
import scipy

from poise.errors import ErrorCode, InputError
from poise.robot.regular_clock import regular_clock
from poise.robot.rest import encoder_step, find_rests
from poise.robot.splines import Design, Grid, SplineFit
from poise.types import Array, Mask

_GAP = 6.0
"""Median sample intervals that make a gap."""
_MIN_SAMPLES, _COMPARED = 30, 1500
"""Samples of a stretch at least; and those on which two clocks are compared at most."""
_EDGE = 0.08
"""s at the ends of a stretch where accelerations are too uncertain."""
_SPACINGS = tuple(0.03 * 1.5**k for k in range(-4, 8))
"""s between knots that are tried: 0.006 to 0.51."""
_SLOW_KNOTS, _SAMPLES = 0.0299, 3.0
"""s; closer knots are tried when each interval has this many samples."""
_LOCAL = 0.7
"""s around a sample that decide which spline fits it best."""
_LOUD = 0.8
"""Quantile of the local noise that represents the whole signal."""
_FINER = 2.5
"""Largest ratio of the knot density at a moment to that of the whole recording."""
_PRICE = 2.0
"""log likelihood that a coefficient must win; Akaike's 1 would fit noise where it is locally larger."""
_NOISY = 2.2
"""Local scatter about a spline that noise alone may cause, in units of its variance."""
_RINGING = 2.0
"""Knot spacings on either side of a misfit within which a spline rings."""
_SUDDEN = 2.0
"""Error by sudden changes of the second rate over the noise of a spline, as variances."""
_COARSE, _INEXACT = 0.5, 0.03
"""Share of the noise from which on it is that of rounding, and least noise beside that, in steps of the encoder."""
_OVER = np.sqrt(2 / np.pi)
"""Share of the samples that white noise of one sigma takes beyond half a step of the encoder, times steps per sigma."""
_NOISELESS = 1e-9
"""m or rad: less noise than any encoder or odometry has."""
_HONEST = 2.5
"""Measured rates are not used when their means over 25 samples scatter by more than this factor over white noise."""


@dataclass(frozen=True, eq=False)
class ResampledSignal:
    """Values (N, J), rates and second rates at the wanted times; NaN outside the samples.

    Args:
        known: (N,) where there are values.
        noise: (J,) one sigma of a sample about the spline.
        sigma: (3, N, J) one-sigma errors of position, velocity and acceleration; no velocity at rest.
    """

    position: Array
    velocity: Array
    acceleration: Array
    known: Mask
    noise: Array
    sigma: Array

    def select(self, mask: Mask) -> "ResampledSignal":
        """The samples that a mask (N,) picks."""
        rows = {name: getattr(self, name)[mask] for name in ("position", "velocity", "acceleration", "known")}
        return replace(self, **rows, sigma=self.sigma[:, mask])


def resample(seconds: Array, values: Array, wanted: Array, rates: Array | None = None) -> ResampledSignal:
    """Differentiate samples and evaluate at other times, never across a gap.

    Splines with close knots follow a jerk, splines with wide knots have little noise: they are averaged with weights
    by their local likelihood. The stamps are used unchanged or as those of a regular clock with jitter, depending on
    which of the two the splines fit better.

    Args:
        seconds: (M,) not descending.
        values: (M, J) finite.
        wanted: (N,).
        rates: (M, J) measured first derivatives; columns with NaN, or with more than white noise, are left out.

    Raises:
        InputError: TOO_FEW_SAMPLES.
    """
    fresh = np.concatenate([[True], np.diff(seconds) > 0])
    seconds, values = seconds[fresh], values[fresh]
    rates = None if rates is None else rates[fresh]
    seconds, _ = sampling_times(seconds, values)
    sure = np.isfinite(seconds)
    seconds, values, rates = seconds[sure], values[sure], None if rates is None else rates[sure]
    out, sigma = np.full((2, 3, len(wanted), values.shape[1]), np.nan)
    noise = np.zeros(values.shape[1])
    for part in _stretches(seconds):
        begin, end = seconds[part][0], seconds[part][-1]
        inside = (wanted >= begin + _EDGE) & (wanted <= end - _EDGE)
        blend = _Blend(seconds[part], values[part], None if rates is None else rates[part])
        noise = np.maximum(noise, blend.noise)
        found, errors = blend(wanted[inside])
        for column, rests in enumerate(find_rests(seconds[part], values[part], blend.spacing)):
            for rest in rests:
                ends = seconds[part][[rest.begin, rest.end - 1]]
                still = (wanted[inside] >= ends[0]) & (wanted[inside] <= ends[1])
                found[:, still, column] = np.array([[rest.level], [0.0], [0.0]])
                errors[:, still, column] = np.array([[rest.sigma[0]], [0.0], [0.0]])
        out[:, inside], sigma[:, inside] = found, errors
    return ResampledSignal(out[0], out[1], out[2], np.isfinite(out).all(axis=(0, 2)), noise, sigma)


def sampling_times(seconds: Array, values: Array) -> tuple[Array, float]:
    """When samples (M, C) were taken, by a regular clock or as their stamps say, and the stamps' jitter, s.

    NaN where the clock is not sure, see `regular_clock`.
    """
    even = regular_clock(seconds, values)
    if even is None:
        return seconds, 0.0
    sure = np.flatnonzero(np.isfinite(even))
    part = sure[_liveliest(even[sure], values[sure])]
    if _roughness(even[part], values[part]) >= _roughness(seconds[part], values[part]):
        return seconds, 0.0
    return even, float(np.std(seconds[sure] - even[sure]))


class _Blend:
    """Splines of several knot spacings through one stretch, weighted by their local likelihood, column by column."""

    def __init__(self, seconds: Array, values: Array, rates: Array | None) -> None:
        span = float(seconds[-1] - seconds[0])
        self._period = float(np.median(np.diff(seconds)))
        least = min(_SLOW_KNOTS, _SAMPLES * self._period)
        sizes = sorted({max(round(span / spacing), 1) for spacing in _SPACINGS if spacing > least})
        grids = [Grid.across(seconds, size) for size in sizes if size <= max(len(seconds) * 2 // 3 - 5, 1)]
        plain = [SplineFit(Design(grid, seconds), values) for grid in grids]
        best = np.argmin([fit.score() for fit in plain], axis=0)
        columns = np.arange(values.shape[1])
        self.noise = np.array([fit.sigma for fit in plain])[best, columns]
        self.noise = np.maximum(self.noise, 1e-12)
        self.spacing = np.array([grid.spacing for grid in grids])[best]
        """(J,) s between the knots that suit the whole stretch."""
        self._seconds, self._step = seconds, encoder_step(values.T)
        # A base's odometry has more noise while it drives than at rest: the former counts.
        local = self._around((values - plain[-1](seconds)) ** 2)
        self.noise *= np.sqrt(
            np.maximum(np.quantile(local, _LOUD, axis=0) / np.maximum(local.mean(axis=0), 1e-30), 1.0)
        )
        slopes, weight = _trusted(seconds, rates, plain, best, self.noise)
        self._fits = plain
        if slopes is not None:
            self._fits = [
                fit.with_slopes(columns, fit.slope_sums(slopes), np.full(len(columns), weight)) for fit in plain
            ]
            best = np.argmin([fit.score() for fit in self._fits], axis=0)
        over = np.mean(np.abs(_off(values, seconds, self._fits, best)) > self._step / 2, axis=0)
        self._rounded = self._step > _COARSE * np.sqrt(12.0) * self.noise
        self._beside = np.maximum(over / _OVER, _INEXACT) * self._step
        self._score = np.stack([self._local(fit, values, slopes, weight) for fit in self._fits])
        # Much closer knots than the whole signal needs would fit noise where it is locally larger.
        fine = np.array([grid.size for grid in grids])
        self._score -= 1e9 * (fine[:, None] > _FINER * fine[best])[:, None]
        self._unresolved = [self._misfit(fit, values) + self._sudden(fit) for fit in self._fits]

    def _local(self, fit: SplineFit, values: Array, slopes: Array | None, weight: float) -> Array:
        """(M, J) local log likelihood, less `_PRICE` for every coefficient spent nearby."""
        square = self._beyond_rounding(values - fit(self._seconds))
        if slopes is not None:
            square = square + weight * ((slopes - fit(self._seconds, 1)) / self.noise) ** 2
        spent = float(self._window(len(values)).sum()) * fit.grid.size / len(values)
        return self._around(-0.5 * square) - _PRICE * spent

    def _beyond_rounding(self, off: Array) -> Array:
        """(M, J) squares of residuals in units of the noise, for a rounded signal of what exceeds half a step.

        Rounding is no white noise: at a constant speed near a whole number of steps per sample its error is a slow saw
        tooth, which splines with close knots follow. All splines within half a step agree with the samples.
        """
        beyond = np.maximum(np.abs(off) - self._step / 2, 0.0) / np.maximum(self._beside, 1e-12)
        return np.asarray(np.where(self._rounded, beyond, off / self.noise) ** 2)

    def _around(self, values: Array) -> Array:
        """(M, J) sums over `_LOCAL` seconds, smoothly weighted."""
        window = self._window(len(values))
        half = len(window) // 2
        padded = np.pad(values, ((half, half), (0, 0)), mode="reflect").T
        size = scipy.fft.next_fast_len(padded.shape[1], real=True)
        summed = scipy.fft.irfft(scipy.fft.rfft(padded, size) * scipy.fft.rfft(window, size), size)
        return np.asarray(summed[:, len(window) - 1 : padded.shape[1]].T)

    def _window(self, count: int) -> Array:
        half = min(max(round(_LOCAL / self._period), 3), (count - 1) // 2)
        return np.asarray(np.hanning(2 * half + 3)[1:-1])

    def __call__(self, wanted: Array) -> tuple[Array, Array]:
        """(3, N, J) value, rate and second rate, and their one-sigma errors.

        The errors are those by the noise of the samples, the spread of the splines that are averaged, and what they
        do not resolve.
        """
        score = np.stack([_at(wanted, self._seconds, each) for each in self._score])
        share = np.exp(score - score.max(axis=0))
        share /= share.sum(axis=0)
        parts = [np.stack([fit(wanted, order) for order in range(3)]) for fit in self._fits]
        mean = np.asarray(sum(w * part for w, part in zip(share, parts, strict=True)))
        variance = np.zeros(mean.shape)
        for w, part, fit, unresolved in zip(share, parts, self._fits, self._unresolved, strict=True):
            variance += w * ((part - mean) ** 2 + fit.usual_gains()[:, None, None] * self.noise**2)
            variance[2] += w * _at(wanted, self._seconds, unresolved)
        return mean, np.sqrt(variance)

    def _misfit(self, fit: SplineFit, values: Array) -> Array:
        """(M, J) variance of the second rate where a spline cannot follow: beside a jump it overshoots and rings.

        There the samples scatter about the spline by more than their noise. A wave of two knot spacings h and
        amplitude x has the second rate (pi / h)^2 x.
        """
        half = self._samples(fit)
        local = scipy.ndimage.uniform_filter1d((values - fit(self._seconds)) ** 2, 2 * half + 1, axis=0, mode="nearest")
        excess = np.where(local > _NOISY * self.noise**2, local - self.noise**2, 0.0)
        ringing = scipy.ndimage.maximum_filter1d(excess, 2 * round(_RINGING * half) + 1, axis=0, mode="nearest")
        return np.asarray(ringing * (np.pi / fit.grid.spacing) ** 4)

    def _sudden(self, fit: SplineFit) -> Array:
        """(M, J) variance of the second rate by changes that may be sudden, as at the corners of a trapezoidal motion.

        Within the noise, a change over one spacing may have happened at once. Errors by that are about as large as the
        noise on average, since closer knots would have won otherwise; they lie where the second rate changes.
        """
        half = self._samples(fit) // 2
        padded = np.pad(fit(self._seconds, 2), ((half, half), (0, 0)), mode="edge")
        changed = (padded[2 * half :] - padded[: len(padded) - 2 * half]) ** 2
        noise = fit.usual_gains()[2] * self.noise**2
        return np.asarray(_SUDDEN * noise * changed / np.maximum(changed.mean(axis=0), 1e-30))

    def _samples(self, fit: SplineFit) -> int:
        """Samples between two knots."""
        return max(round(fit.grid.spacing / self._period), 1)


def _at(wanted: Array, seconds: Array, values: Array) -> Array:
    """(N, J) values (M, J), interpolated linearly."""
    return np.stack([np.interp(wanted, seconds, column) for column in values.T], axis=1)


def _off(values: Array, seconds: Array, fits: list[SplineFit], best: Array, order: int = 0) -> Array:
    """(M, J) samples of a derivative less that of the spline that suits each column best."""
    return np.stack([values[:, j] - fits[i](seconds, order)[:, j] for j, i in enumerate(best)], axis=1)


def _trusted(
    seconds: Array, rates: Array | None, fits: list[SplineFit], best: Array, noise: Array
) -> tuple[Array | None, float]:
    """Measured rates to use, with the weight (s2) of their noise; None when the noise is not white."""
    if rates is None or not np.isfinite(rates).all():
        return None, 0.0
    off = _off(rates, seconds, fits, best, order=1)
    length = len(off) // 25 * 25
    if length < 100:
        return None, 0.0
    means = off[:length].reshape(-1, 25, off.shape[1]).mean(axis=1)
    scatter = np.maximum(off.var(axis=0), 1e-18)
    if (25.0 * np.mean(means**2, axis=0) > _HONEST * scatter).any():
        return None, 0.0
    noisy = noise > _NOISELESS  # a planar base never leaves the plane
    return rates, float(np.median((noise**2 / scatter)[noisy if noisy.any() else slice(None)]))


def _roughness(seconds: Array, values: Array) -> float:
    """Residual of smooth splines for these stamps (log, summed over the columns that move)."""
    moving = np.ptp(values, axis=0) > 1e-4
    if not moving.any():
        return 0.0
    size = max(round((seconds[-1] - seconds[0]) / 0.1), 1)
    sigma = SplineFit(Design(Grid.across(seconds, size), seconds), values[:, moving]).sigma
    return float(np.log(np.maximum(sigma, 1e-12)).sum())


def _liveliest(seconds: Array, values: Array) -> slice:
    """The samples in a row, without a gap, in which values (M, C) travel most."""
    stretch = max(_stretches(seconds), key=lambda part: part.stop - part.start)
    ways = np.abs(np.diff(values[stretch], axis=0)).sum(axis=1)
    count = min(len(ways), _COMPARED)
    travelled = np.cumsum(np.append(0.0, ways))
    start = stretch.start + int(np.argmax(travelled[count:] - travelled[: len(travelled) - count]))
    return slice(start, start + count + 1)


def _stretches(seconds: Array) -> list[slice]:
    steps = np.diff(seconds)
    limit = _GAP * float(np.median(steps)) if len(steps) else 0.0
    edges = [0, *(np.flatnonzero(steps > limit) + 1).tolist(), len(seconds)]
    found = [slice(a, b) for a, b in itertools.pairwise(edges) if b - a >= _MIN_SAMPLES]
    if not found:
        raise InputError(
            ErrorCode.TOO_FEW_SAMPLES,
            f"too few joint samples: of {len(seconds)} no {_MIN_SAMPLES} come without a gap of {limit:.3g} s; "
            "record at 50 Hz or more, for ten seconds or more",
        )
    return found
