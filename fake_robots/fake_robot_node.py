"""The node `fake_robot`: replays bags onto topics, or moves a simulated arm, at the recorded or the real rate."""

import functools
import math
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import rclpy
from geometry_msgs.msg import Twist, TwistStamped
from rcl_interfaces.msg import SetParametersResult
from rclpy._rclpy_pybind11 import RCLError
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.time import Time
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Empty, Header
from std_srvs.srv import SetBool
from trajectory_msgs.msg import JointTrajectory

from poise.errors import ErrorCode, InputError, PoiseError
from poise.fake_robots.arm import SimulatedArm
from poise.fake_robots.bag_replay import BagSource, message_class
from poise.fake_robots.commands import waypoints_of
from poise.fake_robots.faults import apply_faults, parse_faults
from poise.fake_robots.followers import Followers
from poise.fake_robots.gripper_action import GripperAction
from poise.fake_robots.parameters import PARAMETERS, PAYLOAD, make_source, make_world
from poise.fake_robots.player import Player
from poise.fake_robots.stream import CLOCK, Message, TopicInfo, with_clock
from poise.fake_robots.trajectory_action import TrajectoryAction
from poise.nodes.clock import CLOCK_HEARD, CLOCK_SAID
from poise.nodes.parameters import declare_parameters
from poise.nodes.runtime import guarded, publish, run

_ACKNOWLEDGED = Duration(seconds=2)
"""How long the end waits for subscribers to confirm the last messages."""

_MUTUAL = 0.5
"""s for which subscribers have been seen before the first message: they may see their publisher later than it them."""


