"""Keep the world as it is: `ros2 launch poise world_model.launch.py scene:=/path/table.yaml`."""

from launch import LaunchDescription
from poise.nodes.launching import describe_launch


def generate_launch_description() -> LaunchDescription:
    """One node; arguments: params_file, namespace, and a name for every topic."""
    return describe_launch(
        "world_model",
        ("assembly", "world", "segmented_object", "grasp_events", "inertial_estimate", "tf", "tf_static"),
        {"scene": "scene file to begin with", "state_file": "file that keeps the world over a restart"},
    )
