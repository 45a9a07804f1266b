"""Node: how fast the base under an assembly may accelerate, published whenever the assembly or the payload changes."""

import threading
import time
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from geometry_msgs.msg import Vector3
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.serialization import serialize_message

from poise.assembly.robustness import AccelerationLimits, TurningBase
from poise.errors import ErrorCode, InputError, NoAnswerError, PoiseError
from poise.nodes.acceleration_worker import AccelerationWorker, limits_of, load_type_supports
from poise.nodes.clock import node_seconds
from poise.nodes.jobs import Jobs, run_with_jobs
from poise.nodes.parameters import WORDS, Parameter, declare_parameters
from poise.nodes.payload import GraspedPayload
from poise.nodes.runtime import LATCHED, coded, guarded, subscribe, to_message
from poise.nodes.workers import Worker, WorkerTemplate
from poise.recording import stamp_of
from poise_msgs.msg import AccelerationLimits as AccelerationLimitsMessage
from poise_msgs.msg import Assembly as AssemblyMessage
from poise_msgs.msg import InertialEstimate, ObjectIds

_MOST, _MOST_SPEED = 1e6, 1e3
"""m/s2 or rad/s2, and rad/s, above which limits are sent as these."""
_TURN_STEP, _TILT_STEP = 0.01, 0.002
"""Changes of rad/s or rad/s2, and of rad, below which nothing is published again."""
_GRACE = 1.0
"""s beyond `longest` after which limits count as late, and beyond twice `longest` after which the worker is stopped."""
_AGAIN = 10.0
"""Times what an attempt took, after which a computation that was stopped is tried again."""

ACCELERATION_LIMITS_PARAMETERS = (
    Parameter("azimuths", 72, "directions in the horizontal plane, counter-clockwise from x", (3, 10_000)),
    Parameter("rate", 10.0, "Hz at which inputs are checked for changes", (0.1, 100.0)),
    Parameter(
        "longest",
        1.0,
        "time limit of the computation, s; the limits certified by then are published",
        (0.01, 60.0),
        dynamic=True,
    ),
    Parameter(
        "longest_contacts", 30.0, "time limit for finding the contacts of an assembly, s", (0.1, 3600.0), dynamic=True
    ),
    Parameter("most_bytes", 64_000_000, "size of the largest assembly, bytes", (1000, 2_000_000_000), dynamic=True),
    Parameter("worker_memory", 4096, "MB of memory that the computation may take", (256, 1_000_000)),
    Parameter("axis", [0.0, 0.0], "x and y of the axis about which the base turns, m, in the assembly's frame"),
    Parameter("tilt", [0.0, 0.0], "roll and pitch of the base, rad: turns the assembly's gravity"),
    Parameter("turning_speed", 0.0, "angular speed of the base, rad/s", (-100.0, 100.0), dynamic=True),
    Parameter("turning_acceleration", 0.0, "angular acceleration of the base, rad/s2", (-1000.0, 1000.0), dynamic=True),
    Parameter("from_odom", False, "take tilt and turning from odom instead"),
    Parameter("odom_age", 1.0, "s without odom after which there are no limits", (0.05, 60.0), dynamic=True),
    Parameter(
        "mesh_folders", WORDS, "folders in which files named by mesh_uri may lie, besides packages' share folders"
    ),
    Parameter("payload", "", "id of the object that gets the payload of inertial_estimate; empty: none"),
    Parameter("payload_age", 5.0, "age of its newest sample up to which an estimate is used, s", (0.1, 1e6)),
    Parameter("payload_pose", [0.0] * 6 + [1.0], "pose x y z qx qy qz qw of that object in the sensor's frame"),
)


class _Inputs(NamedTuple):
    """What limits depend on.

    Args:
        assembly: number of the message.
        payload: number of the estimate.
        base: how it is tilted and turns.
    """

    assembly: int
    payload: int
    base: TurningBase


