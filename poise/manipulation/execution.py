"""Carries out a transfer: commands arm and fingers step by step, supervises them, and stops the arm on an error.

Knows nothing of ROS: joint states and the time go in, commands come out. Nothing in it waits: `tick` returns at once.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from poise.errors import ErrorCode, NoAnswerError, PoiseError, SensorError
from poise.excitation.execution import (
    DEFAULT_EXECUTION,
    NOT_WATCHED,
    CommandedArm,
    ExecutionOptions,
    HeldUp,
    Jointed,
    JointWatch,
    ReadyStops,
    Watchdog,
)
from poise.manipulation.carrying import Transfer, TransferPhase
from poise.manipulation.gripper import FingerWatch, Grip, Gripper
from poise.simulation import WaypointTrajectory
from poise.types import Array

_STAGES = {"carry": "carrying", "lower": "placing", "retreat": "placing", "return": "placing"}
"""Of the phases of a transfer; those before are picking."""
_STOP_TIME = 0.4
"""s in which the arm stops; longer when what it holds would slip."""


class TransferStep(NamedTuple):
    """One thing to do, then to wait for.

    Args:
        name: of the phase.
        motion: of the arm, from rest to rest; None: the fingers move.
        opening: m, of the fingers.
        holding: the object is in the hand.
        stop_time: s that a stop takes where none is ready.
        stops: of the motion, chosen ahead; None: they are chosen when the transfer begins, without regard to limits.
    """

    name: str
    motion: WaypointTrajectory | None
    opening: float
    holding: bool
    stop_time: float = _STOP_TIME
    stops: ReadyStops | None = None

    @property
    def stage(self) -> str:
        """The stage of the goal, as feedback names it."""
        return _STAGES.get(self.name, "picking")


def steps_of(transfer: Transfer, speed: float) -> tuple[TransferStep, ...]:
    """What a transfer takes: the fingers move before the phases that want them elsewhere, each phase is one motion.

    Args:
        transfer: the plan.
        speed: m/s of the tool, at most; a stop from it must not shake off what is held.
    """
    steps = steps_of_phases(transfer.phases, transfer.ends.hold, speed)
    # What is held already is not grasped again: fingers that it keeps open would not arrive.
    return steps[1:] if transfer.phases[0].holding else steps


def steps_of_phases(phases: Sequence[TransferPhase], hold: float, speed: float) -> tuple[TransferStep, ...]:
    """As `steps_of`, of phases whose grip withstands `hold`, m/s2."""
    steps: list[TransferStep] = []
    for phase in phases:
        if not steps or (phase.opening, phase.holding) != (steps[-1].opening, steps[-1].holding):
            steps.append(TransferStep(phase.name, None, phase.opening, phase.holding))
        if phase.motions:
            # Time slows down as 1 - 3 u^2 + 2 u^3, at 1.5 / stop_time at most.
            gently = max(_STOP_TIME, 1.5 * speed / hold) if phase.holding else _STOP_TIME
            steps.append(TransferStep(phase.name, joined(phase.motions), phase.opening, phase.holding, gently))
    return tuple(steps)


def joined(motions: Sequence[WaypointTrajectory]) -> WaypointTrajectory:
    """Motions from rest to rest, one after another, as one."""
    begins = np.cumsum([0.0, *(motion.duration for motion in motions[:-1])])
    times = [begin + motion.times[1:] for begin, motion in zip(begins, motions, strict=True)]
    rows = [
        np.concatenate([getattr(motions[0], name)[:1], *(getattr(motion, name)[1:] for motion in motions)])
        for name in ("position", "velocity", "acceleration")
    ]
    return WaypointTrajectory(np.concatenate([[0.0], *times]), *rows)


@dataclass(frozen=True)
class Tolerances:
    """How well a robot has to follow.

    Args:
        arrival: rad or m that a joint may be off the end of a motion.
        path: rad or m that it may be off its path, besides what it covers in 0.15 s.
        slack: s that arm and fingers may take longer than they should.
    """

    arrival: float = 0.003
    path: float = 0.05
    slack: float = 2.0


class RobotPort:
    """The state of an arm and its fingers from joint states, and the two commands that they take.

    Args:
        arm: whose joints.
        gripper: its hand's.
        move: takes a motion of the arm and its begin, ns of the joint states' clock.
        grip: takes a position of the gripper's joint.
        watchdog: stops the arm when this program cannot; None: only this program does.
        options: times.
    """

    def __init__(
        self,
        arm: Jointed,
        gripper: Gripper,
        move: Callable[[WaypointTrajectory, int], None],
        grip: Callable[[float], None],
        watchdog: Watchdog | None = None,
        options: ExecutionOptions = DEFAULT_EXECUTION,
    ) -> None:
        self.joint_names, self.gripper, self.move, self.grip = arm.joint_names, gripper, move, grip
        self.options = options
        self.joints, self.fingers = JointWatch(arm, options.stale), FingerWatch(gripper)
        self.commanded = CommandedArm(self.joints, lambda command: self.move(*command), watchdog, options)

    def add_joint_state(self, stamp: int, names: Sequence[str], position: ArrayLike, now: float) -> None:
        """Take a joint state; arm and gripper may have their own."""
        self.fingers.add(names, position, now)
        self.joints.add(stamp, names, position, now)

    def rests_at(self, now: float, since: float) -> Array | None:
        """(J,) where the arm rests; None while that is not known, for a short while after `since`, s.

        Raises:
            PoiseError: TOPIC_MISSING, JOINT_MISSING, SENSOR_STALE; BUSY when it moves.
        """
        problem = self.joints.problem(now)
        if problem is None and not self.joints.at_rest():
            problem = PoiseError(ErrorCode.BUSY, "the arm is moving: something else commands it; stop that")
        if problem is None and not self.commanded.ready:
            problem = PoiseError(ErrorCode.BUSY, NOT_WATCHED)
        if problem is None:
            return self.joints.position.copy()
        if now - since > self.options.patience:
            raise problem
        return None


class TransferExecution:
    """One transfer. Call `tick` some fifty times a second until `done`; then there is an `error`, or all went well.

    Args:
        name: of the object.
        steps: what to do.
        robot: takes the commands and the joint states.
        tolerances: how well it has to follow.
        now: s of a clock that never goes back, the one of all calls.
        held: how the fingers have closed on the object before, when it is in the hand; None: not known.

    Fingers that close through what they hold while the arm moves stop the arm: NOT_HELD. Nothing is checked where
    it is not known how they hold it, or where they closed about as far as they were commanded, as on foam.
    """

    def __init__(
        self,
        name: str,
        steps: Sequence[TransferStep],
        robot: RobotPort,
        tolerances: Tolerances,
        now: float,
        held: Grip | None = None,
    ) -> None:
        self._name, self._robot, self._tolerances = name, robot, tolerances
        self._left = [_ready(step) for step in steps]
        self._start = next(step.motion.position[0] for step in steps if step.motion is not None)
        self._step: TransferStep | None = None
        self._since, self._held_up = now, HeldUp(now, robot.options)
        self._sent = 0  # ns on the joint states' clock when the motion was sent
        self._gripped: float | None = None  # where the fingers were when they were commanded to move
        self._felt = robot.fingers.position is not None
        self.held = held
        self.stage, self.done = steps[0].stage, False
        self.grip: bool | None = None  # whether the fingers have closed, or opened, last; None: not moved
        self.dropped = False
        self.error: PoiseError | None = None

    def tick(self, now: float) -> None:
        """Go on; never blocks, never raises."""
        if self.done:
            return
        self._held_up.tick(now)
        if self.error is not None:
            self._stop(self.error, now)
            return
        try:
            self._robot.commanded.check()
            if not self._held_up.lately(now) and (problem := self._robot.joints.problem(now)) is not None:
                raise problem
            if self._step is None:
                self._require_start()
                self._require_held(self._left[0])
                self._next(now)
            elif self._arrived(self._step, now):
                self._next(now)
        except PoiseError as error:
            self._fail(error, now)
        except Exception as error:  # of ours; the arm has to stop all the same
            self._fail(PoiseError(ErrorCode.INTERNAL, f"internal error: {error!r}; please report it"), now)

    def cancel(self, now: float) -> None:
        """Command the arm to stop, and end."""
        if not self.done and self.error is None:
            words = f"the arm stopped while {self.stage} {self._name}; {self._hand}"
            self._conclude(PoiseError(ErrorCode.CANCELLED, words), now)

    # -- step by step ------------------------------------------------------------------------------------------

    def _require_start(self) -> None:
        away = np.abs(self._robot.joints.position - self._start)
        if away.max() > self._robot.options.moved:
            name = self._robot.joint_names[int(away.argmax())]
            raise PoiseError(
                ErrorCode.BUSY, f"{name} has moved by {away.max():.3f} while the way was planned: stop what moves it"
            )

    def _require_held(self, step: TransferStep) -> None:
        if step.motion is None or not step.holding or self.held is None:
            return
        fingers = self._robot.fingers
        if fingers.shows(self.held) and fingers.closed_through(self.held):
            self.dropped = True
            raise NoAnswerError(ErrorCode.NOT_HELD, f"the fingers closed: {self._name} is no longer between them")

    def _next(self, now: float) -> None:
        self._robot.commanded.ended()
        if self._step is not None and self._step.motion is None:
            self.grip = self._step.holding
            self.held = self._robot.fingers.grip(self._target(self._step)) if self.grip else None
        if not self._left:
            self.done = True
            return
        self._step = step = self._left.pop(0)
        self.stage, self._since = step.stage, now
        if step.motion is None:
            self._gripped = self._robot.fingers.position
            self._robot.grip(self._target(step))
        else:
            self._sent = self._robot.joints.stamp
            self._robot.commanded.move(_stops_of(step), now)

    def _target(self, step: TransferStep) -> float:
        return self._robot.gripper.position(step.opening, step.holding)

    def _arrived(self, step: TransferStep, now: float) -> bool:
        if step.motion is None:
            return self._fingers_arrived(step, now)
        self._require_held(step)
        return self._arm_arrived(step.name, step.motion)

    def _arm_arrived(self, name: str, motion: WaypointTrajectory) -> bool:
        arm, joints, tolerances = self._robot.commanded, self._robot.joints, self._tolerances
        if joints.stamp < self._sent:
            raise SensorError(
                ErrorCode.SENSOR_STALE,
                f"the clock of joint_states was set back during {name}: fix that clock and send the goal again",
            )
        if arm.arrived(tolerances.arrival, tolerances.slack, name):
            return True
        if arm.seconds < motion.duration:
            arm.require_on_path(tolerances.path, f"its path of {name}")
        return False

    def _fingers_arrived(self, step: TransferStep, now: float) -> bool:
        fingers, gripper, waited = self._robot.fingers, self._robot.gripper, now - self._since
        if not self._felt:
            return waited > gripper.seconds
        if not self._held_up.lately(now) and now - fingers.heard > self._robot.options.stale:
            raise SensorError(
                ErrorCode.SENSOR_STALE, f"{gripper.joint} has gone from joint_states: the gripper's driver has stopped"
            )
        there = fingers.near(self._target(step))
        # What is grasped stops the fingers on their way.
        grasped = step.holding and waited > gripper.seconds and fingers.moved(self._gripped)
        if fingers.stopped(now) and (there or grasped):
            return True
        if waited > gripper.seconds + self._tolerances.slack:
            blocked = "" if step.holding else "is something between the fingers, "
            raise NoAnswerError(
                ErrorCode.NOT_FOLLOWING,
                f"{gripper.joint} is at {fingers.position:.3f} and was commanded to {self._target(step):.3f}: {blocked}"
                "is the gripper's controller active, and does it listen to gripper_trajectory",
            )
        return False

    # -- what can go wrong ---------------------------------------------------------------------------------------

    @property
    def _hand(self) -> str:
        step = self._step
        if self.dropped:
            return "its hand is empty"
        if step is None:  # what begins with a motion that holds does hold
            holds = bool(self._left) and self._left[0].motion is not None and self._left[0].holding
            return "it still holds it" if holds else "its hand is empty"
        if step.motion is None:
            return f"its fingers were {'closing' if step.holding else 'opening'}"
        return "it still holds it" if step.holding else "its hand is empty"

    def _fail(self, error: PoiseError, now: float) -> None:
        if error.code is ErrorCode.CANCELLED:  # the watchdog heard of it first
            self.cancel(now)
            return
        state = "was commanded to stop" if self._robot.commanded.moving or self._robot.commanded.stopped else "rests"
        words = f"{error.message}; the arm {state} while {self.stage} {self._name}, and {self._hand}"
        self._conclude(PoiseError(error.code, words), now)

    def _conclude(self, error: PoiseError, now: float) -> None:
        self.error, self._since = error, now
        self._stop(error, now)

    def _stop(self, error: PoiseError, now: float) -> None:
        """Stop along the path, which is free, or in place when the arm is off it or that fails; then it is done.

        Never raises. An arm at rest gets no command.
        """
        arm = self._robot.commanded
        if arm.moving:
            off_path = error.code is ErrorCode.NOT_FOLLOWING
            sent = arm.hold(error, now) if off_path else arm.stop(error, now)
            if not sent and arm.failure is not None:
                sent = arm.hold(error, now)
            if not sent and arm.asked and now - self._since < self._robot.options.stopping:
                return
            if not sent:
                error = PoiseError(error.code, f"{error.message}; the stop could not be sent: {arm.failure!r}")
        if arm.excess:
            error = PoiseError(error.code, f"{error.message}; no stop kept the limits: {arm.excess}")
        arm.ended()
        self.error, self.done = error, True


def _ready(step: TransferStep) -> TransferStep:
    if step.motion is None or step.stops is not None:
        return step
    return step._replace(stops=ReadyStops.judged(step.motion, lambda *_: "", (step.stop_time,)))


def _stops_of(step: TransferStep) -> ReadyStops:
    if step.stops is None:
        raise PoiseError(ErrorCode.INTERNAL, f"the motion {step.name} has no stops")
    return step.stops
