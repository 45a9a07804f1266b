"""The estimator that looks for changes of the payload beside the one that answers; it is no method of the registry."""

from dataclasses import replace

from poise.inertia.bayes import LOAD_ACCURACY, ContinuousEstimator, PayloadChange, PayloadDoubt, sample_rows
from poise.inertia.estimators.accelerometer import OFFSET_SPREAD, Accelerometer
from poise.inertia.estimators.entry import EstimatorEntry
from poise.inertia.estimators.noise import NoiseMeter
from poise.inertia.estimators.streaming import Prior, SampleEvidence
from poise.inertia.model import InertialSolution, NoiseLevels, Parts
from poise.robot import SensorMotion
from poise.types import Array

_EMPTY_HAND = 0.02
"""kg; a smaller payload is none."""

WATCH_NOISE = NoiseLevels(linear_acceleration=0.02, angular_acceleration=0.05)
"""The levels that changes are judged by where none are given and too few samples show them."""


class ChangeWatch:
    """`ContinuousEstimator` as a `StreamingEstimator`.

    Args:
        prior: what is known before the first sample; samples show the noise where it is NaN.
    """

    def __init__(self, prior: Prior) -> None:
        self._given = prior
        limits = {"longest_delay": prior.longest_delay, "lag_step": prior.lag_step}
        options = prior.options | {"load_accuracy": LOAD_ACCURACY} | limits
        offset = 0.0 if prior.accelerometer is Accelerometer.NONE else OFFSET_SPREAD
        self._estimator = ContinuousEstimator(prior.parts, prior.noise.filled(WATCH_NOISE), offset, **options)
        self._meter, self._n_believed = NoiseMeter(), -1
        self._parts = prior.parts
        self._n_changes = 0

    def new_changes(self) -> list[PayloadChange]:
        """Those since the last call."""
        new = self._estimator.changes[self._n_changes :]
        self._n_changes += len(new)
        if new:
            self._parts = None
        return new

    @property
    def is_empty(self) -> bool:
        """Nothing is held, as far as is known."""
        mass = self._estimator.mass
        return mass is not None and mass < _EMPTY_HAND

    def doubts(self, bias: Array) -> tuple[PayloadDoubt, ...]:
        """What else may be held than what is estimated, with a bias (6,)."""
        return self._estimator.doubts(bias)

    def hold(self, parts: Parts) -> None:
        """Set the shape of the payload; soon after a change."""
        self._parts = parts
        self._estimator.hold(parts)

    @property
    def prior(self) -> Prior:
        """What is known before the first sample of the payload held now: the bias, and the shape where it was set."""
        known = self._estimator
        if not known.changes:
            return self._given
        force, torque = known.bias_spread
        noise = replace(self._given.noise, force_bias=force, torque_bias=torque, zeroed=known.noise.zeroed)
        return replace(self._given, parts=self._parts, noise=noise, tare=known.tare, since=known.since)

    def add(self, motion: SensorMotion, wrench: Array) -> None:
        """See `StreamingEstimator`."""
        self._meter.add(wrench)
        if self._meter.n_blocks != self._n_believed:
            self._n_believed = self._meter.n_blocks
            self._estimator.believe(self._given.noise.filled(self._meter.levels(None, WATCH_NOISE)))
        self._estimator.add_rows(motion.stamps, sample_rows(motion, wrench, self._given.gravity))

    def solve(self, evidence: SampleEvidence) -> InertialSolution:
        """See `StreamingEstimator`."""
        return self._estimator.solve()


WATCH = EstimatorEntry(
    "watch",
    "looks for changes of the payload",
    estimate=None,
    stream=ChangeWatch,
    gives_covariance=True,
    answers_hidden=True,
)
