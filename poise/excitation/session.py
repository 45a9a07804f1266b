"""An identification from goal to answer: plans, moves, watches, weighs; stops the arm whenever something is wrong.

Knows nothing of ROS: joint states and the time go in, commands for the arm come out. Nothing in it waits: every phase
has a deadline, and `tick` returns at once.
"""

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike

from poise.errors import ErrorCode, PoiseError, SensorError
from poise.excitation.brake import ReadyStops
from poise.excitation.joint_watch import JointWatch
from poise.excitation.limits import Guard, MotionLimits
from poise.excitation.plan import ExcitationPlan
from poise.excitation.search import Cancelled, Progress
from poise.inertia import InertialEstimate
from poise.robot import RobotModel
from poise.simulation import WaypointTrajectory

PATIENCE = 2.0
"""s that joint states, wrenches, and an arm that stands still are waited for."""
STALE = 0.5
"""s without joint states or wrenches after which the arm is stopped."""
HELD_UP = 0.1
"""s between two ticks from which the process was held up, and messages wait that would prove the streams alive."""
PLANNING = 40.0
"""s that planning may take; the search has its own, shorter limit."""
LEAD = 0.15
"""s between sending a motion and its begin: it must have arrived by then."""
STOP_LEAD = 0.06
"""s, the same for a stop, which is urgent."""
SETTLE = 0.15
"""s of rest after the motion that still belong to it."""
MOVED = 0.01
"""rad or m: an arm that is farther from where its motion was planned from has been moved by somebody else."""
OFF_PATH, LAG = 0.03, 0.15
"""rad or m, and s of the joint's speed, that an arm may be off its path."""
STOPPING = 3.0
"""s that an arm may take to come to rest."""

Plan = Callable[[Progress, Cancelled], ExcitationPlan]


class Phase(Enum):
    """What an identification is doing."""

    WAITING = "waiting"
    PLANNING = "planning"
    MOVING = "moving"
    SETTLING = "settling"
    LISTENING = "listening"
    STOPPING = "stopping"
    DONE = "done"


class Scale(Protocol):
    """What weighs: an estimator with a window of samples."""

    def begin(self) -> None:
        """From here on."""

    def estimate(self) -> InertialEstimate:
        """Of the samples since.

        Raises:
            NoAnswerError: TOO_FEW_SAMPLES or NOT_IDENTIFIABLE.
        """

    def settled(self, stamp: int) -> bool:
        """All samples up to a stamp (ns) are in."""

    def heard(self) -> float | None:
        """When the last wrench came, s of the clock of `now`; None: never."""


class Command(NamedTuple):
    """A motion for the arm, to begin at `stamp` ns of the joint states' clock."""

    motion: WaypointTrajectory
    stamp: int


@dataclass(frozen=True)
class Task:
    """What is to be done.

    Args:
        plan: makes the motion from where the arm is; None: listen only, for `duration` s.
        guard, limits: what the motion and every stop keep to.
        duration: s to listen for.
    """

    plan: "Callable[[np.ndarray[tuple[int], np.dtype[np.float64]]], Plan] | None"
    guard: Guard
    limits: MotionLimits
    duration: float = 3.0


