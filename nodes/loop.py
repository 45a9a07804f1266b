"""Node: the whole loop: scans, picks, weighs and places the objects of a table, then carries them."""

import json
import signal
import sys
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import rclpy
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from poise.assembly import Assembly
from poise.errors import ErrorCode, NoAnswerError, PoiseError
from poise.files import write_whole
from poise.nodes.clock import follow_clock
from poise.nodes.loop_bag import LoopBag
from poise.nodes.loop_results import loop_content
from poise.nodes.loop_robot import NodesRobot
from poise.nodes.loop_sequence import LoopSequence, StepRecord
from poise.nodes.parameters import WORDS, Parameter, declare_parameters
from poise.recording import RecordingWriter

LOOP_PARAMETERS = (
    Parameter("objects", 5, "objects that are scanned, weighed and placed", (1, 50)),
    Parameter("distance", 3.0, "m that the base then carries them forwards; 0: it does not", (0.0, 1000.0)),
    Parameter("speed", 0.5, "largest speed of the base, m/s", (0.01, 5.0)),
    Parameter("seed", 0, "equal seeds give equal plans", (0, 2**31 - 1)),
    Parameter("planning", 30.0, "s of planning of each pick and each placement", (1.0, 3600.0)),
    Parameter("ready_timeout", 60.0, "s to wait for all nodes, at the start and after one has ended", (1.0, 3600.0)),
    Parameter("riding", WORDS, "ids of fixed objects that the base carries: the tray"),
    Parameter("shapes", "scan", "shapes of the objects: by scan_object, or given by `world`", ("scan", "given")),
    Parameter("world", "", "scene file of the true world, for `given` and to compare with; empty: not known"),
    Parameter("out", "", "folder for loop.mcap and loop.json; empty: neither"),
)


class Watching:
    """How a loop is watched: each does nothing by default."""

    def step(self, record: StepRecord | None, words: str) -> None:
        """A step begins (None, with its words) or has ended."""

    def progress(self, words: str, share: float) -> None:
        """What the node of the step says; share: 0..1 or NaN."""

    def check(self) -> list[str]:
        """The nodes that have ended since this was asked last; may raise a PoiseError."""
        return []

    @property
    def restarts(self) -> dict[str, int]:
        """How often each node was started again."""
        return {}


def perform(
    node: Node, values: dict[str, Any], watching: Watching, stopped: Callable[[], bool]
) -> tuple[dict[str, Any], Assembly | None]:
    """Run a loop with nodes that run already or are being started.

    Args:
        node: of the loop.
        values: of `LOOP_PARAMETERS`.
        watching: is called back.
        stopped: the loop is to end, with the robot at rest.

    Returns:
        The content of loop.json, and what stands at the end.
    """
    follow_clock(node)
    begun = time.monotonic()
    out = Path(values["out"]) if values["out"] else None
    with ExitStack() as stack:
        bag = None
        if out is not None:
            out.mkdir(parents=True, exist_ok=True)
            bag = LoopBag(node, stack.enter_context(RecordingWriter(out / "loop.mcap")))

        def check() -> list[str]:
            if bag is not None:
                bag.look()
            return watching.check()

        robot = NodesRobot(node, values, check, stopped, watching.progress)
        stack.callback(robot.close)
        sequence = LoopSequence(robot, values["objects"], values["distance"], values["seed"], watching.step)
        record = sequence.record
        try:
            robot.ready(values["ready_timeout"])
        except PoiseError as error:
            record.error = error
        else:
            record = sequence.run()
        seconds = time.monotonic() - begun
        return loop_content(record, robot.planning, watching.restarts, seconds), robot.assembly


class _Logged(Watching):
    """Says each step in the log of a node."""

    def __init__(self, node: Node) -> None:
        self._logger = node.get_logger()

    def step(self, record: StepRecord | None, words: str) -> None:
        if record is None:
            self._logger.info(words)
        elif record.code is ErrorCode.OK:
            self._logger.info(f"{record.step} {record.name}: done in {record.seconds:.1f} s")
        else:
            self._logger.error(f"{record.step} {record.name}: {record.code.name}: {record.message}")


def stop_on_signals() -> threading.Event:
    """An event that Ctrl-C and SIGTERM set."""
    stopped = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stopped.set())
    return stopped


def main(args: list[str] | None = None) -> None:
    """Run one loop; exit 0 when it is complete, 3 when not."""
    rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    stopped, status = stop_on_signals(), 0
    node = Node("loop")
    try:
        values = declare_parameters(node, LOOP_PARAMETERS)
        content, _ = perform(node, values, _Logged(node), stopped.is_set)
        if values["out"]:
            write_whole(Path(values["out"]) / "loop.json", json.dumps(content, indent=2).encode())
        if not content["complete"]:
            print(content["sentence"] or "not all objects were placed", file=sys.stderr)
            status = NoAnswerError.exit_status
    except PoiseError as error:
        print(f"{error.code.name}: {error.message}", file=sys.stderr)
        status = error.exit_status
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
    sys.exit(status)


if __name__ == "__main__":
    main()
