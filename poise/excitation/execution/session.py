"""An identification from goal to answer: plan, move, watch, estimate; any problem stops the arm.

There is no ROS in it: joint states and the time go in, commands for the arm come out. It never blocks: every phase has
a deadline, and `tick` returns at once.
"""

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from poise.errors import ErrorCode, PoiseError, SensorError
from poise.excitation import ExcitationPlan, Guard, MotionLimits
from poise.excitation.execution.commanded import NOT_WATCHED, CommandedArm, TimedMotion, Watchdog
from poise.excitation.execution.held_up import HeldUp
from poise.excitation.execution.joint_watch import JointWatch
from poise.excitation.execution.options import DEFAULT_EXECUTION, ExecutionOptions
from poise.excitation.execution.stops import ReadyStops
from poise.inertia import InertialEstimate
from poise.robot import RobotModel
from poise.types import Cancelled, Progress

Plan = Callable[[Progress, Cancelled], ExcitationPlan]


class SessionPhase(Enum):
    """What an identification is doing."""

    WAITING = "waiting"
    PLANNING = "planning"
    MOVING = "moving"
    SETTLING = "settling"
    LISTENING = "listening"
    STOPPING = "stopping"
    DONE = "done"


class PayloadEstimatorPort(Protocol):
    """An estimator with a window of samples."""

    def begin(self) -> None:
        """Open the window: samples count from here on."""

    def estimate(self) -> InertialEstimate:
        """The payload by the samples in the window.

        Raises:
            NoAnswerError: TOO_FEW_SAMPLES or NOT_IDENTIFIABLE.
        """

    def settled(self, stamp: int) -> bool:
        """Whether all samples up to a stamp (ns) are in the window."""

    def heard(self) -> float | None:
        """When the last wrench arrived, s of the clock of `now`; None: never."""


@dataclass(frozen=True)
class IdentificationTask:
    """What an identification has to do.

    Args:
        plan: plans the motion from the present joint positions (J,); None: listen without a motion.
        guard, limits: bounds of the motion and of every stop.
        duration: s to listen, without a motion.
        options: times and tolerances.
    """

    plan: "Callable[[np.ndarray[tuple[int], np.dtype[np.float64]]], Plan] | None"
    guard: Guard
    limits: MotionLimits
    duration: float = 3.0
    options: ExecutionOptions = DEFAULT_EXECUTION


