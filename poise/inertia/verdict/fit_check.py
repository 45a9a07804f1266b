"""The verdict on a fit: tests of what an estimate leaves unexplained, and the uncertainty that follows from it.

An estimator weighs under assumptions: the axes, units and signs of the wrench, a constant bias, one payload, a sensor
that touches nothing else. Where one of them is false, the noise of the samples says nothing about the error. What
remains to judge by is the slow residual: averages over a tenth of a second contain little noise, and a correct model
leaves little of them. On recordings of a real arm (KUKA with an ATI Gamma) that is 1.6 to 2.2 % of the weight.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from poise.errors import ErrorCode
from poise.inertia.model import (
    ENTRIES,
    N_MOTION,
    EstimateFinding,
    NoiseLevels,
    RejectedInterval,
)
from poise.inertia.verdict.samples import FitSamples
from poise.types import Array, Mask

_SLOW = 0.1
"""s over which the residual is averaged."""

_LEVER = 0.05
"""m: torques are compared with those of the weight, at this lever at least."""

_LEAST_BINS = 20
"""Slow averages from which on a fit is judged."""

_MATERIAL, _SLACK = 0.04, np.array([0.1, 0.005])
"""Limit of the slow residual: this share of the load, and what sensors drift and creep by, N and N m."""

_TREND, _TREND_SLACK = 0.03, np.array([0.1, 0.005])
"""Limit of a linear drift over half of the recording: share of the load, and N and N m."""

_SHIFTED = 25.0
"""Squared Mahalanobis distance by which a drift moves the answer, above which the answer depends on it."""

_POSES = 0.3
"""s between samples from which on they are single poses; their differences say nothing about the noise."""

_HOPELESS = 0.2
"""Share of the load from which on the numbers mean nothing."""

_REJECTED, _MOSTLY_REJECTED = 0.25, 0.6
"""Shares of rejected samples: a press and an arm that is shaken give 0.2."""

_AT_LIMIT = 0.95
"""Share of the longest delay."""

_PARTS = 8
"""Blocks of the recording whose scores show slow errors."""

_BEYOND_CHANCE = 8.0
"""Variance, in units of the stated one, that the scores of few blocks do not have by chance."""


@dataclass(frozen=True)
class FitTest:
    """One test of a fit.

    Args:
        name: residual, halves or drift with _force or _torque; rejected; delay.
        value, limit, hopeless: it passes up to the limit; from `hopeless` on the estimate means nothing.
        sentence: what was measured, with its numbers.
    """

    name: str
    value: float
    limit: float
    hopeless: float
    sentence: str

    @property
    def passed(self) -> bool:
        """The value keeps its limit."""
        return not self.value > self.limit


@dataclass(frozen=True, eq=False)
class FitVerdict:
    """What the tests say of a fit.

    Args:
        tests: those that the samples allowed.
        covariance: (10, 10) of phi with the errors that the blocks of the recording show, and, where a test failed,
            with what stays unexplained; None: as it was.
    """

    tests: tuple[FitTest, ...] = ()
    covariance: Array | None = None

    @property
    def failed(self) -> tuple[FitTest, ...]:
        """The tests that did not pass, the worst first."""
        return tuple(
            sorted((test for test in self.tests if not test.passed), key=lambda test: -test.value / test.limit)
        )

    @property
    def passed(self) -> bool:
        """All tests passed."""
        return not self.failed

    @property
    def is_hopeless(self) -> bool:
        """The numbers of the estimate mean nothing: withhold them."""
        return any(test.value > test.hopeless for test in self.tests)

    @property
    def finding(self) -> EstimateFinding | None:
        """POOR_FIT with the evidence, where a test failed."""
        if self.passed:
            return None
        sentences = "; ".join(test.sentence for test in self.failed)
        what = "the numbers mean nothing" if self.is_hopeless else "the uncertainty is wider by what is not explained"
        return EstimateFinding(
            ErrorCode.POOR_FIT,
            f"no single payload explains the wrench: {sentences}; {what}: check the frame, units and signs of the"
            " wrench, contact, drift and the clocks",
            {test.name: test.value for test in self.failed},
        )


@dataclass(frozen=True, eq=False)
class Fit:
    """What is judged.

    Args:
        phi, bias: (10,) and (6,); NaN where the samples do not show them.
        covariance: (10, 10) of phi.
        delay, longest_delay: s; NaN where it was not estimated.
        noise: of one sample.
        rejected: spans of samples that the estimator found inexplicable.
    """

    phi: Array
    bias: Array
    covariance: Array
    delay: float
    longest_delay: float
    noise: NoiseLevels
    rejected: Sequence[RejectedInterval] = ()


def judge(fit: Fit, samples: FitSamples) -> FitVerdict:
    """Test a fit on its samples."""
    used = _used(samples, fit.rejected)
    slow = _SlowResidual(fit, samples, used)
    if len(slow.counts) < _LEAST_BINS:
        return FitVerdict()
    share = 1.0 - float(samples.counts[used].sum() / samples.counts.sum())
    tests = [*slow.tests(), _rejected_test(share)]
    if np.isfinite(fit.delay) and fit.longest_delay > 0:
        tests.append(_delay_test(fit))
    verdict = FitVerdict(tuple(tests), _widened(fit, slow))
    if verdict.passed or verdict.covariance is None:
        return verdict
    return replace(verdict, covariance=verdict.covariance + _unexplained(fit, slow, verdict.failed))


def _unexplained(fit: Fit, slow: "_SlowResidual", failed: Sequence[FitTest]) -> Array:
    """(10, 10) covariance: the parameters may be off by the share of the load that stays unexplained."""
    scale = dict(zip(("force", "torque"), slow.scale, strict=True))
    shares = [test.value / scale[kind] for test in failed if (kind := test.name.rpartition("_")[2]) in scale]
    phi = np.nan_to_num(fit.phi)
    mass = abs(phi[0])
    reach = max(float(np.linalg.norm(phi[1:4])) / mass, _LEVER) if mass else _LEVER
    units = mass * np.array([1.0] + [reach] * 3 + [reach**2] * 6)
    inertia = float(np.abs(phi[[4, 7, 9]]).sum())
    units[4:] = np.maximum(units[4:], inertia)
    result = np.diag(np.square(max(shares, default=0.0) * units))
    result[np.isnan(fit.covariance)] = np.nan
    return result


def _used(samples: FitSamples, rejected: Sequence[RejectedInterval]) -> Mask:
    """(B,) bins that do not lie within a rejected span."""
    outside = np.ones(len(samples), dtype=bool)
    for span in rejected:
        outside &= (samples.stamps < span.start) | (samples.stamps > span.end)
    return outside


_RESIDUAL = "averages over 0.1 s differ from the payload's wrench by {:.3g} {} rms"
_HALVES = "the payloads of the two halves of the samples differ by {:.3g} {} rms"
_DRIFT = "the residual drifts by {:.3g} {} in half of the time"


@dataclass(frozen=True, eq=False)
class _Trend:
    """Drift (6,) of the bias in half of the time, N and N m, and by how much phi (10,) moves when it is allowed."""

    drift: Array
    shift: Array


class _SlowResidual:
    """Averages over a tenth of a second of signals, wrench and residual, in blocks of the recording."""

    def __init__(self, fit: Fit, samples: FitSamples, used: Mask) -> None:
        self.fit = fit
        self.unknowns = np.nan_to_num(np.concatenate([fit.phi, fit.bias]))
        signals = _delayed(samples, np.nan_to_num(fit.delay))
        rows = np.concatenate([signals, samples.wrench], axis=1)[used] * samples.counts[used, None]
        keys = np.floor(samples.seconds[used] / _SLOW)
        begins = np.flatnonzero(np.diff(keys, prepend=-1.0))
        self.seconds = samples.seconds[used][begins]
        self.counts = np.add.reduceat(samples.counts[used], begins) if len(begins) else np.zeros(0)
        self.rows = np.add.reduceat(rows, begins, axis=0) / self.counts[:, None] if len(begins) else rows
        model = _by_signal(self.unknowns)
        self.residual = self.rows[:, N_MOTION:] - self.rows[:, :N_MOTION] @ model.T
        self.load = self.rows[:, :N_MOTION] @ _by_signal(np.append(self.unknowns[:10], np.zeros(6))).T

    @property
    def scale(self) -> Array:
        """(2,) N and N m: the size of the load."""
        force, torque = _sizes(self.load)
        return np.array([force, np.hypot(torque, _LEVER * force)])

    def tests(self) -> list[FitTest]:
        """Of the residual, of its two halves against each other, and of a drift."""
        scale, noise = self.scale, self._noise
        limits, hopeless = _MATERIAL * scale + _SLACK, _HOPELESS * scale + 2 * _SLACK
        drift = _sizes(self.trend.drift[None])
        few = np.sqrt(16.0 / len(self.counts)) * noise  # noise of an answer in the prediction
        checks = (
            ("residual", _sizes(self.residual), limits + 3 * noise, hopeless + 6 * noise, _RESIDUAL),
            ("halves", self._halves(), limits + 6 * few, hopeless + 12 * few, _HALVES),
            ("drift", drift, _TREND * scale + _TREND_SLACK + 6 * few, np.full(2, np.inf), _DRIFT),
        )
        found = []
        for name, values, limit, most, words in checks:
            for which, (kind, unit) in enumerate((("force", "N"), ("torque", "N m"))):
                value, size = float(values[which]), float(scale[which])
                sentence = f"{words.format(value, unit)}, {value / max(size, 1e-9):.0%} of the load's {size:.3g} {unit}"
                found.append(FitTest(f"{name}_{kind}", value, float(limit[which]), float(most[which]), sentence))
        return found

    @cached_property
    def trend(self) -> "_Trend":
        """A bias that drifts at a constant rate, fitted together with all unknowns."""
        columns, residual = self._weighted
        weight = np.diag(1.0 / np.repeat(self.noise_levels, 3))
        time = np.linspace(-1.0, 1.0, len(columns))[:, None, None] * weight
        left, right = np.concatenate([columns, time], axis=2).reshape(-1, 22), residual.reshape(-1)
        known = np.zeros((22, 22))  # what the samples do not show stays as it is
        known[:10, :10] = np.linalg.pinv(np.nan_to_num(self.fit.covariance, nan=1e-9)) * 1e-2
        constant, drifting = (
            np.linalg.lstsq(
                (system := left[:, :count]).T @ system + known[:count, :count], system.T @ right, rcond=1e-14
            )[0]
            for count in (16, 22)
        )
        return _Trend(np.asarray(drifting[16:]), np.asarray(drifting[:10] - constant[:10]))

    @property
    def noise_levels(self) -> Array:
        """(2,) standard deviation of one axis of the averages, not less than that of a sample's white noise."""
        least = np.array([self.fit.noise.force, self.fit.noise.torque]) / np.sqrt(self.counts.max())
        return np.asarray(np.maximum(_sizes(self.residual) / np.sqrt(3.0), least))

    @property
    def _noise(self) -> Array:
        """(2,) rms of the averages that white noise of the sensor makes."""
        if np.median(np.diff(self.seconds)) > _POSES:
            return np.zeros(2)
        per_sample = np.array([self.fit.noise.force, self.fit.noise.torque]) * np.sqrt(3.0)
        return np.asarray(per_sample * np.sqrt(np.mean(1.0 / self.counts)))

    def _halves(self) -> Array:
        """(2,) by how much the loads that the halves of the samples show differ, rms over all samples."""
        information, scores = self.blocks(2)
        # Directions that a half does not show stay as in the fit of all samples.
        ridge = 1e-3 * np.diag(np.diag(information.sum(axis=0)))
        steps = [
            np.linalg.lstsq(block + ridge, score, rcond=1e-12)[0]
            for block, score in zip(information, scores, strict=True)
        ]
        return _sizes(self.rows[:, :N_MOTION] @ _by_signal(steps[1] - steps[0]).T)

    def blocks(self, number: int) -> tuple[Array, Array]:
        """(K, 16, 16) information and (K, 16) score, the gradient at the fit, of blocks of the recording in time."""
        columns, residual = self._weighted
        parts = [
            (left.reshape(-1, 16), right.reshape(-1))
            for left, right in zip(np.array_split(columns, number), np.array_split(residual, number), strict=True)
        ]
        return np.array([left.T @ left for left, _ in parts]), np.array([left.T @ right for left, right in parts])

    @cached_property
    def _weighted(self) -> tuple[Array, Array]:
        """(B, 6, 16) columns of the unknowns and (B, 6) residuals, in units of the noise levels."""
        weight = 1.0 / np.repeat(self.noise_levels, 3)
        columns = np.einsum("bc,ipc->bip", self.rows[:, :N_MOTION], ENTRIES)
        return columns * weight[:, None], self.residual * weight


