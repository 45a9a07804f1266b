"""From sampled joint positions or rotations to velocities and accelerations with their covariance.

Quintic regression splines; cross-validation chooses the distance of their knots, joint by joint. The stated noise has
two parts: what the samples' noise makes of the spline (exact for white noise), and what the spline cannot follow
(measured against a spline with finer knots). Where a signal stands still its derivatives are zero, see `rest`.
"""

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from poise.errors import ErrorCode, InputError
from poise.geometry import are_rotations, quaternion_of_rotation, rotation_of_quaternion
from poise.robot.rest import find_rests
from poise.robot.smoother import Smoother
from poise.types import Array, Mask, Stamps

MIN_STRETCH = 12
"""A stretch between gaps that has fewer gets no derivatives: six coefficients and their noise want more."""

GAP_INTERVALS = 6.0
"""Median sample intervals that make a gap."""


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
    smoother = partial(Smoother, spacing=knot_spacing)
    return _derivatives(smoother, stamps, values, rates, gap=gap, within=within, errors=errors)


def _derivatives(
    smoother_of: Callable[..., Smoother],
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


def _answer(out: Derivatives, rows: slice, smoother: Smoother, inside: slice, errors: bool) -> None:
    """Write the derivatives of one stretch, and set those at rest to zero."""
    rests = find_rests(smoother.seconds, smoother.values, smoother.spacing)
    for column, at_rest in enumerate(rests):
        values = smoother.at(column, inside)
        covariance = smoother.covariance(column, inside) if errors else out.covariance[rows, column]
        for rest in at_rest:
            still = slice(max(rest.begin - inside.start, 0), max(rest.end - inside.start, 0))
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

    smoother = partial(Smoother, spacing=knot_spacing, together=True)
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


def turning(quaternion: Array, first: Array, second: Array) -> tuple[Array, Array, Array]:
    """Rotation (N, 3, 3), angular velocity and acceleration (N, 3) in body axes of an attitude with its derivatives.

    Of a quaternion s (N, 4), x y z w, of any length: omega = 2 vec(s* s') / |s|^2 and
    alpha = 2 vec(s* s'') / |s|^2 - 2 (s . s') omega / |s|^2.
    """
    square = np.sum(quaternion * quaternion, axis=1, keepdims=True)
    omega = 2.0 * _vector_of_product(quaternion, first) / square
    stretch = np.sum(quaternion * first, axis=1, keepdims=True) / square
    alpha = 2.0 * _vector_of_product(quaternion, second) / square - 2.0 * stretch * omega
    return rotation_of_quaternion(quaternion), omega, alpha


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
    quaternions = quaternion_of_rotation(rotation)
    flips = np.sum(quaternions[1:] * quaternions[:-1], axis=1) < 0
    sign = np.cumprod(np.concatenate([[1.0], np.where(flips, -1.0, 1.0)]))
    return np.asarray(quaternions * sign[:, None])


def _vector_of_product(p: Array, q: Array) -> Array:
    """(N, 3) the vector part of p* q, quaternions as x, y, z, w."""
    return p[:, 3:] * q[:, :3] - q[:, 3:] * p[:, :3] - np.cross(p[:, :3], q[:, :3])
