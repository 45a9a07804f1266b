"""What an estimator answers: parameters, bias, covariance, rejected samples and findings."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from poise.errors import ErrorCode
from poise.types import Array


@dataclass(frozen=True)
class EstimateFinding:
    """Something to know about an estimate.

    Args:
        code: what kind.
        message: one sentence: what is wrong, and how to fix it.
        evidence: the numbers behind it by name, SI units.
    """

    code: ErrorCode
    message: str
    evidence: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class RejectedInterval:
    """A span of wrench samples that was not used.

    Args:
        start, end: stamps of its first and last sample, int ns.
        n_samples: how many.
        reason: not_finite, saturated, out_of_order, stale, no_kinematics, moving or external_contact, as in
            poise_msgs/RejectedInterval; of a recording also payload_change.
    """

    start: int
    end: int
    n_samples: int
    reason: str


@dataclass(frozen=True, eq=False)
class InertialSolution:
    """What least squares makes of the samples; NaN marks what they do not show.

    Args:
        phi: (10,) m, m c, I about the sensor origin; kg, kg m, kg m2.
        covariance: (10, 10) of phi.
        bias: (6,) what the sensor reads with nothing on it, N and N m.
        bias_covariance: (6, 6).
        unidentified: names of the parameters that cannot be seen.
        condition_number: of the weighted normal matrix with columns scaled to one; inf with anything unidentified.
        residual_force: root mean square per axis, N.
        residual_torque: root mean square per axis, N m.
        n_samples: samples used.
        n_effective: how many independent ones they are worth.
        delay, delay_std: wrench stamps minus kinematics stamps, s; NaN when it was not estimated.
        rejected: samples that the method itself did not use, in the order of time.
        findings: what else to know.
    """

    phi: Array
    covariance: Array
    bias: Array
    bias_covariance: Array
    unidentified: tuple[str, ...]
    condition_number: float
    residual_force: float
    residual_torque: float
    n_samples: int
    n_effective: float
    delay: float = np.nan
    delay_std: float = np.nan
    rejected: tuple[RejectedInterval, ...] = ()
    findings: tuple[EstimateFinding, ...] = ()

    @property
    def com_in_hull(self) -> bool | None:
        """The centre of mass lies in the convex hull of the object; None when its outline is not known."""
        return None


def root_mean_square(squares: float, n_samples: int) -> float:
    """Per-channel root mean square of three channels, from the sum of their squares."""
    return math.sqrt(squares / (3 * n_samples)) if n_samples else math.nan
