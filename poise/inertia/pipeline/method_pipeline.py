"""One estimator at work: wrenches are paired with the motion, checked once, and handed over; its answer is checked."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from poise.errors import ErrorCode, NoAnswerError
from poise.inertia.estimators import (
    AccelerometerComparison,
    EstimatorEntry,
    InformationAccumulator,
    MotionNeed,
    NoiseMeter,
    Prior,
    SampleEvidence,
    StreamingEstimator,
    model_matrix,
    solve,
)
from poise.inertia.model import (
    SPIKE,
    EstimateFinding,
    InertialSolution,
    NoiseLevels,
    RejectionLog,
    SampleChecks,
    SpikeFilter,
)
from poise.inertia.pipeline.estimate import InertialEstimate
from poise.inertia.pipeline.held_poses import HeldPoses
from poise.inertia.verdict import ExtremeReadings, Fit, FitSamples, FitVerdict, SampleBins, judge
from poise.recording import MAX_LATENESS
from poise.robot import USED, MotionBuffer, PairingReasons, SensorMotion, StampedBuffer
from poise.types import Array, Mask, Stamps

_AFTER_JUMP = 10**9
"""ns that pass for the estimator when the clock jumps."""
_SURELY = 5.0
"""Standard deviations."""
_EMPTY_HAND = 0.02
"""kg; a smaller mass says nothing about the sign of the wrench."""


@dataclass(frozen=True, eq=False)
class PairedSamples:
    """Wrenches (N, 6) with the motion at their stamps, and why they were not used (empty: they were)."""

    stamps: Stamps
    wrench: Array
    motion: SensorMotion
    reasons: PairingReasons


class MethodPipeline:
    """Pairs, checks and estimates. The portions in which messages come do not matter.

    A wrench waits until the motion around it is known, and until messages that a network delayed have come, too.

    Args:
        entry: of the estimator.
        buffer: of the sensor's motion.
        prior: what is known before the first sample.
        limits: (6,) |wrench| at which a channel is saturated, N and N m.
        motion_noise: gives the noise of the accelerations so far.
        max_intervals: how many rejected intervals are remembered; None: all.
    """

    def __init__(
        self,
        entry: EstimatorEntry,
        buffer: MotionBuffer,
        prior: Prior,
        limits: Array,
        motion_noise: Callable[[], NoiseLevels],
        max_intervals: int | None = 100,
    ) -> None:
        self.entry, self.buffer, self.prior = entry, buffer, prior
        self.estimator: StreamingEstimator = entry.stream(prior)
        self.rejections = RejectionLog(max_intervals)
        self.n_samples = 0
        self.stamp: int | None = None
        self.newest: PairedSamples
        """What the last update brought together."""
        self._checks, self._spikes = SampleChecks(limits), SpikeFilter()
        self._motion_noise = motion_noise
        self._information, self._noise = InformationAccumulator(), NoiseMeter()
        self._accelerometer = AccelerometerComparison(prior.gravity, prior.accelerometer)
        """Its errors are in the samples, and are taken out of the answer."""
        self._bins, self._extremes = SampleBins(prior.gravity), ExtremeReadings()
        self._waiting = StampedBuffer(6)
        self._shift, self._has_jumped = 0, False
        """ns that are added to the stamps for the estimator, so that they rise when the clock was set back."""

    # -- samples ---------------------------------------------------------------------------------------------

    def add(self, stamps: Stamps, wrench: Array) -> None:
        """Let wrenches wait: (N,) ns and (N, 6)."""
        since = self.prior.since
        late = slice(None) if since is None else stamps >= since
        self._waiting.extend(stamps[late], wrench[late])

    def update(self, patience: int, flush: bool = False) -> None:
        """Use every wrench that waits for nothing more; `patience` ns is how long one waits for its motion at most.

        The motion buffer is up to date. With `flush` no wrench waits for others that may come late.
        """
        stamps, wrench = self._waiting.stamps, self._waiting.rows
        newest = stamps[-1] if len(stamps) else 0
        ready = stamps < newest - patience
        if self.buffer.decided is not None:
            ready |= stamps <= self.buffer.decided
        if not flush:
            ready &= stamps <= newest - MAX_LATENESS
        stamps, wrench, waiting = stamps[ready], wrench[ready], (stamps[~ready], wrench[~ready])
        self._waiting.clear()
        self._waiting.extend(*waiting)
        self.newest = self._paired(stamps, wrench, self._spikes.judge(wrench, waiting[1]))
        used = self.newest.reasons == USED
        self.rejections.add(stamps, self.newest.reasons)
        if used.any():
            self._use(self.newest.motion.select(used), wrench[used])

    def drop_waiting(self, reason: str) -> None:
        """Give up the wrenches that wait."""
        stamps = self._waiting.stamps
        self.rejections.add(stamps, np.full(len(stamps), reason, dtype="<U16"))
        self._waiting.clear()

    def restart_clock(self) -> None:
        """The stamps have jumped: for the estimator, time goes on."""
        self._checks.restart()
        self._has_jumped = self.stamp is not None

    def check_sign(self) -> None:
        """Refuse wrenches of the opposite sign, as far as the samples show it.

        Raises:
            NoAnswerError: NOT_CONSISTENT.
        """
        try:
            plain = solve(self._information)
        except NoAnswerError:
            return
        _check_sign(plain)

    def _paired(self, stamps: Stamps, wrench: Array, spikes: Mask) -> PairedSamples:
        if not len(stamps):
            return PairedSamples(stamps, wrench, _NO_MOTION, np.zeros(0, dtype="<U16"))
        motion, reasons = self.buffer.pair(stamps)
        reasons = self._checks.judge(stamps, wrench, motion.angular_velocity_in_sensor, reasons)
        reasons[spikes & (reasons == USED)] = SPIKE
        return PairedSamples(stamps, wrench, motion, reasons)

    def _use(self, motion: SensorMotion, wrench: Array) -> None:
        first, last = int(motion.stamps[0]), int(motion.stamps[-1])
        if self._has_jumped and self.stamp is not None:
            self._shift, self._has_jumped = self._shift + self.stamp + _AFTER_JUMP - first, False
        if self._shift:
            motion = replace(motion, stamps=motion.stamps + self._shift)
        self.stamp = last
        self.n_samples += len(wrench)
        self._information.add(model_matrix(motion, self.prior.gravity), wrench)
        self._noise.add(wrench)
        self._accelerometer.add(motion)
        self._bins.add(motion, wrench)
        self._extremes.add(wrench)
        self.estimator.add(motion, wrench)

    # -- answers ---------------------------------------------------------------------------------------------

    def estimate(self, frame_id: str) -> InertialEstimate:
        """Solve for all samples used so far.

        Raises:
            InputError: UNSUPPORTED when the method needs a shape and there is none.
            NoAnswerError: TOO_FEW_SAMPLES, NOT_IDENTIFIABLE, NOT_CONSISTENT when the wrench has the opposite sign,
                SOLVER_FAILED. Their data contain the `samples`.
        """
        try:
            solution = self._solve()
        except NoAnswerError as error:
            counts = ", ".join(f"{count} {reason}" for reason, count in self.rejections.counts.most_common())
            sentence = f"{self.entry.name}: {error.message}" + (f" (left out: {counts})" if counts else "")
            raise NoAnswerError(error.code, sentence, **{"samples": self._bins.samples, **error.data}) from None
        samples = self._bins.samples
        if self.entry.motion is MotionNeed.STILL:
            poses = HeldPoses.of(samples)
            solution, few = poses.widened(solution), poses.finding(self.rejections.counts)
            solution = replace(solution, findings=(*([] if few is None else [few]), *solution.findings))
        fit, errors = self._verdict(solution, samples), self._accelerometer.errors()
        if errors is not None:
            covariance = solution.covariance if fit.covariance is None else fit.covariance
            solution = errors.corrected(replace(solution, covariance=covariance))
            fit = replace(fit, covariance=solution.covariance)
        answer = InertialEstimate.from_solution(
            solution,
            fit=fit,
            samples=samples,
            stamp=self.stamp or 0,
            frame_id=frame_id,
            method=self.entry.name,
            rejected=self.rejections.intervals,
            since=self.prior.since,
        )
        return replace(answer, accelerometer=errors)

    def _verdict(self, solution: InertialSolution, samples: FitSamples) -> FitVerdict:
        fit = Fit(
            solution.phi,
            solution.bias,
            solution.covariance,
            solution.delay,
            self.prior.longest_delay,
            self._levels,
            solution.rejected,
            any(each.code is ErrorCode.IN_CONTACT and "other_mass" not in each.evidence for each in solution.findings),
        )
        return judge(fit, samples, self._extremes)

    def _solve(self) -> InertialSolution:
        plain = self._least_squares()
        if plain is not None:
            _check_sign(plain)
        if self.entry.needs_every_parameter and plain is not None and plain.unidentified:
            raise NoAnswerError(
                ErrorCode.NOT_IDENTIFIABLE,
                f"this motion does not show {', '.join(plain.unidentified)}, and the method fails without them:"
                " turn the payload about every axis, or take poise or ols",
                unidentified=plain.unidentified,
            )
        self._levels = self.prior.noise.filled(self._noise.levels(plain, self._motion_noise()))
        solution = self.estimator.solve(SampleEvidence(self._levels, plain))
        if not self.entry.gives_covariance and plain is not None:
            solution = replace(solution, unidentified=plain.unidentified)
        found = None if self.entry.estimates_bias or plain is None else _neglected_bias(plain, self.entry.name)
        return solution if found is None else replace(solution, findings=(*solution.findings, found))

    def _least_squares(self) -> InertialSolution | None:
        """What the samples show when nothing is known of the bias.

        None when that is nothing, but a prior of the bias gives the method an answer.
        """
        try:
            return solve(self._information)
        except NoAnswerError:
            given = self.prior.noise
            if self.entry.answers_hidden and np.isfinite([given.force_bias, given.torque_bias]).all():
                return None
            raise


_NO_MOTION = SensorMotion.at_rest(np.zeros(0, dtype=np.int64), np.zeros((0, 3, 3)))


def _check_sign(plain: InertialSolution) -> None:
    """Refuse a payload that pulls upwards: the wrench is that of the sensor on the load."""
    mass, deviation = float(plain.phi[0]), float(np.sqrt(plain.covariance[0, 0]))
    if np.isfinite(mass) and mass < -max(_SURELY * deviation, _EMPTY_HAND):
        raise NoAnswerError(
            ErrorCode.NOT_CONSISTENT,
            f"the wrench shows a mass of {mass:.4g} kg, so it has the opposite sign (or gravity has): give what the"
            " load exerts on the sensor, at rest f = m g",
            mass=mass,
        )


def _neglected_bias(plain: InertialSolution, name: str) -> EstimateFinding | None:
    """A finding when the sensor has a bias that the method does not allow for."""
    deviations = np.nan_to_num(plain.bias / np.sqrt(np.diag(plain.bias_covariance)))
    if not np.any(np.abs(deviations) > _SURELY):
        return None
    size = float(np.linalg.norm(np.nan_to_num(plain.bias[:3])))
    return EstimateFinding(
        ErrorCode.UNSUPPORTED,
        f"{name} assumes a sensor without bias, but this one reads {size:.2f} N without a load: zero the sensor, or"
        " take poise",
    )
