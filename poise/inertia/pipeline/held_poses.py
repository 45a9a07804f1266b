"""Payloads from poses held still: errors of the sensor that last as long as a pose, and how many poses there are."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from poise.errors import ErrorCode
from poise.geometry import STANDARD_GRAVITY
from poise.inertia.bayes import LOAD_ACCURACY
from poise.inertia.estimators import NULL_EIGENVALUE
from poise.inertia.model import EstimateFinding, InertialSolution, signal_columns
from poise.inertia.verdict import FitSamples
from poise.types import Array

LEAST_POSES = 4
"""Mass, centre of mass and bias are ten unknowns, and a pose shows six numbers: fewer poses leave little to test."""

_TURNED = 0.035
"""Change of the direction of gravity, about rad, between two poses."""

_TAKEN = 5.0
"""Degrees of freedom that the answer takes from force and from torque: half of its ten unknowns."""

_ENOUGH = 12.0
"""Numbers that show the lasting errors; where poses give fewer, the usual accuracy of a load stands for the rest."""

_ARM = 0.05
"""m: lever of the weight at which the torque errs, at least."""


@dataclass(frozen=True, eq=False)
class HeldPoses:
    """Means over K poses.

    Args:
        samples: at rest, in the order of time.
        counts: (K,) samples in each. columns: (K, 6, 16) of the unknowns. wrench: (K, 6) N and N m.
    """

    samples: FitSamples
    counts: Array
    columns: Array
    wrench: Array

    def __len__(self) -> int:
        return len(self.counts)

    @classmethod
    def of(cls, samples: FitSamples) -> "HeldPoses":
        """Group samples at rest by the attitude in which they were taken."""
        down = samples.gravity_in_sensor / max(float(np.linalg.norm(samples.gravity)), 1e-9)
        begins, first = np.zeros(len(down)), 0
        while len(turned := np.flatnonzero(np.linalg.norm(down[first:] - down[first : first + 1], axis=1) > _TURNED)):
            first += int(turned[0])
            begins[first] = 1.0
        means = samples.averaged(np.cumsum(begins))
        return cls(samples, means.counts, signal_columns(means.signals), means.wrench)

    def widened(self, solution: InertialSolution) -> InertialSolution:
        """The solution with errors that stay the same while a pose is held, and do not average out.

        Their variance is what the poses leave unexplained, together with what sensors usually err by.
        """
        noise = np.maximum([solution.residual_force, solution.residual_torque], 1e-9)
        weight = np.repeat(noise**-2.0, 3)
        weighed = self.counts[:, None, None] * self.columns * weight[:, None]
        each = signal_columns(self.samples.signals)
        normal = np.einsum("b,bci,c,bcj->ij", self.samples.counts, each, weight, each, optimize=True)
        scale = np.sqrt(np.diag(normal))
        scale[scale == 0] = 1.0
        inverse = np.linalg.pinv(normal / np.outer(scale, scale), rcond=NULL_EIGENVALUE, hermitian=True)
        inverse = inverse / np.outer(scale, scale)
        unknowns = inverse @ np.einsum("kci,kc->i", weighed, self.wrench)
        residual = self.wrench - self.columns @ unknowns
        variance = self._variance(unknowns, residual)
        freedom = 1.0 - _TAKEN / (3.0 * solution.n_samples)
        known = noise**2 / freedom * solution.n_samples / solution.n_effective / self.counts[:, None]
        lasting = np.repeat((variance - known).clip(min=0.0), 3, axis=1)
        gain = np.einsum("ij,kcj->kci", inverse, weighed)
        wider = np.einsum("kci,kc,kcj->ij", gain, lasting, gain)
        return replace(
            solution,
            covariance=solution.covariance + wider[:10, :10],
            bias_covariance=solution.bias_covariance + wider[10:, 10:],
        )

    def _variance(self, unknowns: Array, residual: Array) -> Array:
        """(2,) of the mean wrench of a pose, of force and of torque; residual: (K, 6)."""
        load = STANDARD_GRAVITY * np.array([abs(unknowns[0]), np.linalg.norm(unknowns[1:4]) + _ARM * abs(unknowns[0])])
        shown = max(3.0 * len(self) - _TAKEN, 0.0)
        assumed = max(_ENOUGH - shown, 0.0)
        squares = np.square(residual).reshape(-1, 2, 3).sum(axis=(0, 2))
        return np.asarray((assumed * (LOAD_ACCURACY * load) ** 2 + squares) / (assumed + shown))

    def finding(self, left_out: Mapping[str, int]) -> EstimateFinding | None:
        """Too few poses; left_out: samples by the reason why."""
        if len(self) >= LEAST_POSES:
            return None
        moving = left_out.get("moving", 0)
        share = moving / max(moving + float(self.counts.sum()), 1.0)
        return EstimateFinding(
            ErrorCode.TOO_FEW_SAMPLES,
            f"the method static weighs poses held still: {share:.0%} of the samples are in motion, left out; the"
            f" others show {len(self)} attitudes, too few to test the answer: hold still in at least {LEAST_POSES}, or"
            " take the method poise",
            {"poses": float(len(self)), "moving": share},
        )
