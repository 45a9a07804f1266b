"""Start the driver of a Robotiq 2F gripper with a parameter file."""

from launch import LaunchDescription
from poise.nodes.launching import describe_launch


def generate_launch_description() -> LaunchDescription:
    """Arguments: params_file, namespace. The node configures and activates itself (parameter autostart)."""
    return describe_launch("gripper_driver", lifecycle=True)
