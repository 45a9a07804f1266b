"""Hostile requests and goals to running nodes, made from the definitions of the interfaces; every answer is judged.

    python -m benchmarks.chaos.fuzz                   # 2,000 calls of services, 100 goals
    python -m benchmarks.chaos.fuzz --count 20000
    python -m benchmarks.chaos.fuzz --quick           # 150 and 10
    python -m benchmarks.chaos.fuzz --readers 20000   # the functions that read messages, without nodes

Four of five requests are sound ones in which one to three fields are replaced; in the others every field is hostile.
Exits with 1 for a fault: no answer in time, a node that ended, or an answer that is neither refused nor consistent.
Writes out/benchmarks/fuzz.json.
"""

import argparse
import json
import math
import os
import random
import sys
import tempfile
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from geometry_msgs.msg import TransformStamped
from rich.console import Console
from tf2_msgs.msg import TFMessage

from benchmarks.chaos.hostile import hostile, numbers_of, spoiled
from benchmarks.chaos.observer import Observer, TooLateError
from benchmarks.chaos.processes import TRANSPORT, NodeProgram
from benchmarks.chaos.subjects import Planner, cube_message, low_push
from poise.errors import ErrorCode, PoiseError
from poise.nodes.assembly_message import assembly_of, pushes_of
from poise.nodes.payload_shape import parts_of_message
from poise.nodes.transforms import add_transforms
from poise.robot import FrameTree
from poise_msgs.action import IdentifyPayload, PlaceObject
from poise_msgs.msg import Assembly, SegmentedObject
from poise_msgs.srv import AssessRobustness, PlanDisassembly, SetAssembly

_DEADLINE = 0.5
"""s in every request, so that thousands take minutes."""
_LATE = 20.0
"""s after which an answer counts as missing; the machine may have other load."""
_MAY_BE_INFINITE = ("robustness", "lower", "upper", "margin", "margins", "com", "covariance", "load")


@dataclass(frozen=True)
class Target:
    """One interface.

    Args:
        kind: of the service or action.
        name: of it.
        node: that serves it.
        request: class of the request or goal.
        sound: makes a request that is answered.
    """

    kind: Any
    name: str
    node: str
    request: Any
    sound: Callable[[], Any]


def _set_request() -> SetAssembly.Request:
    return SetAssembly.Request(operation=SetAssembly.Request.REPLACE, assembly=cube_message())


def _assess_request() -> AssessRobustness.Request:
    return AssessRobustness.Request(assembly=[cube_message()], pushes=[low_push()], map_points=20)


SERVICES = (
    Target(AssessRobustness, "assess_robustness", "robustness_server", AssessRobustness.Request, _assess_request),
    Target(SetAssembly, "set_assembly", "robustness_server", SetAssembly.Request, _set_request),
    Target(
        PlanDisassembly,
        "plan_disassembly",
        "robustness_server",
        PlanDisassembly.Request,
        lambda: PlanDisassembly.Request(assembly=[cube_message()]),
    ),
)
ACTIONS = (
    Target(PlaceObject, "place_object", "placement_planner", PlaceObject.Goal, lambda: Planner().goal(_DEADLINE)),
    Target(
        IdentifyPayload,
        "identify_payload",
        "inertial_estimator",
        IdentifyPayload.Goal,
        lambda: IdentifyPayload.Goal(duration=0.05),
    ),
)


def made(target: Target, rng: random.Random) -> Any:
    """A hostile request; its deadline is short, and it moves no arm."""
    while True:
        try:
            request = (
                spoiled(target.sound(), rng, rng.randint(1, 3)) if rng.random() < 0.8 else hostile(target.request, rng)
            )
        except AssertionError:  # a field that the message class itself refuses
            continue
        if hasattr(request, "deadline") and not (math.isfinite(request.deadline) and request.deadline > _DEADLINE):
            request.deadline = request.deadline if rng.random() < 0.2 else _DEADLINE
        if hasattr(request, "duration"):
            request.duration, request.motion = min(request.duration, 0.1), IdentifyPayload.Goal.MOTION_NONE
        return request


def fault_of(request: Any, response: Any) -> str:
    """What is wrong with an answer; empty: nothing."""
    code = response.error.code
    if code == ErrorCode.INTERNAL:
        return f"internal error: {response.error.message[:150]}"
    numbers = numbers_of(response)
    if code in (ErrorCode.OK, ErrorCode.DEADLINE):
        for path, number in numbers.items():
            documented = any(word in path for word in _MAY_BE_INFINITE)
            if math.isnan(number) and code == ErrorCode.OK and "estimate" not in path:
                return f"NaN in {path}"
            if math.isinf(number) and not documented and "estimate" not in path:
                return f"infinite {path}"
    for answer in getattr(response, "robustness", ()) if isinstance(getattr(response, "robustness", 0), list) else ():
        if not answer.lower <= answer.robustness <= answer.upper:
            return f"bounds {answer.lower} {answer.robustness} {answer.upper}, code {code}"
    if code == ErrorCode.OK:
        bad = [path for path, number in numbers_of(request).items() if math.isnan(number) and not _ignored(path)]
        if bad:
            return f"code 0 with NaN in {bad[0]}"
    return ""