class Session:
    """One identification. Call `add_joint_state` as they come, `tick` some fifty times a second; then read `phase`,
    `progress`, and at the end (`Phase.DONE`) `error`, or `answer`.

    Args:
        model: the robot.
        task: what to do.
        scale: what weighs.
        send: hands a command to the arm.
        now: s of a clock that never goes back, the one of all calls.
    """

    def __init__(
        self, model: RobotModel, task: Task, scale: Scale, send: Callable[[Command], None], now: float
    ) -> None:
        self._model, self._task, self._scale, self._send = model, task, scale, send
        self.joints = JointWatch(model)
        self.phase, self.progress = Phase.WAITING, 0.0
        self.error: PoiseError | None = None
        self.answer: InertialEstimate | None = None
        self.planned: ExcitationPlan | None = None
        self._since = self._ticked = now
        self._trusting_until = now
        self._stop_planning = threading.Event()
        self._planned: list[tuple[ExcitationPlan, ReadyStops] | PoiseError] = []
        self._stops: ReadyStops | None = None
        self._stop_sent = False
        self._stop_failure: Exception | None = None
        self._begin = 0  # ns of the motion on the joint states' clock
        self._steps = {
            Phase.WAITING: self._wait,
            Phase.PLANNING: self._await_plan,
            Phase.MOVING: self._watch,
            Phase.SETTLING: self._settle,
            Phase.LISTENING: self._listen,
            Phase.STOPPING: self._await_rest,
        }

    def add_joint_state(self, stamp: int, names: Sequence[str], position: ArrayLike, now: float) -> None:
        """Take a joint state; another robot's is left out."""
        self.joints.add(stamp, names, position, now)

    def tick(self, now: float) -> None:
        """Go on; never blocks, never raises."""
        if self.phase is Phase.DONE:
            return
        if now - self._ticked > HELD_UP:
            self._trusting_until = now + STALE
        self._ticked = now
        try:
            self._steps[self.phase](now)
        except PoiseError as error:
            self._fail(error, now)
        except Exception as error:  # of ours; the arm has to stop all the same
            self._fail(PoiseError(ErrorCode.INTERNAL, f"identification: {error!r}"), now)

    def cancel(self, now: float, reason: str = "the goal was cancelled") -> None:
        """Stop the arm, then be done."""
        if self.phase not in (Phase.DONE, Phase.STOPPING):
            self._fail(PoiseError(ErrorCode.CANCELLED, reason), now)

    # -- phases ------------------------------------------------------------------------------------------------

    def _enter(self, phase: Phase, now: float) -> None:
        self.phase, self._since = phase, now

    def _wait(self, now: float) -> None:
        """For joint states, wrenches and, before a motion, an arm at rest."""
        late = now - self._since > PATIENCE
        problem = self.joints.problem(now) or self._silent(now)
        if problem is None and self._task.plan is not None and not self.joints.at_rest():
            problem = PoiseError(
                ErrorCode.BUSY, "the arm is moving: something else commands it; stop that, or ask for MOTION_NONE"
            )
        if problem is not None:
            if late:
                raise problem
            return
        if self._task.plan is None:
            self._scale.begin()
            self._enter(Phase.LISTENING, now)
            return
        self._start = self.joints.position.copy()
        plan = self._task.plan(self._start)
        threading.Thread(target=self._make_plan, args=(plan,), name="excitation", daemon=True).start()
        self._enter(Phase.PLANNING, now)

    def _make_plan(self, plan: Plan) -> None:
        """Plan the motion and certify its stops, in a worker thread."""

        def advance(share: float) -> None:
            if not self._stop_planning.is_set():
                self.progress = 0.3 * share

        try:
            made = plan(advance, self._stop_planning.is_set)
            task = self._task
            stops = ReadyStops.prepare(self._model, made.motion, task.guard, task.limits, self._stop_planning.is_set)
            self._planned.append((made, stops))
        except PoiseError as error:
            self._planned.append(error)
        except Exception as error:
            self._planned.append(PoiseError(ErrorCode.INTERNAL, f"planning failed: {error!r}"))

    def _await_plan(self, now: float) -> None:
        self._require_streams(now)
        if not self._planned:
            if now - self._since > PLANNING:
                raise PoiseError(ErrorCode.DEADLINE, f"no motion was found within {PLANNING:g} s")
            return
        planned = self._planned[0]
        if isinstance(planned, PoiseError):
            raise planned
        away = np.abs(self.joints.position - self._start)
        if away.max() > MOVED:
            name = self._model.joint_names[int(away.argmax())]
            raise PoiseError(
                ErrorCode.BUSY, f"{name} has moved by {away.max():.3f} while the motion was planned: stop what moves it"
            )
        self._scale.begin()
        self.planned, self._stops = planned
        self._begin = self.joints.clock(now) + round(LEAD * 1e9)
        self._send(Command(self.planned.motion, self._begin))
        self._enter(Phase.MOVING, now)

    def _watch(self, now: float) -> None:
        self._require_streams(now)
        plan = self._the_plan()
        seconds = (self.joints.stamp - self._begin) * 1e-9
        self._require_on_path(seconds)
        self.progress = 0.3 + 0.6 * float(np.clip(seconds / plan.motion.duration, 0.0, 1.0))
        if seconds >= plan.motion.duration + SETTLE:
            self._enter(Phase.SETTLING, now)

    def _settle(self, now: float) -> None:
        """Until the last samples are in."""
        self.progress = 0.95
        end = self._begin + round((self._the_plan().motion.duration + 0.8 * SETTLE) * 1e9)
        if not self._scale.settled(end) and now - self._since < PATIENCE:
            self._require_streams(now)
            return
        self._weigh(now)

    def _listen(self, now: float) -> None:
        self._require_streams(now)
        self.progress = min((now - self._since) / self._task.duration, 1.0)
        if self.progress >= 1.0:
            self._weigh(now)

    def _weigh(self, now: float) -> None:
        self.answer = self._scale.estimate()
        self.progress = 1.0
        self._enter(Phase.DONE, now)

    def _await_rest(self, now: float) -> None:
        if not self._stop_sent:
            self._try_to_stop(now)
        if self.joints.age(now) < STALE and now - self._since > STOP_LEAD and self.joints.at_rest():
            self._enter(Phase.DONE, now)
        elif now - self._since > STOPPING:
            failure = "" if self._stop_failure is None else f"the stop could not be sent: {self._stop_failure!r}; "
            self._amend(f"{failure}the arm was not seen to come to rest")
            self._enter(Phase.DONE, now)

    # -- what can go wrong ---------------------------------------------------------------------------------------

    def _fail(self, error: PoiseError, now: float) -> None:
        self.error = error
        self._stop_planning.set()
        if self.planned is None or self.phase is Phase.SETTLING:
            self._enter(Phase.DONE, now)
            return
        self._enter(Phase.STOPPING, now)
        self._try_to_stop(now)

    def _try_to_stop(self, now: float) -> None:
        """Send the next stop that is ready. If that fails, the next tick tries again."""
        if self._stops is None or self.error is None:
            return
        try:
            stamp = self.joints.clock(now) + round(STOP_LEAD * 1e9)
            stop = self._stops.after((stamp - self._begin) * 1e-9)
            self._send(Command(stop.motion, self._begin + round(stop.begin * 1e9)))
        except Exception as error:
            self._stop_failure = error
            return
        self._stop_sent = True
        if stop.excess:
            self._amend(f"no stop kept the limits: {stop.excess}")

    def _amend(self, remark: str) -> None:
        error = self.error or PoiseError(ErrorCode.CANCELLED, "")
        self.error = PoiseError(error.code, f"{error.message}; {remark}")

    def _silent(self, now: float) -> PoiseError | None:
        heard = self._scale.heard()
        if heard is None:
            return SensorError(ErrorCode.TOPIC_MISSING, "no wrench has come: start the force-torque sensor's driver")
        if now - heard > STALE:
            return SensorError(
                ErrorCode.SENSOR_STALE,
                f"the last wrench came {now - heard:.2f} s ago: the sensor has stopped, or is not read any more",
            )
        return None

    def _require_streams(self, now: float) -> None:
        if now < self._trusting_until:
            return
        problem = self.joints.problem(now) or self._silent(now)
        if problem is not None:
            raise problem

    def _require_on_path(self, seconds: float) -> None:
        motion = self._the_plan().motion.at(np.array([seconds]))
        off = np.abs(self.joints.position - motion.position[0])
        allowed = OFF_PATH + LAG * np.abs(motion.velocity[0])
        if (off > allowed).any():
            index = int(np.argmax(off - allowed))
            raise PoiseError(
                ErrorCode.NOT_FOLLOWING,
                f"{self._model.joint_names[index]} is {off[index]:.3f} off its path {seconds:.2f} s into the motion:"
                " is its controller active, and does it listen to joint_trajectory?",
            )

    def _the_plan(self) -> ExcitationPlan:
        if self.planned is None:
            raise PoiseError(ErrorCode.INTERNAL, "there is no plan in a phase that needs one")
        return self.planned