def _widened(fit: Fit, slow: _SlowResidual) -> Array | None:
    """(10, 10) covariance of phi, not less than the scatter of the scores of the blocks shows (sandwich estimator).

    Errors that last (drift, a payload that changes, contact) do not average out as noise does. They show in how the
    blocks of a recording pull the answer to different sides (White 1980; Zeileis 2004).
    """
    seen = np.isfinite(np.diag(fit.covariance))
    bias = np.isfinite(fit.bias)
    if not seen.any():
        return None
    information, scores = slow.blocks(_PARTS)
    rest = np.flatnonzero(np.append(np.zeros(10, dtype=bool), bias))
    total = information.sum(axis=0)
    on_bias = np.linalg.lstsq(total[np.ix_(rest, rest)], total[rest][:, :10], rcond=1e-12)[0]
    pulls = (scores[:, :10] - scores[:, rest] @ on_bias)[:, seen]
    shown = (total[:10, :10] - total[:10, rest] @ on_bias)[np.ix_(seen, seen)]
    pulls -= pulls.mean(axis=0)
    root = np.linalg.cholesky(_regular(fit.covariance[np.ix_(seen, seen)]))
    values, axes = np.linalg.eigh(root.T @ shown @ root)
    # In units of the stated covariance: how far each block alone pulls the answer.
    steps = (pulls @ root @ axes) / np.maximum(values, 1.0)
    scatter = axes @ (steps.T @ steps) @ axes.T * _PARTS / (_PARTS - 1)
    variances, directions = np.linalg.eigh(scatter)
    factors = np.where(variances > _BEYOND_CHANCE, variances, 1.0)
    inside = root @ directions
    shift = slow.trend.shift[seen]
    depends = np.sum(np.linalg.solve(root, shift) ** 2) > _SHIFTED
    result = fit.covariance.copy()
    result[np.ix_(seen, seen)] = (inside * factors) @ inside.T + depends * np.outer(shift, shift)
    return result


