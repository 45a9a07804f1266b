"""Stops an arm along the path it is on; all stops of a motion are certified before the motion begins."""

from bisect import bisect_left
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from poise.errors import ErrorCode, PoiseError
from poise.excitation import Guard, MotionLimits, certify
from poise.robot import RobotModel
from poise.simulation import WaypointTrajectory
from poise.types import Array

STOP_SPACING = 0.02
"""s of a motion between two instants at which a stop can begin."""
_STOP_TIMES = (0.15, 0.2, 0.3, 0.4, 0.6, 0.8)
"""s, tried from the shortest."""
_WAYPOINT_SPACING = 0.02
"""s between the waypoints of a stop: quintics through them stay on the path."""
_HARDER = 1.25
"""Factor on the limit of joint acceleration: a stop may be harder than the motion."""


@dataclass(frozen=True, eq=False)
class Stop:
    """A motion that brings the arm to rest.

    Args:
        begin: s of the motion that it leaves.
        motion: from the state of the motion at that time, so that a controller takes over without a jump.
        excess: which limits it exceeds, in words; empty when it keeps them all.
    """

    begin: float
    motion: WaypointTrajectory
    excess: str = ""


class ReadyStops:
    """The stops of one motion, certified ahead: at the moment of need one is looked up, nothing is computed.

    Args:
        motion: the motion.
        stops: in the order of their begins; the last one begins where the motion ends.
    """

    def __init__(self, motion: WaypointTrajectory, stops: tuple[Stop, ...]) -> None:
        self._motion, self.stops = motion, stops
        self._begins = [stop.begin for stop in stops]

    @classmethod
    def prepare(
        cls,
        model: RobotModel,
        motion: WaypointTrajectory,
        guard: Guard,
        limits: MotionLimits,
        cancelled: Callable[[], bool] = lambda: False,
    ) -> "ReadyStops":
        """Certify a stop every `STOP_SPACING` s of a motion.

        Raises:
            PoiseError: CANCELLED.
        """
        count = max(int(np.ceil(motion.duration / STOP_SPACING)), 1)
        stops = []
        for begin in np.linspace(0.0, motion.duration, count + 1).tolist():
            if cancelled():
                raise PoiseError(ErrorCode.CANCELLED, "cancelled while the stops were certified")
            stops.append(brake(model, motion, begin, guard, limits))
        return cls(motion, tuple(stops))

    def after(self, at: float) -> Stop:
        """The first stop that begins at `at` s of the motion or later; before and after the motion: hold the pose."""
        if 0.0 < at < self._motion.duration:
            return self.stops[bisect_left(self._begins, at)]
        end = self.stops[0] if at <= 0.0 else self.stops[-1]
        return Stop(at, end.motion)


def brake(model: RobotModel, motion: WaypointTrajectory, at: float, guard: Guard, limits: MotionLimits) -> Stop:
    """The shortest stop from `at` s of a motion on, along its path, that keeps the limits; at rest already: staying.

    If none of `_STOP_TIMES` keeps them, the longest is returned, and its `excess` names what it exceeds.
    """
    for stop_time in _STOP_TIMES:
        stop = stop_along(motion, at, stop_time)
        excess = _excess(model, stop, guard, limits)
        if not excess:
            break
    return Stop(at, stop, excess)


def _excess(model: RobotModel, stop: WaypointTrajectory, guard: Guard, limits: MotionLimits) -> str:
    found = certify(model, stop, guard)
    over = []
    if found.acceleration > _HARDER * limits.acceleration:
        over.append(f"joint acceleration {found.acceleration:.3g} of {_HARDER * limits.acceleration:.3g} rad/s2")
    if found.speed > limits.speed * (1 + 1e-6):
        over.append(f"speed {found.speed:.4g} of {limits.speed:.4g} m/s")
    return ", ".join(over)


def stop_along(motion: WaypointTrajectory, at: float, stop_time: float) -> WaypointTrajectory:
    """A stop from `at` s of a motion on, along its path, within a time; at rest already: staying.

    Time runs on from `at` at a rate that falls from one to zero as 1 - 3 u^2 + 2 u^3, u = t / stop_time.
    """
    if at <= 0.0 or at >= motion.duration:
        there = motion.at(np.clip([at], 0.0, motion.duration)).position
        return WaypointTrajectory(np.array([0.0, stop_time]), np.repeat(there, 2, axis=0))
    count = max(int(np.ceil(stop_time / _WAYPOINT_SPACING)), 4)
    u: Array = np.linspace(0.0, 1.0, count + 1)
    place = at + stop_time * (u - u**3 + u**4 / 2)
    rate, change = (1 - 3 * u**2 + 2 * u**3)[:, None], ((-6 * u + 6 * u**2) / stop_time)[:, None]
    path = motion.at(place)
    beyond = (place > motion.duration)[:, None]  # at rest there
    velocity, acceleration = (np.where(beyond, 0.0, value) for value in (path.velocity, path.acceleration))
    return WaypointTrajectory(u * stop_time, path.position, velocity * rate, acceleration * rate**2 + velocity * change)