class FakeRobot(Node):
    """A replayed bag or a simulated arm in place of hardware.

    Publishes what the source says (a bag: its topics; an arm: robot_description, joint_states, wrench, tf, odom,
    images), `/clock` when asked, and `replay_done` (std_msgs/Empty, latched) at the end. Service `play`
    (std_srvs/SetBool) resumes and pauses. An arm follows `joint_trajectory` (trajectory_msgs/JointTrajectory) and
    FollowJointTrajectory, its gripper `gripper_trajectory` and GripperCommand, its base `cmd_vel`.

    Args:
        failed: called with the error when the node has to end because of it.
    """

    def __init__(self, failed: Callable[[PoiseError], None]) -> None:
        super().__init__("fake_robot")
        self._failed = failed
        self._actions: list[TrajectoryAction | GripperAction] = []
        values = declare_parameters(self, PARAMETERS, PAYLOAD)
        self._values = values
        self._faults = parse_faults(values["faults"])
        self._source = make_source(values)
        for remark in self._source.remarks if isinstance(self._source, BagSource) else ():
            self.get_logger().warning(remark)
        topics = dict(self._source.topics)
        if values["publish_clock"]:
            topics[CLOCK] = TopicInfo("rosgraph_msgs/msg/Clock", depth=10)
        self._types = {topic: info.type for topic, info in topics.items()}
        self._outlets = {topic: self._publisher(topic, info) for topic, info in topics.items()}
        self._end = self.create_publisher(Empty, "replay_done", _qos(TopicInfo("", latched=True, depth=1)))
        awaited = self._awaited(values["wait_for_subscribers"])
        self._heard_since = math.inf
        self._player = Player(
            self._messages,
            self._publish,
            rate=values["rate"],
            loop=values["loop"],
            playing=values["playing"],
            stay=values["stay"],
            held=self._follow_followers() if values["publish_clock"] and values["clock_lead"] else None,
            ready=functools.partial(self._are_heard, awaited),
            ready_timeout=values["wait_timeout"],
            finished=self._say_done,
        )
        self.create_service(SetBool, "play", guarded(self, self._play))
        if isinstance(self._source, SimulatedArm):
            self._obey(self._source)
        self.add_on_set_parameters_callback(self._set_payload)
        self.create_timer(0.05, self._leave_when_done)
        self._player.start()

    def _follow_followers(self) -> Callable[[int], bool]:
        """Whether nodes that follow /clock are behind a time."""
        between = max(1e-9 * CLOCK_SAID, 1.0 / self._values["clock_rate"])
        followers = Followers(self._values["clock_lead"], self.get_logger().warning, between)
        take = guarded(self, lambda said: followers.heard(said.frame_id, Time.from_msg(said.stamp).nanoseconds))
        self.create_subscription(Header, CLOCK_HEARD, take, 100)
        return followers.are_behind

    def _obey(self, arm: SimulatedArm) -> None:
        """Take commands for arm, gripper and base; render images while they are subscribed to."""
        values = self._values
        self.create_subscription(JointTrajectory, "joint_trajectory", guarded(self, self._command), 10)
        self._actions.append(TrajectoryAction(self, arm, values))
        gear = arm.gear
        if gear.gripper is not None:
            self.create_subscription(JointTrajectory, "gripper_trajectory", guarded(self, self._grip), 10)
            self._actions.append(
                GripperAction(self, arm, gear.gripper, values["gripper_action"], values["allow_stalling"])
            )
        if gear.handling is not None:
            self.create_timer(0.5, guarded(self, functools.partial(self._report, gear.handling.world.remarks)))
        if gear.drive is not None:
            kind = TwistStamped if values["cmd_vel_stamped"] else Twist
            self.create_subscription(kind, "cmd_vel", guarded(self, self._drive), 10)
        if gear.camera is not None:
            images = [self._outlets[topic] for topic in gear.camera.topics]
            gear.camera.wanted = lambda: any(outlet.get_subscription_count() for outlet in images)

    def destroy_node(self) -> None:
        """Stop playing before the publishers go."""
        if hasattr(self, "_player"):
            self._player.stop()
        for action in self._actions:
            action.close()
        super().destroy_node()

    # -- in the player's thread -------------------------------------------------------------------------------

    def _are_heard(self, awaited: list[Any]) -> bool:
        """All have had a subscriber for a while."""
        now = time.monotonic()
        if not all(outlet.get_subscription_count() > 0 for outlet in awaited):
            self._heard_since = math.inf
            return False
        self._heard_since = min(self._heard_since, now)
        return not awaited or now - self._heard_since >= _MUTUAL

    def _messages(self) -> Any:
        messages = self._source.messages()
        if self._values["publish_clock"]:
            messages = with_clock(messages, self._values["clock_rate"] / self._values["rate"])
        return apply_faults(messages, self._faults, self._types, self._values["seed"])

    def _publish(self, message: Message) -> None:
        publish(self._outlets[message.topic], message.data)

    def _say_done(self) -> None:
        try:
            self._end.publish(Empty())
            for outlet in (*self._outlets.values(), self._end):
                outlet.wait_for_all_acked(_ACKNOWLEDGED)
        except RCLError:
            if rclpy.ok():
                raise

    # -- in the executor --------------------------------------------------------------------------------------

    def _play(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        response.message = self._player.play(request.data)
        response.success = not self._player.done.is_set()
        return response

    def _command(self, message: JointTrajectory) -> None:
        self._source.command(waypoints_of(message))

    def _grip(self, message: JointTrajectory) -> None:
        """Only where it ends counts."""
        position = message.points[-1].positions if message.points else ()
        if len(position) != 1 or not math.isfinite(position[0]):
            raise InputError(ErrorCode.BAD_INPUT, "gripper trajectory: its last point needs one finite position")
        self._source.grip(message.joint_names, position[0])

    def _report(self, remarks: list[str]) -> None:
        while remarks:
            self.get_logger().info(remarks.pop(0))

    def _drive(self, message: Twist | TwistStamped) -> None:
        twist = message.twist if isinstance(message, TwistStamped) else message
        self._source.drive(np.array([twist.linear.x, twist.linear.y, twist.angular.z]))

    def _set_payload(self, parameters: list[Any]) -> SetParametersResult:
        changed = {parameter.name: parameter.value for parameter in parameters if parameter.name in PAYLOAD}
        if not changed:
            return SetParametersResult(successful=True)
        if not isinstance(self._source, SimulatedArm):
            return SetParametersResult(successful=False, reason="a bag has no payload to change")
        try:
            self._source.hold(make_world(self._source.model, self._values | changed))
        except PoiseError as error:
            return SetParametersResult(successful=False, reason=error.message)
        self._values |= changed
        return SetParametersResult(successful=True)

    def _leave_when_done(self) -> None:
        if self._player.done.is_set():
            if self._player.failure is not None:
                self._failed(self._player.failure)
            rclpy.try_shutdown()

    # -- publishers -------------------------------------------------------------------------------------------

    def _publisher(self, topic: str, info: TopicInfo) -> Publisher:
        kind = Clock if topic == CLOCK else message_class(info.type)
        return self.create_publisher(kind, topic, _qos(info))

    def _awaited(self, topics: list[str]) -> list[Publisher]:
        wanted = [topic if topic == CLOCK else topic.strip("/") for topic in topics]
        missing = [topic for topic in wanted if topic not in self._outlets]
        if missing:
            raise InputError(
                ErrorCode.TOPIC_MISSING,
                f"parameter wait_for_subscribers: {', '.join(missing)} is not published; there are "
                f"{', '.join(self._outlets)}",
            )
        return [self._outlets[topic] for topic in wanted]


def _qos(info: TopicInfo) -> QoSProfile:
    durability = DurabilityPolicy.TRANSIENT_LOCAL if info.latched else DurabilityPolicy.VOLATILE
    return QoSProfile(depth=info.depth, durability=durability)


def main() -> None:
    """Run the node; ends with status 2 and one line when the bag, the robot or a parameter cannot be used."""
    failures: list[PoiseError] = []
    try:
        run(lambda: FakeRobot(failures.append))
    except SystemExit:
        if not failures:
            raise
    for failure in failures[:1]:
        print(f"{failure.code.name}: {failure.message}", file=sys.stderr)
        sys.exit(failure.exit_status)


if __name__ == "__main__":
    main()
