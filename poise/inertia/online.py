"""The estimator that samples stream into, from a robot or from a recording: one and the same."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from poise.errors import ErrorCode, InputError, NoAnswerError
from poise.inertia.buffer import StampedBuffer, Stamps
from poise.inertia.estimate import InertialEstimate
from poise.inertia.information import InformationAccumulator
from poise.inertia.least_squares import solve
from poise.inertia.parameters import Array
from poise.inertia.regressor import regressor
from poise.inertia.rejection import RejectionLog
from poise.inertia.sources import MotionSource, went_back
from poise.inertia.tracks import NO_KINEMATICS, USED, MotionTrack, PairingSettings, Reasons, RestTrack, Track
from poise.robot import STANDARD_GRAVITY, SensorMotion

STATIC, OLS, AUTO = "static", "ols", "auto"
METHODS = (AUTO, STATIC, OLS)
NOT_FINITE, SATURATED, OUT_OF_ORDER = "not_finite", "saturated", "out_of_order"

MAX_GRAVITY = 1000.0
"""m/s2; more is a slip of the finger, and far more would overflow the sums."""

REST_SHARE = 0.5
"""From this share of samples at rest on, `auto` weighs the held poses alone."""


@dataclass(frozen=True, eq=False)
class PairedSamples:
    """Wrenches (N, 6) with the motion at their stamps, and why they were not used (empty: they were)."""

    stamps: Stamps
    wrench: Array
    motion: SensorMotion
    reasons: Reasons


NOTHING = SensorMotion.at_rest(np.zeros(0, dtype=np.int64), np.zeros((0, 3, 3))), np.zeros(0, dtype="<U16")


class _Run:
    """One method at work: wrenches wait until the track knows the motion around them, then go into the sums."""

    def __init__(self, track: Track, gravity: float, max_intervals: int | None) -> None:
        self.track = track
        self.gravity = np.array([0.0, 0.0, -gravity])
        self.information = InformationAccumulator()
        self.rejections = RejectionLog(max_intervals)
        self.stamp: int | None = None
        self._waiting = StampedBuffer(6)

    def add(self, stamps: Stamps, wrench: Array) -> None:
        self._waiting.extend(stamps, wrench)

    def update(self, limits: Array, patience: int, flush: bool) -> PairedSamples:
        """Use every wrench that waits for nothing any more; `patience` ns is how long one waits at most."""
        self.track.update(flush)
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
        self.information.add(model_matrix(motion.select(used), self.gravity), wrench[used])
        self.rejections.add(stamps, reasons)
        if used.any():
            self.stamp = int(stamps[used][-1])
        return PairedSamples(stamps, wrench, motion, reasons)

    def drop_waiting(self, reason: str) -> None:
        stamps = self._waiting.stamps
        self.rejections.add(stamps, np.full(len(stamps), reason, dtype="<U16"))
        self._waiting.clear()


class OnlineEstimator:
    """Weighs while wrenches and kinematics come in; nothing in it grows with time.

    Kinematics go into the source, wrenches in here; `update` brings them together as far as both are known.

    Args:
        source: where kinematics come in.
        frame_id: the sensor frame.
        gravity: m/s2.
        method: `static`, `ols`, or `auto`, which does both and answers with what suits the motion.
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
        saturation: tuple[float, float] = (np.inf, np.inf),
        settings: PairingSettings | None = None,
        patience: float = 5.0,
        max_intervals: int | None = 100,
    ) -> None:
        check_method(method)
        for name, value in (("gravity", gravity), ("saturation force", saturation[0]), ("torque", saturation[1])):
            if not value > 0:
                raise InputError(ErrorCode.BAD_INPUT, f"{name} is {value}: it must be positive")
        if gravity > MAX_GRAVITY:
            raise InputError(
                ErrorCode.BAD_INPUT, f"gravity is {gravity} m/s2: no more than {MAX_GRAVITY:g} is believed"
            )
        self.source = source
        self.frame_id = frame_id
        self.method = method
        self.clock_jumps = 0
        """How often time went backwards; what waited for its partner then is lost, what was learnt stays."""
        self._gravity = gravity
        self._limits = np.repeat(saturation, 3)
        self._settings = settings or PairingSettings()
        self._patience = round(min(patience, 1e9) * 1e9)
        self._max_intervals = max_intervals
        self._source_jumps = source.jumps
        self._newest: int | None = None
        self.reset()

    def reset(self) -> None:
        """Forget all samples: a new payload."""
        names = (STATIC, OLS) if self.method == AUTO else (self.method,)
        self._runs = {name: _Run(self._track(name), self._gravity, self._max_intervals) for name in names}

    def change_source(self, source: MotionSource) -> None:
        """Take the motion from elsewhere from now on; what was learnt and what waits stays."""
        self.source, self._source_jumps = source, source.jumps
        for name, run in self._runs.items():
            run.track = self._track(name)

    @property
    def n_samples(self) -> int:
        """Samples used, by the method that used most."""
        return self._busiest.information.n_samples

    @property
    def rejected(self) -> Mapping[str, int]:
        """Samples by reason, of the method that used most."""
        return self._busiest.rejections.counts

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
        for run in self._runs.values():
            run.add(times, rows)

    def update(self, flush: bool = False) -> dict[str, PairedSamples]:
        """Use what has become known, by method; `flush`: do not wait for kinematics that would make it better known."""
        self._notice_jump()
        paired = {name: run.update(self._limits, self._patience, flush) for name, run in self._runs.items()}
        self._forget()
        return paired

    def finish(self) -> dict[str, PairedSamples]:
        """Use all there is, and give up the wrenches that have no kinematics: nothing more will come."""
        paired = self.update(flush=True)
        for run in self._runs.values():
            run.drop_waiting(NO_KINEMATICS)
        return paired

    def estimate(self, method: str | None = None) -> InertialEstimate:
        """Solve for everything seen so far.

        Raises:
            NoAnswerError: TOO_FEW_SAMPLES or NOT_IDENTIFIABLE, see `solve`.
        """
        chosen = method or self.method
        if chosen != AUTO:
            return self._estimate(chosen)
        static, moving = self._runs[STATIC].information.n_samples, self._runs[OLS].information.n_samples
        if static >= REST_SHARE * moving:
            try:
                held = self._estimate(STATIC)
            except NoAnswerError:
                return self._estimate(OLS)
            if sees_mass_and_centre(held) or not moving:
                return held
        return self._estimate(OLS)

    def _estimate(self, method: str) -> InertialEstimate:
        run = self._runs[method]
        try:
            solution = solve(run.information)
        except NoAnswerError as error:
            counts = ", ".join(f"{count} {reason}" for reason, count in run.rejections.counts.most_common())
            sentence = f"{method}: {error.message}" + (f" (left out: {counts})" if counts else "")
            raise NoAnswerError(error.code, sentence, **error.data) from None
        return InertialEstimate.from_solution(
            solution,
            stamp=run.stamp or 0,
            frame_id=self.frame_id,
            method=method,
            rejected=run.rejections.intervals,
        )

    @property
    def _busiest(self) -> _Run:
        return max(self._runs.values(), key=lambda run: run.information.n_samples)

    def _track(self, method: str) -> Track:
        return RestTrack(self.source, self._settings) if method == STATIC else MotionTrack(self.source, self._settings)

    def _notice_jump(self) -> None:
        if self.source.jumps != self._source_jumps:
            self._source_jumps = self.source.jumps
            self._start_over()

    def _start_over(self) -> None:
        """Time has jumped: what waits for its partner waits in vain."""
        self.clock_jumps += 1
        self._newest = None
        for name, run in self._runs.items():
            run.drop_waiting(OUT_OF_ORDER)
            run.track = self._track(name)

    def _forget(self) -> None:
        newest = self.source.newest
        if newest is None:
            return
        keep = newest - round(self._settings.memory * 1e9)
        needed = [run.track.needs_from() for run in self._runs.values()]
        for run in self._runs.values():
            run.track.forget_before(keep)
        self.source.forget_before(min([keep, *(stamp for stamp in needed if stamp is not None)]))


def check_method(method: str) -> None:
    """Refuse a name that is no method.

    Raises:
        InputError: BAD_INPUT.
    """
    if method not in METHODS:
        raise InputError(ErrorCode.BAD_INPUT, f"there is no method '{method}'; choose one of {', '.join(METHODS)}")


def sees_mass_and_centre(estimate: InertialEstimate) -> bool:
    """Mass and centre of mass are all identified."""
    return not set(estimate.unidentified) & {"m", "cx", "cy", "cz"}


def model_matrix(motion: SensorMotion, gravity: Array) -> Array:
    """(N, 6, 10) regressor of a motion, for a gravity vector (3,) in the world."""
    return regressor(
        motion.gravity_in_sensor(gravity) - motion.linear_acceleration_in_sensor,
        motion.angular_velocity_in_sensor,
        motion.angular_acceleration_in_sensor,
    )
