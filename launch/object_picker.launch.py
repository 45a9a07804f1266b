"""Take objects into the hand: `ros2 launch poise object_picker.launch.py wrench:=/arm/wrench`."""

from launch import LaunchDescription
from poise.nodes.launching import describe_launch


def generate_launch_description() -> LaunchDescription:
    """One node; arguments: params_file, namespace, and a name for every topic."""
    topics = ("assembly", "world", "grasp_events", "wrench", "robot_description", "joint_states")
    return describe_launch("object_picker", (*topics, "joint_trajectory", "gripper_trajectory"))
