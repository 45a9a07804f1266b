"""From sampled joint positions or rotations to velocities and accelerations with their covariance.

Quintic regression splines; cross-validation chooses the distance of their knots, joint by joint. The stated noise has
two parts: what the samples' noise makes of the spline (exact for white noise), and what the spline cannot follow
(measured against a spline with finer knots). Where a signal stands still its derivatives are zero, see `rest`.
"""

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache, partial

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from poise.errors import ErrorCode, InputError
from poise.geometry import are_rotations
from poise.robot.rest import Rest, find_rests
from poise.robot.splines import DEGREE, Design, Grid, SplineFit
from poise.types import Array, Mask, Stamps

MIN_STRETCH = 12
"""A stretch between gaps that has fewer gets no derivatives: six coefficients and their noise want more."""

GAP_INTERVALS = 6.0
"""Median sample intervals that make a gap."""

_FASTEST = 300.0
"""Hz; of faster samples, several are averaged before a spline is fitted, so that about 250 Hz remain."""

_WORTHWHILE = 0.01
"""Information of measured rates, relative to that of the positions, below which they are not used."""

_CHECKED = 120
"""Samples, evenly spread, at which a spline is compared with a finer one."""


@dataclass(frozen=True)
class Derivatives:
    """Smoothed samples and their time derivatives, each (N, J), with the covariance of the three.

    NaN where a stretch between gaps is too short.

    Args:
        stamps: (N,) ns.
        position, velocity, acceleration: (N, J) rad or m, and per s and s2.
        covariance: (N, J, 3, 3) of position, velocity and acceleration; different signals are independent.
        knot_spacing: (J,) s, the longest that was chosen.
        at_rest: (N, J) bool, where a signal stands still.
    """

    stamps: Stamps
    position: Array
    velocity: Array
    acceleration: Array
    covariance: Array
    knot_spacing: Array
    at_rest: Mask

    @property
    def position_sigma(self) -> Array:
        """(N, J) one-sigma errors."""
        return np.sqrt(self.covariance[..., 0, 0])

    @property
    def velocity_sigma(self) -> Array:
        """(N, J) one-sigma errors."""
        return np.sqrt(self.covariance[..., 1, 1])

    @property
    def acceleration_sigma(self) -> Array:
        """(N, J) one-sigma errors."""
        return np.sqrt(self.covariance[..., 2, 2])


@dataclass(frozen=True)
class RotationDerivatives:
    """Smoothed rotations (N, 3, 3) world <- body, angular velocity and acceleration (N, 3) in body axes.

    The sigmas (N,) are one-sigma errors of each component, in rad, rad/s and rad/s2.
    """

    stamps: Stamps
    rotation: Array
    angular_velocity: Array
    angular_acceleration: Array
    rotation_sigma: Array
    angular_velocity_sigma: Array
    angular_acceleration_sigma: Array
    knot_spacing: float


def differentiate(
    stamps: ArrayLike,
    position: ArrayLike,
    velocity: ArrayLike | None = None,
    *,
    knot_spacing: float | None = None,
    gap: float | None = None,
    within: tuple[int, int] | None = None,
    errors: bool = True,
) -> Derivatives:
    """First and second time derivative of sampled signals.

    Args:
        stamps: (N,) int64 ns, not descending; need not be uniform.
        position: (N, J) rad or m.
        velocity: (N, J) measured rates where there are (a column with NaN is left out); they count as much as their
            scatter about the positions' own derivative earns.
        knot_spacing: s; None: chosen by generalised cross-validation, joint by joint.
        gap: s without a sample across which nothing is derived; None: six median intervals.
        within: ns, first and last stamp that are answered; all samples take part. None: all.
        errors: whether the covariance is wanted; it takes as long as the derivatives. Else it is NaN.

    Returns:
        At the samples, or at those within.

    Raises:
        InputError: TOO_FEW_SAMPLES when no stretch has 12, TIME_BACKWARDS, NOT_FINITE or TYPE_MISMATCH (shapes).
    """
    stamps, values = _check(stamps, position)
    rates = None if velocity is None else np.asarray(velocity, dtype=np.float64).reshape(values.shape)
    smoother = partial(_Smoother, spacing=knot_spacing)
    return _derivatives(smoother, stamps, values, rates, gap=gap, within=within, errors=errors)