def _regular(covariance: Array) -> Array:
    """The same covariance, positive definite beyond rounding."""
    scale = np.sqrt(np.diag(covariance).clip(min=1e-30))
    return np.asarray(covariance + np.diag(1e-10 * scale**2))


def _by_signal(unknowns: Array) -> Array:
    """(6, 13) the wrench that each signal makes."""
    return np.asarray(np.einsum("p,ipc->ic", unknowns, ENTRIES))


def _sizes(wrench: Array) -> Array:
    """(2,) root mean square of the length of force and of torque."""
    squares = np.mean(np.square(wrench), axis=0)
    return np.sqrt([squares[:3].sum(), squares[3:].sum()])


def _delayed(samples: FitSamples, delay: float) -> Array:
    """(B, 13) signals at the time at which the wrenches were measured."""
    if not delay:
        return samples.signals
    then = samples.seconds - delay
    return np.column_stack([np.interp(then, samples.seconds, column) for column in samples.signals.T])


def _rejected_test(share: float) -> FitTest:
    sentence = f"{share:.0%} of the samples were rejected because no payload explains them"
    return FitTest("rejected", share, _REJECTED, _MOSTLY_REJECTED, sentence)


def _delay_test(fit: Fit) -> FitTest:
    value, limit = abs(fit.delay), _AT_LIMIT * fit.longest_delay
    sentence = f"the delay of the wrench, {1e3 * fit.delay:.0f} ms, is at the limit of its search"
    return FitTest("delay", value, limit, np.inf, sentence)
