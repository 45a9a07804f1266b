"""The estimator that samples stream into, from a robot or from a recording: one and the same."""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from poise.errors import ErrorCode, InputError, NoAnswerError
from poise.geometry import STANDARD_GRAVITY
from poise.inertia.bayes import OUT_OF_ORDER, SHAPE_ACCURACY, PayloadChange
from poise.inertia.estimators import AUTO, OWN_METHOD, WATCH, Continuous, Prior, StreamingEstimator
from poise.inertia.model import NoiseLevels, Parts
from poise.inertia.pipeline.estimate import InertialEstimate
from poise.inertia.pipeline.method_pipeline import EstimatorGroup, MethodPipeline, PairedSamples, buffer_for
from poise.robot import (
    LAG_STEP,
    LONGEST_DELAY,
    NO_KINEMATICS,
    LiveImu,
    MotionSource,
    PairingSettings,
    SharedBuffers,
    went_back,
)

MAX_GRAVITY = 1000.0
"""m/s2; more is a slip of the finger, and far more would overflow the sums."""

SETTLED = 1_000_000_000
"""ns after a change in which the watch knows more, because it lags less."""

WINDOW = 10.0
"""s of samples for methods that are not recursive."""


class OnlineEstimator:
    """Weighs while wrenches and kinematics come in; nothing in it grows with time.

    Kinematics go into the source, wrenches in here; `update` brings them together as far as both are known.

    Args:
        source: where kinematics come in.
        frame_id: the sensor frame.
        gravity: m/s2.
        method: see `METHODS`; `auto` does `static` and `ols`, and answers with what suits the motion.
        parts: of the payload, in the sensor frame; None when its shape is not known.
        accuracy: relative error of lengths in the shape.
        noise: of samples, and how large a bias to expect; for methods that are told.
        window: s of samples, for methods that are not recursive.
        continuous: `poise` alone: begin anew when the payload has changed, see `changes`.
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
        method: str = AUTO,
        parts: Parts | None = None,
        accuracy: float = SHAPE_ACCURACY,
        noise: NoiseLevels | None = None,
        window: float = WINDOW,
        continuous: bool = False,
        saturation: tuple[float, float] = (np.inf, np.inf),
        settings: PairingSettings | None = None,
        patience: float = 5.0,
        max_intervals: int | None = 100,
    ) -> None:
        for name, value in (("gravity", gravity), ("saturation force", saturation[0]), ("torque", saturation[1])):
            if not value > 0:
                raise InputError(ErrorCode.BAD_INPUT, f"{name} is {value}: it must be positive")
        if gravity > MAX_GRAVITY:
            raise InputError(
                ErrorCode.BAD_INPUT, f"gravity is {gravity} m/s2: no more than {MAX_GRAVITY:g} is believed"
            )
        self.source = source
        self.frame_id = frame_id
        self.clock_jumps = 0
        """How often time went backwards; what waited for its partner then is lost, what was learnt stays."""
        self.changes: list[PayloadChange] = []
        """Of the payload, in the order of time."""
        self._limits = np.repeat(saturation, 3)
        self._settings = settings or PairingSettings()
        self._patience = round(min(patience, 1e9) * 1e9)
        self._max_intervals = max_intervals
        self._source_jumps = source.jumps
        self._newest: int | None = None
        self.imu: LiveImu | None = None
        """That tells the linear acceleration; None: the source does."""
        self._tracks = SharedBuffers(source, self._settings)
        self._watch: MethodPipeline | None = None
        self._coming: Parts | None = None
        self._continuous = continuous and method == OWN_METHOD
        self._told = Prior(parts, accuracy, noise or NoiseLevels(), np.array([0.0, 0.0, -gravity]), window)
        self._window: EstimatorGroup | None = None
        self._begin(method, self._told)

    def reset(self, parts: Parts | None = None) -> None:
        """Forget all samples: a new payload, of this shape where it is known."""
        self._begin(self._running.method, replace(self._told, parts=parts))

    def hold(self, parts: Parts, accuracy: float = SHAPE_ACCURACY) -> None:
        """Say of what shape the payload is, in the sensor frame, and to what relative error of lengths.

        What is held already is weighed anew; when nothing is held, the shape is that of the next payload.
        """
        self._told = replace(self._told, accuracy=accuracy)
        if isinstance(self._watching, Continuous) and self._watching.is_empty:
            self._coming = parts
        else:
            self.reset(parts)

    @property
    def _watching(self) -> StreamingEstimator | None:
        return None if self._watch is None else self._watch.weigher

    def _begin(self, method: str, prior: Prior) -> None:
        self._running = self._weighing(method, prior)
        if self._continuous:
            self._watch = MethodPipeline(WATCH, buffer_for(WATCH, self._tracks), Continuous(prior))

    def change_source(self, source: MotionSource) -> None:
        """Take the motion from elsewhere from now on; what was learnt and what waits stays."""
        self.source, self._source_jumps = source, source.jumps
        self._renew_tracks()

    def take_imu(self, imu: LiveImu) -> None:
        """Believe an IMU on the sensor about the linear acceleration; what was learnt without it is forgotten."""
        self.imu = imu
        self._told = replace(self._told, longest_delay=LONGEST_DELAY, lag_step=LAG_STEP)
        self._renew_tracks()
        self.reset(self._running.prior.parts)

    # -- a window of its own ---------------------------------------------------------------------------------

    def begin_window(self, method: str = "", parts: Parts | None = None, accuracy: float | None = None) -> None:
        """Weigh what comes from now on by itself, too; the running estimate goes on.

        Args:
            method: see `METHODS`; empty: the running one.
            parts: of the payload, in the sensor frame; None when its shape is not known.
            accuracy: relative error of lengths in the shape; None: that of the running estimate's.

        Raises:
            InputError: BUSY when there is a window already, BAD_INPUT for a method that does not exist.
        """
        if self._window is not None:
            raise InputError(ErrorCode.BUSY, "a window is open already: end it, or wait for its end")
        newest = max((stamp for stamp in (self._newest, self.source.newest) if stamp is not None), default=None)
        since = None if newest is None else newest + 1
        prior = replace(self._told, parts=parts, accuracy=accuracy or self._told.accuracy, since=since)
        self._window = self._weighing(method or self._running.method, prior)

    @property
    def window_samples(self) -> int:
        """Samples used in the window."""
        return 0 if self._window is None else self._window.busiest.weigher.n_samples

    @property
    def window_decided(self) -> int | None:
        """ns: up to which stamp the window's samples are in; None: none are."""
        if self._window is None:
            return None
        ends = [run.track.decided for run in self._window.runs.values()]
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
        return self._running.busiest.weigher.n_samples

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
        """Add wrenches: (N,) int64 ns and (N, 6) N and N m, or one of them."""
        times = np.atleast_1d(np.asarray(stamps, dtype=np.int64))
        rows = np.asarray(wrench, dtype=np.float64).reshape(-1, 6)
        self._notice_jump()
        if went_back(times, self._newest):
            self.source.clear()
            self._start_over()
        self._newest = max(int(times.max()), self._newest or 0)
        for run in self._runs:
            run.add(times, rows)

    def update(self, flush: bool = False) -> dict[str, PairedSamples]:
        """Use what has become known, by method; `flush`: do not wait for kinematics that would make it better known."""
        self._notice_jump()
        self._tracks.update(flush)
        for run in self._runs:
            run.update(self._limits, self._patience)
        paired = {name: run.newest for name, run in self._running.runs.items()}
        self._notice_change()
        self._forget()
        return paired

    def finish(self) -> dict[str, PairedSamples]:
        """Use all there is, and give up the wrenches that have no kinematics: nothing more will come."""
        paired = self.update(flush=True)
        for run in self._runs:
            run.drop_waiting(NO_KINEMATICS)
        return paired

    def estimate(self) -> InertialEstimate:
        """Solve for everything seen so far.

        Raises:
            NoAnswerError: TOO_FEW_SAMPLES or NOT_IDENTIFIABLE.
        """
        running, watch = self._running, self._watch
        if watch is not None and watch.stamp is not None and self.changes:
            since = self._running.prior.since
            known = running.busiest.stamp
            if since is not None and (known is None or known < since + SETTLED):
                return watch.estimate(self.frame_id)
        return running.estimate(self.frame_id)

    @property
    def _runs(self) -> list[MethodPipeline]:
        weighings = [self._running] if self._window is None else [self._running, self._window]
        watch = [] if self._watch is None else [self._watch]
        return [run for weighing in weighings for run in weighing.runs.values()] + watch

    def _weighing(self, method: str, prior: Prior) -> EstimatorGroup:
        return EstimatorGroup(method, partial(buffer_for, buffers=self._tracks), prior, self._max_intervals)

    def _renew_tracks(self) -> None:
        self._tracks = SharedBuffers(self.source, self._settings, self.imu)
        for run in self._runs:
            run.track = buffer_for(run.name, self._tracks)

    def _notice_change(self) -> None:
        """Begin anew with the new payload; what is known of the sensor's bias stays."""
        watch = self._watching
        new = watch.new_changes() if isinstance(watch, Continuous) else []
        if not new or not isinstance(watch, Continuous):
            return
        self.changes += new
        if self._coming is not None and new[-1].mass_after > new[-1].mass_before:
            watch.hold(self._coming)
            self._coming = None
        self._running = self._weighing(self._running.method, replace(watch.prior, accuracy=self._told.accuracy))

    def _notice_jump(self) -> None:
        if self.source.jumps != self._source_jumps:
            self._source_jumps = self.source.jumps
            self._start_over()

    def _start_over(self) -> None:
        """Time has jumped: what waits for its partner waits in vain."""
        self.clock_jumps += 1
        if self.imu is not None:
            self.imu.clear()
        self._newest = None
        for run in self._runs:
            run.drop_waiting(OUT_OF_ORDER)
        self._renew_tracks()

    def _forget(self) -> None:
        newest = self.source.newest
        if newest is None:
            return
        self._tracks.forget_before(newest - round(self._settings.memory * 1e9))
