"""Start the force-torque driver with a parameter file."""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import LifecycleNode

from launch import LaunchDescription


def generate_launch_description() -> LaunchDescription:
    """Arguments: params_file, namespace. The node configures and activates itself (parameter autostart)."""
    defaults = Path(get_package_share_directory("poise")) / "config" / "ft_driver.yaml"
    return LaunchDescription(
        [
            DeclareLaunchArgument("params_file", default_value=str(defaults), description="parameters of the driver"),
            DeclareLaunchArgument("namespace", default_value="", description="namespace of the node"),
            LifecycleNode(
                package="poise",
                executable="ft_driver",
                name="ft_driver",
                namespace=LaunchConfiguration("namespace"),
                parameters=[LaunchConfiguration("params_file")],
                output="screen",
            ),
        ]
    )
