"""Node: weighs what the sensor carries, from wrenches and the robot's motion, and publishes the estimate."""

import time
from collections.abc import Iterator
from dataclasses import replace

from geometry_msgs.msg import WrenchStamped
from nav_msgs.msg import Odometry
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from sensor_msgs.msg import Imu, JointState
from std_msgs.msg import String
from std_srvs.srv import Trigger
from tf2_msgs.msg import TFMessage

from poise.errors import PoiseError
from poise.geometry import rotation_of_quaternion
from poise.inertia.model import Parts
from poise.inertia.pipeline import LiveEstimator, status_of
from poise.nodes.arm_node import ArmNode
from poise.nodes.clock import node_seconds
from poise.nodes.diagnostics import DiagnosticsPublisher
from poise.nodes.estimate_message import change_message, estimate_message, no_estimate_message
from poise.nodes.identify_payload import IdentifyPayload
from poise.nodes.inbox import Inbox
from poise.nodes.inertial_estimator_parameters import PARAMETERS, live_options
from poise.nodes.parameters import declare_parameters
from poise.nodes.payload_shape import accuracy_of, parts_of_message
from poise.nodes.runtime import guarded, run, subscribe, topic_hint
from poise.recording import stamp_of
from poise_msgs.msg import InertialEstimate, PayloadChange, SegmentedObject

