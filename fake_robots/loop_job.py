"""What `poise loop` does: a world, the nodes as processes, one loop, and its files."""

import time
from collections.abc import Callable, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
import rclpy
import yaml
from ament_index_python.packages import get_package_share_directory
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from poise.assembly import Assembly, load_scene, write_scene
from poise.errors import ErrorCode, InputError, NoAnswerError
from poise.fake_robots.tables import random_table
from poise.nodes.clock import with_time
from poise.nodes.loop import LOOP_PARAMETERS, Watching, perform, stop_on_signals
from poise.nodes.loop_processes import NodeProcesses
from poise.nodes.loop_sequence import StepRecord

NODES = (
    "fake_robot",
    "world_model",
    "object_scanner",
    "object_picker",
    "placement_planner",
    "inertial_estimator",
    "robustness_server",
    "acceleration_limits",
    "object_carrier",
)
_MEETING = 1.5
"""s in which nodes of another loop are found."""


class LoopJob(NamedTuple):
    """What is asked for: the options of the command.

    Args:
        robot, objects, seed, world, distance, shapes, out: as there.
        real_time: the time of the machine, not simulated time.
        rate: s of simulated time in a second, where the machine keeps up.
    """

    robot: str
    objects: int
    seed: int
    world: Path | None
    distance: float
    shapes: str
    out: Path | None
    real_time: bool = False
    rate: float = 1.0


class _Watched(Watching):
    """Looks after the processes, and passes on what happens."""

    def __init__(
        self,
        processes: NodeProcesses,
        step: Callable[[StepRecord | None, str], None],
        progress: Callable[[str, float], None],
    ) -> None:
        self._processes = processes
        self.step, self.progress = step, progress  # type: ignore[method-assign]

    def check(self) -> list[str]:
        return self._processes.check()

    @property
    def restarts(self) -> dict[str, int]:
        return {name: count - 1 for name, count in self._processes.starts.items()}


def run_job(
    job: LoopJob,
    step: Callable[[StepRecord | None, str], None],
    progress: Callable[[str, float], None],
    began: Callable[[NodeProcesses], None] = lambda processes: None,
) -> tuple[dict[str, Any], Assembly | None]:
    """Run a loop; the content of loop.json, and what stands at the end. Its bag is written, and nothing else.

    Args:
        job: options.
        step, progress: as of `Watching`.
        began: called with the processes when they are started.

    Raises:
        InputError: FILE_UNREADABLE for a robot without parameters; BUSY when another loop runs; as `load_scene`.
        NoAnswerError: NO_PLACEMENT as `random_table`.
    """
    with TemporaryDirectory(prefix="poise-loop-") as scratch:
        folder = Path(scratch) if job.out is None else job.out
        folder.mkdir(parents=True, exist_ok=True)
        config = parameter_file(job.robot)
        world, extra = prepare_world(job.world, job.objects, job.seed, folder)
        names = [name for name in NODES if name != "object_scanner" or job.shapes == "scan"]
        if not job.real_time:
            extra = with_simulated_time(extra, job.rate)
        processes = NodeProcesses(names, [config], folder, keep=["fake_robot"], extra=extra)
        values = _values(job, config, world)
        content, stack = _run(not job.real_time, processes, values, step, progress, began)
        content["world"] = str(world)
        return content, stack


def prepare_world(
    world: Path | None, objects: int, seed: int, folder: Path
) -> tuple[Path, dict[str, dict[str, str | int]]]:
    """The scene of the true world, and the parameters of single nodes that name it.

    Args:
        world: the scene file; None: random objects.
        objects, seed: of random ones.
        folder: for the files that are made.
    """
    world = (world or random_table(objects, np.random.default_rng(seed), folder)).resolve()
    truth = load_scene(world)
    fixed, state = (folder / name for name in ("fixed.yaml", "world_state"))
    write_scene(Assembly(tuple(item for item in truth.objects if item.fixed), truth.gravity, truth.friction), fixed)
    state.unlink(missing_ok=True)
    return world, {
        "fake_robot": {"world": str(world), "seed": seed},
        "world_model": {"scene": str(fixed.resolve()), "state_file": str(state.resolve())},
    }


def with_simulated_time(extra: Mapping[str, Mapping[str, Any]], rate: float) -> dict[str, dict[str, Any]]:
    """Parameters of single nodes, by which the fake robot gives the time and the others follow it.

    Args:
        extra: parameters of single nodes.
        rate: s of simulated time in a second.
    """
    gives: dict[str, Any] = {"publish_clock": True, "rate": rate}
    return {
        name: {**extra.get(name, {}), **(gives if name == "fake_robot" else {"use_sim_time": True})} for name in NODES
    }


def parameter_file(robot: str) -> Path:
    """The parameters of the nodes for a robot.

    Raises:
        InputError: FILE_UNREADABLE.
    """
    if Path(robot).suffix == ".yaml":
        path = Path(robot)
    else:
        path = Path(get_package_share_directory("poise")) / "config" / f"loop_{robot}.yaml"
        beside = Path(__file__).resolve().parents[1] / "config" / path.name
        path = beside if beside.is_file() else path
    if not path.is_file():
        raise InputError(
            ErrorCode.FILE_UNREADABLE, f"there are no parameters for {robot!r}: give fr3, or the path of a file"
        )
    return path


def _values(job: LoopJob, config: Path, world: Path) -> dict[str, Any]:
    """Parameters of the node `loop`: defaults, those of the file, then the options."""
    values = {each.name: each.default for each in LOOP_PARAMETERS} | {"riding": []}
    try:
        values |= yaml.safe_load(config.read_text(encoding="utf-8"))["/**"]["loop"]["ros__parameters"]
    except (OSError, UnicodeDecodeError, yaml.YAMLError, LookupError, TypeError, ValueError) as error:
        raise InputError(
            ErrorCode.BAD_INPUT, f"{config}: no parameters of the node loop ('/**': loop: ros__parameters): {error!r}"
        ) from error
    return values | {
        "objects": job.objects,
        "seed": job.seed,
        "distance": job.distance,
        "shapes": job.shapes,
        "world": str(world),
        "out": "" if job.out is None else str(job.out),
    }


def _run(
    simulated: bool,
    processes: NodeProcesses,
    values: dict[str, Any],
    step: Callable[[StepRecord | None, str], None],
    progress: Callable[[str, float], None],
    began: Callable[[NodeProcesses], None],
) -> tuple[dict[str, Any], Assembly | None]:
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    stopped = stop_on_signals()
    node = Node("loop", parameter_overrides=with_time(simulated))
    try:
        _refuse_second(node)
        processes.start()
        began(processes)
        answer = perform(node, values, _Watched(processes, step, progress), stopped.is_set)
    finally:
        processes.stop()
        node.destroy_node()
        rclpy.try_shutdown()
    return answer


def _refuse_second(node: Node) -> None:
    """Check that no other loop runs in this ROS domain.

    Raises:
        NoAnswerError: BUSY.
    """
    time.sleep(_MEETING)
    others = sorted({"fake_robot", "world_model", "object_picker"} & set(node.get_node_names()))
    if others:
        what = f"{', '.join(others)} runs already in this ROS domain: stop it, or set another ROS_DOMAIN_ID"
        raise NoAnswerError(ErrorCode.BUSY, what)
