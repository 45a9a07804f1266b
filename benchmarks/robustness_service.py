"""The robustness service from outside: round trip beyond the computation, and a hundred calls in flight."""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections import Counter
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rich.console import Console
from rich.progress import track
from rich.table import Table

from poise.assembly import Assembly, Box, RigidObject, write_scene
from poise.assembly.contact.graph import Structure
from poise.assembly.contact.surface import sample_surface
from poise.errors import ErrorCode
from poise.geometry import Pose
from poise.nodes.assembly_message import assembly_message
from poise.nodes.runtime import EventsExecutor
from poise_msgs.msg import Push as PushMessage
from poise_msgs.srv import AssessRobustness, SetAssembly

PATIENCE = 60.0  # s for anything
SILENCE = 4.0  # s without an answer after which the rest of many count as lost


def box(
    name: str, size: tuple[float, float, float], place: tuple[float, float, float], fixed: bool = False
) -> RigidObject:
    return RigidObject(name, Box(size), Pose.from_vector([*place, 0, 0, 0, 1]), fixed, 1.0)


FLOOR = box("floor", (20.0, 20.0, 0.1), (0, 0, -0.05), fixed=True)
SCENES = {
    "cube": Assembly((FLOOR, box("cube", (1.0, 1.0, 1.0), (0, 0, 0.5)))),
    "stack of 3": Assembly((FLOOR, *(box(f"c{i}", (1.0, 1.0, 1.0), (0, 0, 0.5 + i)) for i in range(3)))),
    "slab on two legs": Assembly(
        (
            FLOOR,
            *(box(f"leg{x}", (0.2, 1.0, 1.0), (x, 0, 0.5)) for x in (-0.9, 0.9)),
            box("slab", (2.0, 1.0, 0.2), (0, 0, 1.1)),
        )
    ),
    "stack of 30": Assembly((FLOOR, *(box(f"c{i}", (1.0, 1.0, 1.0), (0, 0, 0.5 + i)) for i in range(30)))),
}


class Caller:
    """A node that calls the server.

    Args:
        domain: ROS domain of the server.
        depth: of the history of its services; None: rclpy's own.
    """

    def __init__(self, domain: int) -> None:
        rclpy.init(domain_id=domain)
        self.node = Node("caller")
        self._executor = EventsExecutor()
        self._executor.add_node(self.node)

    def client(self, kind: Any, name: str, depth: int | None = None) -> Any:
        client = (
            self.node.create_client(kind, name)
            if depth is None
            else self.node.create_client(kind, name, qos_profile=QoSProfile(depth=depth))
        )
        self.spin(client.service_is_ready, PATIENCE)
        return client

    def spin(self, done: Any, patience: float) -> bool:
        deadline = time.monotonic() + patience
        while not done() and time.monotonic() < deadline:
            self._executor.spin_once(timeout_sec=0.05)
        return bool(done())

    def spin_while_answers_come(self, futures: list[Any]) -> None:
        """Until all are done, or none has been for so long that the rest are lost."""
        done = 0
        while done < len(futures) and self.spin(partial(_more_are_done, futures, done), SILENCE):
            done = sum(future.done() for future in futures)

    def call(self, client: Any, request: Any) -> tuple[Any, float]:
        """The response, and the round trip in s."""
        start = time.perf_counter()
        future = client.call_async(request)
        if not self.spin(future.done, PATIENCE):
            raise TimeoutError("no answer")
        return future.result(), time.perf_counter() - start


def _more_are_done(futures: list[Any], before: int) -> bool:
    return sum(future.done() for future in futures) > before


def pushes_on(assembly: Assembly, count: int) -> list[PushMessage]:
    structure = Structure.of(assembly)
    surface = sample_surface(structure, 1000)
    messages = []
    for row in np.random.default_rng(0).choice(len(surface.points), count, replace=False).tolist():
        message = PushMessage(object=assembly.objects[surface.place[row]].id)
        message.point.x, message.point.y, message.point.z = surface.points[row].tolist()
        message.direction.x, message.direction.y, message.direction.z = surface.directions[row].tolist()
        messages.append(message)
    return messages


