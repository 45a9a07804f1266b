"""A motion of joints as the message that controllers take."""

from collections.abc import Sequence

from builtin_interfaces.msg import Duration
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from poise.nodes.estimate_message import time_message
from poise.simulation import WaypointTrajectory


def trajectory_message(names: Sequence[str], motion: WaypointTrajectory, stamp: int = 0) -> JointTrajectory:
    """A motion that begins at `stamp` ns of the joint states' clock; 0: when it comes."""
    message = JointTrajectory(joint_names=list(names))
    message.header.stamp = time_message(stamp)
    derived = motion.velocity, motion.acceleration
    for seconds, *rows in zip(motion.times.tolist(), motion.position, *derived, strict=True):
        whole, part = divmod(round(seconds * 1e9), 10**9)
        position, velocity, acceleration = (row.tolist() for row in rows)
        point = JointTrajectoryPoint(positions=position, velocities=velocity, accelerations=acceleration)
        point.time_from_start = Duration(sec=whole, nanosec=part)
        message.points.append(point)
    return message