_UPDATE_PERIOD = 0.05
"""s between taking messages and bringing wrenches and motion together: many at once cost less than one by one."""
_SOLVING = 0.2
"""Share of a core that solving may take: with many samples it is done less often."""
DEPTH = 4000
"""Messages that may wait, such as those of 4 s at 1 kHz: solving and a busy machine hold the node up.

rmw_fastrtps keeps 5000 at most, whatever is asked for, and then the oldest instead of the newest.
"""
_LATCHED = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class InertialEstimator(ArmNode):
    """Subscribes to wrench, joint_states, robot_description, odom, tf; publishes inertial_estimate and diagnostics."""

    def __init__(self) -> None:
        super().__init__("inertial_estimator")
        values = declare_parameters(self, PARAMETERS)
        self.live = LiveEstimator(live_options(values))
        """For who weighs on request, see `LiveEstimator.begin_window`."""
        self._published = self._told = 0
        self._rest = 0.0
        self._inbox = Inbox(DEPTH, map(self.resolve_topic_name, ("wrench", "joint_states", "tf", "odom", "imu")))
        # Who joins later (a planner, the demo) still hears what is being held.
        self._estimates = self.create_publisher(InertialEstimate, "inertial_estimate", _LATCHED)
        self._changes = self.create_publisher(PayloadChange, "payload_change", _LATCHED)
        self._diagnostics = DiagnosticsPublisher(self)
        best_effort = QoSProfile(depth=DEPTH, reliability=ReliabilityPolicy.BEST_EFFORT)
        for message_type, topic, callback in (
            (WrenchStamped, "wrench", self._on_wrench),
            (JointState, "joint_states", self._on_joint_state),
            (TFMessage, "tf", self._on_tf),
        ):
            if topic == "wrench" and values["best_effort"]:
                self.create_subscription(message_type, topic, guarded(self, callback), best_effort)
            else:
                subscribe(self, message_type, topic, callback, DEPTH)
        for message_type, topic, callback, qos in (
            (Odometry, "odom", self._on_odometry, best_effort),
            (String, "robot_description", self._on_description, _LATCHED),
            (Imu, "imu", self._on_imu, best_effort),
            (TFMessage, "tf_static", self._on_tf_static, _LATCHED),
            (SegmentedObject, "segmented_object", self._on_shape, _LATCHED),
        ):
            self.create_subscription(message_type, topic, guarded(self, callback), qos)
        self.create_service(Trigger, "reset_estimate", self._on_reset)
        self.create_timer(_UPDATE_PERIOD, guarded(self, self._update))
        self.create_timer(1.0 / values["publish_rate"], guarded(self, self._publish))
        self.create_timer(1.0, guarded(self, self._diagnose))
        self._action = IdentifyPayload(self)
        self.watchdog = self._action.watchdog
        self.start()

    @property
    def subscriptions(self) -> Iterator[Subscription]:
        """Of the executor: those that the inbox does not take."""
        return self._inbox.others(super().subscriptions)

    def halt(self, reason: str) -> None:
        """Stop the arm and end the goal."""
        self._action.halt(reason)

    def _on_wrench(self, message: WrenchStamped) -> None:
        force, torque = message.wrench.force, message.wrench.torque
        wrench = (force.x, force.y, force.z, torque.x, torque.y, torque.z)
        self.live.add_wrench(stamp_of(message), message.header.frame_id, wrench, node_seconds())

    def _on_joint_state(self, message: JointState) -> None:
        stamp, now = stamp_of(message), node_seconds()
        self.live.add_joint_state(stamp, message.name, message.position, message.velocity, now)

    def _on_odometry(self, message: Odometry) -> None:
        turn, at = message.pose.pose.orientation, message.pose.pose.position
        rotation = rotation_of_quaternion([turn.x, turn.y, turn.z, turn.w])
        self.live.add_odometry(stamp_of(message), rotation, (at.x, at.y, at.z), node_seconds())

    def _on_imu(self, message: Imu) -> None:
        felt = message.linear_acceleration
        self.live.add_imu(stamp_of(message), message.header.frame_id, (felt.x, felt.y, felt.z))

    def _on_description(self, message: String) -> None:
        self.live.set_robot_description(message.data, node_seconds())
        if self.live.problem is not None:
            raise self.live.problem

    def _on_tf(self, message: TFMessage, fixed: bool = False) -> None:
        now = node_seconds()
        for transform in message.transforms:
            turn, shift = transform.transform.rotation, transform.transform.translation
            self.live.add_transform(
                stamp_of(transform),
                transform.header.frame_id,
                transform.child_frame_id,
                rotation_of_quaternion([turn.x, turn.y, turn.z, turn.w]),
                (shift.x, shift.y, shift.z),
                fixed,
                now,
            )

    def _on_tf_static(self, message: TFMessage) -> None:
        self._on_tf(message, fixed=True)

    def parts_of(self, message: SegmentedObject) -> Parts:
        """Its parts in the sensor frame; tf gives its place in the hand.

        Raises:
            InputError: OBJECT_INVALID for a shape that cannot be, FRAME_UNKNOWN when tf does not give its place.
        """
        pose = self.live.pose_in_sensor(message.header.frame_id)
        return parts_of_message(message).in_frame(pose.rotation, pose.translation)

    def _on_shape(self, message: SegmentedObject) -> None:
        self.live.hold(self.parts_of(message), accuracy_of(message))
        self.get_logger().info(f"the payload is {message.id or 'an object'} of {len(message.parts)} parts")

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        forgotten = self.live.n_samples
        self.live.reset()
        self._published = 0
        response.success = True
        response.message = f"forgot {forgotten} samples"
        return response

    def _update(self) -> None:
        for topic in self._inbox.take(super().subscriptions):
            self.get_logger().warning(f"{topic}: {DEPTH} messages waited, and older ones are lost")
        self.live.update(node_seconds())
        for change in self.live.changes[self._told :]:
            self._changes.publish(change_message(change, self.live.sensor_frame))
            self._published = -1  # the estimate is another one now
            self.get_logger().info(f"payload changed: {change.mass_before:.3f} -> {change.mass_after:.3f} kg")
        self._told = len(self.live.changes)

    def _publish(self) -> None:
        seen, begun = self.live.n_samples, time.monotonic()
        if seen == self._published or begun < self._rest:
            return
        self._published = seen
        try:
            message = estimate_message(self.live.estimate())
        except PoiseError as error:
            message = no_estimate_message(error, self.live.sensor_frame)
        self._estimates.publish(message)
        now = time.monotonic()
        self._rest = now + (now - begun) * (1 / _SOLVING - 1)

    def _diagnose(self) -> None:
        status = status_of(self.live, node_seconds())
        status = replace(status, values=status.values | {"queue_overflows": str(self._inbox.overflows)})
        if "wrench" not in self.live.heard:
            hint = topic_hint(self, "wrench", "geometry_msgs/msg/WrenchStamped")
            status = replace(status, message=status.message + hint)
        self._diagnostics.publish(status.level, status.message, status.values, self.live.sensor_frame)


def main(args: list[str] | None = None) -> None:
    """Run the node."""
    run(InertialEstimator, args)


if __name__ == "__main__":
    main()
