"""From sampled joint positions or rotations to velocities and accelerations that say how far they can be trusted.

Quintic regression splines; the distance of their knots is chosen by cross-validation, joint by joint. The stated noise
has two parts: what the samples' noise makes of the spline (exact for white noise), and what the spline cannot follow
(measured against a spline with finer knots).
"""

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from poise.errors import ErrorCode, InputError
from poise.robot.splines import DEGREE, Design, Grid, SplineFit
from poise.types import Array

_Made = TypeVar("_Made")

MIN_SAMPLES = 12
"""A stretch between gaps that has fewer gets no derivatives: six coefficients and their noise want more."""

GAP = 6.0
"""Median sample intervals that make a gap."""


@dataclass(frozen=True)
class Derivatives:
    """Smoothed samples, their time derivatives and one-sigma errors of all three, each (N, J).

    NaN where a stretch between gaps is too short to say anything. knot_spacing: (J,) s, the longest that was chosen.
    """

    stamps: NDArray[np.int64]
    position: Array
    velocity: Array
    acceleration: Array
    position_sigma: Array
    velocity_sigma: Array
    acceleration_sigma: Array
    knot_spacing: Array


@dataclass(frozen=True)
class RotationDerivatives:
    """Smoothed rotations (N, 3, 3) world <- body, angular velocity and acceleration (N, 3) in body axes.

    The sigmas (N,) are one-sigma errors of each component, in rad, rad/s and rad/s2.
    """

    stamps: NDArray[np.int64]
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
) -> Derivatives:
    """First and second time derivative of sampled signals.

    Args:
        stamps: (N,) int64 ns, not descending; need not be uniform.
        position: (N, J) rad or m.
        velocity: (N, J) measured rates where there are (a column with NaN is left out); they count as much as their
            scatter about the positions' own derivative earns.
        knot_spacing: s; None: chosen by generalised cross-validation, joint by joint.
        gap: s without a sample across which nothing is derived; None: six median intervals.

    Raises:
        InputError: TOO_FEW_SAMPLES when no stretch has 12, TIME_BACKWARDS, NOT_FINITE or TYPE_MISMATCH (shapes).
    """
    stamps, values = _check(stamps, position)
    rates = None if velocity is None else np.asarray(velocity, dtype=np.float64).reshape(values.shape)
    out = np.full((6, *values.shape), np.nan)
    spacing = np.zeros(values.shape[1])
    for part, seconds in _stretches(stamps, gap):
        designs = _designs(seconds)
        scores = _scores(seconds, designs, values[part])
        for column in range(values.shape[1]):
            rate = _rates(rates, part, column)
            fit = _Smoother(seconds, designs, values[part, column, None], rate, knot_spacing, scores[column])
            out[:3, part, column] = np.stack([fit.spline(seconds, d)[:, 0] for d in range(3)])
            out[3:, part, column] = np.stack([fit.sigma(d)[:, 0] for d in range(3)])
            spacing[column] = max(spacing[column], fit.spline.grid.spacing)
    return Derivatives(stamps, out[0], out[1], out[2], out[3], out[4], out[5], spacing)


