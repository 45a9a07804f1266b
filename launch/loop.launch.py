"""The whole loop on a fake robot: `ros2 launch poise loop.launch.py robot:=fr3 objects:=5 seed:=1`."""

from pathlib import Path
from tempfile import mkdtemp

from launch.actions import DeclareLaunchArgument, OpaqueFunction, Shutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchDescription
from poise.fake_robots.loop_job import NODES, parameter_file, prepare_world

_ARGUMENTS = {
    "robot": ("fr3", "the robot: config/loop_ROBOT.yaml, or the path of such a file"),
    "objects": ("5", "number of unknown objects"),
    "seed": ("0", "of random objects and of the plans"),
    "world": ("", "scene file of the true world; empty: random objects"),
    "distance": ("3.0", "m to carry the stack"),
    "shapes": ("scan", "scan: by the camera; given: as in the scene"),
    "out": ("", "folder for loop.json and the bag; empty: neither"),
}


def generate_launch_description() -> LaunchDescription:
    """The nodes, each started again when it ends, and the node `loop`, with whose end everything ends."""
    arguments = [
        DeclareLaunchArgument(name, default_value=value, description=text) for name, (value, text) in _ARGUMENTS.items()
    ]
    return LaunchDescription([*arguments, OpaqueFunction(function=_nodes)])


def _nodes(context: object) -> list[Node]:
    given = {name: LaunchConfiguration(name).perform(context) for name in _ARGUMENTS}
    config = str(parameter_file(given["robot"]))
    folder = Path(mkdtemp(prefix="poise-loop-"))
    world, extra = prepare_world(
        Path(given["world"]) if given["world"] else None, int(given["objects"]), int(given["seed"]), folder
    )
    own = {"world": str(world), "objects": int(given["objects"]), "seed": int(given["seed"])}
    own |= {"distance": float(given["distance"]), "shapes": given["shapes"], "out": given["out"]}
    started = [
        Node(
            package="poise",
            executable=name,
            name=name,
            parameters=[config, extra.get(name, {})],
            output="screen",
            respawn=name != "fake_robot",
        )
        for name in NODES
        if name != "object_scanner" or given["shapes"] == "scan"
    ]
    loop = Node(
        package="poise", executable="loop", name="loop", parameters=[config, own], output="screen", on_exit=Shutdown()
    )
    return [*started, loop]
