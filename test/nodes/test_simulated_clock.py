"""The time of a node that follows /clock: as fast as that, and it goes on when /clock stops."""

import time
from collections.abc import Iterator

import pytest
from ros_graph import Graph
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Header

from poise.nodes import clock
from poise.nodes.clock import CLOCK_HEARD, SimulatedTime, follow_clock, node_seconds, with_time

pytestmark = pytest.mark.ros


@pytest.fixture
def follower(graph: Graph) -> Iterator[SimulatedTime]:
    """The node of the test follows /clock."""
    graph.node.set_parameters(with_time(True))
    follow_clock(graph.node)
    assert clock._simulated is not None
    yield clock._simulated
    clock._simulated = None


def tick(publisher: object, seconds: float) -> None:
    message = Clock()
    message.clock.sec, message.clock.nanosec = int(seconds), round(seconds % 1 * 1e9)
    publisher.publish(message)  # type: ignore[attr-defined]


def test_without_it_the_time_is_that_of_the_machine(graph: Graph) -> None:
    follow_clock(graph.node)
    before = time.monotonic()
    assert before <= node_seconds() <= time.monotonic()


def test_it_is_as_fast_as_the_clock_and_says_how_far_it_is(
    graph: Graph, follower: SimulatedTime, monkeypatch: pytest.MonkeyPatch
) -> None:
    publisher = graph.node.create_publisher(Clock, "/clock", 10)
    said = graph.collect(CLOCK_HEARD, Header)
    ticked: list[float] = []
    graph.node.create_timer(1.0, lambda: ticked.append(node_seconds()))
    graph.wait_for(publisher.get_subscription_count, what="/clock")
    begun = node_seconds()

    def comes(seconds: float) -> None:
        def heard() -> bool:
            tick(publisher, seconds)
            return any(each.stamp.sec == int(seconds) for each in said)

        graph.wait_for(heard, what=f"{seconds} s")

    comes(1000.0)
    assert node_seconds() == begun  # the first time of all is no duration
    comes(1003.0)
    assert node_seconds() == pytest.approx(begun + 3.0)
    assert said[-1].frame_id == "/test"
    comes(990.0)  # the simulator was started again
    assert node_seconds() == pytest.approx(begun + 3.0)
    comes(995.0)
    assert node_seconds() == pytest.approx(begun + 8.0)

    monkeypatch.setattr(clock, "_PATIENCE", 0.0)  # /clock has stopped
    ticked.clear()
    graph.wait_for(lambda: len(ticked) > 1, what="timers that go on")
    assert node_seconds() > begun + 8.0
    monkeypatch.setattr(clock, "_PATIENCE", 1e6)
    there = node_seconds()
    comes(996.0)
    assert node_seconds() >= there
