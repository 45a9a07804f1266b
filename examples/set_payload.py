"""Send the payload of `inertial_estimate` to the controller of a UR or a Franka, once for each payload.

python examples/set_payload.py --ros-args -p robot:=ur -p flange_pose:="[0.0, 0.0, 0.04, 0.0, 0.0, 0.0, 1.0]"

Parameters: `robot` (of ROBOTS); `flange_pose` (sensor frame in the flange frame: x y z qx qy qz qw); `gripper` (mass,
com and inertia of a gripper to take off, in the sensor frame: 4 or 10 numbers; a Franka takes the object alone);
`transition_time` (s, UR); `relative`, `absolute` (how well the mass must be known: a share of it, or kg).
Needs ur_msgs or franka_msgs, which come with the drivers. A UR zeroes its own force sensor when its payload is set.
"""

import contextlib
import importlib
import json
import sys
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile

from poise.errors import ErrorCode, PoiseError
from poise.exporting import ExportSettings, GripperLoad, export
from poise.geometry import Pose
from poise.inertia import InertialEstimate, InertialParameters
from poise.inertia.model import EstimateFinding, symmetric
from poise_msgs.msg import InertialEstimate as InertialEstimateMessage


class Robot(NamedTuple):
    """How a driver takes a payload: kind of export, type and name of its service, and its request."""

    kind: str
    service_type: str
    service: str
    request: Callable[[dict[str, Any]], dict[str, Any]] = dict


def inertia_request(flat: dict[str, Any]) -> dict[str, Any]:
    """The request of newer UR drivers (ROS 2 Rolling), which take geometry_msgs/Inertia."""
    moments = {name: flat[name] for name in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz") if name in flat}
    time = flat.get("transition_time", {"sec": 0, "nanosec": 0})
    return {
        "payload": {"m": flat["mass"], "com": flat["center_of_gravity"], **moments},
        "transition_time": time["sec"] + 1e-9 * time["nanosec"],
    }


UR = "io_and_status_controller/set_payload"
ROBOTS = {
    "ur": Robot("ur-driver", "ur_msgs/srv/SetPayload", UR),
    "ur-rolling": Robot("ur-driver", "ur_msgs/srv/SetPayload", UR, inertia_request),
    "franka": Robot("franka", "franka_msgs/srv/SetLoad", "service_server/set_load"),
}


def estimate_of(message: InertialEstimateMessage) -> InertialEstimate:
    """The estimate of a message, as exporters take it."""
    it = message.inertia
    com = np.array([it.com.x, it.com.y, it.com.z])
    parameters = InertialParameters(it.m, com, symmetric([it.ixx, it.ixy, it.ixz, it.iyy, it.iyz, it.izz]))
    stamp = message.header.stamp
    return InertialEstimate(
        stamp=stamp.sec * 10**9 + stamp.nanosec,
        frame_id=message.header.frame_id,
        parameters=parameters,
        phi=parameters.phi,
        covariance=np.reshape(message.covariance, (10, 10)),
        bias=np.full(6, np.nan),
        bias_covariance=np.full((6, 6), np.nan),
        delay=message.delay,
        delay_std=message.delay_std,
        method=message.method,
        consistent=message.consistent,
        unidentified=tuple(message.unidentified),
        condition_number=message.condition_number,
        n_samples=message.n_samples,
        rejected=(),
        residual_force=message.residual_force,
        residual_torque=message.residual_torque,
        findings=tuple(finding_of(found.code, found.message) for found in message.findings),
    )


def finding_of(code: int, sentence: str) -> EstimateFinding:
    """A finding of a message, which has no evidence: after a contact, another mass may be as likely."""
    evidence = {"other_mass": np.nan} if code == ErrorCode.IN_CONTACT else {}
    return EstimateFinding(ErrorCode(code), sentence, evidence)


def fill(message: Any, fields: dict[str, Any]) -> None:
    """Set the fields of a message or a request.

    Raises:
        AttributeError: the message lacks one; an older driver, say, takes no inertia.
    """
    for name, value in fields.items():
        if isinstance(value, dict):
            fill(getattr(message, name), value)
        else:
            setattr(message, name, value)


class PayloadSetter(Node):
    """Waits for an estimate that is good enough, and sends it."""

    def __init__(self, **options: Any) -> None:
        super().__init__("set_payload", **options)
        self.robot = ROBOTS[self.declare_parameter("robot", "ur").value]
        pose = self.declare_parameter("flange_pose", [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]).value
        gripper = np.array(self.declare_parameter("gripper", [0.0] * 10).value)
        seconds = self.declare_parameter("transition_time", 0.5).value
        self.relative = self.declare_parameter("relative", 0.02).value
        self.absolute = self.declare_parameter("absolute", 0.02).value
        moments = gripper[4:] if len(gripper) == 10 else np.full(6, np.nan)
        taken = GripperLoad(InertialParameters(gripper[0], gripper[1:4], symmetric(moments)))
        self.settings = ExportSettings(Pose.from_vector(np.array(pose)), gripper=taken, transition_time=seconds)
        package, _, name = self.robot.service_type.split("/")
        self.service_type = getattr(importlib.import_module(f"{package}.srv"), name)
        self.client = self.create_client(self.service_type, self.robot.service)
        self.sent: tuple[int, int] | None = None
        """Since when the payload counts that the controller has, or is getting."""
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.create_subscription(InertialEstimateMessage, "inertial_estimate", self.take, latched)

    def take(self, message: InertialEstimateMessage) -> None:
        """Send the payload of an estimate, unless it was sent, or is not good enough yet."""
        since = (message.since.sec, message.since.nanosec)
        if message.error.code != ErrorCode.OK or self.sent == since:
            return
        estimate = estimate_of(message)
        allowed = max(self.absolute, self.relative * abs(estimate.parameters.mass))
        if not estimate.mass_std <= allowed:
            self.say(f"the mass is known to {estimate.mass_std:.3g} kg, {allowed:.3g} kg is asked for")
        elif not self.client.service_is_ready():
            self.say(f"waiting for the service {self.client.srv_name}")
        else:
            try:
                request = self.request(estimate)
            except (PoiseError, AttributeError) as error:  # unknown inertia, a finding; a driver of another release
                self.say(f"not sent: {error}")
                return
            self.sent = since
            self.client.call_async(request).add_done_callback(lambda future: self.done(future, estimate))

    def request(self, estimate: InertialEstimate) -> Any:
        """The request of the robot's driver; raises what `export` and `fill` do."""
        request = self.service_type.Request()
        fill(request, self.robot.request(json.loads(export(estimate, self.robot.kind, self.settings))))
        return request

    def done(self, future: Any, estimate: InertialEstimate) -> None:
        """Report the driver's response; a payload that it refused is sent again with the next estimate."""
        response = future.result()
        if response.success:
            self.get_logger().info(f"payload set: {estimate}")
        else:
            self.sent = None
            self.get_logger().error(f"the driver refused the payload: {getattr(response, 'error', '')}")

    def say(self, sentence: str) -> None:
        """At most once in five seconds."""
        self.get_logger().warning(sentence, throttle_duration_sec=5.0)


def main() -> None:
    """Run until Ctrl-C."""
    rclpy.init(args=sys.argv)
    with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(PayloadSetter())


if __name__ == "__main__":
    main()
