"""Node: how fast the base under an assembly may accelerate, published whenever the assembly or the payload changes."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from geometry_msgs.msg import Vector3
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.qos import QoSProfile

from poise.assembly import Analysis, acceleration_limits
from poise.assembly.contact import Structure
from poise.assembly.robustness import AccelerationLimits, TurningBase
from poise.errors import ErrorCode, InputError, NoAnswerError, PoiseError
from poise.geometry import Pose
from poise.nodes.assembly_message import assembly_of
from poise.nodes.parameters import WORDS, Parameter, declare_parameters
from poise.nodes.payload import GraspedPayload, weighed
from poise.nodes.request_checks import check_assembly
from poise.nodes.runtime import LATCHED, coded, guarded, run, to_message
from poise.recording import stamp_of
from poise_msgs.msg import AccelerationLimits as AccelerationLimitsMessage
from poise_msgs.msg import Assembly as AssemblyMessage
from poise_msgs.msg import InertialEstimate, ObjectIds

_MOST, _MOST_SPEED = 1e6, 1e3
"""m/s2 or rad/s2, and rad/s, above which limits are sent as these."""
_TURN_STEP, _TILT_STEP = 0.01, 0.002
"""Changes of rad/s or rad/s2, and of rad, below which nothing is published again."""

ACCELERATION_LIMITS_PARAMETERS = (
    Parameter("azimuths", 72, "directions in the horizontal plane, counter-clockwise from x", (3, 10_000)),
    Parameter("rate", 10.0, "Hz at which inputs are checked for changes", (0.1, 100.0)),
    Parameter(
        "longest", 1.0, "time limit of the computation, s; the limits certified by then are published", (0.01, 60.0)
    ),
    Parameter("axis", [0.0, 0.0], "x and y of the axis about which the base turns, m, in the assembly's frame"),
    Parameter("tilt", [0.0, 0.0], "roll and pitch of the base, rad: turns the assembly's gravity"),
    Parameter("turning_speed", 0.0, "angular speed of the base, rad/s", (-100.0, 100.0)),
    Parameter("turning_acceleration", 0.0, "angular acceleration of the base, rad/s2", (-1000.0, 1000.0)),
    Parameter("from_odom", False, "take tilt and turning from odom instead"),
    Parameter(
        "mesh_folders", WORDS, "folders in which files named by mesh_uri may lie, besides packages' share folders"
    ),
    Parameter("payload", "", "id of the object that gets the payload of inertial_estimate; empty: none"),
    Parameter("payload_age", 5.0, "age of its newest sample up to which an estimate is used, s", (0.1, 1e6)),
    Parameter("payload_pose", [0.0] * 6 + [1.0], "pose x y z qx qy qz qw of that object in the sensor's frame"),
)


class AccelerationLimitsNode(Node):
    """Subscribes to assembly, inertial_estimate and odom; publishes acceleration_limits (latched)."""

    def __init__(self) -> None:
        super().__init__("acceleration_limits")
        self._values = values = declare_parameters(self, ACCELERATION_LIMITS_PARAMETERS)
        for name, count in (("axis", 2), ("tilt", 2), ("payload_pose", 7)):
            if len(values[name]) != count or not np.isfinite(values[name]).all():
                raise InputError(ErrorCode.BAD_INPUT, f"parameter {name}: expected {count} numbers")
        self._base = TurningBase.tilted(*values["tilt"], values["turning_speed"], values["turning_acceleration"])
        self._odom_stamp: int | None = None
        self._payload_pose = Pose.from_vector(values["payload_pose"])
        self._folders = tuple(Path(folder) for folder in values["mesh_folders"])
        self._frame_id = ""
        self._structure: Structure | None = None
        self._payload = GraspedPayload(values["payload_age"])
        self._limits: AccelerationLimits | None = None
        self._gravity = 0.0
        self._published: TurningBase | None = None
        self._publisher = self.create_publisher(AccelerationLimitsMessage, "acceleration_limits", LATCHED)
        self.create_subscription(AssemblyMessage, "assembly", guarded(self, self._on_assembly), LATCHED)
        if values["payload"]:
            self.create_subscription(InertialEstimate, "inertial_estimate", guarded(self, self._on_estimate), LATCHED)
        if values["from_odom"]:
            self.create_subscription(Odometry, "odom", guarded(self, self._on_odom), QoSProfile(depth=10))
        self.create_timer(1.0 / values["rate"], guarded(self, self._update))

    def _on_assembly(self, message: AssemblyMessage) -> None:
        self._frame_id = message.header.frame_id
        self._structure = self._published = None
        try:
            check_assembly(message)
            self._structure = Structure.of(assembly_of(message, self._folders))
        except Exception as failure:  # of any kind: the limits of the assembly before must not stay
            self._publisher.publish(self._message(coded(failure)))
            return
        if self._values["payload"] not in self._structure.assembly.index:
            self._payload.left_assembly()

    def _on_estimate(self, message: InertialEstimate) -> None:
        if message.error.code != ErrorCode.OK:
            return
        age = (self.get_clock().now().nanoseconds - stamp_of(message)) * 1e-9
        if self._payload.take(message, age):
            self._published = None

    def _on_odom(self, message: Odometry) -> None:
        stamp = stamp_of(message)
        turn = message.pose.pose.orientation
        passed = 0.0 if self._odom_stamp is None else (stamp - self._odom_stamp) * 1e-9
        self._base = self._base.after(passed, [turn.x, turn.y, turn.z, turn.w], message.twist.twist.angular.z)
        self._odom_stamp = stamp

    def _update(self) -> None:
        """Publish again when something has changed enough to matter."""
        base, before = self._base, self._published
        if self._structure is None:
            return
        changed = before is None or base.tilt_from(before) > _TILT_STEP
        turned = (
            before is None
            or max(abs(base.speed - before.speed), abs(base.acceleration - before.acceleration)) > _TURN_STEP
        )
        if not changed and not turned:
            return
        self._published = base
        try:
            if changed:
                self._limits = None
                self._limits = self._solved(self._structure, base)
            if self._limits is None:  # the error has been published
                return
            self._publisher.publish(self._message(self._error(self._limits, base), self._limits, base))
        except Exception as failure:  # of any kind: the limits before must not stay
            self._limits = None
            self._publisher.publish(self._message(coded(failure)))

    def _solved(self, structure: Structure, base: TurningBase) -> AccelerationLimits:
        """The limits of the base at rest, tilted as it is, with the payload as it is weighed."""
        assembly, values = structure.assembly, self._values
        gravity = base.gravity(np.asarray(assembly.gravity))
        self._gravity = float(np.linalg.norm(gravity))
        estimate = self._payload.estimate
        if estimate is not None and values["payload"] in assembly.index:
            payload = assembly.objects[assembly.index[values["payload"]]]
            assembly = assembly.with_object(weighed(payload, estimate, self._payload_pose))
        # The contacts are the same: only weights and gravity have changed.
        analysis = Analysis(replace(structure, assembly=replace(assembly, gravity=gravity)))
        return acceleration_limits(analysis, values["azimuths"], values["longest"], axis=values["axis"])

    def _error(self, limits: AccelerationLimits, base: TurningBase) -> PoiseError | None:
        if limits.left_by(base.speed, base.acceleration) <= 0:
            return NoAnswerError(
                ErrorCode.UNSTABLE,
                f"turning at {base.speed:.3g} rad/s and {base.acceleration:.3g} rad/s2 is more than is sustained "
                f"({limits.angular_speed:.3g} rad/s, {limits.angular_acceleration:.3g} rad/s2); turn more slowly",
            )
        if not limits.complete:
            return NoAnswerError(ErrorCode.DEADLINE, "the limits are what was certified in the time of `longest`")
        return None

    def _message(
        self, error: PoiseError | None, limits: AccelerationLimits | None = None, base: TurningBase | None = None
    ) -> AccelerationLimitsMessage:
        """What is sustained; all limits zero when the assembly does not stand, none when it cannot be analysed."""
        message = AccelerationLimitsMessage(error=to_message(error))
        message.header.frame_id = self._frame_id
        message.header.stamp = self.get_clock().now().to_msg()
        if limits is None or base is None:
            if error is not None and error.code == ErrorCode.UNSTABLE:
                count = self._values["azimuths"]
                message.azimuths, message.limits = _azimuths(count), [0.0] * count
                movers = ObjectIds(ids=list(error.data.get("objects", [])))
                message.tilts, message.first_to_move = [0.0] * count, [movers] * count
                message.doubtful = [False] * count
            return message
        left = limits.while_turning(base.speed, base.acceleration)
        message.azimuths, message.limits = _azimuths(len(left.limits)), np.minimum(left.limits, _MOST).tolist()
        message.tilts = limits.tilts(self._gravity).tolist()
        message.first_to_move = [ObjectIds(ids=list(names)) for names in limits.first_to_move]
        message.doubtful = limits.doubtful.tolist()
        message.normals = [Vector3(x=x, y=y, z=z) for x, y, z in left.normals.tolist()]
        message.offsets = left.offsets.tolist()
        message.angular_acceleration = min(limits.angular_acceleration, _MOST)
        message.angular_speed = min(limits.angular_speed, _MOST_SPEED)
        message.turning_speed, message.turning_acceleration = float(base.speed), float(base.acceleration)
        if not all(value >= 0 for value in (*message.limits, message.angular_acceleration, message.angular_speed)):
            raise PoiseError(ErrorCode.INTERNAL, "the limits contradict themselves and were withheld; please report it")
        return message


def _azimuths(count: int) -> list[float]:
    return (2 * np.pi * np.arange(count) / count).tolist()


def main(args: list[str] | None = None) -> None:
    """Run the node."""
    run(AccelerationLimitsNode, args)


if __name__ == "__main__":
    main()