def differentiate_rotations(
    stamps: ArrayLike, rotation: ArrayLike, *, knot_spacing: float | None = None, gap: float | None = None
) -> RotationDerivatives:
    """Angular velocity and acceleration of sampled attitudes, as from tf alone.

    The spline runs through the four components of the quaternion, which have no singularity, see `turning`.

    Args:
        stamps: (N,) int64 ns, not descending.
        rotation: (N, 3, 3), takes body axes to world axes; turned by less than half a turn between samples.
        knot_spacing, gap: as `differentiate`.

    Raises:
        InputError: as `differentiate`; NOT_FINITE also when a matrix is no rotation.
    """
    matrices = np.asarray(rotation, dtype=np.float64)
    stamps, _ = _check(stamps, matrices.reshape(len(matrices), -1))
    off = np.abs(np.einsum("nki,nkj->nij", matrices, matrices) - np.eye(3)).max(axis=(1, 2), initial=0.0)
    wrong = np.flatnonzero((off > 1e-2) | (np.linalg.det(matrices) < 0))
    if wrong.size:
        raise InputError(ErrorCode.NOT_FINITE, f"sample {wrong[0]} is not a rotation matrix (columns not orthonormal)")
    quaternions = continuous_quaternions(matrices)

    n = len(stamps)
    smooth, vectors, sigmas = np.full((n, 3, 3), np.nan), np.full((2, n, 3), np.nan), np.full((3, n), np.nan)
    spacing = 0.0
    for part, seconds in _stretches(stamps, gap):
        fit = _Smoother(seconds, _designs(seconds), quaternions[part], None, knot_spacing)
        s, *rates = (fit.spline(seconds, d) for d in range(3))
        smooth[part], vectors[0, part], vectors[1, part] = turning(s, *rates)
        # A rotation error of e rad moves the quaternion by e / 2, in three of its four directions.
        sigmas[:, part] = [2.0 * np.sqrt(np.sum(fit.sigma(d) ** 2, axis=1) / 3.0) for d in range(3)]
        spacing = max(spacing, fit.spline.grid.spacing)
    return RotationDerivatives(stamps, smooth, vectors[0], vectors[1], sigmas[0], sigmas[1], sigmas[2], spacing)


