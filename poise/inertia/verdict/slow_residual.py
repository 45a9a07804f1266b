"""The slow residual of a fit: averages over a tenth of a second, which hold little noise."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from poise.inertia.model import ENTRIES, NoiseLevels, RejectedInterval, signal_columns
from poise.inertia.verdict.samples import FitSamples
from poise.types import Array, Mask

LEVER = 0.05
"""m: torques are compared with those of the weight, at this lever at least."""

PARTS = 8
"""Blocks of the recording whose scores show slow errors."""

_SLOW = 0.1
"""s over which the residual is averaged."""

_SPREAD = 10.0
"""m/s2: what an error of gravity may be."""

_NOTABLE_DELAY, _LEAST_STEP = 0.005, 0.02
"""s: a shorter delay attenuates nothing; for the second derivative of the motion."""

_AS_FILTER = 0.5
"""Prior deviation of the share of a delay that is that of a filter."""

_POSES = 0.3
"""s between samples from which on they are single poses; their differences say nothing about the noise."""


@dataclass(frozen=True, eq=False)
class Fit:
    """What is judged.

    Args:
        phi, bias: (10,) and (6,); NaN where the samples do not show them.
        covariance: (10, 10) of phi.
        delay, longest_delay: s; NaN where it was not estimated.
        noise: of one sample.
        rejected: spans of samples that the estimator found inexplicable.
        only_contact: the rejected samples are contact, and no other payload explains a similar part of them.
    """

    phi: Array
    bias: Array
    covariance: Array
    delay: float
    longest_delay: float
    noise: NoiseLevels
    rejected: Sequence[RejectedInterval] = ()
    only_contact: bool = False


@dataclass(frozen=True, eq=False)
class Extension:
    """What the samples say of further linear parameters, fitted together with all unknowns.

    Args:
        values, deviations: (k,) with standard deviations that hold for errors that last, too.
        shift: (10,) by how much phi moves when they are allowed.
    """

    values: Array
    deviations: Array
    shift: Array


class SlowResidual:
    """Averages over a tenth of a second of signals, wrench and residual.

    Args:
        fit: what is judged.
        samples: of the fit.
        used: (B,) bins that were not rejected.
    """

    # design: (B, 6, 16) of phi and bias. load: (B, 6) of the payload. residual: (B, 6), N and N m.

    def __init__(self, fit: Fit, samples: FitSamples, used: Mask) -> None:
        self.fit = fit
        self._given, self._used = samples, used
        self.samples = self._slow(fit.delay)
        self.design = signal_columns(self.samples.signals)
        self.unknowns = self._completed(np.concatenate([fit.phi, fit.bias]))
        self.load = self.design[:, :, :10] @ self.unknowns[:10]
        self.residual = self.samples.wrench - self.design @ self.unknowns

    def _completed(self, unknowns: Array) -> Array:
        """(16,) with the best of what the samples do not show one by one: their sum may be shown."""
        open_ones = np.isnan(unknowns)
        result = np.where(open_ones, 0.0, unknowns)
        if open_ones.any():
            columns = self.design[:, :, open_ones].reshape(-1, int(open_ones.sum()))
            left = self.samples.wrench - self.design @ result
            result[open_ones] = np.linalg.lstsq(columns, left.ravel(), rcond=1e-9)[0]
        return np.asarray(result)

    def _slow(self, delay: float) -> FitSamples:
        """The averages, with the motion some time (s) before the wrench."""
        bins = np.floor(self._given.seconds[self._used] / _SLOW)
        return self._given.delayed(delay).select(self._used).averaged(bins)

    @cached_property
    def scale(self) -> Array:
        """(2,) N and N m: the size of the load."""
        force, torque = sizes(self.load)
        return np.array([force, np.hypot(torque, LEVER * force)])

    @property
    def white(self) -> Array:
        """(2,) rms of the averages that white noise of the sensor makes; 0 for single poses."""
        if np.median(np.diff(self.samples.seconds)) > _POSES:
            return np.zeros(2)
        per_sample = np.array([self.fit.noise.force, self.fit.noise.torque]) * np.sqrt(3.0)
        return np.asarray(per_sample * np.sqrt(np.mean(1.0 / self.samples.counts)))

    @property
    def white_levels(self) -> Array:
        """(6,) standard deviation of the averages that a sample's white noise makes, at least."""
        per_sample = np.repeat([self.fit.noise.force, self.fit.noise.torque], 3)
        return np.asarray(per_sample / np.sqrt(self.samples.counts.max()))

    @cached_property
    def _levels(self) -> Array:
        """(6,) standard deviation of the averages."""
        return np.asarray(np.maximum(np.repeat(sizes(self.residual) / np.sqrt(3.0), 3), self.white_levels))

    @property
    def known(self) -> Array:
        """(10, 10) information that the estimate has about phi."""
        return np.asarray(np.linalg.pinv(np.nan_to_num(self.fit.covariance, nan=1e-9)))

    @cached_property
    def _columns(self) -> Array:
        """(B, 6, 16) of the unknowns, in units of the levels."""
        return self.design / self._levels[:, None]

    def halves(self) -> Array:
        """(2,) by how much the loads that the halves of the samples show differ, rms over all samples."""
        information, scores = self.blocks(2)
        # Directions that a half does not show stay as in the fit of all samples.
        ridge = 1e-3 * np.diag(np.diag(information.sum(axis=0)))
        steps = [
            np.linalg.lstsq(block + ridge, score, rcond=1e-12)[0]
            for block, score in zip(information, scores, strict=True)
        ]
        return sizes(self.design @ (steps[1] - steps[0]))

    def blocks(self, number: int) -> tuple[Array, Array]:
        """(K, 16, 16) information and (K, 16) score, the gradient at the fit, of blocks of the recording in time."""
        return _normal(self._columns, self.residual / self._levels, number)

    def extended(self, columns: Array, spread: Array) -> Extension:
        """Fit further parameters with responses (B, 6, k), N and N m for one unit, and spreads (k,) of a prior."""
        count = 16 + columns.shape[2]
        left = np.concatenate([self._columns, columns / self._levels[:, None]], axis=2)
        information, scores = _normal(left, self.residual / self._levels, PARTS)
        total = information.sum(axis=0)
        total[:10, :10] += self._stays
        total[range(16, count), range(16, count)] += spread**-2.0
        inverse = np.linalg.pinv(total, rcond=1e-14, hermitian=True)
        both = inverse @ scores.sum(axis=0)
        left_over = scores - information @ both
        scatter = inverse @ left_over.T
        variances = np.maximum(np.diag(inverse), np.sum(scatter**2, axis=1) * PARTS / (PARTS - 1))
        return Extension(both[16:], np.sqrt(variances[16:].clip(min=0.0)), both[:10] - self._step)

    @cached_property
    def _stays(self) -> Array:
        """(10, 10) information that keeps what the samples do not show of the payload."""
        return self.known * 1e-6

    @cached_property
    def _step(self) -> Array:
        """(10,) from phi to the least squares of the averages without further parameters."""
        information, scores = self.blocks(PARTS)
        total = information.sum(axis=0)
        total[:10, :10] += self._stays
        return np.asarray((np.linalg.pinv(total, rcond=1e-14, hermitian=True) @ scores.sum(axis=0))[:10])

    @cached_property
    def drift(self) -> Extension:
        """A bias that drifts at a constant rate: (6,) N and N m in half of the time."""
        time = np.linspace(-1.0, 1.0, len(self.samples))[:, None, None]
        return self.extended(time * np.eye(6), np.repeat(np.maximum(self.scale, 1e-3), 3))

    @cached_property
    def tilt(self) -> Extension:
        """(2,) m/s2 in the world: gravity sideways, as the weight shows it."""
        return self.extended(self._by_gravity[:, :, :2], np.full(2, _SPREAD))

    @cached_property
    def weight(self) -> Extension:
        """(1,) m/s2 upwards in the world, as the weight shows it beside inertial forces."""
        return self.extended(self._by_gravity[:, :, 2:], np.full(1, _SPREAD))

    @cached_property
    def filtered(self) -> Extension | None:
        """(1,) 1 where the delay is that of a filter of first order, 0 where a clock is late; None without a delay.

        Beside the delay d, such a filter adds d^2 / 2 times the second derivative of the wrench: it attenuates.
        """
        delay = abs(self.fit.delay)
        if not delay > _NOTABLE_DELAY:
            return None
        step = max(delay, _LEAST_STEP)
        early, late = (self._slow(self.fit.delay + way * step).signals for way in (1.0, -1.0))
        bend = (early - 2 * self.samples.signals + late) * (delay / step) ** 2 / 2
        return self.extended((signal_columns(bend)[:, :, :10] @ self.unknowns[:10])[:, :, None], np.full(1, _AS_FILTER))

    @cached_property
    def lever(self) -> Extension:
        """(3,) kg m: the first moment that the force shows, less that which the torque shows."""
        columns = self.design[:, :, 1:4].copy()
        columns[:, 3:] = 0.0
        return self.extended(columns, np.full(3, max(abs(float(self.unknowns[0])), 1e-3)))

    @property
    def _by_gravity(self) -> Array:
        """(B, 6, 3) the load's wrench for one m/s2 along each axis of the world."""
        return np.asarray((self.unknowns @ ENTRIES)[:, :3] @ self.samples.rotation_world_sensor.swapaxes(1, 2))


def sizes(wrench: Array) -> Array:
    """(2,) root mean square of the length of force and of torque."""
    squares = np.mean(np.square(wrench), axis=0)
    return np.sqrt([squares[:3].sum(), squares[3:].sum()])


def _normal(columns: Array, right: Array, number: int) -> tuple[Array, Array]:
    """(K, P, P) and (K, P) sums over blocks of columns (B, 6, P) and right sides (B, 6)."""
    size = columns.shape[2]
    parts = [
        (left.reshape(-1, size), measured.reshape(-1))
        for left, measured in zip(np.array_split(columns, number), np.array_split(right, number), strict=True)
    ]
    return np.array([left.T @ left for left, _ in parts]), np.array([left.T @ values for left, values in parts])
