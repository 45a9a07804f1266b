"""The result of an identification: the payload with its covariance, and the samples that it rests on."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from poise.errors import ErrorCode
from poise.inertia.bayes import PayloadDoubt
from poise.inertia.estimators import AccelerometerErrors
from poise.inertia.model import (
    EstimateFinding,
    InertialParameters,
    InertialSolution,
    RejectedInterval,
    about_com_jacobian,
)
from poise.inertia.verdict import FitSamples, FitVerdict
from poise.notebooks import html_table
from poise.robot import SensorMotion
from poise.types import Array

_APART = 3.0
"""Standard deviations from which on another payload is worth a finding."""

_NOTABLE = 0.1
"""m/s2 of linear acceleration, one percent of gravity."""


@dataclass(frozen=True, eq=False)
class InertialEstimate:
    """What the sensor carries. NaN marks what the motion could not show.

    Args:
        stamp: of the newest sample used, int ns.
        frame_id: the sensor frame, in which everything is expressed.
        parameters: mass, centre of mass, inertia about it.
        phi: (10,) m, m c, I about the sensor origin.
        covariance: (10, 10) of phi.
        bias: (6,) what the sensor reads with nothing on it, N and N m.
        bias_covariance: (6, 6).
        delay, delay_std: wrench stamps minus kinematics stamps, s; NaN when not estimated.
        method: the estimator, `static` or `ols`.
        consistent: a body with these parameters can exist.
        unidentified: names of the parameters that this motion cannot show, of `PARAMETER_NAMES`.
        condition_number: of the weighted normal matrix; infinite when a parameter is unidentified.
        n_samples: samples used.
        rejected: samples not used, in the order of time.
        residual_force: root mean square per axis of what the estimate leaves unexplained, N.
        residual_torque: the same, N m.
        n_effective: how many independent samples the used ones are worth.
        com_in_hull: the centre of mass lies in the convex hull of the object; None when its outline is not known.
        findings: what else to know.
        since: ns; no earlier sample counts, because the payload may have been another one. None: all do.
        accelerometer: errors that were found in one that gave the linear acceleration, and corrected; None: none did.
        fit: tests of the fit. Where one failed, `findings` contain POOR_FIT, and the covariance is wider.
        samples: that the fit was tested on; None: it was not tested.
    """

    stamp: int
    frame_id: str
    parameters: InertialParameters
    phi: Array
    covariance: Array
    bias: Array
    bias_covariance: Array
    delay: float
    delay_std: float
    method: str
    consistent: bool
    unidentified: tuple[str, ...]
    condition_number: float
    n_samples: int
    rejected: tuple[RejectedInterval, ...]
    residual_force: float
    residual_torque: float
    n_effective: float = np.nan
    com_in_hull: bool | None = None
    findings: tuple[EstimateFinding, ...] = ()
    since: int | None = None
    accelerometer: AccelerometerErrors | None = None
    fit: FitVerdict = field(default_factory=FitVerdict)
    samples: FitSamples | None = None

    def __repr__(self) -> str:
        com = ", ".join(f"{1e3 * value:.2f}" for value in self.parameters.com)
        mass = f"{self.parameters.mass:.4f} ± {self.mass_std:.4f} kg"
        return f"InertialEstimate({mass}, com [{com}] mm in {self.frame_id}, {self.method}, {self.n_samples} samples)"

    @classmethod
    def from_solution(
        cls,
        solution: InertialSolution,
        *,
        fit: FitVerdict | None = None,
        samples: FitSamples | None = None,
        stamp: int,
        frame_id: str,
        method: str,
        rejected: tuple[RejectedInterval, ...],
        since: int | None = None,
    ) -> "InertialEstimate":
        """Convert a solution to an estimate, with its delay, hull, findings and rejected samples.

        Args:
            solution: of any method.
            fit, samples: tests of its fit, and what they used; None: it was not tested.
            stamp: of the newest sample used, ns.
            frame_id: the sensor frame.
            method: the estimator.
            rejected: samples that it never saw.
            since: ns, see above.
        """
        parameters = InertialParameters.from_phi(solution.phi)
        fit = fit or FitVerdict()
        return cls(
            stamp=stamp,
            frame_id=frame_id,
            parameters=parameters,
            phi=solution.phi,
            covariance=solution.covariance if fit.covariance is None else fit.covariance,
            bias=solution.bias,
            bias_covariance=solution.bias_covariance,
            delay=solution.delay,
            delay_std=solution.delay_std,
            method=method,
            consistent=parameters.is_consistent,
            unidentified=solution.unidentified,
            condition_number=solution.condition_number,
            n_samples=solution.n_samples,
            rejected=tuple(sorted((*rejected, *solution.rejected), key=lambda span: span.start)),
            residual_force=solution.residual_force,
            residual_torque=solution.residual_torque,
            n_effective=solution.n_effective,
            com_in_hull=solution.com_in_hull,
            findings=(*solution.findings, *([] if fit.finding is None else [fit.finding])),
            since=since,
            fit=fit,
            samples=samples,
        )

    def doubted(self, doubts: Sequence[PayloadDoubt]) -> "InertialEstimate":
        """With the uncertainty that another payload may be held; a finding says so if it is notable."""
        if not doubts:
            return self
        covariance = self.covariance + np.sum([doubt.spread(self.phi) for doubt in doubts], axis=0)
        other = max((float(doubt.phi[0]) for doubt in doubts), key=lambda mass: abs(mass - self.phi[0]))
        if abs(other - self.phi[0]) < _APART * self.mass_std:
            return replace(self, covariance=covariance)
        sentence = (
            f"the newest samples may be of a payload of {other:.4f} kg instead of {self.phi[0]:.4f} kg, or something"
            " else touches it; the uncertainty covers both: turn the load in free space"
        )
        found = EstimateFinding(ErrorCode.IN_CONTACT, sentence, {"other_mass": other})
        return replace(self, covariance=covariance, findings=(*self.findings, found))

    def without_positions(self) -> "InertialEstimate":
        """With a finding, where the linear acceleration was taken as zero though the sensor turned fast."""
        size = 0.0 if self.samples is None else self.samples.usual_acceleration
        if size < _NOTABLE:
            return self
        sentence = (
            f"the recording has no positions: {self.method} takes the linear acceleration as zero, and turns like these"
            f" usually have {size:.1g} m/s2: record positions, or an imu for poise; or move more slowly"
        )
        found = EstimateFinding(ErrorCode.TOPIC_MISSING, sentence, {"acceleration": size})
        return replace(self, findings=(found, *self.findings))

    @property
    def mass_std(self) -> float:
        """One sigma of the mass, kg."""
        return float(np.sqrt(self.covariance[0, 0]))

    @property
    def com_std(self) -> Array:
        """(3,) one sigma of the centre of mass, m, to first order in phi."""
        return self._about_com_std[:3]

    @property
    def inertia_std(self) -> Array:
        """(6,) one sigma of ixx ixy ixz iyy iyz izz about the centre of mass, kg m2, to first order in phi."""
        return self._about_com_std[3:]

    @property
    def _about_com_std(self) -> Array:
        jacobian = about_com_jacobian(self.phi)
        seen = np.isfinite(np.diag(self.covariance))
        inside = jacobian[:, seen]
        deviations = np.sqrt(np.einsum("ij,jk,ik->i", inside, self.covariance[np.ix_(seen, seen)], inside))
        needs_unseen = np.any(jacobian[:, ~seen] != 0, axis=1)  # NaN counts: it is not zero
        return np.asarray(np.where(needs_unseen, np.nan, deviations))


@dataclass(frozen=True, eq=False)
class PayloadSegment:
    """A span of a recording in which the payload stayed the same.

    Args:
        start, end: stamps of the first and the last sample, ns; the transition to the next payload is left out.
        since: ns, when the payload became this one.
        event: how the segment began: start (of the recording), grasped, released or spilled; or leaking.
        log_odds: of the change that began it against none; NaN at the start.
        estimate: of the payload; of a leaking one at the end.
        lost: kg that a leaking payload has lost since the start.
    """

    start: int
    end: int
    since: int
    event: str
    log_odds: float
    estimate: InertialEstimate
    lost: float = 0.0


@dataclass(frozen=True, eq=False)
class Identification:
    """An estimate and what it was made of, sample by sample.

    Args:
        estimate: the answer.
        stamps: (N,) int64 ns, of the samples used.
        wrench_measured: (N, 6) N and N m, in the sensor frame.
        wrench_predicted: (N, 6) what the estimate says they should have been, bias included.
        motion: how the sensor moved at these stamps.
        history: the estimate as samples came in, the last one being the answer.
        source: where the motion came from, in words.
        segments: between changes of the payload; one when it stayed the same. The answer is that of the last one in
            which an object was held.
    """

    estimate: InertialEstimate
    stamps: NDArray[np.int64]
    wrench_measured: Array
    wrench_predicted: Array
    motion: SensorMotion
    history: tuple[InertialEstimate, ...]
    source: str
    segments: tuple[PayloadSegment, ...] = ()

    def __repr__(self) -> str:
        return f"Identification({self.estimate!r}, motion from {self.source})"

    def _repr_html_(self) -> str:
        """Values with one standard deviation and the findings, for notebooks."""
        estimate = self.estimate
        inertia = zip(
            ("xx", "xy", "xz", "yy", "yz", "zz"), estimate.parameters.inertia_vector, estimate.inertia_std, strict=True
        )
        rows = [("mass", f"{estimate.parameters.mass:.4f}", f"{estimate.mass_std:.2g}", "kg")]
        com = zip("xyz", 1e3 * estimate.parameters.com, 1e3 * estimate.com_std, strict=True)
        rows += [(f"centre of mass {axis}", f"{value:.2f}", f"{spread:.2g}", "mm") for axis, value, spread in com]
        rows += [
            (f"inertia {axes}", f"{1e3 * value:.3f}", f"{1e3 * spread:.2g}", "10⁻³ kg m²")
            for axes, value, spread in inertia
        ]
        caption = f"Payload in the axes of {estimate.frame_id}, {estimate.method}, {estimate.n_samples} samples"
        return html_table(
            caption, ("", "value", "one sigma", "unit"), rows, [each.message for each in estimate.findings]
        )
