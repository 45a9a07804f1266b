"""An arm that is only moved with its stops ready: the motion, who watches it, and the stop that ends it."""

import time
from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np

from poise.errors import ErrorCode, NoAnswerError, PoiseError
from poise.excitation.execution.joint_watch import JointWatch
from poise.excitation.execution.options import DEFAULT_EXECUTION, ExecutionOptions
from poise.excitation.execution.stops import ReadyStops
from poise.simulation import WaypointTrajectory
from poise.types import Array

NOT_WATCHED = (
    "the watchdog of the arm's motion is not ready: check joint_states, and wrench where stop_force is set; send the"
    " goal again"
)
"""Message of a goal that cannot begin."""


class TimedMotion(NamedTuple):
    """A motion for the arm that begins at `stamp` ns of the joint states' clock."""

    motion: WaypointTrajectory
    stamp: int


class SentStop(NamedTuple):
    """A stop that a watchdog has sent.

    Args:
        error: why.
        excess: which limits it exceeds, in words.
    """

    error: PoiseError
    excess: str


class Watchdog(Protocol):
    """Sends the stop of a motion by itself, also while the program that commanded the motion is busy."""

    @property
    def ready(self) -> bool:
        """It hears what it needs, and may be given a motion."""

    def load(self, stops: ReadyStops) -> None:
        """Take the stops of a motion ahead; may take long, for worker threads."""

    def arm(self, stops: ReadyStops, begin: int) -> bool:
        """The motion of these stops begins at `begin` ns: stop it when something is wrong; False: not in time.

        Raises:
            PoiseError: it will not watch this motion, which must not be sent.
        """

    def beat(self) -> None:
        """The program is alive."""

    def trip(self, error: PoiseError) -> bool:
        """Send the stop at once; False: it cannot be done."""

    def disarm(self) -> None:
        """The motion has ended, or was stopped: send no stop from here on."""

    @property
    def sent(self) -> SentStop | None:
        """The stop of a motion of this goal, once it has been sent; no other motion may follow."""

    @property
    def alive(self) -> bool:
        """It can still stop the motion."""