def overheads(caller: Caller, calls: int) -> list[dict[str, Any]]:
    """Round trips less the computation, for each scene, set before or sent along, and numbers of pushes."""
    client = caller.client(AssessRobustness, "assess_robustness")
    setter = caller.client(SetAssembly, "set_assembly")
    rows = []
    for name, assembly in track(SCENES.items(), description="calling", total=len(SCENES)):
        message = assembly_message(assembly, "world")
        caller.call(setter, SetAssembly.Request(assembly=message))
        for along in (False, True):
            for count in (1, 100):
                pushes = pushes_on(assembly, count)
                request = AssessRobustness.Request(assembly=[message] if along else [], pushes=pushes)
                caller.call(client, request)
                found = [caller.call(client, request) for _ in range(calls)]
                beyond = np.array([trip - answer.seconds for answer, trip in found]) * 1e3
                inside = np.array([answer.seconds for answer, _ in found]) * 1e3
                rows.append(
                    {
                        "scene": name,
                        "assembly": "along" if along else "set",
                        "pushes": count,
                        "computation_ms": float(np.median(inside)),
                        "overhead_ms": np.quantile(beyond, (0.5, 0.95)).tolist(),
                    }
                )
    return rows


def in_flight(caller: Caller, count: int, rounds: int) -> list[dict[str, Any]]:
    """Calls made at once: how they end, for clients that keep enough answers and for rclpy's own."""
    message = assembly_message(SCENES["stack of 3"], "world")
    pushes = pushes_on(SCENES["stack of 3"], 1)
    setter = caller.client(SetAssembly, "set_assembly")
    caller.call(setter, SetAssembly.Request(assembly=message))
    rows = []
    for depth in (1000, None):
        client = caller.client(AssessRobustness, "assess_robustness", depth)
        for along in (False, True):
            codes: Counter[str] = Counter()
            seconds = []
            for _ in range(rounds):
                request = AssessRobustness.Request(assembly=[message] if along else [], pushes=pushes)
                start = time.perf_counter()
                futures = [client.call_async(request) for _ in range(count)]
                caller.spin_while_answers_come(futures)
                seconds.append(time.perf_counter() - start)
                codes.update(ErrorCode(f.result().error.code).name if f.done() else "lost" for f in futures)
            rows.append(
                {
                    "client": "depth 1000" if depth else "rclpy's own (depth 10)",
                    "assembly": "along" if along else "set",
                    "answers": dict(codes),
                    "seconds": float(np.median(seconds)),
                }
            )
        caller.node.destroy_client(client)
    return rows


def start_server(domain: int, scene: Path) -> subprocess.Popen[bytes]:
    environment = os.environ | {"ROS_DOMAIN_ID": str(domain), "AMENT_PREFIX_PATH": sys.prefix}
    environment.pop("_ROS_WHEELS_BOOTSTRAP_COMPLETE", None)
    environment.pop("LD_LIBRARY_PATH", None)
    command = [Path(sys.prefix) / "lib" / "poise" / "robustness_server", "--ros-args", "-p", f"scene:={scene}"]
    return subprocess.Popen(command, env=environment, start_new_session=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--calls", type=int, default=100, help="for each round trip")
    parser.add_argument("--rounds", type=int, default=10, help="of a hundred calls in flight")
    parser.add_argument("--domain", type=int, default=89)
    arguments = parser.parse_args()
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    with tempfile.TemporaryDirectory() as folder:
        write_scene(SCENES["cube"], Path(folder) / "scene.yaml")
        server = start_server(arguments.domain, Path(folder) / "scene.yaml")
        try:
            caller = Caller(arguments.domain)
            trips = overheads(caller, arguments.calls)
            bursts = in_flight(caller, 100, arguments.rounds)
        finally:
            server.terminate()
            server.wait(PATIENCE)
    console = Console(width=120)
    table = Table(
        "scene", "assembly", "pushes", "computation ms", "overhead ms: median", "95 %", title="One call at a time"
    )
    for row in trips:
        median, most = row["overhead_ms"]
        cells = (row["scene"], row["assembly"], str(row["pushes"]), f"{row['computation_ms']:.2f}")
        table.add_row(*cells, f"{median:.2f}", f"{most:.2f}")
    console.print(table)
    table = Table("client", "assembly", "answers", "seconds", title=f"100 calls in flight, {arguments.rounds} times")
    for row in bursts:
        table.add_row(row["client"], row["assembly"], str(row["answers"]), f"{row['seconds']:.3f}")
    console.print(table)
    result = Path("out/benchmarks/robustness_service.json")
    result.parent.mkdir(parents=True, exist_ok=True)
    result.write_text(json.dumps({"round_trips": trips, "in_flight": bursts}, indent=1))


if __name__ == "__main__":
    main()
