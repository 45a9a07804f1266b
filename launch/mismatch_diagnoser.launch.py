"""Hold a robot against its simulation: `ros2 launch poise mismatch_diagnoser.launch.py model:=/path/model.yaml`."""

from launch import LaunchDescription
from poise.nodes.launching import describe_launch


def generate_launch_description() -> LaunchDescription:
    """One node; arguments: params_file, namespace, and a name for every topic."""
    return describe_launch(
        "mismatch_diagnoser",
        ("wrench", "joint_states", "odom", "robot_description"),
        {"model": "model.yaml: payload, tolerances, noise"},
    )
