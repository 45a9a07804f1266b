"""The whole loop on a fake robot: `ros2 launch poise loop.launch.py robot:=fr3 objects:=5 seed:=1`."""

import time
from collections.abc import Callable
from pathlib import Path
from tempfile import mkdtemp

from launch.actions import DeclareLaunchArgument, OpaqueFunction, Shutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchDescription
from poise.fake_robots.loop_job import NODES, parameter_file, prepare_world, with_simulated_time

_ARGUMENTS = {
    "robot": ("fr3", "the robot: config/loop_ROBOT.yaml, or the path of such a file"),
    "objects": ("5", "number of unknown objects"),
    "seed": ("0", "of random objects and of the plans"),
    "world": ("", "scene file of the true world; empty: random objects"),
    "distance": ("3.0", "m to carry the stack"),
    "shapes": ("scan", "scan: by the camera; given: as in the scene"),
    "real_time": ("false", "true: the time of the machine; false: simulated time, which waits for the nodes"),
    "rate": ("1.0", "s of simulated time in a second, where the machine keeps up"),
    "out": ("", "folder for loop.json and the bag; empty: neither"),
}


_MOST_ENDS, _WITHIN = 5, 60.0
"""So often, in so many s, a node may end; then it stays down, and the loop ends."""


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
    simulated = given["real_time"] != "true"
    if simulated:
        extra = with_simulated_time(extra, float(given["rate"]))
    own = {"use_sim_time": simulated, "world": str(world), "objects": int(given["objects"]), "seed": int(given["seed"])}
    own |= {"distance": float(given["distance"]), "shapes": given["shapes"], "out": given["out"]}
    started = [
        Node(
            package="poise",
            executable=name,
            name=name,
            parameters=[config, extra.get(name, {})],
            output="screen",
            respawn=name != "fake_robot",
            on_exit=_limited(name),
        )
        for name in NODES
        if name != "object_scanner" or given["shapes"] == "scan"
    ]
    loop = Node(
        package="poise", executable="loop", name="loop", parameters=[config, own], output="screen", on_exit=Shutdown()
    )
    return [*started, loop]


def _limited(name: str) -> Callable[[object, object], Shutdown | None]:
    """Called when a node has ended: ends everything when that was too often. The loop then says that it was stopped."""
    ends: list[float] = []

    def ended(event: object, context: object) -> Shutdown | None:
        ends.append(time.monotonic())
        if len(ends) >= _MOST_ENDS and ends[-1] - ends[-_MOST_ENDS] < _WITHIN:
            return Shutdown(reason=f"{name} has ended {_MOST_ENDS} times within {_WITHIN:.0f} s: see its output")
        return None

    return ended
