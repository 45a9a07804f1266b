"""A node ends cleanly whenever it is stopped."""

import subprocess
import sys

STOPPED_HALFWAY = """
import rclpy
from rclpy.event_handler import EventHandler
from rclpy.node import Node
from std_msgs.msg import Empty

from poise.nodes.runtime import run, subscribe


class Listener(Node):
    def __init__(self):
        super().__init__("listener")
        for topic in "abc":
            subscribe(self, Empty, topic, print, 1)


asked = []
number_of = EventHandler.get_num_entities


def stop_at_the_second(handler):
    asked.append(handler)
    if len(asked) == 2:  # as by a signal: the executor has taken in one event handler, and is taking in the next
        rclpy.get_default_context().try_shutdown()
    return number_of(handler)


EventHandler.get_num_entities = stop_at_the_second
run(Listener)
"""


def test_a_signal_while_the_executor_takes_in_entities_ends_the_node_cleanly() -> None:
    command = [sys.executable, "-c", STOPPED_HALFWAY]
    done = subprocess.run(command, capture_output=True, text=True, timeout=100, check=False)
    assert "ready" in done.stderr
    assert done.returncode == 0, done.stderr
