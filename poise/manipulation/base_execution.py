"""Carries out a base motion: velocity commands whose accelerations stay below the limits, also when it stops.

Knows nothing of ROS; `tick` gives the command of the moment.
"""

from collections import deque
from dataclasses import dataclass

import numpy as np

from poise.errors import ErrorCode, NoAnswerError, PoiseError, SensorError
from poise.manipulation.base_motion import BaseDrive, BaseLimits, in_base
from poise.types import Array

_STALE = 0.5
"""s without odometry after which it stops."""
_GAIN = 1.0
"""1/s, of the correction of the position."""
_ASIDE, _BRAKING = 0.1, 0.1
"""Shares of what may be used: for what the leg does not do, a turn or a way; and of a turn, for coming to rest."""
_AT_REST = 1e-3
"""m/s and rad/s of the command at which it stops at once."""
_LONGEST_STOP = 4.0
"""Times what it takes under the limits of the plan: a stop takes no longer when limits have fallen on the way."""
_LONGEST_DELAY = 1.0
"""s that odometry may be taken to be late; stamps that say more are of a clock that runs otherwise."""
_LONGEST_TICK = 0.1
"""s: after a pause, commands go on from where they were."""


@dataclass(frozen=True)
class BaseTolerances:
    """How well a base has to follow.

    Args:
        path: m and rad (twice as much) that it may be off its path.
        arrival: m and rad that it may be off the goal at the end.
        slack: s that it may arrive late.
    """

    path: float = 0.15
    arrival: float = 0.02
    slack: float = 3.0


