"""The two processes of the transport benchmark: one publishes WrenchStamped at 1 kHz, the other says how it arrived."""

import json
import sys
import time

import numpy as np
import rclpy
from geometry_msgs.msg import WrenchStamped
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from poise.nodes.ft_driver import WRENCH_QOS
from poise.nodes.runtime import EventsExecutor

RATE = 1000
WARM_UP = 1000
"""Messages before those that count: until both ends know of each other, the first are sent again and come late."""
PATIENCE = 10.0
"""s without the other side, or without a message, after which an end gives up."""


def publish(count: int) -> None:
    """Publish `count` messages on an absolute schedule, stamped when they are handed over."""
    node = Node("publisher")
    publisher = node.create_publisher(WrenchStamped, "transport", WRENCH_QOS)
    deadline = time.monotonic() + PATIENCE
    while not publisher.get_subscription_count() and time.monotonic() < deadline:
        time.sleep(0.01)
    message = WrenchStamped()
    begin = time.monotonic()
    for number in range(-WARM_UP, count):
        time.sleep(max(0.0, begin + (number + WARM_UP) / RATE - time.monotonic()))
        message.wrench.force.x = float(number)
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(time.time_ns(), 10**9)
        publisher.publish(message)
    publisher.wait_for_all_acked(rclpy.duration.Duration(seconds=PATIENCE))
    node.destroy_node()


def subscribe(count: int, executor_name: str) -> None:
    """Receive; print losses, latencies (s) and the share of a core as JSON."""
    node = Node("subscriber")
    numbers: list[float] = []
    latencies: list[int] = []

    def receive(message: WrenchStamped) -> None:
        stamp = message.header.stamp
        if message.wrench.force.x < 0:
            return
        latencies.append(time.time_ns() - stamp.sec * 10**9 - stamp.nanosec)
        numbers.append(message.wrench.force.x)

    node.create_subscription(WrenchStamped, "transport", receive, WRENCH_QOS)
    executor = {"events": EventsExecutor, "single": SingleThreadedExecutor}[executor_name]()
    executor.add_node(node)
    last, seen = time.monotonic(), 0
    began = cpu = None
    while len(numbers) < count and time.monotonic() - last < PATIENCE:
        executor.spin_once(timeout_sec=0.5)
        if len(numbers) != seen:
            last, seen = time.monotonic(), len(numbers)
            if began is None:
                began, cpu = last, time.process_time()
    share = (time.process_time() - cpu) / (last - began) if began is not None and last > began else float("nan")
    latency = np.array(latencies or [np.inf]) * 1e-9
    result = {
        "sent": count,
        "lost": count - len(set(numbers)),
        "latency_p50": float(np.percentile(latency, 50)),
        "latency_p99": float(np.percentile(latency, 99)),
        "latency_max": float(latency.max()),
        "cpu_share": share,
    }
    print(json.dumps(result))
    executor.shutdown()
    node.destroy_node()


def main() -> None:
    """`publish COUNT` or `subscribe COUNT EXECUTOR`."""
    rclpy.init()
    if sys.argv[1] == "publish":
        publish(int(sys.argv[2]))
    else:
        subscribe(int(sys.argv[2]), sys.argv[3])
    rclpy.try_shutdown()


if __name__ == "__main__":
    main()
