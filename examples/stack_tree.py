"""Leaves of a behaviour tree that ask `assess_robustness` before the robot touches a stack.

python examples/stack_tree.py parcel --point -0.27 -0.12 0.26 --direction 1 0 0 --force 2.0

A leaf never blocks the tree: `tick` sends the question, says RUNNING until the answer is there, and FAILURE when none
comes in time. The statuses are those of BehaviorTree.CPP and py_trees.
"""

import argparse
import sys
import time
from collections.abc import Sequence
from enum import Enum
from typing import Any

import rclpy
from geometry_msgs.msg import Point, Vector3
from rclpy.node import Node
from rclpy.qos import QoSProfile

from poise_msgs.msg import Push
from poise_msgs.srv import AssessRobustness


class Status(Enum):
    """Of a leaf."""

    RUNNING = 0
    SUCCESS = 1
    FAILURE = 2


class StackHolds:
    """Condition: the stack holds a push with a force, and that is certified.

    Args:
        node: of the tree.
        push: where and along which direction the robot touches.
        force: N, at the most.
        deadline: s until an answer.
    """

    def __init__(self, node: Node, push: Push, force: float, deadline: float = 0.5) -> None:
        self._node, self._push, self._force, self._deadline = node, push, force, deadline
        self._client = node.create_client(AssessRobustness, "assess_robustness", qos_profile=QoSProfile(depth=100))
        self._future: Any = None
        self._due = 0.0
        self.why = ""

    def tick(self) -> Status:
        """One look at it."""
        now = time.monotonic()
        if self._due == 0.0:
            self._due = now + self._deadline + 0.5  # the server answers 0.25 s after its deadline at the latest
        if self._future is None:
            if self._client.service_is_ready():
                request = AssessRobustness.Request(pushes=[self._push], deadline=self._deadline)
                self._future = self._client.call_async(request)
        elif self._future.done():
            return self._judge(self._future.result())
        if now > self._due:
            return self._end(Status.FAILURE, "robustness_server did not answer in time")
        return Status.RUNNING

    def halt(self) -> None:
        """Forget the question: the tree went elsewhere."""
        if self._future is not None:
            self._client.remove_pending_request(self._future)
        self._future, self._due = None, 0.0

    def _judge(self, answer: AssessRobustness.Response) -> Status:
        if not answer.stable or answer.error.code not in (answer.error.OK, answer.error.DEADLINE):
            return self._end(Status.FAILURE, answer.error.message or "the stack does not stand")
        found = answer.robustness[0]
        # The certified bound decides, also when it is doubtful or the deadline passed.
        if not found.lower >= self._force:
            return self._end(
                Status.FAILURE, f"{', '.join(found.moves) or 'something'} may move from {found.lower:.2f} N on"
            )
        return self._end(Status.SUCCESS, f"it holds {found.lower:.2f} N at least")

    def _end(self, status: Status, why: str) -> Status:
        self.halt()
        self.why = why
        return status


class InTurn:
    """Ticks its children in turn, and ends with the first that fails."""

    def __init__(self, children: Sequence[Any]) -> None:
        self._children, self._at = children, 0

    def tick(self) -> Status:
        """One look at the present child."""
        while self._at < len(self._children):
            status = self._children[self._at].tick()
            if status is not Status.SUCCESS:
                self._at = self._at if status is Status.RUNNING else 0
                return status
            self._at += 1
        self._at = 0
        return Status.SUCCESS


def main() -> None:
    """Ask once, as a tree of one leaf."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("object", help="id of the object that is touched")
    parser.add_argument(
        "--point", type=float, nargs=3, required=True, metavar="M", help="where, in the assembly's frame"
    )
    parser.add_argument("--direction", type=float, nargs=3, required=True, metavar="D")
    parser.add_argument("--force", type=float, required=True, metavar="N")
    arguments = parser.parse_args()
    rclpy.init()
    node = Node("stack_tree")
    push = Push(object=arguments.object, point=Point(), direction=Vector3())
    push.point.x, push.point.y, push.point.z = arguments.point
    push.direction.x, push.direction.y, push.direction.z = arguments.direction
    leaf = StackHolds(node, push, arguments.force, deadline=5.0)
    tree = InTurn([leaf])
    while (status := tree.tick()) is Status.RUNNING:
        rclpy.spin_once(node, timeout_sec=0.05)
    print(f"{status.name}: {leaf.why}")
    rclpy.shutdown()
    sys.exit(0 if status is Status.SUCCESS else 3)


if __name__ == "__main__":
    main()
