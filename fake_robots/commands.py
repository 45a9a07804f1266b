"""Trajectories from messages: what a controller takes, and why it refuses the others."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from trajectory_msgs.msg import JointTrajectory

from poise.errors import ErrorCode, InputError
from poise.fake_robots.arm import Waypoints
from poise.recording import stamp_of
from poise.types import Array


def waypoints_of(message: JointTrajectory) -> Waypoints:
    """The motion of a message; without points, a stop.

    Raises:
        InputError: BAD_INPUT for points of different lengths, or without positions.
    """
    points = message.points
    count = len(message.joint_names)

    def rows(field: str) -> Array | None:
        given = [list(getattr(point, field)) for point in points]
        if not any(given):
            return None
        if any(len(row) != count for row in given):
            raise InputError(ErrorCode.BAD_INPUT, f"joint trajectory: every point needs {count} {field} or none")
        return np.array(given)

    positions = rows("positions")
    if points and positions is None:
        raise InputError(ErrorCode.BAD_INPUT, "joint trajectory: its points have no positions")
    times = np.array([seconds_of(point.time_from_start) for point in points])
    return Waypoints(
        message.joint_names, times, positions, rows("velocities"), rows("accelerations"), stamp_of(message)
    )


def seconds_of(duration: Any) -> float:
    """s of a builtin_interfaces/Duration."""
    return float(duration.sec + duration.nanosec * 1e-9)


def require_complete(waypoints: Waypoints, joints: Sequence[str], partial: bool) -> None:
    """Refuse what joint_trajectory_controller refuses of a goal.

    Args:
        waypoints: of the goal.
        joints: of the controller.
        partial: joints may be left out.

    Raises:
        InputError: JOINT_MISSING for joints that are left out, unknown or named twice; BAD_INPUT for no points, times
            that do not increase, or a motion that does not end at rest.
    """
    names = list(waypoints.names)
    wrong = [name for name in names if name not in joints or names.count(name) > 1]
    missing = [] if partial else [name for name in joints if name not in names]
    if wrong or missing or not names:
        what = f"it has unknown or repeated joints {', '.join(wrong)}" if wrong else f"it lacks {', '.join(missing)}"
        raise InputError(ErrorCode.JOINT_MISSING, f"joint trajectory: {what}; the joints are {', '.join(joints)}")
    if not len(waypoints.times):
        raise InputError(ErrorCode.BAD_INPUT, "joint trajectory: it has no points")
    if (np.diff(waypoints.times) <= 0).any() or waypoints.times[0] < 0:
        raise InputError(ErrorCode.BAD_INPUT, "joint trajectory: time_from_start must increase from point to point")
    if waypoints.velocity is not None and np.any(waypoints.velocity[-1]):
        raise InputError(ErrorCode.BAD_INPUT, "joint trajectory: the last point must be at rest")
