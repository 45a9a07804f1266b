"""What stops a motion without regard to what its program computes: silence, speed, force, a program that hangs."""

from bisect import bisect_left
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from poise.errors import ErrorCode, PoiseError, SensorError
from poise.types import Array

_SPAN = 0.05
"""s over which a joint's speed is measured."""
_LEAST_SPEED = 0.1
"""rad/s or m/s: 5 mrad of encoder noise in that span; slower joints are not too fast."""
_DELAYED = 0.1
"""s between two looks that show that the watch itself was delayed; the messages that wait have to be read first."""


@dataclass(frozen=True)
class WatchLimits:
    """When a motion is stopped.

    Args:
        silence: s without joint states, or without wrenches where they are needed.
        unattended: s without a sign of life of the program that commanded the motion.
        over_speed: times the largest planned speed of a joint.
        force: N of change of the force since the motion was commanded; 0: no limit. A limit needs wrenches.
        lead: s between sending a stop and its begin.
        needs_wrench: the motion is stopped when wrenches do not come.
    """

    silence: float = 0.5
    unattended: float = 5.0
    over_speed: float = 1.5
    force: float = 0.0
    lead: float = 0.06
    needs_wrench: bool = False

    @property
    def wrenches(self) -> bool:
        """No motion without wrenches."""
        return self.needs_wrench or self.force > 0.0


class WatchedStop(NamedTuple):
    """The stop to send.

    Args:
        number: of the stop among those of the motion.
        stamp: ns of the joint states' clock at which it begins.
    """

    number: int
    stamp: int


class MotionWatch:
    """Watches one motion at a time; `problem` says why it must be stopped, `stop` which stop comes next.

    All times `now` are s of one monotonic clock.

    Args:
        names: of the joints (J).
        limits: when to stop.
        now: s.
    """

    def __init__(self, names: Sequence[str], limits: WatchLimits, now: float) -> None:
        self._names, self.limits = tuple(names), limits
        self._heard: float | None = None
        self._wrench_heard: float | None = None
        self._force: Array | None = None
        self._offsets: deque[tuple[float, float]] = deque(maxlen=200)  # s: when it came, stamp minus that
        self._places: deque[tuple[float, Array]] = deque()
        self._beat = self._looked = self._trusting_until = now
        self._begins: Sequence[float] = ()
        self._fastest: Array = np.full(len(self._names), np.inf)
        self._begin = 0
        self._force_before: Array | None = None
        self.armed = False

    # -- what is heard ------------------------------------------------------------------------------------------

    @property
    def ready(self) -> bool:
        """Everything that a motion needs is heard."""
        return self._heard is not None and (self._wrench_heard is not None or not self.limits.wrenches)

    def joint_state(self, stamp: int, positions: Mapping[str, float], now: float) -> bool:
        """Take a joint state: ns, position of each joint by name; False: it is of another robot."""
        if not all(name in positions for name in self._names):
            return False
        self._heard = now
        values = np.array([positions[name] for name in self._names])
        seconds = stamp * 1e-9
        self._offsets.append((now, seconds - now))
        if self._places and seconds <= self._places[-1][0]:
            self._places.clear()  # late, or the clock was set
        self._places.append((seconds, values))
        while seconds - self._places[0][0] > 2 * _SPAN:
            self._places.popleft()
        return True

    def wrench(self, force: Sequence[float], now: float) -> None:
        """Take a force (3,) N."""
        self._wrench_heard, self._force = now, np.array(force)

    def beat(self, now: float) -> None:
        """The program is alive."""
        self._beat = now

    # -- a motion -----------------------------------------------------------------------------------------------

    def arm(self, begins: Sequence[float], fastest: Sequence[float], begin: int, now: float) -> None:
        """A motion is commanded.

        Args:
            begins: s of the motion at which its stops begin, ascending; the last one is its end.
            fastest: (J,) rad/s or m/s, the largest speed of each joint.
            begin: ns of the motion on the joint states' clock.
            now: s.
        """
        self._begins, self._begin = begins, begin
        self._fastest = np.maximum(self.limits.over_speed * np.array(fastest), _LEAST_SPEED)
        self._force_before = self._force
        self._beat = self._looked = now
        self.armed = True

    def disarm(self) -> None:
        """The motion has ended, or was stopped."""
        self.armed = False

    def problem(self, now: float) -> PoiseError | None:
        """Why the motion has to stop now; None: it may go on."""
        if now - self._looked > _DELAYED:
            self._trusting_until = now + _DELAYED
        self._looked = now
        if not self.armed:
            return None
        return self._silence(now) or self._too_fast() or self._too_strong()

    def _silence(self, now: float) -> PoiseError | None:
        if now < self._trusting_until:
            return None
        limits = self.limits
        for what, heard in (("joint state", self._heard), ("wrench", self._wrench_heard)):
            if what == "wrench" and not limits.wrenches:
                continue
            age = np.inf if heard is None else now - heard
            if age > limits.silence:
                return SensorError(
                    ErrorCode.SENSOR_STALE, f"the last {what} arrived {age:.2f} s ago: its driver has stopped"
                )
        if now - self._beat > limits.unattended:
            return PoiseError(
                ErrorCode.INTERNAL, f"the program did not supervise the motion for {now - self._beat:.2f} s"
            )
        return None

    def _too_fast(self) -> PoiseError | None:
        places = [one for one in self._places if one[0] >= self._begin * 1e-9]  # the motion before may have been faster
        if len(places) < 2:
            return None
        newest, values = places[-1]
        before, place = next((one for one in reversed(places) if newest - one[0] >= _SPAN), places[0])
        # At first less than the span has passed: noise over a shorter time would look fast, a jump does not hide in it.
        speed = np.abs(values - place) / max(newest - before, _SPAN)
        over = speed / self._fastest
        index = int(np.argmax(over))
        if not over[index] > 1.0:
            return None
        return PoiseError(
            ErrorCode.NOT_FOLLOWING,
            f"{self._names[index]} moves at {speed[index]:.3g}, above {self._fastest[index]:.3g} rad/s or m/s, the"
            " largest that its motion allows",
        )

    def _too_strong(self) -> PoiseError | None:
        if not self.limits.force or self._force is None:
            return None
        if self._force_before is None:
            self._force_before = self._force
        change = float(np.linalg.norm(self._force - self._force_before))
        if change <= self.limits.force:
            return None
        return PoiseError(
            ErrorCode.IN_CONTACT,
            f"the force changed by {change:.3g} N during the motion; {self.limits.force:g} N are allowed (stop_force)",
        )

    def stop(self, now: float) -> WatchedStop:
        """The next stop that is ready; before and after the motion the one that holds its first or last pose."""
        offset = max((offset for came, offset in self._offsets if now - came < 2.0), default=None)
        if offset is None:
            offset = self._offsets[-1][1] if self._offsets else self._begin * 1e-9 - now
        stamp = round((now + offset + self.limits.lead) * 1e9)
        at = (stamp - self._begin) * 1e-9
        if not 0.0 < at < self._begins[-1]:
            return WatchedStop(0 if at <= 0.0 else len(self._begins) - 1, stamp)
        index = bisect_left(self._begins, at)
        return WatchedStop(index, self._begin + round(self._begins[index] * 1e9))