def _derivatives(
    smoother_of: "Callable[..., _Smoother]",
    stamps: Stamps,
    values: Array,
    rates: Array | None,
    *,
    gap: float | None,
    within: tuple[int, int] | None,
    errors: bool,
) -> Derivatives:
    n, columns = values.shape
    begin, end = (0, n) if within is None else np.searchsorted(stamps, [within[0], within[1] + 1])
    shape = (int(end - begin), columns)
    position, velocity, acceleration = np.full((3, *shape), np.nan)
    covariance, still = np.full((*shape, 3, 3), np.nan), np.zeros(shape, dtype=bool)
    out = Derivatives(stamps[begin:end], position, velocity, acceleration, covariance, np.zeros(columns), still)
    for part, seconds in _stretches(stamps, gap):
        low, high = max(part.start, begin), min(part.stop, end)
        smoother = smoother_of(seconds, values[part], None if rates is None else rates[part])
        np.maximum(out.knot_spacing, smoother.spacing, out=out.knot_spacing)
        if low < high:
            inside = slice(low - part.start, high - part.start)
            _answer(out, slice(low - begin, high - begin), smoother, inside, errors)
    return out


def _answer(out: Derivatives, rows: slice, smoother: "_Smoother", inside: slice, errors: bool) -> None:
    """Write the derivatives of one stretch, and set those at rest to zero."""
    for column in range(smoother.values.shape[1]):
        values = smoother.at(column, inside)
        covariance = smoother.covariance(column, inside) if errors else out.covariance[rows, column]
        shortest = min(1.5 * smoother.spacing[column], 0.8 * float(smoother.seconds[-1] - smoother.seconds[0]))
        for rest in find_rests(smoother.seconds, smoother.values[:, column], shortest):
            still = smoother.inner(column, rest, inside.start)
            values[:, still] = np.array([[rest.level], [0.0], [0.0]])
            covariance[still] = np.diag(np.square(rest.sigma))
            out.at_rest[rows][still, column] = True
        for signal, value in zip((out.position, out.velocity, out.acceleration), values, strict=True):
            signal[rows, column] = value
        out.covariance[rows, column] = covariance


def differentiate_rotations(
    stamps: ArrayLike,
    rotation: ArrayLike,
    *,
    knot_spacing: float | None = None,
    gap: float | None = None,
    within: tuple[int, int] | None = None,
    errors: bool = True,
) -> RotationDerivatives:
    """Angular velocity and acceleration of sampled attitudes, as from tf alone.

    The spline runs through the four components of the quaternion, which have no singularity, see `turning`. All four
    follow the same knots.

    Args:
        stamps: (N,) int64 ns, not descending.
        rotation: (N, 3, 3), takes body axes to world axes; turned by less than half a turn between samples.
        knot_spacing, gap, within, errors: as `differentiate`.

    Raises:
        InputError: as `differentiate`; NOT_FINITE also when a matrix is not a rotation.
    """
    matrices = np.asarray(rotation, dtype=np.float64)
    stamps, _ = _check(stamps, matrices.reshape(len(matrices), -1))
    wrong = np.flatnonzero(~are_rotations(matrices, 1e-2))
    if wrong.size:
        raise InputError(ErrorCode.NOT_FINITE, f"sample {wrong[0]} is not a rotation matrix (columns not orthonormal)")
    quaternions = continuous_quaternions(matrices)

    smoother = partial(_Smoother, spacing=knot_spacing, together=True)
    found = _derivatives(smoother, stamps, quaternions, None, gap=gap, within=within, errors=errors)
    known = np.isfinite(found.acceleration).all(axis=1)
    n = len(found.stamps)
    smooth, omega, alpha = np.full((n, 3, 3), np.nan), np.full((n, 3), np.nan), np.full((n, 3), np.nan)
    if known.any():
        parts = found.position[known], found.velocity[known], found.acceleration[known]
        smooth[known], omega[known], alpha[known] = turning(*parts)
    # A rotation error of e rad moves the quaternion by e / 2, in three of its four directions.
    sigma, rate, second = 2.0 * np.sqrt(np.diagonal(found.covariance, axis1=2, axis2=3).sum(axis=1).T / 3.0)
    return RotationDerivatives(found.stamps, smooth, omega, alpha, sigma, rate, second, float(found.knot_spacing.max()))


