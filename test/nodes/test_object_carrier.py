"""carry_object with acceleration_limits and an ideal base of the test: it arrives, stops, or refuses."""

from types import SimpleNamespace

import numpy as np
import pytest
from action_caller import Caller
from action_msgs.msg import GoalStatus
from assembly_calls import LATCHED
from geometry_msgs.msg import PoseStamped, Twist
from nav_msgs.msg import Odometry

from poise.assembly import Assembly, Box, RigidObject
from poise.errors import ErrorCode, NoAnswerError
from poise.geometry import Pose
from poise.nodes.assembly_message import assembly_message
from poise.nodes.object_carrier import ObjectCarrier
from poise.robot import FrameTree
from poise_msgs.action import CarryObject
from poise_msgs.msg import AccelerationLimits
from poise_msgs.msg import Assembly as AssemblyMessage

pytestmark = pytest.mark.ros
TRAY = RigidObject("tray", Box((0.6, 0.4, 0.02)), Pose.from_vector([0, 0, 0.29, 0, 0, 0, 1]), fixed=True)
PERIOD = 0.02


class Base:
    """Does what cmd_vel says, and publishes odom."""

    def __init__(self, graph):
        self.graph, self.place, self.velocity, self.commands = graph, 0.0, 0.0, []
        self.said = graph.node.get_clock().now()
        graph.node.create_subscription(Twist, "cmd_vel", self.take, 1000)
        self.odom = graph.node.create_publisher(Odometry, "odom", 10)
        self.timer = graph.node.create_timer(PERIOD, self.say)

    def take(self, command):
        self.velocity = command.linear.x
        self.commands.append(command.linear.x)

    def say(self):
        now = self.graph.node.get_clock().now()
        self.place += 1e-9 * (now - self.said).nanoseconds * self.velocity  # a busy machine leaves ticks out
        self.said = now
        message = Odometry(child_frame_id="base_link")
        message.header.frame_id, message.header.stamp = "odom", now.to_msg()
        message.pose.pose.position.x, message.pose.pose.orientation.w = self.place, 1.0
        self.odom.publish(message)


@pytest.fixture
def caller(graph):
    caller = Caller(graph, CarryObject, "carry_object")
    yield caller
    caller.close()


def to(x, **more):
    goal = PoseStamped()
    goal.pose.position.x, goal.pose.orientation.w = x, 1.0
    return {"path": [goal], **more}


@pytest.mark.alone
def test_a_load_is_carried_under_its_limits_or_not_at_all(start_node, graph, caller):
    start_node("object_carrier", {"ready_timeout": 3.0, "share": 0.9, "path_tolerance": 0.5})
    caller.ready()

    def refused(code, **goal):
        return caller.result(caller.send(**to(1.0, **goal))).result.error.code == code

    assert refused(ErrorCode.TOPIC_MISSING)
    assert refused(ErrorCode.BAD_INPUT, share=0.95)
    assert refused(ErrorCode.BAD_INPUT, speed=-1.0)
    base = Base(graph)
    start_node("acceleration_limits")
    assemblies = graph.node.create_publisher(AssemblyMessage, "assembly", LATCHED)
    limits = graph.collect("acceleration_limits", AccelerationLimits, LATCHED)

    def load(height):
        there = Pose.from_vector([0, 0, 0.3 + height / 2, 0, 0, 0, 1])
        block = RigidObject("block", Box((0.05, 0.05, height)), there, mass=0.3)
        message = assembly_message(Assembly((TRAY, block)), "base_link")
        message.header.stamp = graph.node.get_clock().now().to_msg()
        limits.clear()
        assemblies.publish(message)
        graph.wait_for(lambda: limits, what="its limits")
        return limits[-1]

    limit = load(0.25).limits[0]  # it topples at a fifth of gravity
    assert limit == pytest.approx(0.2 * 9.80665, rel=0.02)
    begun, base.commands[:] = base.place, []
    done = caller.result(caller.send(**to(begun + 0.6, share=0.5)))
    assert (done.result.error.message, done.status) == ("", GoalStatus.STATUS_SUCCEEDED)
    assert base.place == pytest.approx(begun + 0.6, abs=0.03)
    assert done.result.limit == pytest.approx(limit, rel=0.02)
    assert 0.2 < done.result.used <= 0.5
    assert base.commands[-1] == 0.0

    handle = caller.send(**to(base.place + 5.0))
    graph.wait_for(lambda: base.velocity > 0.1, what="motion")
    caller.cancel(handle)
    done = caller.result(handle)
    assert (done.result.error.code, done.status) == (ErrorCode.CANCELLED, GoalStatus.STATUS_CANCELED)
    assert base.commands[-1] == 0.0
    steps = np.abs(np.diff(base.commands))
    assert steps.max() < 0.1 * limit  # it was brought to rest, not cut off

    handle = caller.send(**to(base.place + 5.0))
    graph.wait_for(lambda: base.velocity > 0.1, what="motion")
    leaning = RigidObject("block", Box((0.05, 0.05, 0.2)), Pose.from_vector([0.32, 0, 0.4, 0, 0, 0, 1]), mass=0.3)
    message = assembly_message(Assembly((TRAY, leaning)), "base_link")
    message.header.stamp = graph.node.get_clock().now().to_msg()
    assemblies.publish(message)
    assert caller.result(handle).result.error.code == ErrorCode.UNSTABLE
    graph.wait_for(lambda: base.velocity == 0.0, what="rest")
    assert refused(ErrorCode.UNSTABLE)


@pytest.mark.parametrize("code", [ErrorCode.OK, ErrorCode.DEADLINE])
def test_an_answer_without_limits_is_no_freedom_from_limits(code):
    message = AccelerationLimits()
    message.header.frame_id, message.error.code = "base_link", int(code)
    heard = SimpleNamespace(
        _limits=message, _assembly_stamp=0, _odom=None, _frames=FrameTree(), count_publishers=lambda _: 1
    )
    with pytest.raises(NoAnswerError) as caught:
        ObjectCarrier._in_base(heard)
    assert caught.value.code == ErrorCode.DEADLINE
