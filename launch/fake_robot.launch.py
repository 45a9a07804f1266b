"""Starts fake_robot with one of its parameter files: ros2 launch poise fake_robot.launch.py params_file:=FILE."""

from launch import LaunchDescription
from poise.nodes.launching import describe_launch


def generate_launch_description() -> LaunchDescription:
    """One node; `params_file` is a parameter file, `namespace` goes before all topics."""
    return describe_launch("fake_robot", params_file="fake_robot_xarm7.yaml")