class _Smoother:
    """The splines with the best knots for one stretch without gaps, and their errors; one for each column."""

    def __init__(
        self, seconds: Array, values: Array, rates: Array | None, spacing: float | None, together: bool = False
    ) -> None:
        self.seconds, self.values = seconds, values
        self._count, self._span = _bin_size(seconds), 0.0
        if self._count > 1:
            self._span = float(seconds[-1] - seconds[0]) * self._count / (len(seconds) - 1)
            seconds, values = _binned(seconds, self._count), _binned(values, self._count)
            rates = None if rates is None else _binned(rates, self._count)
        self._at = seconds
        design = cache(lambda m: Design(Grid.across(seconds, m), seconds))
        self._plain = cache(lambda m: SplineFit(design(m), values))
        columns = range(values.shape[1])
        self._fit: list[Callable[[int], SplineFit]] = [self._column(k) for k in columns]
        scores = cache(lambda m: self._plain(m).score())
        if together:
            chosen = [self._intervals(spacing, lambda m: float(scores(m).sum()))] * len(columns)
        else:
            chosen = [self._intervals(spacing, partial(_score_of, scores, k)) for k in columns]
        if rates is not None:
            for k in np.flatnonzero(np.isfinite(rates).all(axis=0)):
                chosen[k] = self._with_rates(int(k), rates, chosen[k], spacing)
        self._chosen = chosen
        self.spacing = np.array([design(m).grid.spacing for m in chosen])

    def inner(self, column: int, rest: Rest, start: int) -> slice:
        """Samples of a rest, counted from `start`, at least one knot spacing away from motion, which shows late."""
        rate = (len(self.seconds) - 1) / float(self.seconds[-1] - self.seconds[0])
        margin = math.ceil(self.spacing[column] * rate)
        begin = rest.begin + margin if rest.begin > 0 else 0
        end = rest.end - margin if rest.end < len(self.seconds) else rest.end
        return slice(max(begin - start, 0), max(end - start, begin - start, 0))

    def at(self, column: int, inside: slice) -> Array:
        """(3, M) position, velocity, acceleration at the samples inside."""
        values = self._fit[column](self._chosen[column]).derivatives(self.seconds[inside])[:, :, 0]
        values[0] -= self._span**2 * (1.0 - self._count**-2.0) / 24.0 * values[2]  # what the mean over a bin adds
        return values

    def covariance(self, column: int, inside: slice) -> Array:
        """(M, 3, 3) of position, velocity and acceleration at the samples inside: noise, and the lag of the spline."""
        m = self._chosen[column]
        fit, finer = self._fit[column](m), self._fit[column](min(max(round(m * math.sqrt(2)), 2), self._most()))
        # The gain hardly changes from one sample to the next: of averaged samples, that of their mean.
        nearest = np.minimum(np.arange(inside.start, inside.stop) // self._count, len(self._at) - 1)
        gains = fit.gains(self._at[nearest[0] : nearest[-1] + 1])
        checked = self._at[self._interior(m)]
        checked = checked[:: max(-(-len(checked) // _CHECKED), 1)]
        difference = (fit.derivatives(checked) - finer.derivatives(checked))[:, :, 0]
        # The spline spaces nearly contain one another: the difference varies by what the finer one varies more.
        excess = finer.gains(checked) * finer.sigma**2 - fit.gains(checked) * fit.sigma**2
        lag = np.mean(difference**2 - np.diagonal(excess, axis1=1, axis2=2).T, axis=1)
        return np.asarray(gains[nearest - nearest[0]] * fit.sigma**2 + np.diag(np.maximum(lag, 0.0)))

    def _column(self, column: int) -> Callable[[int], SplineFit]:
        return cache(lambda m: self._plain(m).select(slice(column, column + 1)))

    def _with_rates(self, column: int, rates: Array, plain: int, spacing: float | None) -> int:
        """Let a column follow its measured rates too; how many knot intervals suit that."""
        best = self._plain(plain)
        scatter = float(np.mean((rates[:, column] - best(self._at, 1)[:, column]) ** 2))
        weight = float(best.sigma[column] ** 2) / scatter if scatter > 0 else 0.0
        band, rate_band = best.information
        if weight * rate_band < _WORTHWHILE * band:
            return plain
        sums = self._sums(rates)
        fit = cache(lambda m: self._plain(m).with_slopes(slice(column, column + 1), sums(m), weight))
        self._fit[column] = fit
        return self._intervals(spacing, lambda m: float(fit(m).score().sum()))

    def _sums(self, rates: Array) -> Callable[[int], tuple[Array, Array]]:
        if not hasattr(self, "_made"):
            self._made = cache(lambda m: self._plain(m).slope_sums(np.nan_to_num(rates)))
        return self._made

    def _interior(self, m: int) -> slice:
        edge = min(round(3 * len(self._at) / m), len(self._at) // 4)
        return slice(edge, len(self._at) - edge)

    def _most(self) -> int:
        """Most knot intervals that still leave a third of the samples to judge by."""
        return max(len(self._at) * 2 // 3 - DEGREE, 1)

    def _intervals(self, spacing: float | None, score: Callable[[int], float]) -> int:
        most = self._most()
        duration = float(self._at[-1] - self._at[0])
        if spacing is not None:
            return min(max(round(duration / spacing), 1), most)

        coarse = [2**k for k in range(most.bit_length()) if 2**k <= most]
        best = min(coarse, key=score)
        near: list[int] = [min(max(round(best * math.pow(2.0, k / 4)), 1), most) for k in range(-3, 4)]
        return min(near, key=score)


def _score_of(scores: Callable[[int], Array], column: int, m: int) -> float:
    return float(scores(m)[column])


def _bin_size(seconds: Array) -> int:
    """How many samples in a row are averaged before the fit."""
    rate = (len(seconds) - 1) / float(seconds[-1] - seconds[0])
    return max(round(rate / 250.0), 1) if rate > _FASTEST else 1


def _binned(values: Array, count: int) -> Array:
    """Means of `count` rows of (N, ...) in a row; the last one takes the remainder."""
    edges = np.arange(0, max(len(values) - count + 1, 1), count)
    sizes = np.diff(edges, append=len(values)).reshape(-1, *[1] * (values.ndim - 1))
    return np.asarray(np.add.reduceat(values, edges, axis=0) / sizes)


def turning(quaternion: Array, first: Array, second: Array) -> tuple[Array, Array, Array]:
    """Rotation (N, 3, 3), angular velocity and acceleration (N, 3) in body axes of an attitude with its derivatives.

    Of a quaternion s (N, 4), x y z w, of any length: omega = 2 vec(s* s') / |s|^2 and
    alpha = 2 vec(s* s'') / |s|^2 - 2 (s . s') omega / |s|^2.
    """
    square = np.sum(quaternion * quaternion, axis=1, keepdims=True)
    omega = 2.0 * _vector_of_product(quaternion, first) / square
    stretch = np.sum(quaternion * first, axis=1, keepdims=True) / square
    alpha = 2.0 * _vector_of_product(quaternion, second) / square - 2.0 * stretch * omega
    return Rotation.from_quat(quaternion).as_matrix(), omega, alpha


def _check(stamps: ArrayLike, values: ArrayLike) -> tuple[Stamps, Array]:
    times = np.asarray(stamps)
    array = np.asarray(values, dtype=np.float64)
    if times.ndim != 1 or array.ndim != 2 or len(times) != len(array):
        raise InputError(
            ErrorCode.TYPE_MISMATCH, f"stamps have shape {times.shape} and samples {array.shape}: expected (N,), (N, J)"
        )
    times = times.astype(np.int64)
    back = np.flatnonzero(np.diff(times) < 0)
    if back.size:
        raise InputError(ErrorCode.TIME_BACKWARDS, f"time runs backwards at sample {back[0] + 1}; sort the samples")
    bad = np.flatnonzero(~np.isfinite(array).all(axis=1))
    if bad.size:
        raise InputError(ErrorCode.NOT_FINITE, f"sample {bad[0]} is not finite; leave out all {bad.size} of them")
    return times, array


def _stretches(stamps: Stamps, gap: float | None) -> Iterator[tuple[slice, Array]]:
    """The stretches between gaps that are long enough, with seconds from their first sample."""
    steps = np.diff(stamps) * 1e-9
    positive = steps[steps > 0]
    limit = gap if gap is not None else GAP_INTERVALS * float(np.median(positive)) if positive.size else 0.0
    edges = [0, *(np.flatnonzero(steps > limit) + 1).tolist(), len(stamps)]
    found = False
    for begin, end in itertools.pairwise(edges):
        if end - begin >= MIN_STRETCH and stamps[end - 1] > stamps[begin]:
            found = True
            yield slice(begin, end), (stamps[begin:end] - stamps[begin]) * 1e-9
    if not found:
        raise InputError(
            ErrorCode.TOO_FEW_SAMPLES,
            f"too few samples to differentiate: of {len(stamps)} no {MIN_STRETCH} come without a gap of {limit:.3g} s",
        )


def continuous_quaternions(rotation: Array) -> Array:
    """(N, 4) x y z w of rotations (N, 3, 3), with signs chosen so that neighbours are close."""
    quaternions = np.asarray(Rotation.from_matrix(rotation).as_quat())
    flips = np.sum(quaternions[1:] * quaternions[:-1], axis=1) < 0
    sign = np.cumprod(np.concatenate([[1.0], np.where(flips, -1.0, 1.0)]))
    return np.asarray(quaternions * sign[:, None])


def _vector_of_product(p: Array, q: Array) -> Array:
    """(N, 3) the vector part of p* q, quaternions as x, y, z, w."""
    return p[:, 3:] * q[:, :3] - q[:, 3:] * p[:, :3] - np.cross(p[:, :3], q[:, :3])
