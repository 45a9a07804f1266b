"""Hold a robot against its simulation: `ros2 launch poise mismatch_diagnoser.launch.py model:=/path/model.yaml`."""

from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription

TOPICS = ("wrench", "joint_states", "odom", "robot_description")


def generate_launch_description() -> LaunchDescription:
    """One node; arguments: params_file, namespace, and a name for every topic it reads."""
    defaults = PathJoinSubstitution([FindPackageShare("poise"), "config", "mismatch_diagnoser.yaml"])
    return LaunchDescription(
        [
            DeclareLaunchArgument("namespace", default_value="", description="of the node and its topics"),
            DeclareLaunchArgument("params_file", default_value=defaults, description="parameters of the node"),
            DeclareLaunchArgument("model", default_value="", description="model.yaml: payload, tolerances, noise"),
            *(DeclareLaunchArgument(name, default_value=name, description="topic to read it from") for name in TOPICS),
            Node(
                package="poise",
                executable="mismatch_diagnoser",
                name="mismatch_diagnoser",
                namespace=LaunchConfiguration("namespace"),
                parameters=[LaunchConfiguration("params_file"), {"model": LaunchConfiguration("model")}],
                remappings=[(name, LaunchConfiguration(name)) for name in TOPICS],
                output="screen",
            ),
        ]
    )
