"""The streaming form of batch estimators: a bounded buffer of samples, thinned out evenly when it is full."""

import numpy as np

from poise.errors import ErrorCode, NoAnswerError
from poise.inertia.estimators.answer import Method
from poise.inertia.estimators.streaming import Prior, SampleEvidence, joined
from poise.inertia.model import IdentificationProblem, InertialSolution
from poise.robot import SensorMotion
from poise.types import Array, Mask

_CAPACITY = 20_000
"""Samples; of more, every second one is kept, then every fourth and so on."""


class SampleWindow:
    """Samples of a prior's window, handed to a batch estimator.

    Args:
        estimate: the batch estimator.
        prior: what is known before.
    """

    def __init__(self, estimate: Method, prior: Prior) -> None:
        self._estimate, self._prior = estimate, prior
        self._stride, self._n_seen = 1, 0
        self._motion: SensorMotion | None = None
        self._wrench = np.zeros((0, 6))
        self._numbers = np.zeros(0, dtype=np.int64)

    def add(self, motion: SensorMotion, wrench: Array) -> None:
        """See `StreamingEstimator`."""
        numbers = self._n_seen + np.arange(len(wrench))
        self._n_seen += len(wrench)
        kept = numbers % self._stride == 0
        if not kept.any():
            return
        motion = motion.select(kept)
        self._motion = motion if self._motion is None else joined([self._motion, motion])
        self._wrench = np.concatenate([self._wrench, wrench[kept]])
        self._numbers = np.concatenate([self._numbers, numbers[kept]])
        if np.isfinite(self._prior.window):
            self._keep(self._motion.stamps >= self._motion.stamps[-1] - round(self._prior.window * 1e9))
        while len(self._wrench) > _CAPACITY:
            self._stride *= 2
            self._keep(self._numbers % self._stride == 0)

    def solve(self, evidence: SampleEvidence) -> InertialSolution:
        """See `StreamingEstimator`."""
        if self._motion is None:
            raise NoAnswerError(ErrorCode.TOO_FEW_SAMPLES, "no wrench sample can be used yet", n_samples=0)
        parts, known = self._prior.parts, {}
        if parts is not None:
            known = {"unit_parts": parts.unit_phi, "part_volumes": parts.volumes, "shape_points": parts.inside}
        return self._estimate(
            IdentificationProblem.from_motion(
                self._motion, self._wrench, self._prior.gravity, noise=evidence.noise, **known
            )
        )

    def _keep(self, which: Mask) -> None:
        if self._motion is not None:
            self._motion = self._motion.select(which)
        self._wrench, self._numbers = self._wrench[which], self._numbers[which]
