"""Carry what stands on the base: `ros2 launch poise object_carrier.launch.py cmd_vel:=/base/cmd_vel`."""

from launch import LaunchDescription
from poise.nodes.launching import describe_launch


def generate_launch_description() -> LaunchDescription:
    """One node; arguments: params_file, namespace, and a name for every topic."""
    return describe_launch("object_carrier", ("acceleration_limits", "assembly", "odom", "cmd_vel", "tf", "tf_static"))
