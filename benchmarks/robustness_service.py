"""The robustness service from outside: overhead, calls in flight, one heavy client among others, refused changes."""

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
from poise.nodes.runtime import EventsExecutor, run
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


def beside_maps(caller: Caller, calls: int) -> dict[str, Any]:
    """Round trips of one push, alone and while another client has the largest allowed maps computed, ms."""
    assembly = SCENES["stack of 3"]
    message = assembly_message(assembly, "world")
    client = caller.client(AssessRobustness, "assess_robustness", 1000)
    caller.call(caller.client(SetAssembly, "set_assembly"), SetAssembly.Request(assembly=message))
    push = AssessRobustness.Request(pushes=pushes_on(assembly, 1))
    map_ = AssessRobustness.Request(assembly=[message], map_points=100_000, map_tolerance=0.001, deadline=20.0)
    trips = {}
    for name in ("alone", "beside maps"):
        maps = [client.call_async(map_) for _ in range(10)] if name == "beside maps" else []
        found = []
        while len(found) < calls and (not maps or not all(future.done() for future in maps)):
            found.append(caller.call(client, push)[1] * 1e3)
        trips[name] = [len(found), *np.quantile(found, (0.5, 0.99)).tolist()]
        caller.spin(partial(_all_done, maps), 10 * PATIENCE)
    return trips


def after_abuse(caller: Caller, count: int) -> dict[str, Any]:
    """Clients that call at once, after maps, plans and assemblies that were too much: how the calls end."""
    message, push = assembly_message(SCENES["stack of 3"], "world"), pushes_on(SCENES["stack of 3"], 1)
    abused = caller.client(AssessRobustness, "assess_robustness", 1000)
    blocks = [box(f"b{i}_{j}", (0.2, 0.1, 0.1), (0.2 * i, 0.2 * j, 0.05)) for i in range(40) for j in range(40)]
    large = assembly_message(Assembly((FLOOR, *blocks)), "world")
    for request in (
        AssessRobustness.Request(assembly=[large], map_points=100_000, deadline=1.0),
        AssessRobustness.Request(assembly=[message], map_points=4_000_000_000),
        AssessRobustness.Request(assembly=[message], map_points=100_000, map_tolerance=0.001, deadline=0.5),
    ):
        caller.call(abused, request)
    clients = [caller.client(AssessRobustness, "assess_robustness", 1000) for _ in range(count)]
    request = AssessRobustness.Request(assembly=[message], pushes=push, deadline=5.0)
    start = time.perf_counter()
    futures = [client.call_async(request) for client in clients]
    caller.spin_while_answers_come(futures)
    seconds = time.perf_counter() - start
    codes = Counter(ErrorCode(f.result().error.code).name if f.done() else "lost" for f in futures)
    for client in clients:
        caller.node.destroy_client(client)
    return {"answers": dict(codes), "seconds": seconds}


def refused_changes(caller: Caller, count: int) -> dict[str, Any]:
    """Changes that are refused or late, one after the other: how many of them changed the version."""
    setter = caller.client(SetAssembly, "set_assembly", 1000)
    good = assembly_message(SCENES["cube"], "world")
    version = caller.call(setter, SetAssembly.Request(assembly=good))[0].version
    stack = assembly_message(SCENES["stack of 30"], "world")
    codes: Counter[str] = Counter()
    changed = 0
    for number in range(count):
        bad = assembly_message(SCENES["cube"], "world")
        request = SetAssembly.Request(assembly=bad)
        match number % 5:
            case 0:
                request.assembly, request.deadline = stack, 1e-4
            case 1:
                bad.objects[1].pose.position.z = 0.3
            case 2:
                request.operation, bad.header.frame_id = SetAssembly.Request.ADD_OR_MOVE, "camera"
            case 3:
                request.expected_version = version + 1000
            case _:
                bad.objects[1].inertia.m = float("nan")
        answer, _ = caller.call(setter, request)
        codes[ErrorCode(answer.error.code).name] += 1
        if answer.error.code != ErrorCode.OK:
            changed += answer.version != version
        version = answer.version
    return {"answers": dict(codes), "changed": changed}


def _all_done(futures: list[Any]) -> bool:
    return all(future.done() for future in futures)


def start_server(domain: int, scene: Path) -> subprocess.Popen[bytes]:
    environment = os.environ | {"ROS_DOMAIN_ID": str(domain), "AMENT_PREFIX_PATH": sys.prefix}
    environment.pop("_ROS_WHEELS_BOOTSTRAP_COMPLETE", None)
    environment.pop("LD_LIBRARY_PATH", None)
    command = [Path(sys.prefix) / "lib" / "poise" / "robustness_server", "--ros-args", "-p", f"scene:={scene}"]
    return subprocess.Popen(command, env=environment, start_new_session=True)


