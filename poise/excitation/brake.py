"""Stops an arm along the path it is on: slower from the first instant, so that what was certified stays so."""

import numpy as np

from poise.excitation.certificate import certify
from poise.excitation.limits import Guard, MotionLimits
from poise.robot import RobotModel
from poise.simulation import WaypointTrajectory
from poise.types import Array

STOP_TIMES = (0.15, 0.2, 0.3, 0.4, 0.6, 0.8)
"""s, tried from the shortest."""
WAYPOINT_SPACING = 0.02
"""s between the waypoints of a stop: quintics through them stay on the path."""
HARDER = 1.25
"""Factor on the limit of joint acceleration: a stop may be harder than the motion."""


def brake(
    model: RobotModel, motion: WaypointTrajectory, at: float, guard: Guard, limits: MotionLimits
) -> WaypointTrajectory:
    """The shortest stop from `at` s of a motion on, along its path, that keeps the limits; at rest already: staying.

    The first waypoint is the state of the motion at that time, so that a controller takes over without a jump.
    """
    for stop_time in STOP_TIMES:
        stop = stop_along(motion, at, stop_time)
        found = certify(model, stop, guard)
        gentle = found.acceleration <= HARDER * limits.acceleration
        if gentle and found.speed <= limits.speed * (1 + 1e-6):
            break
    return stop


def stop_along(motion: WaypointTrajectory, at: float, stop_time: float) -> WaypointTrajectory:
    """A stop from `at` s of a motion on, along its path, within a time; at rest already: staying.

    Time runs on from `at` at a rate that falls from one to zero as 1 - 3 u^2 + 2 u^3, u = t / stop_time.
    """
    if at <= 0.0 or at >= motion.duration:
        there = motion.at(np.clip([at], 0.0, motion.duration)).position
        return WaypointTrajectory(np.array([0.0, stop_time]), np.repeat(there, 2, axis=0))
    count = max(int(np.ceil(stop_time / WAYPOINT_SPACING)), 4)
    u: Array = np.linspace(0.0, 1.0, count + 1)
    place = at + stop_time * (u - u**3 + u**4 / 2)
    rate, change = (1 - 3 * u**2 + 2 * u**3)[:, None], ((-6 * u + 6 * u**2) / stop_time)[:, None]
    path = motion.at(place)
    beyond = (place > motion.duration)[:, None]  # at rest there
    velocity, acceleration = (np.where(beyond, 0.0, value) for value in (path.velocity, path.acceleration))
    return WaypointTrajectory(u * stop_time, path.position, velocity * rate, acceleration * rate**2 + velocity * change)