class CommandedArm:
    """Commands motions to an arm. No motion is sent before its stops are ready; a stop is looked up, not computed.

    Args:
        joints: of the arm.
        send: sends a command to the arm's controller.
        watchdog: stops the arm when this program cannot; None: only this program does.
        options: times.
    """

    def __init__(
        self,
        joints: JointWatch,
        send: Callable[[TimedMotion], None],
        watchdog: Watchdog | None = None,
        options: ExecutionOptions = DEFAULT_EXECUTION,
    ) -> None:
        self._joints, self._send, self._watchdog, self._options = joints, send, watchdog, options
        self._stops: ReadyStops | None = None
        self._asked: float | None = None
        self.begin = 0
        """ns of the motion on the joint states' clock."""
        self.stopped = False
        """A stop was sent."""
        self.failure: Exception | None = None
        """Of the last stop that could not be sent."""
        self.excess = ""
        """Limits that the stop exceeds, in words."""

    @property
    def ready(self) -> bool:
        """A motion may be sent."""
        return self._watchdog is None or self._watchdog.ready

    @property
    def asked(self) -> bool:
        """The watchdog was asked for a stop and can still send it."""
        return self._asked is not None and self._watchdog is not None and self._watchdog.alive

    @property
    def moving(self) -> bool:
        """A motion was sent that was not stopped, and has not been reported as ended."""
        return self._stops is not None and not self.stopped

    def load(self, stops: ReadyStops) -> None:
        """Hand the stops of a motion over ahead; may take long, for worker threads."""
        if self._watchdog is not None:
            self._watchdog.load(stops)

    def move(self, stops: ReadyStops, now: float) -> None:
        """Send the motion of these stops. If that raises, there is no motion, and nothing to stop.

        Raises:
            PoiseError: the watchdog does not watch it.
            Exception: of the publisher.
        """
        self._stops, self._asked, self.stopped, self.excess, self.failure = None, None, False, "", None
        try:
            self._arm(stops, now)
            self._send(TimedMotion(stops.motion, self.begin))
        except Exception:
            self.ended()
            raise
        self._stops = stops

    def _arm(self, stops: ReadyStops, now: float) -> None:
        """Choose when the motion begins, and have it watched; a watchdog that is late is asked again."""
        since = time.monotonic()
        while (waited := time.monotonic() - since) < self._options.arming:
            self.begin = self._joints.clock(now + waited) + round(self._options.lead * 1e9)
            if self._watchdog is None or self._watchdog.arm(stops, self.begin):
                return
        raise PoiseError(
            ErrorCode.INTERNAL,
            f"the watchdog did not answer for {waited:.2f} s: the machine is overloaded; send the goal again",
        )

    def check(self) -> None:
        """Call it with every tick of a motion.

        Raises:
            PoiseError: the watchdog has stopped the arm, and why; or it can no longer do so.
        """
        watchdog = self._watchdog
        if watchdog is None:
            return
        if watchdog.sent is not None:  # perhaps of a motion that has ended since
            self._take(watchdog.sent)
            raise watchdog.sent.error
        if not self.moving:
            return
        watchdog.beat()
        if not watchdog.alive:
            raise PoiseError(ErrorCode.INTERNAL, "the watchdog of the motion has ended")

    @property
    def seconds(self) -> float:
        """s since the begin of the motion, when the newest joint state was measured."""
        return (self._joints.stamp - self.begin) * 1e-9

    def require_on_path(self, tolerance: float, name: str = "its path") -> None:
        """The arm is where the motion has it now, up to a tolerance (rad or m) and what it covers in `lag`.

        Raises:
            NoAnswerError: NOT_FOLLOWING.
        """
        self._require_near(self.seconds, tolerance, f"{name} {self.seconds:.2f} s into the motion")

    def arrived(self, tolerance: float, slack: float, name: str) -> bool:
        """The motion has ended, and the arm is at its end up to a tolerance (rad or m).

        Raises:
            NoAnswerError: NOT_FOLLOWING when it is not there `slack` s after that.
        """
        over = self.seconds - self._motion.duration
        if over < 0:
            return False
        try:
            self._require_near(self._motion.duration, tolerance, f"the end of {name}")
        except NoAnswerError:
            if over > slack:
                raise
            return False
        return True

    @property
    def _motion(self) -> WaypointTrajectory:
        if self._stops is None:
            raise PoiseError(ErrorCode.INTERNAL, "no motion was sent")
        return self._stops.motion

    def _require_near(self, at: float, tolerance: float, where: str) -> None:
        there = self._motion.at(np.array([at]))
        off: Array = np.abs(self._joints.position - there.position[0])
        beyond = off - tolerance - self._options.lag * np.abs(there.velocity[0])
        index = int(np.argmax(beyond))
        if not beyond[index] <= 0:
            raise NoAnswerError(
                ErrorCode.NOT_FOLLOWING,
                f"{self._joints.names[index]} is {off[index]:.3f} off {where}: check that its controller is active and"
                " subscribes to joint_trajectory, and that commands arrive within motion_lead",
            )

    def ended(self) -> None:
        """The motion is over, and the arm at rest."""
        self._stops = None
        if self._watchdog is not None:
            self._watchdog.disarm()

    def stop(self, error: PoiseError, now: float) -> bool:
        """Send the next stop that is ready, through the watchdog where there is one; False: try again.

        Without an answer of the watchdog, the second call sends the stop itself. Never raises.
        """
        stops = self._stops
        if stops is None or self.stopped or self._stopped_by_watchdog(error, now):
            return True
        if self.asked and self._asked is not None and now - self._asked < self._options.answer:
            return False
        try:
            stamp = self._joints.clock(now) + round(self._options.stop_lead * 1e9)
            stop = stops.after((stamp - self.begin) * 1e-9)
            self._send(TimedMotion(stop.motion, self.begin + round(stop.begin * 1e9)))
        except Exception as failure:
            self.failure = failure
            return False
        self._replace(stop.excess)
        return True

    def hold(self, error: PoiseError, now: float) -> bool:
        """Stop where the arm is now, off its path; False: try again. Never raises.

        If that cannot be sent, the watchdog is asked for its stop.
        """
        if self._stops is None or self.stopped:
            return True
        try:
            stamp = self._joints.clock(now) + round(self._options.stop_lead * 1e9)
            place = np.stack([self._joints.position] * 2)
            self._send(TimedMotion(WaypointTrajectory(np.array([0.0, self._options.holding]), place), stamp))
        except Exception as failure:
            self.failure = failure
            return self._stopped_by_watchdog(error, now)
        self._replace("")
        return True

    def _stopped_by_watchdog(self, error: PoiseError, now: float) -> bool:
        """Whether the watchdog has stopped the arm; if not, it is asked to."""
        watchdog = self._watchdog
        if watchdog is None:
            return False
        if watchdog.sent is not None:
            self._take(watchdog.sent)
            return True
        if self._asked is None and watchdog.alive and watchdog.trip(error):
            self._asked = now
        return False

    def _replace(self, excess: str) -> None:
        """Our stop was sent: a watchdog that is late must not send another."""
        self.stopped, self.excess = True, excess
        if self._watchdog is not None:
            self._watchdog.disarm()

    def _take(self, sent: SentStop) -> None:
        self.stopped, self.excess = True, sent.excess