class BareNode(Node):
    """Answers the same requests at once: what a service of rclpy takes with these messages."""

    def __init__(self) -> None:
        super().__init__("bare")
        self.create_service(AssessRobustness, "bare", lambda _, response: response)


def bare_trips(caller: Caller, domain: int, calls: int) -> dict[str, list[float]]:
    """Round trips to a service that computes nothing, ms: median and 95 %, for each scene sent along with one push."""
    environment = os.environ | {"ROS_DOMAIN_ID": str(domain)}
    server = subprocess.Popen([sys.executable, "-m", "benchmarks.robustness_service", "--bare"], env=environment)
    found = {}
    try:
        client = caller.client(AssessRobustness, "bare")
        for name, assembly in SCENES.items():
            for along in (False, True):
                message = [assembly_message(assembly, "world")] if along else []
                request = AssessRobustness.Request(assembly=message, pushes=pushes_on(assembly, 1))
                caller.call(client, request)
                trips = [caller.call(client, request)[1] for _ in range(calls)]
                key = f"{name}, {'along' if along else 'set'}"
                found[key] = (1e3 * np.quantile(trips, (0.5, 0.95))).tolist()
    finally:
        server.kill()
        server.wait(PATIENCE)
    return found


def measure(arguments: argparse.Namespace) -> dict[str, Any]:
    """All figures, by name."""
    with tempfile.TemporaryDirectory() as folder:
        write_scene(SCENES["cube"], Path(folder) / "scene.yaml")
        server = start_server(arguments.domain, Path(folder) / "scene.yaml")
        try:
            caller = Caller(arguments.domain)
            return {
                "bare": bare_trips(caller, arguments.domain, arguments.calls),
                "round_trips": overheads(caller, arguments.calls),
                "in_flight": in_flight(caller, 100, arguments.rounds),
                "others": beside_maps(caller, 10 * arguments.calls),
                "crowd": after_abuse(caller, 200),
                "refusals": refused_changes(caller, arguments.refusals),
            }
        finally:
            server.terminate()
            server.wait(PATIENCE)


def report(found: dict[str, Any]) -> None:
    """Print the tables."""
    console = Console(width=120)
    table = Table(
        "scene", "assembly", "pushes", "computation ms", "overhead ms: median", "95 %", title="One call at a time"
    )
    for row in found["round_trips"]:
        median, most = row["overhead_ms"]
        cells = (row["scene"], row["assembly"], str(row["pushes"]), f"{row['computation_ms']:.2f}")
        table.add_row(*cells, f"{median:.2f}", f"{most:.2f}")
    console.print(table)
    table = Table("scene, one push", "median ms", "95 %", title="The same requests to a service that computes nothing")
    for name, (median, most) in found["bare"].items():
        table.add_row(name, f"{median:.2f}", f"{most:.2f}")
    console.print(table)
    table = Table("client", "assembly", "answers", "seconds", title="100 calls in flight")
    for row in found["in_flight"]:
        table.add_row(row["client"], row["assembly"], str(row["answers"]), f"{row['seconds']:.3f}")
    console.print(table)
    table = Table("one push", "calls", "median ms", "99 % ms", title="One client among others")
    for name, (count, median, most) in found["others"].items():
        table.add_row(name, str(count), f"{median:.2f}", f"{most:.2f}")
    console.print(table)
    crowd, refusals = found["crowd"], found["refusals"]
    console.print(
        f"200 clients at once, after calls that were too much: {crowd['answers']} in {crowd['seconds']:.2f} s"
    )
    console.print(f"refused changes: {refusals['answers']}; {refusals['changed']} changed the assembly")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--calls", type=int, default=100, help="for each round trip")
    parser.add_argument("--rounds", type=int, default=10, help="of a hundred calls in flight")
    parser.add_argument("--refusals", type=int, default=1000, help="changes that are refused")
    parser.add_argument("--domain", type=int, default=89)
    parser.add_argument("--bare", action="store_true", help="be the service that computes nothing")
    arguments = parser.parse_args()
    if arguments.bare:
        run(BareNode, [])
        return
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    found = measure(arguments)
    report(found)
    result = Path("out/benchmarks/robustness_service.json")
    result.parent.mkdir(parents=True, exist_ok=True)
    result.write_text(json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
