"""Find where the next object stays: `ros2 launch poise placement_planner.launch.py scene:=/path/scene.yaml`."""

from launch import LaunchDescription
from poise.nodes.launching import describe_launch


def generate_launch_description() -> LaunchDescription:
    """One node; arguments: params_file, namespace, and a name for every topic."""
    return describe_launch(
        "placement_planner",
        (
            "assembly",
            "world",
            "grasp_events",
            "robot_description",
            "joint_states",
            "joint_trajectory",
            "gripper_trajectory",
        ),
        {"scene": "scene file to begin with"},
    )
