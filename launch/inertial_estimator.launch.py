"""Weigh what a robot holds: `ros2 launch poise inertial_estimator.launch.py wrench:=/arm/wrench`."""

from launch import LaunchDescription
from poise.nodes.launching import describe_launch


def generate_launch_description() -> LaunchDescription:
    """One node; arguments: params_file, namespace, and a name for every topic."""
    return describe_launch("inertial_estimator", ("wrench", "joint_states", "robot_description", "tf", "tf_static"))
