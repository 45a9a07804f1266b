"""Find where the next object stays: `ros2 launch poise placement_planner.launch.py scene:=/path/scene.yaml`."""

from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription

TOPICS = ("assembly", "robot_description", "joint_states", "joint_trajectory", "gripper_trajectory")


def generate_launch_description() -> LaunchDescription:
    """One node; arguments: params_file, namespace, and a name for every topic."""
    defaults = PathJoinSubstitution([FindPackageShare("poise"), "config", "placement_planner.yaml"])
    return LaunchDescription(
        [
            DeclareLaunchArgument("namespace", default_value="", description="of the node and its topics"),
            DeclareLaunchArgument("params_file", default_value=defaults, description="parameters of the node"),
            DeclareLaunchArgument("scene", default_value="", description="scene file to begin with"),
            *(DeclareLaunchArgument(name, default_value=name, description="name of this topic") for name in TOPICS),
            Node(
                package="poise",
                executable="placement_planner",
                name="placement_planner",
                namespace=LaunchConfiguration("namespace"),
                parameters=[LaunchConfiguration("params_file"), {"scene": LaunchConfiguration("scene")}],
                remappings=[(name, LaunchConfiguration(name)) for name in TOPICS],
                output="screen",
            ),
        ]
    )
