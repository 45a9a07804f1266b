"""Scan objects: `ros2 launch poise object_scanner.launch.py depth:=/camera/aligned_depth_to_color/image_raw`."""

from launch import LaunchDescription
from poise.nodes.launching import describe_launch

_TOPICS = {
    "depth": "camera/aligned_depth_to_color/image_raw",
    "camera_info": "camera/aligned_depth_to_color/camera_info",
    "colour": "camera/color/image_raw",
    "points": "camera/depth/color/points",
    "joint_states": "joint_states",
    "robot_description": "robot_description",
    "joint_trajectory": "joint_trajectory",
    "tf": "tf",
    "tf_static": "tf_static",
    "assembly": "assembly",
}


def generate_launch_description() -> LaunchDescription:
    """One node; arguments: params_file, namespace, and a name for every topic."""
    return describe_launch("object_scanner", _TOPICS)