class BaseExecution:
    """One motion. Call `tick` at a steady rate until `done`; then there is an `error`, or it has arrived.

    Args:
        motion: the plan, in the frame of the odometry.
        limits: in the frame of the base; may be replaced on the way.
        share: of the limits that may be used.
        tolerances: how well the base has to follow.
        now: s of a clock that never goes back, the one of all calls.
    """

    def __init__(
        self, motion: BaseDrive, limits: BaseLimits, share: float, tolerances: BaseTolerances, now: float
    ) -> None:
        self._motion, self.limits, self._share, self._tolerances = motion, limits, share, tolerances
        self._stopping = limits.times(1 / _LONGEST_STOP)
        self._ticked = self._heard = now
        self._time = 0.0  # s of the plan; it waits while the program is held up, and when the base stops
        self._ticks = deque([(now, 0.0)], maxlen=256)  # s of the clock of all calls, s of the plan
        self._least = np.inf  # s from a stamp to its arrival; its zero has no meaning, as the clocks are two
        self._planned = 0.0  # s of the plan when the pose was measured
        self._pose: Array | None = None
        self._velocity = np.zeros(3)  # commanded: x, y m/s in the frame of the odometry, rad/s
        self.used = self.distance = 0.0
        self.done = False
        self.error: PoiseError | None = None
        self._fault: PoiseError | None = None

    @property
    def stage(self) -> str:
        """As feedback names it."""
        if self._fault is not None:
            return "stopping"
        return "turning" if self._motion.at(self._time)[2] else "driving"

    @property
    def progress(self) -> float:
        """0 to 1, by time."""
        return float(np.clip(self._time / self._motion.duration, 0.0, 1.0))

    def add_odometry(self, pose: Array, now: float, stamp: float = 0.0) -> None:
        """Take a pose (3,): x, y, m, and yaw, rad; `stamp`, s of any clock: when it was measured; 0: now.

        A message is late by what it took longer than the fastest one: a busy machine does not move the base.
        """
        if not np.isfinite(pose).all():
            return
        self._heard = now
        self._least = min(self._least, now - stamp) if stamp else self._least
        late = min(now - stamp - self._least, _LONGEST_DELAY) if stamp else 0.0
        ticks, times = np.array(self._ticks).T
        self._planned = float(np.interp(now - late, ticks, times) + max(now - late - ticks[-1], 0.0))
        if self._pose is not None:
            self.distance += float(np.linalg.norm(pose[:2] - self._pose[:2]))
        self._pose = np.asarray(pose, dtype=np.float64)

    def stop(self, error: PoiseError) -> None:
        """Come to rest within the limits, or by a quarter of those of the plan where these are more; and end."""
        self._fault = self._fault or error

    def tick(self, now: float) -> Array:
        """(3,) the command: x, y, m/s in the frame of the base, and rad/s."""
        passed = float(np.clip(now - self._ticked, 1e-3, _LONGEST_TICK))
        self._ticked = now
        wanted = np.zeros(3)
        if self._fault is None:
            self._time += passed if self._pose is not None else 0.0
            self._ticks.append((now, self._time))
            try:
                wanted = self._wanted(now)
            except PoiseError as error:
                self._fault = error
            except Exception as failure:  # of ours; the base has to stop all the same
                self._fault = PoiseError(ErrorCode.INTERNAL, f"internal error: {failure!r}; please report it")
        self._command(wanted, passed)
        if self._fault is not None and np.abs(self._velocity).max() < _AT_REST:
            self._velocity[:] = 0.0
            self.done, self.error = True, self._fault
        if self.done:
            return np.zeros(3)
        yaw = 0.0 if self._pose is None else float(self._pose[2])
        return np.array([*in_base(self._velocity[:2], yaw), self._velocity[2]])

    def _wanted(self, now: float) -> Array:
        """(3,) velocity in the frame of the odometry: that of the plan, and a correction of what is off it."""
        if now - self._heard > _STALE:
            raise SensorError(
                ErrorCode.SENSOR_STALE, "odom has stopped, and the base was brought to rest: start its driver"
            )
        rate = self._motion.at(self._time)[1]
        place = self._motion.at(min(self._planned, self._time))[0]  # when the odometry was measured
        if self._pose is None:
            return np.zeros(3)
        off = place - self._pose
        off[2] = (off[2] + np.pi) % (2 * np.pi) - np.pi
        size = max(float(np.linalg.norm(off[:2])), abs(float(off[2])) / 2)
        late = self._time - self._motion.duration
        if late > 0 and size <= self._tolerances.arrival and np.abs(self._velocity).max() < 20 * _AT_REST:
            self.done = True
            return np.zeros(3)
        where = f"{1e3 * float(np.linalg.norm(off[:2])):.0f} mm and {abs(off[2]):.2f} rad off its"
        if size > self._tolerances.path:
            advice = "does it listen to cmd_vel, and is its way free"
            raise NoAnswerError(ErrorCode.NOT_FOLLOWING, f"the base is {where} path: {advice}")
        if late > self._tolerances.slack:
            speed = float(np.linalg.norm(self._velocity[:2]))
            rest = f"{late:.1f} s after its plan ended, and still drives at {speed:.3f} m/s"
            raise NoAnswerError(ErrorCode.NOT_FOLLOWING, f"the base is {where} goal {rest}: is its way free")
        return np.asarray(rate + _GAIN * off)

    def _command(self, wanted: Array, passed: float) -> None:
        """Change the command towards what is wanted, as far as the limits allow."""
        yaw = 0.0 if self._pose is None else float(self._pose[2])
        allowed = [self.limits] if self._fault is None else [self.limits, self._stopping]
        change = (wanted - self._velocity) / passed
        for_way = self._share * (_ASIDE if self._motion.at(self._time)[2] else 1 - _ASIDE)
        linear = min(limits.share(in_base(change[:2], yaw)) for limits in allowed)
        if linear > for_way:
            change[:2] *= for_way / linear
        spinning = min(limits.turning_share(0.0, float(self._velocity[2])) for limits in allowed)
        for_turn = self._share - for_way
        left = max(for_turn - spinning, _BRAKING * for_turn)
        angular = min(limits.turning_share(float(change[2]), 0.0) for limits in allowed)
        if angular > left:
            change[2] *= left / angular
        turning = self.limits.turning_share(float(change[2]), float(self._velocity[2]))
        self.used = max(self.used, self.limits.share(in_base(change[:2], yaw)) + turning)
        self._velocity = self._velocity + passed * change
