"""Node: weighs what the sensor carries, from wrenches and the robot's motion, and says how sure that is."""

import time
from typing import NamedTuple

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import WrenchStamped
from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import Trigger
from tf2_msgs.msg import TFMessage

from poise.errors import ErrorCode, InputError, NoAnswerError
from poise.inertia.live import LiveEstimator, LiveOptions
from poise.inertia.status import status_of
from poise.inertia.tracks import PairingSettings
from poise.nodes.estimate_message import estimate_message, no_estimate_message
from poise.nodes.runtime import guarded, run
from poise.recording.decoding import rotation_from_quaternion
from poise_msgs.msg import InertialEstimate

UPDATE_PERIOD = 0.05
"""s between bringing wrenches and motion together: many at once cost less than one by one."""
LATCHED = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class Parameter(NamedTuple):
    """A parameter, and for a number its range."""

    name: str
    default: str | float | bool
    description: str
    least: float = 0.0
    greatest: float = 1e6


PARAMETERS = (
    Parameter("sensor_frame", "", "frame of the wrench; empty: what its first message says"),
    Parameter("base_frame", "", "gravity-aligned frame in tf; empty: the topmost"),
    Parameter("motion_source", "auto", "joint_states, tf, or auto: the former when a robot_description comes"),
    Parameter("gravity", 9.80665, "m/s2", 0.1, 100.0),
    Parameter("method", "auto", "static: poses held still; ols: motion; auto: what the motion suits"),
    Parameter("publish_rate", 10.0, "Hz of inertial_estimate while samples come", 0.1, 100.0),
    Parameter("max_force", 0.0, "N at which an axis of the sensor is saturated; 0: no limit"),
    Parameter("max_torque", 0.0, "N m at which an axis of the sensor is saturated; 0: no limit"),
    Parameter("max_gap", 0.2, "s between kinematic samples across which nothing is interpolated", 0.001, 10.0),
    Parameter("rest_gap", 1.0, "s, the same for attitudes held still", 0.001, 60.0),
    Parameter("rest_window", 0.1, "s before and after a sample in which the sensor has to hold still", 0.01, 10.0),
    Parameter("rest_turning", 0.02, "rad/s below which it does", 0.0, 10.0),
    Parameter("rest_speed", 0.01, "m/s below which it does", 0.0, 10.0),
    Parameter("block", 0.5, "s of motion that are differentiated together", 0.1, 10.0),
    Parameter("margin", 0.5, "s of motion on either side that take part in it; the estimate lags by both", 0.1, 10.0),
    Parameter("best_effort", False, "take wrenches from a best-effort publisher too (some may be lost)"),
)


