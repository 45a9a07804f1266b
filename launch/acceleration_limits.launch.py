"""Say how fast a base may accelerate: `ros2 launch poise acceleration_limits.launch.py odom:=/base/odom`."""

from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription

TOPICS = ("assembly", "inertial_estimate", "odom")


def generate_launch_description() -> LaunchDescription:
    """One node; arguments: params_file, namespace, and a name for every topic it reads."""
    defaults = PathJoinSubstitution([FindPackageShare("poise"), "config", "acceleration_limits.yaml"])
    return LaunchDescription(
        [
            DeclareLaunchArgument("namespace", default_value="", description="of the node and its topics"),
            DeclareLaunchArgument("params_file", default_value=defaults, description="parameters of the node"),
            *(DeclareLaunchArgument(name, default_value=name, description="topic to read it from") for name in TOPICS),
            Node(
                package="poise",
                executable="acceleration_limits",
                name="acceleration_limits",
                namespace=LaunchConfiguration("namespace"),
                parameters=[LaunchConfiguration("params_file")],
                remappings=[(name, LaunchConfiguration(name)) for name in TOPICS],
                output="screen",
            ),
        ]
    )
