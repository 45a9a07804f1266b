"""One question put to the samples as they come: methods at work side by side, and the one that answers."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from poise.errors import NoAnswerError
from poise.inertia.bayes import NOT_FINITE, SATURATED
from poise.inertia.estimators import AUTO, OLS, STATIC, WATCH, Prior, StreamingEstimator, check_method, weigher
from poise.inertia.model import RejectionLog
from poise.inertia.pipeline.estimate import InertialEstimate
from poise.robot import USED, MotionBuffer, PairingReasons, SensorMotion, SharedBuffers, StampedBuffer
from poise.types import Array, Stamps

REST_SHARE = 0.5
"""From this share of samples at rest on, `auto` weighs the held poses alone."""


@dataclass(frozen=True, eq=False)
class PairedSamples:
    """Wrenches (N, 6) with the motion at their stamps, and why they were not used (empty: they were)."""

    stamps: Stamps
    wrench: Array
    motion: SensorMotion
    reasons: PairingReasons


NOTHING = SensorMotion.at_rest(np.zeros(0, dtype=np.int64), np.zeros((0, 3, 3))), np.zeros(0, dtype="<U16")


def buffer_for(method: str, buffers: SharedBuffers) -> MotionBuffer:
    """The motion that a method needs."""
    if method == STATIC:
        return buffers.still
    if method == OLS:
        return buffers.moving
    return buffers.fresh if method == WATCH else buffers.either


class MethodPipeline:
    """One method at work: wrenches wait until the track knows the motion around them, then go to the weigher.

    Args:
        name: of the method; not `auto`.
        track: of the sensor.
        weigher: takes the samples.
        since: ns; earlier samples are of another payload. None: there are none.
        max_intervals: how many rejected intervals are remembered; None: all.
    """

    def __init__(
        self,
        name: str,
        track: MotionBuffer,
        weigher: StreamingEstimator,
        since: int | None = None,
        max_intervals: int | None = 100,
    ) -> None:
        self.name = name
        self.track = track
        self.weigher = weigher
        self.rejections = RejectionLog(max_intervals)
        self.stamp: int | None = None
        self.newest: PairedSamples
        """What the last update brought together."""
        self._since = since
        self._waiting = StampedBuffer(6)

    def add(self, stamps: Stamps, wrench: Array) -> None:
        """Let wrenches wait: (N,) ns and (N, 6)."""
        late = slice(None) if self._since is None else stamps >= self._since
        self._waiting.extend(stamps[late], wrench[late])

    def update(self, limits: Array, patience: int) -> None:
        """Use every wrench that waits for nothing any more; `patience` ns is how long one waits at most.

        The track is up to date.
        """
        stamps, wrench = self._waiting.stamps, self._waiting.rows
        ready = stamps < (stamps[-1] if len(stamps) else 0) - patience
        if self.track.decided is not None:
            ready |= stamps <= self.track.decided
        stamps, wrench, waiting = stamps[ready], wrench[ready], (stamps[~ready], wrench[~ready])
        self._waiting.clear()
        self._waiting.extend(*waiting)
        motion, reasons = self.track.pair(stamps) if len(stamps) else NOTHING
        with np.errstate(invalid="ignore"):
            reasons[np.any(np.abs(wrench) >= limits, axis=1)] = SATURATED
        reasons[~np.isfinite(wrench).all(axis=1)] = NOT_FINITE
        used = reasons == USED
        self.weigher.add(motion.select(used), wrench[used])
        self.rejections.add(stamps, reasons)
        if used.any():
            self.stamp = int(stamps[used][-1])
        self.newest = PairedSamples(stamps, wrench, motion, reasons)

    def drop_waiting(self, reason: str) -> None:
        stamps = self._waiting.stamps
        self.rejections.add(stamps, np.full(len(stamps), reason, dtype="<U16"))
        self._waiting.clear()

    def estimate(self, frame_id: str) -> InertialEstimate:
        """Solve for all samples used so far.

        Raises:
            NoAnswerError: TOO_FEW_SAMPLES or NOT_IDENTIFIABLE.
        """
        try:
            solution = self.weigher.solve()
        except NoAnswerError as error:
            counts = ", ".join(f"{count} {reason}" for reason, count in self.rejections.counts.most_common())
            sentence = f"{self.name}: {error.message}" + (f" (left out: {counts})" if counts else "")
            raise NoAnswerError(error.code, sentence, **error.data) from None
        return InertialEstimate.from_solution(
            solution,
            stamp=self.stamp or 0,
            frame_id=frame_id,
            method=self.name,
            rejected=self.rejections.intervals,
            since=self._since,
        )


class EstimatorGroup:
    """One question put to the samples: the methods at work on it, and which of them answers.

    Args:
        method: see `METHODS`.
        track: makes that of a method.
        prior: what is known beforehand.
        max_intervals: how many rejected intervals are remembered; None: all.

    Raises:
        InputError: BAD_INPUT for a method that does not exist.
    """

    def __init__(
        self, method: str, track: Callable[[str], MotionBuffer], prior: Prior, max_intervals: int | None
    ) -> None:
        check_method(method)
        self.method = method
        self.prior = prior
        names = (STATIC, OLS) if method == AUTO else (method,)
        self.runs = {
            name: MethodPipeline(name, track(name), weigher(name, prior), prior.since, max_intervals) for name in names
        }

    @property
    def busiest(self) -> MethodPipeline:
        """The run that has used most samples."""
        return max(self.runs.values(), key=lambda run: run.weigher.n_samples)

    def estimate(self, frame_id: str) -> InertialEstimate:
        """Solve for everything seen so far.

        Raises:
            NoAnswerError: TOO_FEW_SAMPLES or NOT_IDENTIFIABLE.
        """
        if self.method != AUTO:
            return self.runs[self.method].estimate(frame_id)
        static, moving = (self.runs[name].weigher.n_samples for name in (STATIC, OLS))
        if static >= REST_SHARE * moving:
            try:
                held = self.runs[STATIC].estimate(frame_id)
            except NoAnswerError:
                return self.runs[OLS].estimate(frame_id)
            if sees_mass_and_centre(held) or not moving:
                return held
        return self.runs[OLS].estimate(frame_id)


def sees_mass_and_centre(estimate: InertialEstimate) -> bool:
    """Mass and centre of mass are all identified."""
    return not set(estimate.unidentified) & {"m", "cx", "cy", "cz"}
