"""Poise's own estimator on a stream: the clocks are compared first, and a shape that does not fit is dropped."""

from dataclasses import replace

import numpy as np

from poise.errors import ErrorCode
from poise.inertia.bayes import (
    PRIOR_SPREAD,
    ClockComparison,
    Delay,
    PoiseEstimator,
    poise,
    sample_rows,
)
from poise.inertia.estimators.entry import EstimatorEntry
from poise.inertia.estimators.noise import LEAST_NOISE
from poise.inertia.estimators.streaming import Prior, SampleEvidence
from poise.inertia.model import EstimateFinding, InertialSolution, NoiseLevels
from poise.robot import SensorMotion
from poise.types import Array, Stamps

_CAPACITY = 65_536
"""Samples that are kept to compare the clocks. With more of them, the delay stays what these showed."""

_CHECKPOINTS = 1.05
"""The clocks are compared each time the samples have become more by this factor, at fixed numbers of samples."""
_SHARP = 0.0015
"""s: a delay that the samples alone show this well needs no prior, and no shape."""
_GAIN = 0.004
"""Relative error of accelerations: splines through positions make those of fast motions too small, by 0.2 to 0.7 %."""
_NEAR_STEP = 0.004
"""s between lags about a delay that few samples show as sharply: over tenths of a second, its likelihood is no
polynomial."""
_NEAR_QUANTUM = 2_000_000
"""ns to which the middle of those lags is rounded."""
_QUANTUM = 100_000
"""ns to which a sharp delay is rounded, so that samples are not summed again for nothing."""
_LEARNT = 0.8
"""Share of the prior's spread: a delay that is not known better has not been estimated."""
_MISFIT, _ENOUGH = 1.15, 50
"""Residual in units of what least squares leave, from this many samples on, at which a shape is dropped."""

_SHAPE_DROPPED = EstimateFinding(
    ErrorCode.SHAPE_MISMATCH,
    "the wrench does not fit the shape that was given, in any place near it, so the answer does without the shape;"
    " check that it is the right object, its unit (metres), frame and pose",
)


class PoiseStream:
    """`PoiseEstimator` on samples with one known delay where they show it, else on samples at several lags.

    Args:
        prior: what is known before.
    """

    def __init__(self, prior: Prior) -> None:
        self._prior = prior
        self._samples = _SampleStore()
        self._clocks = ClockComparison()
        self._compared, self._delay = 0, _NOT_COMPARED
        self._at_lags = _FedEstimator(self._estimator(prior.longest_delay, 0.0))
        self._aligned: tuple[int, _FedEstimator] | None = None
        self._near: tuple[int, _FedEstimator] | None = None

    def add(self, motion: SensorMotion, wrench: Array) -> None:
        """See `StreamingEstimator`."""
        stamps, rows = motion.stamps, sample_rows(motion, wrench - self._prior.tare, self._prior.gravity)
        room = _CAPACITY - self._samples.count
        if not self._samples.is_full:
            self._samples.add(stamps[:room], rows[:room])
            if len(stamps) < room:
                return
            self._current().feed(self._samples)
            self._samples.close()
        self._current().estimator.add_rows(stamps[room:], rows[room:])

    def solve(self, evidence: SampleEvidence) -> InertialSolution:
        """See `StreamingEstimator`."""
        current = self._current()
        if not self._samples.is_full:
            current.feed(self._samples)
        solution: InertialSolution = current.estimator.solve(evidence.noise)
        if current is self._at_lags and solution.delay_std < _SHARP and not self._samples.is_full:
            current = self._near_delay(solution.delay)
            solution = current.estimator.solve(evidence.noise)
        if self._prior.parts is not None and _fits_worse(solution, evidence.least_squares):
            solution = current.estimator.solve(evidence.noise, use_shape=False)
            solution = replace(solution, findings=(*solution.findings, _SHAPE_DROPPED))
        if self._aligned is not None and current is self._aligned[1]:
            solution = replace(solution, delay=self._delay.mean, delay_std=self._delay.std)
        spread = min(PRIOR_SPREAD, self._prior.longest_delay / np.sqrt(3))
        if not solution.delay_std < _LEARNT * spread:
            solution = replace(solution, delay=np.nan, delay_std=np.nan)
        covariance = solution.covariance.copy()
        covariance[4:, 4:] += _by_gain(solution.phi[4:])
        return replace(solution, covariance=covariance, bias=solution.bias + self._prior.tare)

    def _current(self) -> "_FedEstimator":
        """The estimator that the comparison of the clocks asks for."""
        self._compare_clocks()
        if not self._delay.std < _SHARP:
            return self._at_lags
        shift = round(self._delay.mean * 1e9 / _QUANTUM) * _QUANTUM
        if self._aligned is None or self._aligned[0] != shift:
            self._aligned = shift, _FedEstimator(self._estimator(0.0, shift * 1e-9))
        return self._aligned[1]

    def _near_delay(self, delay: float) -> "_FedEstimator":
        """The estimator at lags close to a delay, with all samples."""
        about = round(delay * 1e9 / _NEAR_QUANTUM) * _NEAR_QUANTUM
        if self._near is None or self._near[0] != about:
            step = min(_NEAR_STEP, self._prior.lag_step)
            estimator = self._estimator(2 * step, about * 1e-9, step)
            self._near = about, _FedEstimator(estimator)
        self._near[1].feed(self._samples)
        return self._near[1]

    def _compare_clocks(self) -> None:
        """Compare them at the last checkpoint, so that it does not matter how often solutions are asked for."""
        if self._samples.is_full and self._compared == _CAPACITY:
            return
        checkpoint = _last_checkpoint(self._samples.count)
        if checkpoint > self._compared:
            self._compared = checkpoint
            found = self._clocks.delay(self._samples.stamps[:checkpoint], self._samples.rows[:checkpoint])
            self._delay = _NOT_COMPARED if found is None else found

    def _estimator(self, longest_delay: float, delay: float, lag_step: float | None = None) -> PoiseEstimator:
        known = self._prior
        return PoiseEstimator(
            known.parts,
            known.noise.filled(NoiseLevels()),
            longest_delay=longest_delay,
            lag_step=lag_step or known.lag_step,
            delay=delay,
            **known.options,
        )


