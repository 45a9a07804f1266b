"""Subscriptions of nodes: a publisher that offers only best effort is heard, and a reliable one only once."""

import time

import pytest
import rclpy
from geometry_msgs.msg import Wrench, WrenchStamped
from rclpy.context import Context
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy

from poise.nodes.inbox import Inbox
from poise.nodes.inertial_estimator import DEPTH
from poise.nodes.runtime import subscribe, topic_hint

pytestmark = pytest.mark.ros


@pytest.mark.parametrize("raw", [False, True])
def test_best_effort_publishers_are_heard_and_nothing_is_heard_twice(graph, raw) -> None:
    node = Node("listener", context=graph.node.context)
    graph.add(node)
    heard: list[object] = []
    subscribe(node, WrenchStamped, "wrench", heard.append, 100, raw=raw)
    reliable = graph.node.create_publisher(WrenchStamped, "wrench", QoSProfile(depth=100))
    graph.wait_for(reliable.get_subscription_count, what="the reliable subscription")
    reliable.publish(WrenchStamped())
    graph.wait_for(lambda: len(heard) == 1, what="a reliable message")
    quality = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
    hasty = graph.node.create_publisher(WrenchStamped, "wrench", quality)
    graph.wait_for(hasty.get_subscription_count, what="the subscription by best effort")
    graph.wait_for(lambda: reliable.get_subscription_count() == 2, what="both subscriptions")
    hasty.publish(WrenchStamped())
    graph.wait_for(lambda: len(heard) == 2, what="a message by best effort")
    reliable.publish(WrenchStamped())
    reliable.publish(WrenchStamped())
    graph.wait_for(lambda: len(heard) >= 4, what="two reliable messages")
    assert len(heard) == 4
    node.destroy_node()


class Slow(Node):
    """Takes a while for each wrench."""

    def __init__(self, context: Context, depth: int, pause: float = 0.0) -> None:
        self.inbox = Inbox(depth, ["/wrench"])
        super().__init__("slow", context=context)
        self.heard: list[WrenchStamped] = []
        self.ticks = 0
        self.pause = pause
        subscribe(self, WrenchStamped, "wrench", self.hear, depth)
        self.create_timer(0.02, self.tick)

    @property
    def subscriptions(self):
        return self.inbox.others(super().subscriptions)

    def hear(self, message: WrenchStamped) -> None:
        self.heard.append(message)
        time.sleep(self.pause)

    def tick(self) -> None:
        self.ticks += 1
        self.inbox.take(super().subscriptions)


@pytest.mark.parametrize("depth", [20, DEPTH])
def test_a_queue_that_was_full_keeps_the_newest_and_is_counted(graph, depth) -> None:
    node = Slow(graph.node.context, depth)
    graph.add(node)
    publisher = graph.node.create_publisher(WrenchStamped, "wrench", QoSProfile(depth=2 * depth))
    graph.wait_for(publisher.get_subscription_count, what="the subscription")
    message = WrenchStamped()
    for count, kept, full in ((depth // 2, depth // 2, 0), (depth * 3 // 2, depth, 1), (10, 10, 1)):
        node.heard.clear()
        for number in range(count):
            message.header.stamp.sec = number
            publisher.publish(message)
        graph.wait_for(lambda kept=kept: len(node.heard) >= kept, what="the messages that waited")
        assert [one.header.stamp.sec for one in node.heard] == list(range(count - kept, count))
        assert node.inbox.overflows == full
    node.destroy_node()


def test_a_node_that_is_slower_than_a_topic_comes_to_its_timers(graph) -> None:
    """Three times as many messages as it can take: with an event for each, the timer would wait behind all of them."""
    node = Slow(graph.node.context, 20, pause=0.002)
    executor = EventsExecutor(context=graph.node.context)
    executor.add_node(node)
    publisher = graph.node.create_publisher(WrenchStamped, "wrench", QoSProfile(depth=20))
    graph.wait_for(publisher.get_subscription_count, what="the subscription")
    message = WrenchStamped()
    for _ in range(20):
        for _ in range(60):
            publisher.publish(message)
        executor.spin_once(timeout_sec=0.04)
    assert node.ticks >= 10
    assert node.inbox.overflows >= 5
    assert len(node.heard) < 0.5 * 20 * 60  # the rest was lost, and counted
    executor.shutdown()
    node.destroy_node()


def test_a_silent_topic_is_explained_by_its_type_or_by_other_topics_of_this_type(graph) -> None:
    kind = "geometry_msgs/msg/WrenchStamped"
    subscribe(graph.node, WrenchStamped, "wrench", lambda message: None, 10)
    assert topic_hint(graph.node, "wrench", kind) == ""
    graph.node.create_publisher(WrenchStamped, "ft/wrench", 10)
    graph.wait_for(lambda: topic_hint(graph.node, "wrench", kind), what="the other topic")
    assert topic_hint(graph.node, "wrench", kind) == f"; {kind} is on /ft/wrench: remap wrench to it"
    silent = graph.node.create_publisher(WrenchStamped, "wrench", 10)
    graph.wait_for(lambda: "nothing arrives" in topic_hint(graph.node, "wrench", kind), what="the silent publisher")
    graph.node.destroy_publisher(silent)
    graph.wait_for(lambda: "nothing arrives" not in topic_hint(graph.node, "wrench", kind), what="its end")
    other = Context()  # one participant of DDS has one type for a name
    rclpy.init(context=other, domain_id=graph.domain)
    driver = Node("driver", context=other)
    driver.create_publisher(Wrench, "wrench", 10)
    graph.wait_for(lambda: "carries" in topic_hint(graph.node, "wrench", kind), what="the other type")
    assert topic_hint(graph.node, "wrench", kind) == f"; /wrench carries geometry_msgs/msg/Wrench, not {kind}"
    driver.destroy_node()
    rclpy.shutdown(context=other)
