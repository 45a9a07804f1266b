"""Scan objects: `ros2 launch poise object_scanner.launch.py depth:=/camera/aligned_depth_to_color/image_raw`."""

from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription

TOPICS = {
    "depth": "camera/aligned_depth_to_color/image_raw",
    "camera_info": "camera/aligned_depth_to_color/camera_info",
    "colour": "camera/color/image_raw",
    "points": "camera/depth/color/points",
    "joint_states": "joint_states",
    "robot_description": "robot_description",
    "joint_trajectory": "joint_trajectory",
    "tf_static": "tf_static",
}


def generate_launch_description() -> LaunchDescription:
    """One node; arguments: params_file, namespace, and a name for every topic."""
    defaults = PathJoinSubstitution([FindPackageShare("poise"), "config", "object_scanner.yaml"])
    return LaunchDescription(
        [
            DeclareLaunchArgument("namespace", default_value="", description="of the node and its topics"),
            DeclareLaunchArgument("params_file", default_value=defaults, description="parameters of the node"),
            *(
                DeclareLaunchArgument(name, default_value=topic, description="its topic")
                for name, topic in TOPICS.items()
            ),
            Node(
                package="poise",
                executable="object_scanner",
                name="object_scanner",
                namespace=LaunchConfiguration("namespace"),
                parameters=[LaunchConfiguration("params_file")],
                remappings=[(topic, LaunchConfiguration(name)) for name, topic in TOPICS.items()],
                output="screen",
            ),
        ]
    )