class InertialEstimator(Node):
    """Subscribes to wrench, joint_states, robot_description, tf; publishes inertial_estimate and diagnostics."""

    def __init__(self) -> None:
        super().__init__("inertial_estimator")
        values = {parameter.name: self._declared(parameter) for parameter in PARAMETERS}
        self._live = LiveEstimator(
            LiveOptions(
                sensor_frame=values["sensor_frame"],
                base_frame=values["base_frame"],
                motion_source=values["motion_source"],
                gravity=values["gravity"],
                method=values["method"],
                saturation=(values["max_force"] or np.inf, values["max_torque"] or np.inf),
                settings=PairingSettings(**{name: values[name] for name in SETTINGS}),
            )
        )
        self._published = 0
        # Who joins later (a planner, the demo) still hears what is being held.
        self._estimates = self.create_publisher(InertialEstimate, "inertial_estimate", LATCHED)
        self._diagnostics = self.create_publisher(DiagnosticArray, "diagnostics", 10)
        best_effort = QoSProfile(depth=2000, reliability=ReliabilityPolicy.BEST_EFFORT)
        wrench_qos = best_effort if values["best_effort"] else QoSProfile(depth=2000)
        for message_type, topic, callback, qos in (
            (WrenchStamped, "wrench", self._on_wrench, wrench_qos),
            (JointState, "joint_states", self._on_joint_state, QoSProfile(depth=2000)),
            (String, "robot_description", self._on_description, LATCHED),
            (TFMessage, "tf", self._on_tf, QoSProfile(depth=2000)),
            (TFMessage, "tf_static", self._on_tf_static, LATCHED),
        ):
            self.create_subscription(message_type, topic, guarded(self, callback), qos)
        self.create_service(Trigger, "reset_estimate", self._on_reset)
        self.create_timer(UPDATE_PERIOD, guarded(self, self._update))
        self.create_timer(1.0 / values["publish_rate"], guarded(self, self._publish))
        self.create_timer(1.0, guarded(self, self._diagnose))

    def _declared(self, parameter: Parameter) -> str | float | bool:
        descriptor = ParameterDescriptor(description=parameter.description, read_only=True)
        if isinstance(parameter.default, float):
            limits = FloatingPointRange(from_value=parameter.least, to_value=parameter.greatest)
            descriptor.floating_point_range = [limits]
        try:
            return self.declare_parameter(parameter.name, parameter.default, descriptor).value
        except (InvalidParameterTypeException, InvalidParameterValueException) as error:
            raise InputError(
                ErrorCode.BAD_INPUT, f"parameter {parameter.name}: {error} ({parameter.description})"
            ) from error

    def _on_wrench(self, message: WrenchStamped) -> None:
        force, torque = message.wrench.force, message.wrench.torque
        wrench = (force.x, force.y, force.z, torque.x, torque.y, torque.z)
        self._live.add_wrench(_ns(message.header.stamp), message.header.frame_id, wrench, time.monotonic())

    def _on_joint_state(self, message: JointState) -> None:
        stamp, now = _ns(message.header.stamp), time.monotonic()
        self._live.add_joint_state(stamp, message.name, message.position, message.velocity, now)

    def _on_description(self, message: String) -> None:
        self._live.set_robot_description(message.data, time.monotonic())
        if self._live.problem is not None:
            raise self._live.problem

    def _on_tf(self, message: TFMessage, fixed: bool = False) -> None:
        now = time.monotonic()
        for transform in message.transforms:
            turn, shift = transform.transform.rotation, transform.transform.translation
            self._live.add_transform(
                _ns(transform.header.stamp),
                transform.header.frame_id,
                transform.child_frame_id,
                rotation_from_quaternion(np.array([[turn.x, turn.y, turn.z, turn.w]]))[0],
                (shift.x, shift.y, shift.z),
                fixed,
                now,
            )

    def _on_tf_static(self, message: TFMessage) -> None:
        self._on_tf(message, fixed=True)

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        forgotten = self._live.n_samples
        self._live.reset()
        self._published = 0
        response.success = True
        response.message = f"forgot {forgotten} samples"
        return response

    def _update(self) -> None:
        self._live.update(time.monotonic())

    def _publish(self) -> None:
        seen = self._live.n_samples
        if seen == self._published:
            return
        self._published = seen
        try:
            message = estimate_message(self._live.estimate())
        except NoAnswerError as error:
            message = no_estimate_message(error, self._live.sensor_frame)
        self._estimates.publish(message)

    def _diagnose(self) -> None:
        status = status_of(self._live, time.monotonic())
        message = DiagnosticArray()
        message.header.stamp = self.get_clock().now().to_msg()
        message.status = [
            DiagnosticStatus(
                level=bytes([status.level]),
                name=self.get_fully_qualified_name().lstrip("/"),
                message=status.message,
                hardware_id=self._live.sensor_frame,
                values=[KeyValue(key=key, value=value) for key, value in status.values.items()],
            )
        ]
        self._diagnostics.publish(message)


SETTINGS = ("max_gap", "rest_gap", "rest_window", "rest_turning", "rest_speed", "block", "margin")


def _ns(stamp) -> int:
    return stamp.sec * 10**9 + stamp.nanosec


def main(args: list[str] | None = None) -> None:
    """Run the node."""
    run(InertialEstimator, args)


if __name__ == "__main__":
    main()