_NOT_COMPARED = Delay(0.0, np.inf)


class _SampleStore:
    """Up to `_CAPACITY` samples."""

    def __init__(self) -> None:
        self.count = 0
        self.is_full = False
        self._stamps: Stamps = np.zeros(1024, dtype=np.int64)
        self._rows = np.zeros((1024, 15))

    @property
    def stamps(self) -> Stamps:
        """(N,) ns."""
        return self._stamps[: self.count]

    @property
    def rows(self) -> Array:
        """(N, 15), see `sample_rows`."""
        return self._rows[: self.count]

    def add(self, stamps: Stamps, rows: Array) -> None:
        """Take more."""
        end = self.count + len(stamps)
        if end > len(self._stamps):
            spare = max(end, 2 * self.count) - self.count
            self._stamps = np.concatenate([self.stamps, np.zeros(spare, dtype=np.int64)])
            self._rows = np.concatenate([self.rows, np.zeros((spare, 15))])
        self._stamps[self.count : end], self._rows[self.count : end] = stamps, rows
        self.count = end

    def close(self) -> None:
        """Drop all samples: no more are kept."""
        self.is_full = True
        self._stamps, self._rows = self._stamps[:0], self._rows[:0]


class _FedEstimator:
    """An estimator, and how many of the stored samples it has been given."""

    def __init__(self, estimator: PoiseEstimator) -> None:
        self.estimator = estimator
        self._n_fed = 0

    def feed(self, samples: _SampleStore) -> None:
        """Hand over the samples that it does not have."""
        self.estimator.add_rows(samples.stamps[self._n_fed :], samples.rows[self._n_fed :])
        self._n_fed = samples.count


def _by_gain(inertia: Array) -> Array:
    """(6, 6) covariance of an inertia (6,) about the sensor, by a gain of angular accelerations that is not quite 1."""
    moments = inertia[[0, 3, 5]]
    scale = np.outer(moments, moments)[np.triu_indices(3)]
    return np.asarray(_GAIN**2 / 2 * (np.outer(inertia, inertia) + np.diag(scale)))


def _last_checkpoint(count: int) -> int:
    """The largest checkpoint that is no more than a number of samples."""
    if count >= _CAPACITY:
        return _CAPACITY
    if count < 1:
        return 0
    exponent = int(np.floor(np.log(count) / np.log(_CHECKPOINTS) + 1e-9))
    return min(int(np.ceil(_CHECKPOINTS**exponent - 1e-6)), count)


def _fits_worse(solution: InertialSolution, plain: InertialSolution | None) -> bool:
    """A shape costs far more of the fit than chance."""
    if plain is None or solution.n_samples < _ENOUGH:
        return False
    force = solution.residual_force / max(plain.residual_force, LEAST_NOISE.force)
    torque = solution.residual_torque / max(plain.residual_torque, LEAST_NOISE.torque)
    return max(force, torque) > _MISFIT


ENTRY = EstimatorEntry(
    "poise",
    "Bayesian model averaging over shape, density, bias and clock delay, with a calibrated covariance",
    estimate=poise,
    stream=PoiseStream,
    gives_covariance=True,
    answers_hidden=True,
)