def _ignored(path: str) -> bool:
    """Numbers that are documented as not read, or for which NaN means that they are not given."""
    words = ("objects[0]", "inertia", "mesh", "covariance", "polygon")  # a box and a cylinder have no polygon
    return path == "deadline" or any(word in path for word in words)


def fuzz_readers(count: int, seed: int) -> Counter[str]:
    """Give hostile messages to the functions that read messages; returns exceptions that are no PoiseError."""
    rng, faults = random.Random(seed), Counter[str]()
    readers: tuple[tuple[Any, Callable[[], Any], Callable[[Any], Any]], ...] = (
        (Assembly, cube_message, assembly_of),
        (AssessRobustness.Request, _assess_request, lambda request: pushes_of(request.pushes, request.groups)),
        (SegmentedObject, SegmentedObject, parts_of_message),
        (TFMessage, lambda: TFMessage(transforms=[TransformStamped()]), lambda tf: add_transforms(FrameTree(), tf)),
    )
    for number in range(count):
        kind, sound, read = readers[number % len(readers)]
        try:
            message = spoiled(sound(), rng, rng.randint(1, 3)) if rng.random() < 0.6 else hostile(kind, rng)
        except AssertionError:
            continue
        try:
            read(message)
        except PoiseError:
            continue
        except Exception as error:  # what is looked for
            faults[f"{kind.__name__}: {error!r}"[:200]] += 1
    return faults


class Fuzzer:
    """Sends hostile requests, and counts what comes back.

    Args:
        observer: sends them.
        programs: the nodes by name.
        seed: of the requests.
    """

    def __init__(self, observer: Observer, programs: dict[str, NodeProgram], seed: int) -> None:
        self._observer, self._programs, self._rng = observer, programs, random.Random(seed)
        self.codes: Counter[str] = Counter()
        self.faults: Counter[str] = Counter()

    def run(self, targets: tuple[Target, ...], count: int, ask: Callable[..., Any]) -> None:
        """Send `count` requests by `ask(kind, name, request, timeout)`."""
        for number in range(count):
            target = targets[number % len(targets)]
            request = made(target, self._rng)
            try:
                response = ask(target.kind, target.name, request, _LATE)
            except TooLateError as late:
                self._note(target, f"no answer: {late}")
            except (UnicodeError, AssertionError):  # the client's own message class refuses it
                continue
            else:
                if response is not None:
                    self.codes[f"{target.name} {ErrorCode(response.error.code).name}"] += 1
                    self._note(target, fault_of(request, response))
            program = self._programs[target.node]
            if not program.is_running:
                self._note(target, f"the node ended: {program.output.strip()[-200:]}")
                program.start()

    def _note(self, target: Target, fault: str) -> None:
        if fault:
            self.faults[f"{target.name}: {fault}"] += 1


def fuzz(calls: int, goals: int, seed: int, domain: int) -> Fuzzer:
    """Start the nodes, send everything, stop them."""
    observer = Observer(domain)
    with tempfile.TemporaryDirectory() as folder:
        nodes = {target.node: {} for target in SERVICES} | ({target.node: {} for target in ACTIONS} if goals else {})
        if goals:
            nodes["fake_robot"] = {"mode": "arm", "robot": "fr3"}
        programs = {name: NodeProgram(name, values, Path(folder), domain) for name, values in nodes.items()}
        fuzzer = Fuzzer(observer, programs, seed)
        try:
            for program in programs.values():
                program.start()
            for target in SERVICES:
                observer.call(target.kind, target.name, target.sound())
            fuzzer.run(SERVICES, calls, observer.call)
            if goals:
                for target in ACTIONS:
                    observer.until(observer.actor(target.kind, target.name).server_is_ready, target.name)
                observer.rest(1.0)
                fuzzer.run(ACTIONS, goals, observer.act)
            for name, program in programs.items():
                if program.stop() != 0:
                    fuzzer.faults[f"{name} did not end cleanly: {program.output.strip()[-200:]}"] += 1
        finally:
            for program in programs.values():
                program.kill()
            observer.close()
    return fuzzer


def main() -> None:
    """Run what the arguments ask for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=2000, help="calls of services; a twentieth as many goals")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--domain", type=int, default=79)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--readers", type=int, default=0, metavar="COUNT", help="fuzz functions instead of nodes")
    arguments = parser.parse_args()
    if arguments.readers:
        faults = fuzz_readers(arguments.readers, arguments.seed)
        print(f"{sum(faults.values())} faults in {arguments.readers} messages", *faults.most_common(), sep="\n")
        sys.exit(bool(faults))
    os.environ.update(TRANSPORT)
    count = 150 if arguments.quick else arguments.count
    found = fuzz(count, max(count // 20, 10), arguments.seed, arguments.domain)
    console = Console()
    for name, number in sorted(found.codes.items()):
        console.print(f"{number:6d} {name}", markup=False)
    for name, number in found.faults.most_common():
        console.print(f"FAULT {number} x {name}", markup=False)
    console.print(f"{sum(found.faults.values())} faults in {sum(found.codes.values())} answers")
    result = Path("out/benchmarks/fuzz.json")
    result.parent.mkdir(parents=True, exist_ok=True)
    result.write_text(json.dumps({"codes": found.codes, "faults": found.faults}, indent=1))
    sys.exit(bool(found.faults))


if __name__ == "__main__":
    main()
