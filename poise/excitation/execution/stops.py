"""Stops an arm along the path it is on; all stops of a motion are certified before the motion begins."""

from bisect import bisect_left
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from poise.errors import ErrorCode, PoiseError
from poise.excitation import Guard, MotionLimits, certify, joint_peaks
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
_SHARED = 1 + 1e-6
"""Rounding that a limit may be exceeded by."""

Judge = Callable[[WaypointTrajectory, float], str]
"""Names the limits that a stop exceeds, in words, or gives an empty text: `judge(stop, begin)`, s of the motion."""


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
        """Certify a stop of a motion with guarded points every `STOP_SPACING` s.

        Raises:
            PoiseError: CANCELLED.
        """
        return cls.judged(motion, _guarded(model, guard, limits), cancelled=cancelled)

    @classmethod
    def judged(
        cls,
        motion: WaypointTrajectory,
        judge: Judge,
        times: Sequence[float] = _STOP_TIMES,
        cancelled: Callable[[], bool] = lambda: False,
    ) -> "ReadyStops":
        """Choose a stop every `STOP_SPACING` s of a motion, as `shortest_stops`.

        Raises:
            PoiseError: CANCELLED.
        """
        count = max(int(np.ceil(motion.duration / STOP_SPACING)), 1)
        begins = np.linspace(0.0, motion.duration, count + 1).tolist()
        return cls(motion, tuple(shortest_stops(motion, begins, judge, times, cancelled)))

    @property
    def motion(self) -> WaypointTrajectory:
        """The one that they stop."""
        return self._motion

    def after(self, at: float) -> Stop:
        """The first stop that begins at `at` s of the motion or later; before and after the motion: hold the pose."""
        if 0.0 < at < self._motion.duration:
            return self.stops[bisect_left(self._begins, at)]
        end = self.stops[0] if at <= 0.0 else self.stops[-1]
        return Stop(at, end.motion)


def brake(model: RobotModel, motion: WaypointTrajectory, at: float, guard: Guard, limits: MotionLimits) -> Stop:
    """The shortest stop from `at` s of a motion with guarded points on."""
    return shortest_stops(motion, [at], _guarded(model, guard, limits))[0]


def shortest_stops(
    motion: WaypointTrajectory,
    begins: Sequence[float],
    judge: Judge,
    times: Sequence[float] = _STOP_TIMES,
    cancelled: Callable[[], bool] = lambda: False,
) -> list[Stop]:
    """The shortest stops of a motion, along its path, that keep the limits; at rest already: staying.

    If none keeps them, the fastest is returned, and its `excess` names what it exceeds.

    Args:
        motion: what is stopped.
        begins: s of it.
        judge: of the limits.
        times: s that a stop may take, ascending.
        cancelled: whether to give up.

    Raises:
        PoiseError: CANCELLED.
    """
    found: dict[float, Stop] = {}
    for stop_time in times:
        left = [at for at in begins if at not in found or found[at].excess]
        for at, stop in zip(left, stops_along(motion, left, stop_time), strict=True):
            if cancelled():
                raise PoiseError(ErrorCode.CANCELLED, "cancelled while the stops were certified")
            judged = Stop(at, stop, judge(stop, at))
            if at not in found or not judged.excess:
                found[at] = judged
    return [found[at] for at in begins]


def _guarded(model: RobotModel, guard: Guard, limits: MotionLimits) -> Judge:
    def judge(stop: WaypointTrajectory, _: float) -> str:
        found = certify(model, stop, guard)
        over = []
        if found.acceleration > _HARDER * limits.acceleration:
            over.append(f"joint acceleration {found.acceleration:.3g} of {_HARDER * limits.acceleration:.3g} rad/s2")
        if found.speed > limits.speed * _SHARED:
            over.append(f"speed {found.speed:.4g} of {limits.speed:.4g} m/s")
        return ", ".join(over)

    return judge


_JOINT_ACCELERATION = MotionLimits().acceleration


def joint_judge(names: Sequence[str], velocity_limit: Array, acceleration: float = _JOINT_ACCELERATION) -> Judge:
    """A judge of stops by the limits of the joints alone, which hold at every instant of a stop.

    Args:
        names: of the joints (J).
        velocity_limit: (J,) rad/s or m/s.
        acceleration: rad/s2 or m/s2 of a motion; a stop may be harder than that by a quarter.
    """

    def judge(stop: WaypointTrajectory, _: float) -> str:
        rate, change = joint_peaks(stop)
        fast, hard = int(np.argmax(rate / velocity_limit)), int(np.argmax(change))
        over = []
        if change[hard] > _HARDER * acceleration:
            over.append(f"acceleration {change[hard]:.3g} of {_HARDER * acceleration:.3g} rad/s2 of {names[hard]}")
        if rate[fast] > velocity_limit[fast] * _SHARED:
            over.append(f"speed {rate[fast]:.3g} of {velocity_limit[fast]:.3g} rad/s of {names[fast]}")
        return ", ".join(over)

    return judge


def stops_along(motion: WaypointTrajectory, begins: Sequence[float], stop_time: float) -> list[WaypointTrajectory]:
    """Stops from `begins`, s of a motion, on, along its path, within a time; at rest already: staying.

    Time runs on from each begin at a rate that falls from one to zero as 1 - 3 u^2 + 2 u^3, u = t / stop_time.
    """
    count = max(int(np.ceil(stop_time / _WAYPOINT_SPACING)), 4)
    u: Array = np.linspace(0.0, 1.0, count + 1)
    place = np.asarray(begins)[:, None] + stop_time * (u - u**3 + u**4 / 2)
    rate, change = (1 - 3 * u**2 + 2 * u**3)[:, None], ((-6 * u + 6 * u**2) / stop_time)[:, None]
    position, velocity, acceleration = (
        value.reshape(*place.shape, value.shape[1]) for value in motion.at(place.ravel())
    )
    beyond = place > motion.duration
    velocity[beyond] = acceleration[beyond] = 0.0  # at rest there
    rows = zip(begins, position, velocity * rate, acceleration * rate**2 + velocity * change, strict=True)
    return [
        WaypointTrajectory(u * stop_time, *row) if 0.0 < at < motion.duration else _staying(motion, at, stop_time)
        for at, *row in rows
    ]


def _staying(motion: WaypointTrajectory, at: float, seconds: float) -> WaypointTrajectory:
    there = motion.at(np.clip([at], 0.0, motion.duration)).position
    return WaypointTrajectory(np.array([0.0, seconds]), np.repeat(there, 2, axis=0))