class AccelerationLimitsNode(Node):
    """Subscribes to assembly, inertial_estimate and odom; publishes acceleration_limits (latched).

    A worker process reads assemblies and computes; the executor never waits for it.

    Args:
        template: forks that process.
    """

    def __init__(self, template: WorkerTemplate) -> None:
        super().__init__("acceleration_limits")
        self._template = template
        self._values = values = declare_parameters(self, ACCELERATION_LIMITS_PARAMETERS)
        for name, count in (("axis", 2), ("tilt", 2), ("payload_pose", 7)):
            if len(values[name]) != count or not np.isfinite(values[name]).all():
                raise InputError(ErrorCode.BAD_INPUT, f"parameter {name}: expected {count} numbers")
        self._base = self._given_base
        self._odom_stamp: int | None = None
        self._odom_heard, self._odom_silent = float("-inf"), False
        settings = (list(values["mesh_folders"]), values["payload"], list(values["payload_pose"]))
        self._worker = Worker(template, settings, values["worker_memory"] * 1_000_000)
        self._payload = GraspedPayload(values["payload_age"])
        self._left_assembly = False
        self._assembly = b""
        self._assemblies = self._estimates = 0
        # While a job runs, it alone changes what follows.
        self._published: _Inputs | None = None
        self._limits: AccelerationLimits | None = None
        self._frame_id, self._level, self._gravity = "", np.zeros(3), 0.0
        self._refused, self._again = 0, float("inf")
        # The lock is held by who publishes while a job runs, and by the job for its end.
        self._lock, self._busy_since, self._said_late = threading.Lock(), None, False
        self._publisher = self.create_publisher(AccelerationLimitsMessage, "acceleration_limits", LATCHED)
        self._jobs = Jobs(self, 1)
        self.create_subscription(AssemblyMessage, "assembly", guarded(self, self._on_assembly), LATCHED, raw=True)
        if values["payload"]:
            self.create_subscription(InertialEstimate, "inertial_estimate", guarded(self, self._on_estimate), LATCHED)
        if values["from_odom"]:
            subscribe(self, Odometry, "odom", self._on_odom, 10)
        self.create_timer(1.0 / values["rate"], guarded(self, self._update))

    def destroy_node(self) -> None:
        """End the worker before the node goes."""
        if hasattr(self, "_jobs"):
            self._jobs.close()
        self._template.close()
        if hasattr(self, "_worker"):
            self._worker.stop()
        super().destroy_node()

    # -- in the executor -------------------------------------------------------------------------------------------

    def _on_assembly(self, serialized: bytes) -> None:
        self._assembly = serialized
        self._assemblies += 1

    def _on_estimate(self, message: InertialEstimate) -> None:
        if message.error.code != ErrorCode.OK:
            return
        age = (self.get_clock().now().nanoseconds - stamp_of(message)) * 1e-9
        if self._payload.take(message, age):
            self._estimates += 1

    def _on_odom(self, message: Odometry) -> None:
        stamp = stamp_of(message)
        turn = message.pose.pose.orientation
        passed = 0.0 if self._odom_stamp is None else (stamp - self._odom_stamp) * 1e-9
        self._base = self._base.after(passed, [turn.x, turn.y, turn.z, turn.w], message.twist.twist.angular.z)
        self._odom_stamp, self._odom_heard = stamp, node_seconds()

    def _update(self) -> None:
        """Publish again when something has changed enough to matter."""
        now, before = time.monotonic(), self._published
        if self._busy_since is not None:
            self._say_late(now)
            return
        if self._left_assembly:
            self._payload.left_assembly()
            self._left_assembly = False
        if self._assemblies == self._refused:
            return
        if not self._values["from_odom"]:
            self._base = self._given_base
        elif node_seconds() - self._odom_heard > self._values["odom_age"]:
            if not self._odom_silent:
                self._odom_silent, self._published = True, None
                self._publisher.publish(self._message(_no_odom(self._odom_stamp is not None)))
            return
        self._odom_silent = False
        base = self._base
        inputs = _Inputs(self._assemblies, self._estimates, base)
        if before is None or now > self._again or before[:2] != inputs[:2] or base.tilt_from(before.base) > _TILT_STEP:
            self._busy_since, self._said_late, self._again = now, False, float("inf")
            estimate = self._payload.estimate
            messages = [] if estimate is None else [serialize_message(estimate)]
            self._jobs.do(partial(self._compute, inputs, self._assembly, messages))
        elif max(abs(base.speed - before.base.speed), abs(base.acceleration - before.base.acceleration)) > _TURN_STEP:
            self._published = inputs
            self._publish(base)

    @property
    def _given_base(self) -> TurningBase:
        """As the parameters say."""
        values = self._values
        return TurningBase.tilted(*values["tilt"], values["turning_speed"], values["turning_acceleration"])

    def _say_late(self, now: float) -> None:
        """The limits of the inputs before must not stay for long."""
        with self._lock:
            since = self._busy_since
            if since is not None and not self._said_late and now - since > self._values["longest"] + _GRACE:
                self._said_late = True
                self._publisher.publish(self._message(_late()))

    # -- in the thread of the jobs ---------------------------------------------------------------------------------

    def _compute(self, inputs: _Inputs, assembly: bytes, estimate: list[bytes]) -> None:
        """Have the limits of these inputs computed, and publish them or why there are none."""
        begun, error = time.monotonic(), None
        self._limits = None
        try:
            self._limits = self._solved(inputs, assembly, estimate)
        except Exception as failure:  # of any kind: the limits before must not stay
            error = coded(failure)
            now = time.monotonic()
            if self._refused != inputs.assembly and error.code in (ErrorCode.DEADLINE, ErrorCode.INTERNAL):
                self._again = now + _AGAIN * max(now - begun, _GRACE)
        with self._lock:
            self._published, self._busy_since = inputs, None
            if self._assemblies != inputs.assembly:  # their stamp would say that they are of the new one
                self._limits, error = None, _late()
            if error is None:
                self._publish(inputs.base)
            else:
                self._publisher.publish(self._message(error))

    def _solved(self, inputs: _Inputs, assembly: bytes, estimate: list[bytes]) -> AccelerationLimits:
        values = self._values
        if len(assembly) > values["most_bytes"]:
            what = f"an assembly of {len(assembly)} bytes; this node takes {values['most_bytes']} at most (most_bytes)"
            raise InputError(ErrorCode.BAD_INPUT, what)
        if self._worker.state.get("assembly") != inputs.assembly:
            answer = self._asked({"do": "hold"}, [assembly], values["longest_contacts"])
            self._frame_id, self._left_assembly = answer.get("frame", ""), not answer.get("payload", True)
            self._refused = inputs.assembly
            _require_none(answer)
            self._refused = 0
            self._level = np.array(answer["gravity"])
            self._worker.state["assembly"] = inputs.assembly
        gravity = inputs.base.gravity(self._level)
        self._gravity = float(np.linalg.norm(gravity))
        header = {"do": "solve", "gravity": gravity.tolist(), "azimuths": values["azimuths"]}
        header |= {"longest": values["longest"], "axis": list(values["axis"])}
        answer = self._asked(header, estimate, 2 * values["longest"])
        _require_none(answer)
        return limits_of(answer["limits"])

    def _asked(self, header: dict[str, Any], messages: list[bytes], seconds: float) -> dict[str, Any]:
        due = time.monotonic() + seconds + _GRACE
        self._worker.start(due)
        return self._worker.ask(header, messages, due)[0]

    # -- in both -----------------------------------------------------------------------------------------------------

    def _publish(self, base: TurningBase) -> None:
        if self._limits is None:  # the error has been published
            return
        try:
            message = self._message(self._error(self._limits, base), self._limits, base)
        except Exception as failure:  # of any kind: the limits before must not stay
            self._limits = None
            message = self._message(coded(failure))
        self._publisher.publish(message)

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


def _no_odom(heard: bool) -> InputError:
    """How the base is tilted and turns is not known."""
    code, when = (ErrorCode.SENSOR_STALE, "any more") if heard else (ErrorCode.TOPIC_MISSING, "yet")
    what = f"no odom {when}, so that it is not known how the base is tilted and turns: start its publisher"
    return InputError(code, f"{what}, or turn from_odom off")


def _late() -> NoAnswerError:
    what = "the limits of the present assembly are still being computed; wait for them"
    return NoAnswerError(ErrorCode.DEADLINE, what)


def _require_none(answer: dict[str, Any]) -> None:
    """Raise the error of an answer of the worker, if it has one."""
    if error := answer.get("error"):
        code, message, objects = error
        raise PoiseError(ErrorCode(code), message, objects=objects)


def main(args: list[str] | None = None) -> None:
    """Run the node."""
    load_type_supports()
    template = WorkerTemplate(AccelerationWorker)
    run_with_jobs(lambda: AccelerationLimitsNode(template), args)


if __name__ == "__main__":
    main()
