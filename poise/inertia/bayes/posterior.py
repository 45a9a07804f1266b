"""What is known after the samples, over all hypotheses, and how hard to try for it."""

from dataclasses import dataclass, replace

import numpy as np

from poise.inertia.bayes.small_systems import normalised
from poise.types import Array, Indices


@dataclass(frozen=True, eq=False)
class Posterior:
    """What is known after the samples.

    Args:
        unknowns: (16,) mean of phi and bias.
        covariance: (16, 16).
        states: (H, n) of the `MassModel`, of the hypotheses that are left.
        left: (H,) which ones these are.
        bias_cases: (H,) and their case of the bias.
        log_weights: (H,) log of their probabilities, up to a constant.
    """

    unknowns: Array
    covariance: Array
    states: Array
    left: Indices
    bias_cases: Indices
    log_weights: Array

    @property
    def phi(self) -> Array:
        """(10,)."""
        return self.unknowns[:10]

    def moved(self, step: Array) -> "Posterior":
        """The same answer elsewhere, by (16,), with the mean square error that it has there."""
        return replace(self, unknowns=self.unknowns + step, covariance=self.covariance + np.outer(step, step))

    @property
    def weights(self) -> Array:
        """(H,) probabilities."""
        return normalised(self.log_weights)


@dataclass(frozen=True)
class SolverEffort:
    """How hard to try.

    Args:
        tolerance: gain of log posterior in a step with which a hypothesis counts as settled.
        max_iterations: a cap.
        negligible: hypotheses less probable than this are dropped.
    """

    tolerance: float
    max_iterations: int
    negligible: float
