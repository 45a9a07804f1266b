"""The pipeline that wrenches and motion stream into, from a robot or from a recording."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from poise.errors import ErrorCode, InputError, NoAnswerError
from poise.geometry import STANDARD_GRAVITY
from poise.inertia.bayes import SHAPE_ACCURACY, PayloadChange
from poise.inertia.estimators import (
    DEFAULT_METHOD,
    WATCH,
    Accelerometer,
    ChangeWatch,
    EstimatorEntry,
    MotionNeed,
    Prior,
    check_method,
)
from poise.inertia.model import OUT_OF_ORDER, UNKNOWN_NOISE, EstimateFinding, NoiseLevels, Parts
from poise.inertia.pipeline.estimate import InertialEstimate
from poise.inertia.pipeline.estimator_group import EstimatorGroup
from poise.inertia.pipeline.measuring_source import MeasuringSource
from poise.inertia.pipeline.method_pipeline import MethodPipeline, PairedSamples
from poise.ranges import check_range
from poise.robot import (
    CLOCK_JUMP,
    IMU_LAG_STEP,
    IMU_LONGEST_DELAY,
    NO_KINEMATICS,
    ImuSource,
    LiveImu,
    MotionBuffer,
    MotionSource,
    PairingSettings,
    SharedBuffers,
    went_back,
)
from poise.types import Array, Stamps

_SETTLED = 1_000_000_000
"""ns after a change in which the watch knows more, because it lags less."""


class OnlineEstimator:
    """Weighs while wrenches and kinematics come in; nothing in it grows with time.

    Kinematics go into the source, wrenches in here; `update` brings them together as far as both are known. The answer
    does not depend on the portions in which they come, nor on how often `update` is called.

    Args:
        source: where kinematics come in.
        frame_id: the sensor frame.
        gravity: m/s2.
        method: see `method_choices`; `auto` does `static` and `ols`, and answers with what suits the motion.
        parts: of the payload, in the sensor frame; None when its shape is not known.
        accuracy: relative error of lengths in the shape.
        noise: of samples, and how large a bias to expect; NaN where it has to be estimated, None: all of it.
        window: s of samples, for methods that are not recursive; infinite: all, thinned out when they are many.
        continuous: `poise` alone: start again when the payload has changed, see `changes`.
        saturation: force [N] and torque [N m] at which a channel counts as saturated.
        settings: how wrenches and motion are brought together.
        patience: s that a wrench waits for its kinematics.
        max_intervals: how many rejected intervals are remembered; None: all.

    Raises:
        InputError: BAD_INPUT for a method that does not exist, or numbers that make no sense.
    """

    def __init__(
        self,
        source: MotionSource,
        *,
        frame_id: str,
        gravity: float = STANDARD_GRAVITY,
        method: str = DEFAULT_METHOD,
        parts: Parts | None = None,
        accuracy: float = SHAPE_ACCURACY,
        noise: NoiseLevels | None = None,
        window: float = np.inf,
        continuous: bool = False,
        saturation: tuple[float, float] = (np.inf, np.inf),
        settings: PairingSettings | None = None,
        patience: float = 5.0,
        max_intervals: int | None = 100,
    ) -> None:
        check_options(method, gravity, saturation)
        self.source = source
        self.frame_id = frame_id
        self.clock_jumps = 0
        """How often time went backwards. Samples that waited for the motion are lost then, estimates stay."""
        self.foreign_wrenches: Counter[str] = Counter()
        """Wrenches of other frames than the sensor's, which are not used, by frame."""
        self.changes: list[PayloadChange] = []
        """Of the payload, in the order of time."""
        self._limits = np.repeat(saturation, 3)
        self._settings = settings or PairingSettings()
        self._patience = round(min(patience, 1e9) * 1e9)
        self._max_intervals = max_intervals
        self._source_jumps = source.jumps
        self._newest: int | None = None
        self.imu: LiveImu | None = None
        """Measures the linear acceleration; None: the source gives it."""
        self._measuring = MeasuringSource(source)
        self._buffers = SharedBuffers(self._measuring, self._settings)
        self._watch: MethodPipeline | None = None
        self._coming: Parts | None = None
        self._continuous = continuous and method == DEFAULT_METHOD
        alone = Accelerometer.ALONE if isinstance(source, ImuSource) else Accelerometer.NONE
        down = np.array([0.0, 0.0, -gravity])
        self._prior = Prior(parts, accuracy, noise or UNKNOWN_NOISE, down, window, accelerometer=alone)
        self._window: EstimatorGroup | None = None
        self._begin(method, self._prior)

    def reset(self, parts: Parts | None = None) -> None:
        """Forget all samples: a new payload, of this shape where it is known."""
        self._begin(self._running.method, replace(self._prior, parts=parts))

    def hold(self, parts: Parts, accuracy: float = SHAPE_ACCURACY) -> None:
        """Set the shape of the payload, in the sensor frame, and the relative error of its lengths.

        The estimate of what is held already starts again; when nothing is held, the shape is that of the next payload.
        """
        self._prior = replace(self._prior, accuracy=accuracy)
        if self._changes is not None and self._changes.is_empty:
            self._coming = parts
        else:
            self.reset(parts)

    @property
    def _changes(self) -> ChangeWatch | None:
        watching = None if self._watch is None else self._watch.estimator
        return watching if isinstance(watching, ChangeWatch) else None

    def _begin(self, method: str, prior: Prior) -> None:
        self._running = EstimatorGroup(method, self._pipeline, prior)
        if self._continuous:
            self._watch = self._pipeline(WATCH, prior)

    def change_source(self, source: MotionSource) -> None:
        """Take the motion from another source from now on; estimates and waiting wrenches stay."""
        self.source, self._source_jumps = source, source.jumps
        self._measuring = MeasuringSource(source)
        self._renew_buffers()

    def take_imu(self, imu: LiveImu) -> None:
        """Take the linear acceleration from an IMU on the sensor; estimates that did without it are dropped."""
        self.imu = imu
        kind = Accelerometer.ON_KINEMATICS
        self._prior = replace(self._prior, longest_delay=IMU_LONGEST_DELAY, lag_step=IMU_LAG_STEP, accelerometer=kind)
        self._renew_buffers()
        self.reset(self._running.prior.parts)

    # -- a separate window ------------------------------------------------------------------------------------

    def begin_window(self, method: str = "", parts: Parts | None = None, accuracy: float | None = None) -> None:
        """Weigh what comes from now on separately; the running estimate goes on.

        Args:
            method: see `method_choices`; empty: the running one.
            parts: of the payload, in the sensor frame; None when its shape is not known.
            accuracy: relative error of lengths in the shape; None: that of the running estimate's.

        Raises:
            InputError: BUSY when there is a window already, BAD_INPUT for a method that does not exist.
        """
        if self._window is not None:
            raise InputError(ErrorCode.BUSY, "a window is open already: end it, or wait for its end")
        newest = max((stamp for stamp in (self._newest, self.source.newest) if stamp is not None), default=None)
        since = None if newest is None else newest + 1
        prior = replace(self._prior, parts=parts, accuracy=accuracy or self._prior.accuracy, since=since)
        self._window = EstimatorGroup(method or self._running.method, self._pipeline, prior)

    @property
    def window_samples(self) -> int:
        """Samples used in the window."""
        return 0 if self._window is None else self._window.busiest.n_samples

    @property
    def window_decided(self) -> int | None:
        """ns: up to which stamp the window's samples are in; None: none are."""
        if self._window is None:
            return None
        ends = [pipeline.buffer.decided for pipeline in self._window.pipelines.values()]
        return min((end for end in ends if end is not None), default=None)

    def window_estimate(self) -> InertialEstimate:
        """Solve for everything in the window.

        Raises:
            NoAnswerError: EMPTY without a window, TOO_FEW_SAMPLES or NOT_IDENTIFIABLE.
        """
        if self._window is None:
            raise NoAnswerError(ErrorCode.EMPTY, "no window is open: begin one")
        return self._window.estimate(self.frame_id)

    def end_window(self, keep: bool = False) -> None:
        """Close the window, if there is one; with `keep` it takes the place of the running estimate."""
        if keep and self._window is not None:
            self._running = self._window
        self._window = None

    # -- samples ---------------------------------------------------------------------------------------------

    @property
    def n_samples(self) -> int:
        """Samples used, by the method that used most."""
        return self._running.busiest.n_samples

    @property
    def gravity(self) -> Array:
        """(3,) m/s2 in the world."""
        return self._prior.gravity

    @property
    def motion_words(self) -> str:
        """For people: where the motion comes from."""
        return self.source.words if self.imu is None else f"{self.source.words}; {self.imu.words}"

    @property
    def rejected(self) -> Mapping[str, int]:
        """Samples by reason, of the method that used most."""
        return self._running.busiest.rejections.counts

    @property
    def clocks_apart(self) -> float | None:
        """s by which the newest wrench is stamped later than the newest kinematics."""
        newest = self.source.newest
        return None if newest is None or self._newest is None else (self._newest - newest) * 1e-9

    def add_wrench(self, stamps: ArrayLike, wrench: ArrayLike) -> None:
        """Add wrenches in the order of arrival: (N,) int64 ns and (N, 6) N and N m, or one of them, or none."""
        times = np.atleast_1d(np.asarray(stamps, dtype=np.int64))
        rows = np.asarray(wrench, dtype=np.float64).reshape(-1, 6)
        while len(times):
            back = np.flatnonzero(times[1:] < np.maximum.accumulate(times)[:-1] - CLOCK_JUMP)
            end = int(back[0]) + 1 if len(back) else len(times)
            self._add_wrench(times[:end], rows[:end])
            times, rows = times[end:], rows[end:]

    def _add_wrench(self, stamps: Stamps, wrench: Array) -> None:
        """Add wrenches among which the clock does not jump."""
        self._notice_jump()
        if went_back(stamps, self._newest):
            self.source.clear()
            self._start_over()
        self._newest = max(int(stamps.max()), self._newest or 0)
        for pipeline in self._pipelines:
            pipeline.add(stamps, wrench)

    def update(self, flush: bool = False) -> dict[str, PairedSamples]:
        """Use what has become known, by method; `flush`: do not wait for kinematics that would make it better known."""
        self._notice_jump()
        self._buffers.update(flush)
        for pipeline in self._pipelines:
            pipeline.update(self._patience, flush)
        paired = {name: pipeline.newest for name, pipeline in self._running.pipelines.items()}
        self._notice_change()
        self._forget()
        return paired

    def finish(self) -> dict[str, PairedSamples]:
        """Use all there is, and give up the wrenches that have no kinematics: nothing more will come."""
        paired = self.update(flush=True)
        for pipeline in self._pipelines:
            pipeline.drop_waiting(NO_KINEMATICS)
        return paired

    def estimate(self) -> InertialEstimate:
        """Solve for everything seen so far.

        Raises:
            InputError: UNSUPPORTED when the method needs a shape and there is none.
            NoAnswerError: TOO_FEW_SAMPLES, NOT_IDENTIFIABLE, NOT_CONSISTENT (opposite sign), SOLVER_FAILED.
        """
        running, watch = self._running, self._watch
        since, known = running.prior.since, running.busiest.stamp
        unsettled = since is not None and (known is None or known < since + _SETTLED)
        if watch is not None:
            watch.check_sign()  # of all payloads so far: a stream of the opposite sign looks like many changes
        if watch is not None and watch.stamp is not None and self.changes and unsettled:
            found = watch.estimate(self.frame_id)
        else:
            found = running.estimate(self.frame_id)
        if self._changes is not None:
            found = found.doubted(self._changes.doubts(found.bias))
        if self.imu is None and not self.source.has_positions:
            found = found.without_positions()
        if not self.foreign_wrenches:
            return found
        return replace(found, findings=(*found.findings, _foreign_frames(self.foreign_wrenches, self.frame_id)))

    @property
    def _pipelines(self) -> list[MethodPipeline]:
        groups = [self._running] if self._window is None else [self._running, self._window]
        watch = [] if self._watch is None else [self._watch]
        return [pipeline for group in groups for pipeline in group.pipelines.values()] + watch

    def _pipeline(self, entry: EstimatorEntry, prior: Prior) -> MethodPipeline:
        return MethodPipeline(
            entry, self._buffer(entry), prior, self._limits, lambda: self._motion_noise, self._max_intervals
        )

    def pipeline_of(
        self, entry: EstimatorEntry, buffer: MotionBuffer, bias: Array, spread: tuple[float, float], is_empty: bool
    ) -> MethodPipeline:
        """A pipeline that is separate from the running one, for samples of one payload among several.

        Args:
            entry: of its estimator.
            buffer: of its motion.
            bias: (6,) what the sensor reads with nothing on it, N and N m.
            spread: standard deviations of that, N and N m; they count where no bias was given.
            is_empty: nothing is held, so that the shape does not count.
        """
        given = self._prior.noise
        noise = replace(given, force_bias=spread[0], torque_bias=spread[1], zeroed=1.0)
        prior = replace(self._prior, noise=noise, tare=bias) if np.isnan(given.force_bias) else self._prior
        prior = replace(prior, parts=None) if is_empty else prior
        return MethodPipeline(entry, buffer, prior, self._limits, lambda: self._motion_noise, self._max_intervals)

    def _buffer(self, entry: EstimatorEntry) -> MotionBuffer:
        """The motion that an estimator needs."""
        if entry is WATCH:
            return self._buffers.fresh
        if entry.motion is MotionNeed.STILL:
            return self._buffers.still
        return self._buffers.moving if entry.motion is MotionNeed.MOVING else self._buffers.either

    @property
    def _motion_noise(self) -> NoiseLevels:
        noise = self._measuring.noise
        if self.imu is None:
            return noise
        return replace(noise, linear_acceleration=float(np.nan_to_num(self.imu.noise, nan=noise.linear_acceleration)))

    def _renew_buffers(self) -> None:
        self._buffers = SharedBuffers(self._measuring, self._settings, self.imu)
        for pipeline in self._pipelines:
            pipeline.buffer = self._buffer(pipeline.entry)

    def _notice_change(self) -> None:
        """Start again with the new payload; what is known of the sensor's bias stays."""
        changes = self._changes
        new = [] if changes is None else changes.new_changes()
        if not new or changes is None:
            return
        self.changes += new
        if self._coming is not None and new[-1].mass_after > new[-1].mass_before:
            changes.hold(self._coming)
            self._coming = None
        prior = replace(changes.prior, accuracy=self._prior.accuracy)
        self._running = EstimatorGroup(self._running.method, self._pipeline, prior)

    def _notice_jump(self) -> None:
        if self.source.jumps != self._source_jumps:
            self._source_jumps = self.source.jumps
            self._start_over()

    def _start_over(self) -> None:
        """The clock has jumped: what waits for its partner waits in vain."""
        self.clock_jumps += 1
        if self.imu is not None:
            self.imu.clear()
        self._newest = None
        for pipeline in self._pipelines:
            pipeline.drop_waiting(OUT_OF_ORDER)
            pipeline.restart_clock()
        self._renew_buffers()

    def _forget(self) -> None:
        newest = self.source.newest
        if newest is None:
            return
        self._buffers.forget_before(newest - round(self._settings.memory * 1e9))


def check_options(method: str, gravity: float | None, saturation: tuple[float, float]) -> None:
    """Refuse a method that does not exist, and values that cannot be: gravity in m/s2, saturation in N and N m.

    Raises:
        InputError: BAD_INPUT.
    """
    check_method(method)
    for name, value in (("saturation force", saturation[0]), ("torque", saturation[1])):
        if not value > 0:
            raise InputError(ErrorCode.BAD_INPUT, f"{name} is {value}: it must be positive")
    if gravity is not None:
        check_range("gravity of a recording", gravity)


def _foreign_frames(counts: Counter[str], frame_id: str) -> EstimateFinding:
    frames = ", ".join(f"{count} of {frame or 'no frame'}" for frame, count in counts.most_common())
    sentence = f"wrenches of other frames than {frame_id} were not used ({frames}): remap their topic"
    return EstimateFinding(ErrorCode.FRAME_UNKNOWN, sentence)
