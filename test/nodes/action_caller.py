"""A client of one action for tests: sends goals, keeps the feedback, waits with deadlines."""

from typing import Any

from rclpy.action import ActionClient
from ros_graph import TIMEOUT, Graph

PATIENCE = 2.5 * TIMEOUT
"""s for the result of an action, which moves an arm and weighs, on a busy machine."""


class Caller:
    """Sends goals, and keeps what comes back."""

    def __init__(self, graph: Graph, action: Any, name: str) -> None:
        self._graph, self._action = graph, action
        self._client = ActionClient(graph.node, action, name)
        self.feedback: list[Any] = []

    def ready(self) -> "Caller":
        self._graph.wait_for(self._client.server_is_ready, what="the action")
        self._graph.meet()
        return self

    def send(self, **fields):
        """The handle of an accepted goal."""
        handle = self.offer(**fields)
        assert handle.accepted
        return handle

    def offer(self, **fields):
        """The handle of a goal, accepted or not."""
        goal = self._action.Goal(**fields)
        future = self._client.send_goal_async(goal, feedback_callback=lambda said: self.feedback.append(said.feedback))
        self._graph.wait_for(future.done, what="acceptance")
        return future.result()

    def result(self, handle, timeout: float = PATIENCE):
        future = handle.get_result_async()
        self._graph.wait_for(future.done, timeout, "the result")
        return future.result()

    def cancel(self, handle) -> None:
        """Ask for it, and wait until it is heard."""
        self._graph.wait_for(handle.cancel_goal_async().done, TIMEOUT, "the cancel response")

    def close(self) -> None:
        self._client.destroy()
