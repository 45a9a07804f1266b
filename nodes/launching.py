"""What the launch files share: one node with its parameter file, namespace and topics as launch arguments."""

from collections.abc import Mapping, Sequence

from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import LifecycleNode, Node
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription


def describe_launch(
    node: str,
    topics: Mapping[str, str] | Sequence[str] = (),
    parameters: Mapping[str, str] | None = None,
    *,
    params_file: str = "",
    lifecycle: bool = False,
) -> LaunchDescription:
    """One node of the package, with the arguments params_file, namespace, and one for every topic and parameter.

    Args:
        node: name of the executable and of the node.
        topics: argument by topic, or the topics that are their own arguments.
        parameters: parameters of the node that are arguments too, with their descriptions; empty by default.
        params_file: the default one, in the package's folder config; empty: NODE.yaml.
        lifecycle: the node has a lifecycle.
    """
    names = topics if isinstance(topics, Mapping) else {topic: topic for topic in topics}
    extra = parameters or {}
    default = PathJoinSubstitution([FindPackageShare("poise"), "config", params_file or f"{node}.yaml"])
    arguments = [
        DeclareLaunchArgument("namespace", default_value="", description="of the node and its topics"),
        DeclareLaunchArgument("params_file", default_value=default, description="parameters of the node"),
        *(DeclareLaunchArgument(name, default_value="", description=text) for name, text in extra.items()),
        *(DeclareLaunchArgument(name, default_value=topic, description="its topic") for name, topic in names.items()),
    ]
    kind = LifecycleNode if lifecycle else Node
    values = {name: LaunchConfiguration(name) for name in extra}
    started = kind(
        package="poise",
        executable=node,
        name=node,
        namespace=LaunchConfiguration("namespace"),
        parameters=[LaunchConfiguration("params_file"), *([values] if values else [])],
        remappings=[(topic, LaunchConfiguration(name)) for name, topic in names.items()],
        output="screen",
    )
    return LaunchDescription([*arguments, started])
