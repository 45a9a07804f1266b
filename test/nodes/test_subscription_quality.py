"""Subscriptions of nodes: a publisher that offers only best effort is heard, and a reliable one only once."""

import pytest
import rclpy
from geometry_msgs.msg import Wrench, WrenchStamped
from rclpy.context import Context
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy

from poise.nodes.backlog import Backlog
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


@pytest.mark.parametrize("depth", [20, DEPTH])
def test_a_queue_that_was_full_while_the_node_was_held_up_keeps_the_newest_and_is_counted(graph, depth) -> None:
    node = Node("held_up", context=graph.node.context)
    graph.add(node)
    backlog = Backlog(depth)
    heard: list[WrenchStamped] = []
    subscribe(node, WrenchStamped, "wrench", backlog.counted("wrench", heard.append), depth)
    publisher = graph.node.create_publisher(WrenchStamped, "wrench", QoSProfile(depth=2 * depth))
    graph.wait_for(publisher.get_subscription_count, what="the subscription")
    message = WrenchStamped()
    for count, kept, full in ((depth // 2, depth // 2, []), (depth * 3 // 2, depth, ["wrench"]), (10, 10, [])):
        heard.clear()
        for number in range(count):
            message.header.stamp.sec = number
            publisher.publish(message)
        graph.wait_for(lambda kept=kept: len(heard) >= kept, what="the messages that waited")
        assert [one.header.stamp.sec for one in heard] == list(range(count - kept, count))
        assert backlog.full() == full
    assert backlog.overflows == 1
    node.destroy_node()


def test_a_silent_topic_is_explained_by_its_type_or_by_other_topics_of_this_type(graph) -> None:
    kind = "geometry_msgs/msg/WrenchStamped"
    subscribe(graph.node, WrenchStamped, "wrench", lambda message: None, 10)
    assert topic_hint(graph.node, "wrench", kind) == ""
    graph.node.create_publisher(WrenchStamped, "ft/wrench", 10)
    graph.wait_for(lambda: topic_hint(graph.node, "wrench", kind), what="the other topic")
    assert topic_hint(graph.node, "wrench", kind) == f"; {kind} is on /ft/wrench: remap wrench to it"
    other = Context()  # one participant of DDS has one type for a name
    rclpy.init(context=other, domain_id=graph.domain)
    driver = Node("driver", context=other)
    driver.create_publisher(Wrench, "wrench", 10)
    graph.wait_for(lambda: "carries" in topic_hint(graph.node, "wrench", kind), what="the other type")
    assert topic_hint(graph.node, "wrench", kind) == f"; /wrench carries geometry_msgs/msg/Wrench, not {kind}"
    driver.destroy_node()
    rclpy.shutdown(context=other)
