"""Say how fast a base may accelerate: `ros2 launch poise acceleration_limits.launch.py odom:=/base/odom`."""

from launch import LaunchDescription
from poise.nodes.launching import describe_launch


def generate_launch_description() -> LaunchDescription:
    """One node; arguments: params_file, namespace, and a name for every topic."""
    return describe_launch("acceleration_limits", ("assembly", "inertial_estimate", "odom"))