class Session:
    """One identification. Call `add_joint_state` as they come, `tick` some fifty times a second; then read `phase`,
    `progress`, and at the end (`SessionPhase.DONE`) `error`, or `answer`.

    Args:
        model: the robot.
        task: what to do.
        estimator: estimates the payload.
        send: sends a command to the arm.
        now: s of a monotonic clock, which all calls share.
        watchdog: stops the arm when this program cannot.
    """

    def __init__(
        self,
        model: RobotModel,
        task: IdentificationTask,
        estimator: PayloadEstimatorPort,
        send: Callable[[TimedMotion], None],
        now: float,
        watchdog: Watchdog | None = None,
    ) -> None:
        self._model, self._task, self._estimator = model, task, estimator
        self._options = task.options
        self.joints = JointWatch(model, self._options.stale)
        self._arm = CommandedArm(self.joints, send, watchdog, self._options)
        self.phase, self.progress = SessionPhase.WAITING, 0.0
        self.error: PoiseError | None = None
        self.answer: InertialEstimate | None = None
        self.planned: ExcitationPlan | None = None
        self._since, self._held_up = now, HeldUp(now, self._options)
        self._stop_planning = threading.Event()
        self._planned: list[tuple[ExcitationPlan, ReadyStops] | PoiseError] = []
        self._steps = {
            SessionPhase.WAITING: self._wait,
            SessionPhase.PLANNING: self._await_plan,
            SessionPhase.MOVING: self._watch,
            SessionPhase.SETTLING: self._settle,
            SessionPhase.LISTENING: self._listen,
            SessionPhase.STOPPING: self._await_rest,
        }

    def add_joint_state(self, stamp: int, names: Sequence[str], position: ArrayLike, now: float) -> None:
        """Take a joint state; those of another robot are ignored."""
        self.joints.add(stamp, names, position, now)

    def tick(self, now: float) -> None:
        """Advance; never blocks, never raises."""
        if self.phase is SessionPhase.DONE:
            return
        self._held_up.tick(now)
        try:
            self._steps[self.phase](now)
        except PoiseError as error:
            self._fail(error, now)
        except Exception as error:  # an internal error; the arm has to stop too
            self._fail(
                PoiseError(ErrorCode.INTERNAL, f"internal error of the identification: {error!r}; please report it"),
                now,
            )

    def cancel(self, now: float, reason: str = "the goal was cancelled") -> None:
        """Stop the arm and end."""
        if self.phase not in (SessionPhase.DONE, SessionPhase.STOPPING):
            self._fail(PoiseError(ErrorCode.CANCELLED, reason), now)

    # -- phases ------------------------------------------------------------------------------------------------

    def _enter(self, phase: SessionPhase, now: float) -> None:
        self.phase, self._since = phase, now

    def _wait(self, now: float) -> None:
        """Wait for joint states, wrenches and, before a motion, an arm at rest."""
        late = now - self._since > self._options.patience
        problem = self.joints.problem(now) or self._silent(now)
        if problem is None and self._task.plan is not None and not self.joints.at_rest():
            problem = PoiseError(
                ErrorCode.BUSY,
                "the arm is moving: another program commands it; stop that program, or ask for MOTION_NONE",
            )
        if problem is not None:
            if late:
                raise problem
            return
        if self._task.plan is not None and not self._arm.ready:
            if late:
                raise PoiseError(ErrorCode.BUSY, NOT_WATCHED)
            return
        if self._task.plan is None:
            self._estimator.begin()
            self._enter(SessionPhase.LISTENING, now)
            return
        self._start = self.joints.position.copy()
        plan = self._task.plan(self._start)
        threading.Thread(target=self._make_plan, args=(plan,), name="excitation", daemon=True).start()
        self._enter(SessionPhase.PLANNING, now)

    def _make_plan(self, plan: Plan) -> None:
        """Plan the motion and certify its stops, in a worker thread."""

        def advance(share: float) -> None:
            if not self._stop_planning.is_set():
                self.progress = 0.3 * share

        try:
            made = plan(advance, self._stop_planning.is_set)
            task = self._task
            stops = ReadyStops.prepare(self._model, made.motion, task.guard, task.limits, self._stop_planning.is_set)
            self._arm.load(stops)
            self._planned.append((made, stops))
        except PoiseError as error:
            self._planned.append(error)
        except Exception as error:
            self._planned.append(PoiseError(ErrorCode.INTERNAL, f"planning failed: {error!r}"))

    def _await_plan(self, now: float) -> None:
        self._require_streams(now)
        if not self._planned:
            if now - self._since > self._options.planning:
                raise PoiseError(ErrorCode.DEADLINE, f"no motion was found within {self._options.planning:g} s")
            return
        planned = self._planned[0]
        if isinstance(planned, PoiseError):
            raise planned
        away = np.abs(self.joints.position - self._start)
        if away.max() > self._options.moved:
            name = self._model.joint_names[int(away.argmax())]
            raise PoiseError(
                ErrorCode.BUSY,
                f"{name} has moved by {away.max():.3f} while the motion was planned: stop the program that moves it",
            )
        self._estimator.begin()
        self.planned, stops = planned
        self._arm.move(stops, now)
        self._enter(SessionPhase.MOVING, now)

    def _watch(self, now: float) -> None:
        self._arm.check()
        self._require_streams(now)
        plan = self._the_plan()
        self._arm.require_on_path(self._options.off_path)
        seconds = self._arm.seconds
        self.progress = 0.3 + 0.6 * float(np.clip(seconds / plan.motion.duration, 0.0, 1.0))
        if seconds >= plan.motion.duration + self._options.settle:
            self._arm.ended()
            self._enter(SessionPhase.SETTLING, now)

    def _settle(self, now: float) -> None:
        """Wait until the last samples are in the window."""
        self.progress = 0.95
        end = self._arm.begin + round((self._the_plan().motion.duration + 0.8 * self._options.settle) * 1e9)
        if not self._estimator.settled(end) and now - self._since < self._options.patience:
            self._require_streams(now)
            return
        self._weigh(now)

    def _listen(self, now: float) -> None:
        self._require_streams(now)
        self.progress = min((now - self._since) / self._task.duration, 1.0)
        if self.progress >= 1.0:
            self._weigh(now)

    def _weigh(self, now: float) -> None:
        self.answer = self._estimator.estimate()
        self.progress = 1.0
        self._enter(SessionPhase.DONE, now)

    def _await_rest(self, now: float) -> None:
        self._stop(now)
        rests = self.joints.age(now) < self._options.stale and self.joints.at_rest()
        if rests and now - self._since > self._options.stop_lead:
            self._finish(now)
        elif now - self._since > self._options.stopping:
            failure = "" if not self._arm.moving else f"the stop could not be sent: {self._arm.failure!r}; "
            self._amend(f"{failure}the arm was not seen to come to rest")
            self._finish(now)

    def _finish(self, now: float) -> None:
        self._arm.ended()
        self._enter(SessionPhase.DONE, now)

    # -- problems -----------------------------------------------------------------------------------------------

    def _fail(self, error: PoiseError, now: float) -> None:
        self.error = error
        self._stop_planning.set()
        if self.planned is None or self.phase is SessionPhase.SETTLING:
            self._enter(SessionPhase.DONE, now)
            return
        self._enter(SessionPhase.STOPPING, now)
        self._stop(now)

    def _stop(self, now: float) -> None:
        """Send the next stop that is ready. If that fails, the next tick tries again."""
        if self._arm.stopped or self.error is None:
            return
        if self._arm.stop(self.error, now) and self._arm.excess:
            self._amend(f"no stop kept the limits: {self._arm.excess}")

    def _amend(self, remark: str) -> None:
        error = self.error or PoiseError(ErrorCode.CANCELLED, "")
        self.error = PoiseError(error.code, f"{error.message}; {remark}")

    def _silent(self, now: float) -> PoiseError | None:
        heard = self._estimator.heard()
        if heard is None:
            return SensorError(
                ErrorCode.TOPIC_MISSING, "no wrench has arrived: start the driver of the force-torque sensor"
            )
        if now - heard > self._options.stale:
            return SensorError(
                ErrorCode.SENSOR_STALE,
                f"the last wrench arrived {now - heard:.2f} s ago: check the sensor and its driver",
            )
        return None

    def _require_streams(self, now: float) -> None:
        if self._held_up.lately(now):
            return
        problem = self.joints.problem(now) or self._silent(now)
        if problem is not None:
            raise problem

    def _the_plan(self) -> ExcitationPlan:
        if self.planned is None:
            raise PoiseError(ErrorCode.INTERNAL, "a phase that needs a plan has none")
        return self.planned