class _Smoother:
    """The spline with the best knots for one stretch without gaps, and its error."""

    def __init__(
        self,
        seconds: Array,
        designs: "_Designs",
        values: Array,
        rates: Array | None,
        spacing: float | None,
        score: Callable[[int], float] | None = None,
    ) -> None:
        self.seconds = seconds
        self._fit = _memo(lambda m: SplineFit(designs(m).grid, seconds, values, design=designs(m)))
        self.spline = self._fit(self._intervals(spacing, score or self._score))
        if rates is not None:
            scatter = float(np.mean((rates - self.spline(seconds, 1)) ** 2))
            weight = float(np.sum(self.spline.sigma**2)) / scatter if scatter > 0 else 0.0
            self._fit = _memo(lambda m: SplineFit(designs(m).grid, seconds, values, rates, weight, designs(m)))
            self.spline = self._fit(self._intervals(spacing, self._score))

    def sigma(self, derivative: int) -> Array:
        """(N, K) one-sigma error of the derivative, noise and lag of the spline together."""
        finer = self._fit(min(max(round(self.spline.grid.intervals * np.sqrt(2)), 2), self._most()))
        noise = self.spline.gain(self.seconds, derivative)[:, None] * self.spline.sigma
        noise_finer = finer.gain(self.seconds, derivative)[:, None] * finer.sigma
        difference = self.spline(self.seconds, derivative) - finer(self.seconds, derivative)
        # The spline spaces nearly contain one another: the difference varies by what the finer one varies more.
        inner = self._interior()
        lag = float(np.mean((difference**2 - noise_finer**2 + noise**2)[inner]))
        return np.asarray(np.sqrt(noise**2 + max(lag, 0.0)))

    def _interior(self) -> slice:
        edge = min(round(3 * len(self.seconds) / self.spline.grid.intervals), len(self.seconds) // 4)
        return slice(edge, len(self.seconds) - edge)

    def _most(self) -> int:
        """Most knot intervals that still leave a third of the samples to judge by."""
        return max(len(self.seconds) * 2 // 3 - DEGREE, 1)

    def _score(self, m: int) -> float:
        return float(self._fit(m).score().sum())

    def _intervals(self, spacing: float | None, score: Callable[[int], float]) -> int:
        most = self._most()
        duration = float(self.seconds[-1] - self.seconds[0])
        if spacing is not None:
            return min(max(round(duration / spacing), 1), most)

        coarse = [2**k for k in range(most.bit_length()) if 2**k <= most]
        best = min(coarse, key=score)
        near: list[int] = [min(max(round(best * math.pow(2.0, k / 4)), 1), most) for k in range(-3, 4)]
        return min(near, key=score)


def turning(quaternion: Array, first: Array, second: Array) -> tuple[Array, Array, Array]:
    """Rotation (N, 3, 3), angular velocity and acceleration (N, 3) in body axes of an attitude with its derivatives.

    Of a quaternion s (N, 4), x y z w, whatever its length: omega = 2 vec(s* s') / |s|^2 and
    alpha = 2 vec(s* s'') / |s|^2 - 2 (s . s') omega / |s|^2.
    """
    square = np.sum(quaternion * quaternion, axis=1, keepdims=True)
    omega = 2.0 * _vector_of_product(quaternion, first) / square
    stretch = np.sum(quaternion * first, axis=1, keepdims=True) / square
    alpha = 2.0 * _vector_of_product(quaternion, second) / square - 2.0 * stretch * omega
    return Rotation.from_quat(quaternion).as_matrix(), omega, alpha


_Designs = Callable[[int], Design]


def _designs(seconds: Array) -> _Designs:
    """Those of every number of knot intervals across these times, for all columns that were sampled then."""
    return _memo(lambda m: Design(Grid.across(seconds, m), seconds))


def _scores(seconds: Array, designs: _Designs, values: Array) -> list[Callable[[int], float]]:
    """Of each column (N, J), its score by the number of knot intervals; all are worked out when one is asked for."""
    together = _memo(lambda m: SplineFit(designs(m).grid, seconds, values, design=designs(m)).score())

    def of(column: int) -> Callable[[int], float]:
        return lambda m: float(together(m)[column])

    return [of(column) for column in range(values.shape[1])]


def _memo(make: Callable[[int], _Made]) -> Callable[[int], _Made]:
    made: dict[int, _Made] = {}

    def get(m: int) -> _Made:
        if m not in made:
            made[m] = make(m)
        return made[m]

    return get


def _check(stamps: ArrayLike, values: ArrayLike) -> tuple[NDArray[np.int64], Array]:
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
        raise InputError(ErrorCode.NOT_FINITE, f"sample {bad[0]} is not finite; leave out the {bad.size} such samples")
    return times, array


def _stretches(stamps: NDArray[np.int64], gap: float | None) -> Iterator[tuple[slice, Array]]:
    """The stretches between gaps that are long enough, with seconds from their first sample."""
    steps = np.diff(stamps) * 1e-9
    positive = steps[steps > 0]
    limit = gap if gap is not None else GAP * float(np.median(positive)) if positive.size else 0.0
    edges = [0, *(np.flatnonzero(steps > limit) + 1).tolist(), len(stamps)]
    found = False
    for begin, end in itertools.pairwise(edges):
        if end - begin >= MIN_SAMPLES and stamps[end - 1] > stamps[begin]:
            found = True
            yield slice(begin, end), (stamps[begin:end] - stamps[begin]) * 1e-9
    if not found:
        raise InputError(
            ErrorCode.TOO_FEW_SAMPLES,
            f"too few samples to differentiate: of {len(stamps)} no {MIN_SAMPLES} come without a gap of {limit:.3g} s",
        )


def _rates(rates: Array | None, part: slice, column: int) -> Array | None:
    chosen = None if rates is None else rates[part, column, None]
    return chosen if chosen is not None and np.isfinite(chosen).all() else None


def continuous_quaternions(rotation: Array) -> Array:
    """(N, 4) x y z w of rotations (N, 3, 3), with signs chosen so that neighbours are close."""
    quaternions = np.asarray(Rotation.from_matrix(rotation).as_quat())
    flips = np.sum(quaternions[1:] * quaternions[:-1], axis=1) < 0
    sign = np.cumprod(np.concatenate([[1.0], np.where(flips, -1.0, 1.0)]))
    return np.asarray(quaternions * sign[:, None])


def _vector_of_product(p: Array, q: Array) -> Array:
    """(N, 3) the vector part of p* q, quaternions as x, y, z, w."""
    return p[:, 3:] * q[:, :3] - q[:, 3:] * p[:, :3] - np.cross(p[:, :3], q[:, :3])
