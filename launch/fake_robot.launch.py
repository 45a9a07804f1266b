"""Starts fake_robot with one of its parameter files: ros2 launch poise fake_robot.launch.py params_file:=FILE."""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchDescription


def generate_launch_description() -> LaunchDescription:
    """One node; `params_file` is a parameter file, `namespace` goes before all topics."""
    default = Path(get_package_share_directory("poise")) / "config" / "fake_robot_xarm7.yaml"
    return LaunchDescription(
        [
            DeclareLaunchArgument("params_file", default_value=str(default), description="parameters of the robot"),
            DeclareLaunchArgument("namespace", default_value="", description="namespace of all topics"),
            Node(
                package="poise",
                executable="fake_robot",
                name="fake_robot",
                namespace=LaunchConfiguration("namespace"),
                parameters=[LaunchConfiguration("params_file")],
                output="screen",
            ),
        ]
    )
