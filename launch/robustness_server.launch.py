"""Answer how hard a stack may be pushed: `ros2 launch poise robustness_server.launch.py scene:=/path/scene.yaml`."""

from launch import LaunchDescription
from poise.nodes.launching import describe_launch


def generate_launch_description() -> LaunchDescription:
    """One node; arguments: params_file, namespace, and a name for every topic."""
    return describe_launch("robustness_server", ("assembly", "tf", "tf_static"), {"scene": "scene file to begin with"})
