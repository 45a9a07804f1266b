"""An arm that is only moved with its stops ready: the motion, who watches it, and the stop that ends it."""

from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np

from poise.errors import ErrorCode, PoiseError
from poise.excitation.execution.joint_watch import JointWatch
from poise.excitation.execution.options import ExecutionOptions
from poise.excitation.execution.stops import ReadyStops
from poise.simulation import WaypointTrajectory

_OPTIONS = ExecutionOptions()


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

    def arm(self, stops: ReadyStops, begin: int) -> None:
        """The motion of these stops begins at `begin` ns: stop it when something is wrong."""

    def beat(self) -> None:
        """The program is alive."""

    def trip(self, error: PoiseError) -> bool:
        """Send the stop at once; False: it cannot be done."""

    def disarm(self) -> None:
        """The motion has ended."""

    @property
    def sent(self) -> SentStop | None:
        """The stop of the motion, once it has been sent."""

    @property
    def alive(self) -> bool:
        """It can still stop the motion."""


class CommandedArm:
    """Commands motions to an arm. No motion is sent before its stops are ready; a stop is looked up, not computed.

    Args:
        joints: of the arm.
        send: sends a command to the arm's controller.
        watchdog: stops the arm when this program cannot; None: only this program does.
    """

    def __init__(
        self, joints: JointWatch, send: Callable[[TimedMotion], None], watchdog: Watchdog | None = None
    ) -> None:
        self._joints, self._send, self._watchdog = joints, send, watchdog
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
    def moving(self) -> bool:
        """A motion was sent that was not stopped, and has not been reported as ended."""
        return self._stops is not None and not self.stopped

    def load(self, stops: ReadyStops) -> None:
        """Hand the stops of a motion over ahead; may take long, for worker threads."""
        if self._watchdog is not None:
            self._watchdog.load(stops)

    def move(self, stops: ReadyStops, now: float) -> None:
        """Send the motion of these stops.

        Raises:
            Exception: of the publisher.
        """
        self._stops, self._asked, self.stopped, self.excess = stops, None, False, ""
        self.begin = self._joints.clock(now) + round(_OPTIONS.lead * 1e9)
        if self._watchdog is not None:
            self._watchdog.arm(stops, self.begin)
        self._send(TimedMotion(stops.motion, self.begin))

    def check(self) -> None:
        """Call it with every tick of a motion.

        Raises:
            PoiseError: the watchdog has stopped the arm, and why; or it can no longer do so.
        """
        watchdog = self._watchdog
        if watchdog is None or not self.moving:
            return
        watchdog.beat()
        if watchdog.sent is not None:
            self._take(watchdog.sent)
            raise watchdog.sent.error
        if not watchdog.alive:
            raise PoiseError(ErrorCode.INTERNAL, "the watchdog of the motion has ended")

    def ended(self) -> None:
        """The motion is over, and the arm at rest."""
        self._stops = None
        if self._watchdog is not None:
            self._watchdog.disarm()

    def stop(self, error: PoiseError, now: float) -> bool:
        """Send the next stop that is ready, through the watchdog where there is one; False: try again.

        Without an answer of the watchdog, the second call sends the stop itself. Never raises.
        """
        stops, watchdog = self._stops, self._watchdog
        if stops is None or self.stopped:
            return True
        if watchdog is not None and watchdog.alive:
            if watchdog.sent is not None:
                self._take(watchdog.sent)
                return True
            if self._asked is None and watchdog.trip(error):
                self._asked = now
            if self._asked is not None and now - self._asked < _OPTIONS.answer:
                return False
        try:
            stamp = self._joints.clock(now) + round(_OPTIONS.stop_lead * 1e9)
            stop = stops.after((stamp - self.begin) * 1e-9)
            self._send(TimedMotion(stop.motion, self.begin + round(stop.begin * 1e9)))
        except Exception as failure:
            self.failure = failure
            return False
        self.stopped, self.excess = True, stop.excess
        return True

    def hold(self, now: float) -> bool:
        """Stop where the arm is now, off its path; False: it could not be sent. Never raises."""
        if self._stops is None or self.stopped:
            return True
        if self._watchdog is not None:
            self._watchdog.disarm()
        try:
            stamp = self._joints.clock(now) + round(_OPTIONS.stop_lead * 1e9)
            place = np.stack([self._joints.position] * 2)
            self._send(TimedMotion(WaypointTrajectory(np.array([0.0, _OPTIONS.holding]), place), stamp))
        except Exception as failure:
            self.failure = failure
            return False
        self.stopped = True
        return True

    def _take(self, sent: SentStop) -> None:
        self.stopped, self.excess = True, sent.excess
