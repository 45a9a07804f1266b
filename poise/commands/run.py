"""`poise run`: start a ROS 2 node of Poise as `ros2 run poise NODE` does, on a machine without ros2cli."""

import os
import sys
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

import typer

from poise.errors import ErrorCode, InputError

CONTEXT_SETTINGS = {"allow_extra_args": True, "ignore_unknown_options": True, "allow_interspersed_args": False}
_ROOMS = ("poise.nodes.", "poise.fake_robots.")


def run(
    context: typer.Context,
    node: Annotated[str, typer.Argument(metavar="NODE", help="Name of the node.", show_default=False)],
) -> None:
    """Start a ROS 2 node of Poise; works without ros2cli.

    Everything after NODE goes to the node, as with `ros2 run poise NODE`. A parameter file that is not found is looked
    up in the folder config/ of the installed package.

    Example:  poise run fake_robot --ros-args --params-file fake_robot_xarm7.yaml -r __ns:=/arm
    """
    if node.endswith(".launch.py"):
        raise _instead_of_launch(node.removesuffix(".launch.py"))
    prepare_nodes(node)
    nodes = installed_nodes()
    if node not in nodes:
        raise InputError(ErrorCode.BAD_INPUT, f"no node is named {node!r}; the nodes are: {', '.join(nodes)}")
    config = Path(sys.prefix) / "share" / "poise" / "config"
    if {"--help", "-h"} & set(context.args):
        print(help_of(nodes[node], config))
        return
    sys.argv = [node, *with_installed_parameters(context.args, config)]
    nodes[node].load()()


def _instead_of_launch(name: str) -> InputError:
    """PyPI has no `launch`; every launch file of Poise but one starts a single node with its parameter file."""
    same = "poise loop" if name == "loop" else f"poise run {name} --ros-args --params-file {name}.yaml"
    message = f"launch files need `ros2 launch poise {name}.launch.py`, which PyPI does not have; the same is `{same}`"
    return InputError(ErrorCode.UNSUPPORTED, message)


def prepare_nodes(what: str) -> None:
    """Let nodes run in this process.

    Raises:
        InputError: UNSUPPORTED without ROS, naming what needs it.
    """
    if not _has_ros():
        raise InputError(
            ErrorCode.UNSUPPORTED,
            f"{what} needs ROS 2, which is not installed here; install Poise with its nodes (pip install .)",
        )
    _add_to_ament_index(Path(sys.prefix))


def _has_ros() -> bool:
    try:
        return find_spec("rclpy") is not None
    except ImportError:
        return False


def installed_nodes() -> dict[str, EntryPoint]:
    """The nodes of the installed package by name: the same entry points that `ros2 run poise` offers."""
    scripts = entry_points(group="console_scripts")
    return {entry.name: entry for entry in sorted(scripts) if entry.value.startswith(_ROOMS)}


def help_of(node: EntryPoint, config: Path) -> str:
    """What the node does, how to start it, and its parameter files."""
    purpose = (import_module(node.module).__doc__ or "").strip()
    files = [str(path) for path in sorted(config.glob(f"{node.name}*.yaml"))]
    usage = (
        f"poise run {node.name} --ros-args [--params-file FILE] [-p NAME:=VALUE] [-r FROM:=TO] [-r __ns:=/NAMESPACE]"
    )
    return "\n".join([purpose, "", f"Usage: {usage}", "", "Parameters with their meanings and defaults:", *files])


def with_installed_parameters(arguments: list[str], config: Path) -> list[str]:
    """The arguments, where a parameter file that exists only in `config` is replaced by its full path."""
    found = list(arguments)
    for at, argument in enumerate(arguments[1:], start=1):
        missing = arguments[at - 1] == "--params-file" and not Path(argument).exists()
        if missing and (config / argument).is_file():
            found[at] = str(config / argument)
    return found


def _add_to_ament_index(prefix: Path) -> None:
    """Let the node find the package's own files where the shell has not set AMENT_PREFIX_PATH."""
    known = os.environ.get("AMENT_PREFIX_PATH", "")
    if str(prefix) not in known.split(os.pathsep) and (prefix / "share" / "ament_index").is_dir():
        os.environ["AMENT_PREFIX_PATH"] = os.pathsep.join(filter(None, [known, str(prefix)]))
